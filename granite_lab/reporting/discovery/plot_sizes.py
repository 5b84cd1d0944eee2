"""How small each candidate may be and still be named."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from granite_lab.discovery.finding import Finding
from granite_lab.model.effect import Effect
from granite_lab.reporting import canvas
from granite_lab.reporting.discovery import rows
from granite_lab.reporting.discovery.names import brief, listed, plain
from granite_lab.reporting.discovery.sizes import Share, shares
from granite_lab.reporting.figures import Figure
from granite_lab.reporting.rounding import significant, with_unit

MARKERS: dict[str, dict[str, Any]] = {
    "noise": {"marker": "o", "linestyle": "none", "markersize": 4.5},
    "tolerance": {"marker": "o", "linestyle": "none", "markersize": 4.5, "markerfacecolor": "none"},
}
"""What limits a size, as it is drawn."""


def detectable_drawing(finding: Finding, known: Mapping[str, Effect]) -> Figure | None:
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
    figure, (axis,) = rows.panels([brief(i) for i in ranked], row=0.165, head=0.45)
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
    return Figure(
        "found_detectable",
        f"What these trials could show of each candidate{canvas.data_tag(finding.virtual)}",
        _describe_detectable(ranked, smallest),
        "Smallest size of each candidate effect that these trials show, over the largest that the literature "
        "leads to expect.",
        lambda: figure,
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
