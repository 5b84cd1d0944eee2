"""How large what was found is, and what these trials could have shown at least."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from granite_lab.discovery.finding import Finding, FoundEffect, FoundParameter
from granite_lab.model.effect import Effect, EffectParameter
from granite_lab.reporting import canvas
from granite_lab.reporting.canvas import Drawing
from granite_lab.reporting.discovery import rows
from granite_lab.reporting.discovery.amounts import amount, value
from granite_lab.reporting.discovery.names import listed, plain
from granite_lab.reporting.discovery.sizes import LIKELY, Share, reach, shares
from granite_lab.reporting.rounding import significant, with_unit

MARKERS: dict[str, dict[str, Any]] = {
    "noise": {"marker": "o", "linestyle": "none", "markersize": 4.5},
    "tolerance": {"marker": "o", "linestyle": "none", "markersize": 4.5, "markerfacecolor": "none"},
}
"""What limits a size, as it is drawn."""


def sizes_drawing(finding: Finding) -> Drawing | None:
    """Draw each fitted number on the range that the literature leads to expect; None without any."""
    declared = {a.effect.id: {p.name: p for p in a.effect.parameters} for a in finding.active}
    lines = [
        (e, p, declared[e.id][p.name])
        for e in finding.effects
        if not e.empirical and e.id in declared
        for p in e.parameters
    ]
    if not lines:
        return None
    names = [f"{plain(e.id)}\n{p.name.replace('_', ' ')}" for e, p, _ in lines]
    figure, (axis,) = rows.panels(names, row=0.44, head=0.3, foot=0.46)
    seen = {(d.effect, d.parameter): d.size for d in finding.detectable}
    with canvas.styled():
        for i, (e, p, own) in enumerate(lines):
            right = _line(axis, i, p, own, seen.get((e.id, p.name), math.nan))
            axis.annotate(
                value(e, p), (right, i), (6, 0), textcoords="offset points", va="center", fontsize=7.5
            )
        axis.axvline(0, color=canvas.INK, linewidth=0.7)
        axis.margins(x=0.12)
        axis.xaxis.set_major_locator(MaxNLocator(5))
        axis.set_xlabel("share of the largest value expected [%]")
        rows.legend_on_top(figure, axis, 4)
        canvas.mark_virtual(figure, finding.virtual)
    return Drawing(
        "found_sizes",
        f"The sizes of what was found{canvas.data_tag(finding.virtual)}",
        _describe(lines[0][0], [p for _, p, _ in lines]),
        "Fitted parameters with 95 % intervals on the range that the literature leads to expect, with the "
        "smallest size that these trials can show.",
        figure,
    )


def _line(axis: Axes, i: int, p: FoundParameter, own: EffectParameter, smallest: float) -> float:
    """Draw one number; return where its marks end on the right."""
    scale = 100 / reach(own)

    def at(value: float) -> float:
        return (value - (0.0 if own.shape else own.neutral)) * scale

    low, high = at(own.prior_low), at(own.prior_high)
    axis.barh(
        i, high - low, left=low, height=0.5, color=canvas.SHADE, linewidth=0,
        label=_once(axis, "expected"),
    )  # fmt: skip
    if math.isfinite(smallest) and not own.shape:
        ends = (-1, 1) if own.prior_low < own.neutral else (1,)
        axis.plot(
            [sign * smallest * abs(scale) for sign in ends], [i] * len(ends), "|", color=canvas.INK,
            markersize=11, label=_once(axis, "smallest seen"),
        )  # fmt: skip
    if p.per_trial:
        axis.plot(
            [at(v) for v in p.per_trial], [i] * len(p.per_trial), ".", color=canvas.GREY, markersize=4,
            label=_once(axis, "a trial"),
        )  # fmt: skip
    half = LIKELY * p.estimate.std * abs(scale)
    half = half if math.isfinite(half) else 0.0
    axis.errorbar(
        at(p.estimate.value), i, xerr=half, color=rows.AFTER, marker="D",
        markersize=4.5, capsize=3, linestyle="none", label=_once(axis, "found, 95 %"),
    )  # fmt: skip
    return max([at(p.estimate.value) + half, *map(at, p.per_trial)])


def _once(axis: Axes, label: str) -> str | None:
    return None if label in axis.get_legend_handles_labels()[1] else label


def _describe(effect: FoundEffect, parameters: list[FoundParameter]) -> str:
    first = parameters[0]
    text = amount(effect, first)
    return (
        f"Green is what was found with its 95 % interval ({plain(effect.id)}: "
        f"{first.name.replace('_', ' ')} {text}), grey the range that the literature leads to expect, "
        "the black stroke the smallest size that these trials show."
    )


def detectable_drawing(finding: Finding, known: Mapping[str, Effect]) -> Drawing | None:
    """Draw the smallest size of each candidate that these trials show, over what is expected of it.

    Args:
        finding: the record.
        known: candidates by id; of those that are not there nothing is known to compare with.
    """
    smallest = shares(finding, known)
    if not smallest:
        return None
    ranked = sorted(smallest, key=lambda i: smallest[i].low)
    finite = [v for s in smallest.values() for v in (s.low, s.high) if math.isfinite(v) and v > 0]
    figure, (axis,) = rows.panels([plain(i) for i in ranked], row=0.165, head=0.45)
    named = {e.id for e in finding.effects}
    with canvas.styled():
        low, high = 0.7 * min([*finite, 50.0]), 1.4 * max([*finite, 200.0])
        for k, id_ in enumerate(ranked):
            colour, own = rows.AFTER if id_ in named else canvas.MEASURED, smallest[id_]
            if not math.isfinite(own.low):
                axis.text(low, k, "  cannot be seen", ha="left", va="center", fontsize=7)
                continue
            if math.isfinite(own.high) and own.high > own.low:
                axis.plot([own.low, own.high], [k, k], color=colour, linewidth=1.2)
            axis.plot(own.low, k, color=colour, **MARKERS[own.limit])
            if id_ in named:
                axis.get_yticklabels()[k].set_fontweight("bold")
        axis.axvline(
            100, color=canvas.INK, linewidth=1.0, linestyle=(0, (4, 1.5)), label="largest value expected"
        )
        for limit, marker in MARKERS.items():
            axis.plot([], [], color=canvas.MEASURED, label=f"limited by {limit}", **marker)
        rows.log_axis(axis, low, high)
        axis.set_xlabel("smallest size seen, over the largest expected [%]")
        rows.legend_on_top(figure, axis, 2)
        canvas.mark_virtual(figure, finding.virtual)
    return Drawing(
        "found_detectable",
        f"What these trials could show of each candidate{canvas.data_tag(finding.virtual)}",
        _describe_detectable(ranked, smallest),
        "Smallest size of each candidate effect that these trials show, over the largest that the literature "
        "leads to expect.",
        figure,
    )


def _describe_detectable(ranked: list[str], smallest: dict[str, Share]) -> str:
    seen = [i for i in ranked if math.isfinite(smallest[i].low)]
    text = "Further left is seen more easily; right of the dashed line even the largest expected is not."
    if seen:
        first, last = (with_unit(significant(smallest[seen[k]].low, 2), "%") for k in (0, -1))
        text += (
            f" An effect is named four times out of five at this size, from {plain(seen[0])} ({first}) to "
            f"{plain(seen[-1])} ({last})."
        )
    beyond = [plain(i) for i in ranked if smallest[i].low > 100]
    return f"{text} These trials cannot show {listed(beyond)}." if beyond else text
