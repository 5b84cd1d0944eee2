"""Which candidate explains the disagreement, and which of them look alike."""

from __future__ import annotations

import math

import numpy as np

from granite_lab.discovery.finding import Finding
from granite_lab.reporting import canvas
from granite_lab.reporting.discovery import rows
from granite_lab.reporting.discovery.answers import percent
from granite_lab.reporting.discovery.names import STATUS, brief, capital, plain, shown_candidates
from granite_lab.reporting.figures import Figure

MARKERS = {"named": "o", "twin": "s", "small": "v", "less likely": "D", "screened": ".", "at a bound": "x"}


def candidates_drawing(finding: Finding) -> Figure | None:
    """Draw the probability of each candidate and the share of the gap that it closes; None without any."""
    found = shown_candidates(finding)
    if not found:
        return None
    figure, (left, right) = rows.panels([brief(c.id) for c in found], columns=2, row=0.165, head=0.45)
    with canvas.styled():
        for status, marker in MARKERS.items():
            own = [(i, c) for i, c in enumerate(found) if c.status == status]
            if not own:
                continue
            y, colour = [i for i, _ in own], canvas.FITTED if status == "named" else canvas.GREY
            for axis, x in (
                (left, [100 * c.probability for _, c in own]),
                (right, [100 * c.closes for _, c in own]),
            ):
                axis.plot(
                    x, y, linestyle="none", marker=marker, markersize=5, color=colour, label=STATUS[status],
                    clip_on=False,
                )  # fmt: skip
            if status == "named":
                for i in y:
                    left.get_yticklabels()[i].set_fontweight("bold")
        left.set_xlim(-8, 105)
        left.set_xlabel("probability [%]")
        closes = [100 * c.closes for c in found if math.isfinite(c.closes)]
        right.set_xlim(min([-8.0, *closes]) - 2, max([100.0, *closes]) + 5)
        right.set_xlabel("closes alone [%]")
        rows.legend_on_top(figure, left, 3)
        canvas.mark_virtual(figure, finding.virtual)
    return Figure(
        "found_candidates",
        f"How likely each candidate is, and what it closes{canvas.data_tag(finding.virtual)}",
        _describe(finding),
        "Posterior probability of each candidate effect, and the share of the gap that it closes alone.",
        lambda: figure,
    )


def _describe(finding: Finding) -> str:
    best, *rest = sorted(finding.candidates, key=lambda c: -c.probability)
    closes = f" and closes {percent(best.closes)} of the gap" if math.isfinite(best.closes) else ""
    text = (
        f"{capital(plain(best.id))} is in the model with a probability of {percent(best.probability)}{closes}"
    )
    if rest:
        text += f"; next comes {plain(rest[0].id)} with {percent(rest[0].probability)}"
    return f"{text}. Without a dot on the right: looked at by the screen only."


def confusion_drawing(finding: Finding) -> Figure | None:
    """Draw how alike the candidates' signatures are on these trials; None without any."""
    check = finding.confusion
    if check is None or len(check.ids) < 2:
        return None
    ids, named = check.ids, {e.id for e in finding.effects}
    names = [brief(i) for i in ids]
    values = np.abs(check.cosines)
    figure, (axis,) = rows.panels(names, row=0.138, head=0.08, foot=2.0)
    with canvas.styled():
        edges = np.arange(len(ids) + 1) - 0.5
        image = axis.pcolormesh(
            edges, edges, values, cmap="cividis", vmin=0, vmax=1, edgecolors="white", linewidth=0.3
        )
        axis.set_xticks(range(len(ids)), names, rotation=90, fontsize=6.5)
        axis.tick_params(axis="both", length=0)
        axis.tick_params(axis="y", labelsize=6.5)
        for ticks in (axis.get_yticklabels(), axis.get_xticklabels()):
            for tick, id_ in zip(ticks, ids, strict=True):
                tick.set_fontweight("bold" if id_ in named else "normal")
        axis.grid(visible=False)
        axis.spines[:].set_visible(False)
        rows.colour_bar(figure, image, "likeness of two candidates on these trials [–]")
        canvas.mark_virtual(figure, finding.virtual)
    text = (
        "1 means that two effects change the readings in the same way once the sand is fitted again; such "
        "two can only be told apart by their sizes, or by other trials."
    )
    for e in finding.effects:
        if e.id in ids:
            row = values[ids.index(e.id)].copy()
            row[ids.index(e.id)] = -1
            k = int(np.argmax(row))
            text += f" Most like {plain(e.id)}: {names[k]} ({row[k]:.2f})."
    return Figure(
        "found_confusion",
        f"Which candidates look alike{canvas.data_tag(finding.virtual)}",
        text,
        "Heat map of how alike the signatures of all candidates are once sand and sensor errors are fitted "
        "again.",
        lambda: figure,
    )
