"""Which candidate explains the disagreement, and which of them look alike."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np

from granite_lab.discovery.finding import Candidate, Finding
from granite_lab.reporting import canvas
from granite_lab.reporting.canvas import Drawing
from granite_lab.reporting.discovery import rows
from granite_lab.reporting.discovery.names import STATUS, listed, plain
from granite_lab.reporting.discovery.sizes import picked
from granite_lab.reporting.rounding import evidence, significant

MARKERS = {"evaluated": "o", "screened only": ".", "at a bound": "x", "not converged": "+", "related": "D",
           "uneven": "s"}  # fmt: skip
NOT_NAMED = {
    "related": "it is like what is in the model already, and a fault in that formula could do as much",
    "uneven": "it would need another size in each trial, not only another phase",
    "at a bound": "its fit ended at a bound of what is physically possible",
}
"""Why a candidate with much evidence is not named, by how far it was tried."""

MOST = 12
"""Candidates of a later round that are drawn."""


def candidate_drawings(finding: Finding) -> list[Drawing]:
    """Draw the evidence for each candidate, one figure per round of the search."""
    return [_round(finding, k) for k, found in enumerate(finding.rounds) if found]


def _round(finding: Finding, k: int) -> Drawing:
    found = finding.rounds[k]
    shown = found if k == 0 else found[:MOST]
    chosen, named = picked(finding, k), {e.id for e in finding.effects}
    figure, (axis,) = rows.panels([plain(c.id) for c in shown], row=0.165, head=0.45)
    top = 3 * max([c.evidence for c in shown] + [finding.threshold])
    with canvas.styled():
        axis.axvline(
            finding.threshold, color=canvas.INK, linewidth=1.0, linestyle=(0, (4, 1.5)),
            label="chance, 1 set of 100",
        )  # fmt: skip
        for status, marker in MARKERS.items():
            own = [(i, c) for i, c in enumerate(shown) if c.status == status]
            if own:
                axis.plot(
                    [max(c.evidence, 1.0) for _, c in own], [i for i, _ in own], linestyle="none",
                    marker=marker, markersize=5, color=canvas.GREY, label=STATUS[status],
                )  # fmt: skip
        for i, c in enumerate(shown):
            if c.id == chosen:
                axis.plot(
                    c.evidence, i, linestyle="none", marker="o", markersize=6.5, color=canvas.FITTED,
                    label="named" if c.id in named else "put in for a time",
                )  # fmt: skip
                axis.get_yticklabels()[i].set_fontweight("bold")
        rows.log_axis(axis, 0.8, top)
        axis.set_xlabel("evidence for the effect: drop of χ² [–]")
        rows.legend_on_top(figure, axis, 3)
        canvas.mark_virtual(figure, finding.virtual)
    step = ("First", "Second", "Third", "Fourth")[min(k, 3)]
    return Drawing(
        f"found_candidates_{k + 1}",
        f"{step} round: evidence for each candidate{canvas.data_tag(finding.virtual)}",
        _describe(finding, found, chosen, k),
        f"Evidence for each candidate effect in round {k + 1} of the search, with the threshold that chance "
        "reaches in one set of a hundred.",
        figure,
    )


def _describe(finding: Finding, found: tuple[Candidate, ...], chosen: str | None, k: int) -> str:
    chance = significant(finding.threshold, 2)
    best = max(found, key=lambda c: c.evidence)
    already = [plain(i) for i in (picked(finding, r) for r in range(k)) if i is not None]
    given = f"With {listed(already)} in the model, " if already else ""
    if chosen is None:
        if best.evidence <= finding.threshold:
            text = f"no candidate reaches the {chance} that chance alone reaches in one set of 100"
            return _sentence(f"{given}{text} (best: {plain(best.id)}, {evidence(best.evidence)}).")
        why = NOT_NAMED.get(best.status, "it explains too little, or it does not hold on trials left out")
        return _sentence(
            f"{given}{plain(best.id)} comes closest with {evidence(best.evidence)} (chance: {chance}), "
            f"but it does not count: {why}."
        )
    own = next((c for c in found if c.id == chosen), best)
    rest = sorted((c for c in found if c.id != chosen), key=lambda c: -c.evidence)
    second = f"; next comes {plain(rest[0].id)} with {evidence(rest[0].evidence)}" if rest else ""
    return _sentence(
        f"{given}{plain(chosen)} brings {evidence(own.evidence)}, where chance alone reaches {chance} "
        f"in one set of 100{second}.{_others(finding, rest, k)}"
    )


def _others(finding: Finding, rest: list[Candidate], k: int) -> str:
    """Say what became of others beyond the line: the next round tells whether they add anything."""
    beyond = sum(c.evidence > finding.threshold for c in rest)
    if beyond == 0 or k + 1 >= len(finding.rounds):
        return ""
    still = sum(c.evidence > finding.threshold for c in finding.rounds[k + 1])
    first = (
        "The other one beyond the line explains" if beyond == 1 else f"{beyond} more beyond the line explain"
    )
    then = "none adds" if still == 0 else "one adds" if still == 1 else f"{still} add"
    return f" {first} part of the same; once it is in the model, {then} more than chance."


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:]


def confusion_drawing(finding: Finding) -> Drawing | None:
    """Draw how alike the candidates' signatures are on these trials; None without any."""
    ids = finding.confusion_ids
    if len(ids) < 2:
        return None
    named = {e.id for e in finding.effects}
    figure, (axis,) = rows.panels([plain(i) for i in ids], row=0.138, head=0.08, foot=2.0)
    with canvas.styled():
        values = np.abs(finding.confusion)
        edges = np.arange(len(ids) + 1) - 0.5
        image = axis.pcolormesh(
            edges, edges, values, cmap="cividis", vmin=0, vmax=1, edgecolors="white", linewidth=0.3
        )
        axis.set_xticks(range(len(ids)), [plain(i) for i in ids], rotation=90, fontsize=6.5)
        axis.tick_params(axis="both", length=0)
        axis.tick_params(axis="y", labelsize=6.5)
        for ticks in (axis.get_yticklabels(), axis.get_xticklabels()):
            for tick, id_ in zip(ticks, ids, strict=True):
                if id_ in named:
                    tick.set_fontweight("bold")
        axis.grid(visible=False)
        for spine in axis.spines.values():
            spine.set_visible(False)
        height = figure.get_size_inches()[1]
        wide = canvas.WIDTH - rows.LEFT - rows.RIGHT
        bar = figure.add_axes((rows.LEFT / canvas.WIDTH, 0.4 / height, wide / canvas.WIDTH, 0.09 / height))
        scale = figure.colorbar(
            mpl.cm.ScalarMappable(image.norm, image.cmap), cax=bar, orientation="horizontal"
        )
        assert scale.solids is not None
        scale.solids.set(rasterized=False, edgecolor="face", linewidth=0.3)
        scale.set_label("likeness of the signatures [–]", fontsize=8)
        scale.outline.set_linewidth(0.4)
        canvas.mark_virtual(figure, finding.virtual)
    return Drawing(
        "found_confusion",
        f"Which candidates look alike on these trials{canvas.data_tag(finding.virtual)}",
        _describe_confusion(finding),
        "Heat map of how alike the signatures of the candidates are once sand and sensor errors are fitted "
        "again.",
        figure,
    )


def _describe_confusion(finding: Finding) -> str:
    ids = finding.confusion_ids
    text = (
        "1 means that two effects change the readings in the same way once the sand is fitted again; such "
        "two can only be told apart by their sizes, or by other trials."
    )
    for e in finding.effects:
        if e.id in ids:
            row = np.abs(finding.confusion[ids.index(e.id)]).copy()
            row[ids.index(e.id)] = -1
            k = int(np.argmax(row))
            text += f" Most like {plain(e.id)}: {plain(ids[k])} ({row[k]:.2f})."
    return text
