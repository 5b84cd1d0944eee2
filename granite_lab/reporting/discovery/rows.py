"""Figures with one named row per channel, candidate or trial."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from granite_lab.reporting import canvas

LEFT, RIGHT, GAP = 1.66, 0.14, 0.16
"""Room for the names of the rows, to the right, and between panels [in]."""

ROW = 0.185
"""Height of a row [in]."""

FOOT = 0.46
"""Room for the x axis [in]."""

BEFORE, AFTER = canvas.SIMULATED, canvas.FITTED
"""The model without and with what was found; measured stays blue."""


def panels(
    names: Sequence[str],
    *,
    columns: int = 1,
    row: float = ROW,
    left: float = LEFT,
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
    wide = (canvas.WIDTH - left - RIGHT - GAP * (columns - 1)) / columns
    with canvas.styled():
        figure = Figure(figsize=(canvas.WIDTH, height))
        axes: list[Axes] = []
        for k in range(columns):
            x = left + k * (wide + GAP)
            box = (x / canvas.WIDTH, foot / height, wide / canvas.WIDTH, tall / height)
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
        bbox_to_anchor=(left / canvas.WIDTH, 1 - 0.05 / figure_height), bbox_transform=figure.transFigure,
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
    wide = canvas.WIDTH - LEFT - RIGHT
    bar = figure.add_axes((LEFT / canvas.WIDTH, 0.4 / height, wide / canvas.WIDTH, 0.09 / height))
    shown = mpl.cm.ScalarMappable(image.norm, image.cmap)
    scale = figure.colorbar(shown, cax=bar, orientation="horizontal", ticks=ticks)
    if names:
        scale.ax.set_xticklabels(names)
    scale.ax.minorticks_off()
    assert scale.solids is not None
    scale.solids.set(rasterized=False, edgecolor="face", linewidth=0.3)  # no image inside the SVG
    scale.set_label(label, fontsize=8)
    scale.outline.set_linewidth(0.4)


def times(value: float) -> str:
    """Return a tick of a logarithmic axis as a plain number where it is short."""
    return f"{value:g}" if 0.01 <= value < 10_000 else f"10{_superscript(value)}"


def _superscript(value: float) -> str:
    exponent = len(f"{value:.0f}") - 1 if value >= 1 else -len(f"{1 / value:.0f}") + 1
    return str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def log_axis(axis: Axes, low: float, high: float) -> None:
    """Make the x axis logarithmic with plain numbers, about four of them."""
    from matplotlib.ticker import FixedLocator, NullLocator  # noqa: PLC0415

    axis.set_xscale("log")
    axis.set_xlim(low, high)
    steps = [m * 10.0**e for e in range(-12, 13) for m in (1, 2, 5)]
    inside = [s for s in steps if low <= s * (1 + 1e-9) and s <= high * (1 + 1e-9)]
    decades = [s for s in inside if f"{s:e}".startswith("1.0")]
    shown = inside if len(inside) <= 4 else decades
    shown = shown[:: max(1, -(-len(shown) // 5))]
    axis.xaxis.set_major_locator(FixedLocator(shown))
    axis.xaxis.set_minor_locator(NullLocator())
    axis.set_xticks(shown, [times(s) for s in shown])
