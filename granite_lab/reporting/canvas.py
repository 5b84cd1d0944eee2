"""Figures: one palette with fixed meanings, panels sized in inches; the same input gives the same bytes."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from markupsafe import Markup, escape
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Plain
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Transform, blended_transform_factory

from granite_lab.logs.trial import Array

# Okabe and Ito's palette, safe for all common kinds of colour blindness. Blue tones are always
# measured, orange tones simulated, the light tone of each the rear axle or the wheels.
MEASURED, MEASURED_LIGHT = "#0072b2", "#56b4e9"
SIMULATED, SIMULATED_LIGHT = "#d55e00", "#e69f00"
FITTED, PAPER, DESIRED = "#009e73", "#cc79a7", "#555555"
INK, FAINT, GREY, SHADE, GROUND = "#000000", "#b0b0b0", "#8a8a8a", "#ededed", "#ffffff"
BEFORE, AFTER = SIMULATED, FITTED
"""The model without and with the effects found; measured stays blue."""

THEMED = {
    MEASURED: "measured", MEASURED_LIGHT: "measured-light", SIMULATED: "simulated",
    SIMULATED_LIGHT: "simulated-light", FITTED: "fitted", PAPER: "paper", DESIRED: "desired", INK: "ink",
    FAINT: "faint", GREY: "grey", SHADE: "shade", GROUND: "ground",
}  # fmt: skip
"""Colours that a page may replace by its own variable of that name, for dark mode."""

WIDTH = 4.8  # [in]; a figure then reads at the width of a phone and in half a page
LEFT, RIGHT, HEAD, FOOT = 0.78, 0.14, 0.3, 0.48  # margins; the head holds a legend of one row [in]
NAMES, ROW = 1.66, 0.185  # room for the names of rows, and height of a row [in]
GAP, BETWEEN = 0.3, 0.16  # between panels above and beside each other [in]

DPI = 300
"""Resolution of a PNG, as journals ask for it."""

TIME = "time since the start of the command [s]"

NOTEBOOK_DPI = 110
"""Resolution of a figure in a notebook."""


class Canvas(Plain):
    """A Matplotlib figure that a notebook shows without a backend of its own."""

    def _repr_png_(self) -> bytes:
        return saved(self, "png", NOTEBOOK_DPI)


STYLE = Path(__file__).parent / "templates" / "figure.mplstyle"


def styled() -> AbstractContextManager[None]:
    """Return a context in which figures have the report's style, whatever the user's matplotlibrc says."""
    return style.context(STYLE)


@dataclass(frozen=True, eq=False)
class Figure:
    """A figure of a report.

    Attributes:
        name: stem of its files.
        title: the answer that it gives, or the quantity that it shows, on one line.
        caption: what is drawn and how to read it.
        make: makes it; called once per use, so that only one figure need be in memory at a time.
        virtual: its data were written by a simulator; `heading` and the drawing itself then say so.
        lines: address of its lines on the page to zoom into; empty where they are not there.
    """

    name: str
    title: str
    caption: str
    make: Callable[[], Plain]
    virtual: bool = False
    lines: str = ""

    @property
    def heading(self) -> str:
        """The title, with "(virtual data)" behind it where that is so."""
        return f"{self.title} (virtual data)" if self.virtual else self.title

    def draw(self) -> Plain:
        """Return the figure in the report's style, marked in its lower left corner if data are virtual."""
        with styled():
            figure = self.make()
            mark_virtual(figure, self.virtual)
        return figure


def mark_virtual(figure: Plain, virtual: bool) -> None:
    """Write on the figure itself, in its lower left corner, that its data come from a simulator."""
    if virtual:
        figure.text(
            0.06, 0.06, "virtual\ndata", transform=figure.dpi_scale_trans, ha="left", va="bottom",
            fontsize=7.5, style="italic", color=DESIRED, linespacing=1.0,
        )  # fmt: skip


class Frame(NamedTuple):
    """Lengths around the panels of a figure [in].

    Attributes:
        left, head: margins.
        gap: between rows, with room for a legend.
        width: of the figure.
        label: place of the labels of the y axes, from the left edge of the figure.
    """

    left: float = LEFT
    head: float = HEAD
    gap: float = GAP
    width: float = WIDTH
    label: float = 0.16


FRAME = Frame()


def panels(
    heights: Sequence[float], columns: int = 1, frame: Frame = FRAME, *, y: Sequence[str] = (), x: str = ""
) -> tuple[Canvas, list[Axes]]:
    """Return a figure and its panels, row by row; a column shares the x axis, a row the y axis.

    Args:
        heights: of the rows [in].
        columns: of panels.
        frame: lengths around them.
        y, x: labels of the rows and of the lowest panel.
    """
    left, head, gap, width, label = frame
    tall = head + sum(heights) + gap * (len(heights) - 1) + FOOT
    wide = (width - left - RIGHT - BETWEEN * (columns - 1)) / columns
    figure = Canvas(figsize=(width, tall))
    fractions = {
        "left": left / width, "right": 1 - RIGHT / width, "top": 1 - head / tall, "bottom": FOOT / tall,
        "hspace": gap * len(heights) / sum(heights), "wspace": BETWEEN / wide,
    }  # fmt: skip
    grid = figure.subplots(
        len(heights), columns, sharex="col", sharey="row", squeeze=False, height_ratios=heights,
        gridspec_kw=fractions,
    )  # fmt: skip
    for axis in grid[:, 0]:
        axis.yaxis.set_label_coords(label, 0.5, transform=_inches_along(axis))
    for axis, text in zip(grid[:, 0], y, strict=False):
        axis.set_ylabel(text)
        axis.yaxis.set_major_locator(MaxNLocator(5))
    grid[-1, 0].set_xlabel(x)
    return figure, list(grid.flat)


def _inches_along(axis: Axes) -> Transform:
    """Return coordinates: x in inches from the left edge of the figure, y from 0 to 1 in the panel."""
    figure = axis.get_figure(root=True)
    assert figure is not None
    return blended_transform_factory(figure.dpi_scale_trans, axis.transAxes)


def name_rows(axis: Axes, names: Sequence[str], size: float = 7.5) -> None:
    """Give a panel one named row at each whole number, the first row on top."""
    axis.set_ylim(len(names) - 0.5, -0.5)
    axis.set_yticks(range(len(names)), names, fontsize=size, parse_math=False)
    axis.tick_params(axis="y", length=0)
    axis.grid(visible=False, axis="y")


def named_rows(
    names: Sequence[str], columns: int = 1, *, row: float = ROW, left: float = NAMES
) -> tuple[Canvas, list[Axes]]:
    """Return a figure with panels beside each other that share named rows; lengths as in `panels`."""
    figure, axes = panels([row * len(names)], columns, Frame(left))
    for axis in axes:
        name_rows(axis, names)
    return figure, axes


def legend(axis: Axes, columns: int = 3, *, left: float = LEFT - 0.08, points: float = 1.0) -> None:
    """Put the legend of a panel above it, from `left` [in] of the figure on; its points times `points`."""
    handles, labels = axis.get_legend_handles_labels()
    if handles:
        axis.legend(
            handles, labels, loc="lower left", ncols=columns, bbox_to_anchor=(left, 1.0),
            bbox_transform=_inches_along(axis), markerscale=points,
        )  # fmt: skip


def band(axis: Axes, t: Array, value: Array, std: Array, label: str) -> None:
    """Draw a measured line with its band of ±2σ."""
    axis.fill_between(t, value - 2 * std, value + 2 * std, color=MEASURED, alpha=0.25, linewidth=0)
    axis.plot(t, value, color=MEASURED, label=f"{label} ±2σ")


def key(axis: Axes, text: str) -> None:
    """Write above the right end of a panel what its lines are."""
    axis.text(1, 1.02, text, transform=axis.transAxes, ha="right", va="bottom", fontsize=7.5)


def envelope(t: Array, *values: Array, points: int = 700) -> tuple[Array, ...]:
    """Thin (N,) traces at instants t for drawing, to about so many points.

    Kept are the smallest and the largest sample of the first trace in each bin; NaN stays where a bin has
    nothing else.
    """
    index = extremes(values[:1], points)
    return (t[index], *(v[index] for v in values))


def extremes(lines: Sequence[Array], points: int) -> npt.NDArray[np.intp]:
    """Return positions of the smallest and the largest sample of each of some (N,) lines in each bin.

    Bins are such that about `points` positions are returned; all where there are no more.
    """
    n = len(lines[0])
    if n <= points:
        return np.arange(n)
    size = -(-n // max(1, points // (2 * len(lines))))
    bins = -(-n // size)
    starts, kept = np.arange(bins) * size, [np.array([0, n - 1])]
    for line in lines:
        filled = np.full(bins * size, np.nan)
        filled[:n] = line
        blocks = filled.reshape(bins, size)
        kept.append(starts + np.where(np.isnan(blocks), np.inf, blocks).argmin(axis=1))
        kept.append(starts + np.where(np.isnan(blocks), -np.inf, blocks).argmax(axis=1))
    return np.unique(np.concatenate(kept))


FORMATS = ("svg", "png", "pdf")
"""Formats of figures."""

_NO_DATE = {"Date": None, "Creator": None, "Format": None, "Type": None}  # they would change the bytes
_TAG, _NUMBER = re.compile(r"<[^>]+>"), re.compile(r"-?\d+\.\d{3,}")
_ALONE = b'#set page(width: auto, height: auto, margin: 0pt)\n#image("figure.svg")'


def saved(figure: Plain, kind: str, dpi: int = 150) -> bytes:
    """Return a figure as "svg", "png" or "pdf": the same bytes for the same figure."""
    return converted(drawn(figure), kind, dpi)


def drawn(figure: Plain) -> bytes:
    """Return a figure as SVG, with text as text and coordinates to 0.01 pt."""
    buffer = io.BytesIO()
    with styled():
        figure.savefig(buffer, format="svg", metadata=_NO_DATE)

    def short(number: re.Match[str]) -> str:
        return f"{float(number[0]):.2f}".rstrip("0").rstrip(".")

    text = _TAG.sub(lambda tag: _NUMBER.sub(short, tag[0]), buffer.getvalue().decode())
    return text.replace("'DejaVu Sans'", "'DejaVu Sans', Verdana, sans-serif").encode()


def converted(svg: bytes, kind: str, dpi: int) -> bytes:
    """Return a figure that is drawn in another format, which is ten times faster than to draw it again."""
    return svg if kind == "svg" else typeset(_ALONE, {"figure.svg": svg}, kind, dpi)


def typeset(source: bytes, files: Mapping[str, bytes], kind: str, dpi: int = DPI, **inputs: str) -> bytes:
    """Return a Typst document as "png" or "pdf", with the files and the ``sys.inputs`` that it names."""
    import typst  # noqa: PLC0415, only where something is written

    given: Any = {"main.typ": source, **files}
    options: Any = {"format": kind, "ppi": dpi, "sys_inputs": inputs}
    return bytes(typst.compile(given, font_paths=_fonts(), timestamp=0, **options))


@cache
def _fonts() -> Any:
    """Return the fonts of matplotlib alone, so that a figure looks alike on any machine."""
    import typst  # noqa: PLC0415, only where something is written

    places = [str(Path(mpl.get_data_path()) / "fonts" / "ttf")]
    return typst.Fonts(include_system_fonts=False, include_embedded_fonts=False, font_paths=places)


def on_page(figure: Figure, svg: str) -> Markup:
    """Return a figure as an element of a page: its ids are unique there, its colours follow the theme."""
    label, head = escape(f"{figure.title}. {figure.caption}"), svg[svg.index("<svg") :]
    size = re.search(r'width="([\d.]+)pt" height="([\d.]+)pt"', head)
    assert size is not None
    body = re.sub(r"<metadata>.*?</metadata>\s*", "", head.partition(">")[2].strip(), flags=re.S)
    used = set(re.findall(r'(?:href="|url\()#([^")]*)', body))
    body = re.sub(r' id="([^"]*)"', lambda m: f' id="{figure.name}-{m[1]}"' if m[1] in used else "", body)
    body = re.sub(r'(href="|url\()#', rf"\1#{figure.name}-", body)
    body = re.sub(
        "#[0-9a-f]{6}", lambda m: f"var(--{THEMED[m[0]]}, {m[0]})" if m[0] in THEMED else m[0], body
    )
    box = 'viewBox="0 0 {0} {1}" width="{0}" height="{1}" role="img" aria-label="{2}"'.format(
        *size.groups(), label
    )
    return Markup(f"<svg {box}>{body}")
