"""Figures without global state: one size, one palette with fixed meaning, the same bytes each time."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

from granite_lab.logs.trial import Array

# Okabe and Ito's palette, safe for all common kinds of colour blindness. Blue tones are always
# measured, orange tones simulated, the light tone of each the rear axle or the wheels.
MEASURED = "#0072b2"
MEASURED_LIGHT = "#56b4e9"
SIMULATED = "#d55e00"
SIMULATED_LIGHT = "#e69f00"
FITTED = "#009e73"
PAPER = "#cc79a7"
DESIRED = "#555555"
INK = "#000000"
FAINT = "#b0b0b0"
GREY = "#8a8a8a"
SHADE = "#ededed"
GROUND = "#ffffff"

THEMED = {
    MEASURED: "measured",
    MEASURED_LIGHT: "measured-light",
    SIMULATED: "simulated",
    SIMULATED_LIGHT: "simulated-light",
    FITTED: "fitted",
    PAPER: "paper",
    DESIRED: "desired",
    INK: "ink",
    FAINT: "faint",
    GREY: "grey",
    SHADE: "shade",
    GROUND: "ground",
}
"""Colours that a page may replace by its own variable of that name, for dark mode."""

RC = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.0,
    "axes.labelsize": 9.0,
    "axes.titlesize": 9.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "axes.edgecolor": INK,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.unicode_minus": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.4,
    "lines.linewidth": 1.2,
    "path.simplify": True,
    "svg.fonttype": "none",
    "svg.hashsalt": "granite-lab",
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}


def styled() -> AbstractContextManager[None]:
    """Return a context in which figures are made with `RC`, whatever the user's matplotlibrc says."""
    settings: Any = RC
    return mpl.rc_context(settings)


def embedded_fonts() -> AbstractContextManager[None]:
    """Return a context in which a PDF holds whole TrueType fonts, so that its text can be searched."""
    settings: Any = {"pdf.fonttype": 42}
    return mpl.rc_context(settings)


WIDTH = 4.8  # [in]; a figure then reads at the width of a phone and in half a page
LEFT, RIGHT = 0.78, 0.14  # margins [in]
XLABEL = 0.48  # room below the lowest panel [in]
HEAD = 0.08  # room above the highest legend [in]
LEGEND_ROW = 0.165  # height of one row of a legend [in]


def stacked(
    heights: list[float], legend_rows: list[int], width: float = WIDTH, gap: float = 0.12
) -> tuple[Figure, list[Axes]]:
    """Return a figure with panels above each other that share the x axis, legends between them.

    Args:
        heights: of the panels [in].
        legend_rows: rows of the legend above each panel.
        width: of the figure [in].
        gap: between a panel and the legend of the next one [in].
    """
    total = (
        HEAD
        + XLABEL
        + sum(heights)
        + LEGEND_ROW * sum(legend_rows)
        + gap * (len(heights) - 1)
        + 0.04 * len(heights)
    )
    with styled():
        figure = Figure(figsize=(width, total))
        axes: list[Axes] = []
        top = total - HEAD
        for height, rows in zip(heights, legend_rows, strict=True):
            top -= LEGEND_ROW * rows + 0.04
            box = (LEFT / width, (top - height) / total, (width - LEFT - RIGHT) / width, height / total)
            axes.append(figure.add_axes(box, sharex=axes[0] if axes else None))
            top -= height + gap
        for axis in axes[:-1]:
            axis.tick_params(labelbottom=False)
    return figure, axes


def legend_above(axis: Axes, columns: int = 3) -> None:
    """Put the legend of a panel above it, where it covers nothing."""
    handles, labels = axis.get_legend_handles_labels()
    if handles:
        axis.legend(
            handles, labels, loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=columns, frameon=False,
            borderaxespad=0.1, borderpad=0.1, handlelength=1.5, handletextpad=0.5, columnspacing=0.9,
            labelspacing=0.2,
        )  # fmt: skip


def align_labels(axes: list[Axes]) -> None:
    """Put the labels of the y axes on one vertical line."""
    for axis in axes:
        figure = axis.get_figure(root=True)
        assert figure is not None
        wide = axis.get_position().width * figure.get_size_inches()[0]
        axis.yaxis.set_label_coords(-(LEFT - 0.16) / wide, 0.5)


def mark_virtual(figure: Figure, virtual: bool) -> None:
    """Write on the figure itself, in its lower left corner, that its data come from a simulator."""
    if virtual:
        width, height = figure.get_size_inches()
        figure.text(0.06 / width, 0.06 / height, "virtual\ndata", ha="left", va="bottom", fontsize=7.5,
                    style="italic", color=DESIRED, linespacing=1.0)  # fmt: skip


NAMES, BETWEEN = 1.66, 0.16
"""Room for the names of rows, and between panels beside each other [in]."""

ROW = 0.185
"""Height of a named row [in]."""

FOOT = 0.46
"""Room for the x axis below named rows [in]."""

BEFORE, AFTER = SIMULATED, FITTED
"""The model without and with the effects found; measured stays blue."""


def named_rows(
    names: Sequence[str],
    *,
    columns: int = 1,
    row: float = ROW,
    left: float = NAMES,
    head: float = 0.08,
    foot: float = FOOT,
) -> tuple[Figure, list[Axes]]:
    """Return a figure with panels beside each other that share named rows, the first row on top.

    Args:
        names: of the rows.
        columns: number of panels.
        row: height of a row [in].
        left: room for the names [in].
        head: room above the panels, for a legend [in].
        foot: room below them [in].
    """
    tall = row * len(names)
    height = head + tall + foot
    wide = (WIDTH - left - RIGHT - BETWEEN * (columns - 1)) / columns
    with styled():
        figure = Figure(figsize=(WIDTH, height))
        axes: list[Axes] = []
        for k in range(columns):
            x = left + k * (wide + BETWEEN)
            box = (x / WIDTH, foot / height, wide / WIDTH, tall / height)
            axis = figure.add_axes(box, sharey=axes[0] if axes else None)
            axis.set_ylim(len(names) - 0.5, -0.5)
            axis.set_yticks(range(len(names)), names)
            axis.tick_params(axis="y", length=0, labelleft=k == 0, labelsize=7.5)
            for label in axis.get_yticklabels():
                label.set_parse_math(False)  # a name may hold dollar signs
            axis.grid(visible=False, axis="y")
            axes.append(axis)
    return figure, axes


def legend_on_top(figure: Figure, axis: Axes, columns: int = 3, left: float = 0.06) -> None:
    """Put the legend of a panel along the upper edge of the figure, from its left side on."""
    handles, labels = axis.get_legend_handles_labels()
    figure_height = figure.get_size_inches()[1]
    legend = axis.legend(
        handles, labels, loc="upper left", ncols=columns, frameon=False, borderaxespad=0, borderpad=0.1,
        handlelength=1.4, handletextpad=0.5, columnspacing=0.9, labelspacing=0.25,
        bbox_to_anchor=(left / WIDTH, 1 - 0.05 / figure_height), bbox_transform=figure.transFigure,
    )  # fmt: skip
    legend.set_in_layout(False)


def colour_bar(
    figure: Figure, image: Any, label: str, ticks: Sequence[float] | None = None, names: Sequence[str] = ()
) -> None:
    """Put the scale of a picture's colours along the lower edge of the figure.

    Args:
        figure: with room for it.
        image: with colours and their norm.
        label: of the scale, with its unit.
        ticks: where numbers stand.
        names: what they say.
    """
    height = figure.get_size_inches()[1]
    wide = WIDTH - NAMES - RIGHT
    bar = figure.add_axes((NAMES / WIDTH, 0.4 / height, wide / WIDTH, 0.09 / height))
    shown = mpl.cm.ScalarMappable(image.norm, image.cmap)
    scale = figure.colorbar(shown, cax=bar, orientation="horizontal", ticks=ticks)
    if names:
        scale.ax.set_xticklabels(names)
    scale.ax.minorticks_off()
    assert scale.solids is not None
    scale.solids.set(rasterized=False, edgecolor="face", linewidth=0.3)  # no image inside the SVG
    scale.set_label(label, fontsize=8)
    scale.outline.set_linewidth(0.4)


def _tick(value: float) -> str:
    """Return a tick of a logarithmic axis as a plain number where it is short."""
    return f"{value:g}" if 0.01 <= value < 10_000 else f"10{_superscript(value)}"


def _superscript(value: float) -> str:
    exponent = len(f"{value:.0f}") - 1 if value >= 1 else -len(f"{1 / value:.0f}") + 1
    return str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def log_axis(axis: Axes, low: float, high: float) -> None:
    """Make the x axis logarithmic with plain numbers, about four of them."""
    axis.set_xscale("log")
    axis.set_xlim(low, high)
    steps = [m * 10.0**e for e in range(-12, 13) for m in (1, 2, 5)]
    inside = [s for s in steps if low <= s * (1 + 1e-9) and s <= high * (1 + 1e-9)]
    decades = [s for s in inside if f"{s:e}".startswith("1.0")]
    shown = inside if len(inside) <= 4 else decades
    shown = shown[:: max(1, -(-len(shown) // 5))]
    axis.xaxis.set_major_locator(FixedLocator(shown))
    axis.xaxis.set_minor_locator(NullLocator())
    axis.set_xticks(shown, [_tick(s) for s in shown])


def envelope(t: Array, *values: Array, points: int = 700) -> tuple[Array, ...]:
    """Thin traces for drawing: keep the smallest and the largest sample of the first in each bin.

    Args:
        t: (N,) instants.
        *values: (N,) traces; all are thinned at the same samples, NaN stays where a bin has nothing else.
        points: about how many samples remain.
    """
    n = len(t)
    if n <= points:
        return (t, *values)
    size = -(-n // (points // 2))
    bins = -(-n // size)
    first = np.full(bins * size, np.nan)
    first[:n] = values[0]
    blocks, starts = first.reshape(bins, size), np.arange(bins) * size
    lowest = starts + np.where(np.isnan(blocks), np.inf, blocks).argmin(axis=1)
    highest = starts + np.where(np.isnan(blocks), -np.inf, blocks).argmax(axis=1)
    index = np.unique(np.concatenate([[0, n - 1], lowest, highest]))
    return (t[index], *(v[index] for v in values))


_TAG = re.compile(r"<[^>]+>")
_NUMBER = re.compile(r"-?\d+\.\d{3,}")
_STYLE_COLOUR = re.compile(r"#[0-9a-f]{6}")


def _shorter(number: re.Match[str]) -> str:
    return f"{float(number[0]):.2f}".rstrip("0").rstrip(".")


def to_svg(figure: Figure) -> str:
    """Return the figure as SVG text: the same bytes for the same figure, coordinates to 0.01 pt."""
    buffer = io.StringIO()
    with styled():
        canvas: Any = FigureCanvasSVG(figure)
        canvas.print_svg(buffer, metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = buffer.getvalue()
    text = _TAG.sub(lambda tag: _NUMBER.sub(_shorter, tag[0]), text)
    return text.replace("'DejaVu Sans'", "'DejaVu Sans', Verdana, sans-serif")


def to_png(figure: Figure, dpi: int = 150) -> bytes:
    """Return the figure as PNG, without a date in it."""
    buffer = io.BytesIO()
    figure.set_dpi(dpi)
    with styled():
        canvas: Any = FigureCanvasAgg(figure)
        canvas.print_png(buffer, metadata={"Software": None}, pil_kwargs={"optimize": False})
        return buffer.getvalue()


def to_pdf(figure: Figure) -> bytes:
    """Return the figure as PDF, without a date in it."""
    buffer = io.BytesIO()
    with styled():
        canvas: Any = FigureCanvasPdf(figure)
        canvas.print_pdf(buffer, metadata={"CreationDate": None, "Producer": None, "Creator": None})
    return buffer.getvalue()


def inline_svg(svg: str, drawing_id: str, label: str) -> str:
    """Turn an SVG file into an element of a page.

    Its ids become unique, its colours follow the page's theme, its size the page's width, and
    it carries a title for screen readers.

    Args:
        svg: text of `to_svg`.
        drawing_id: unique in the page.
        label: escaped text for screen readers.
    """
    body = svg[svg.index("<svg") :].strip()
    body = re.sub(r"<metadata>.*?</metadata>\s*", "", body, flags=re.S)
    used = set(re.findall(r'(?:href="|url\()#([^")]*)', body))
    body = re.sub(r' id="([^"]*)"', lambda m: f' id="{drawing_id}-{m[1]}"' if m[1] in used else "", body)
    body = re.sub(r'(xlink:href|href)="#([^"]*)"', rf'href="#{drawing_id}-\2"', body)
    body = re.sub(r"url\(#([^)]*)\)", rf"url(#{drawing_id}-\1)", body)
    body = _STYLE_COLOUR.sub(lambda m: f"var(--{THEMED[m[0]]}, {m[0]})" if m[0] in THEMED else m[0], body)
    head, rest = body.split(">", 1)
    box = re.search(r'viewBox="[^"]*"', head)
    assert box is not None
    width, height = svg_size(head)
    head = f'<svg {box[0]} width="{width}" height="{height}" role="img" aria-label="{label}"'
    return f"{head}>{rest}"


def svg_size(svg: str) -> tuple[str, str]:
    """Return width and height of a figure [pt], as text, from its `to_svg`."""
    size = re.search(r'width="([\d.]+)pt" height="([\d.]+)pt"', svg)
    assert size is not None
    return size[1], size[2]
