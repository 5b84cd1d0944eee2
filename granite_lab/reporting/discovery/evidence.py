"""The case for a finding, step by step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from granite_lab.discovery.as_json import finding_as_json
from granite_lab.discovery.finding import Finding
from granite_lab.model.effect import Effect
from granite_lab.reporting.discovery import plot_gap, plot_sizes, plot_where, plot_which, tables
from granite_lab.reporting.discovery.answers import missing_answer, percent
from granite_lab.reporting.discovery.law import law_formulas
from granite_lab.reporting.discovery.names import in_plain_words, latency_in_words, with_found
from granite_lab.reporting.discovery.next_steps import next_steps
from granite_lab.reporting.discovery.plot_history import history_drawings
from granite_lab.reporting.document import (
    Block,
    Discovery,
    Fold,
    Gallery,
    Heading,
    Listing,
    Section,
    Words,
)
from granite_lab.reporting.figures import Figure
from granite_lab.reporting.table import Table

SYMBOLS = (
    "The empirical law is a description, no physics: it says what to look for, and holds for trials like "
    "these only. As formulas, while the wheels turn; v is the speed of the robot, s the slip ratio of the "
    "wheel, x the way and t the time since the start, θ the angle of the wheel, and z its sinkage:"
)


def how(finding: Finding) -> str:
    """Say in a paragraph how the search works."""
    return (
        "How it works: the model is fitted to what the sensors read, not to the estimated motion; the sand "
        "of each trial, the start of the command, the latency of the IMU and the sensors' offsets and gains "
        "are fitted along, so that they cannot pass for a missing effect. What all repetitions of a command "
        "share and no parameter explains is the discrepancy of the model; up to "
        f"{percent(finding.tolerance)} of a channel's rms in motion (--tolerance) it does not matter."
    )


def section(
    finding: Finding, model: Path | str | None = None, *, effects: Mapping[str, Effect] | None = None
) -> Discovery:
    """Return what a finding adds to a report: the answer of the first page, and the evidence.

    Args:
        finding: the record.
        model: path of the model file with what was found, as the report shall name it.
        effects: the candidates by id, of which the report tells the meaning and the expected sizes;
            those of the package by default.
    """
    blocks: list[Block] = [Words(how(finding))]
    for step in steps(finding, model, effects=effects):
        blocks += [Heading(step.title), *step.blocks]
    return _discovery(finding, model, blocks)


def bare_section(finding: Finding, model: Path | str | None = None) -> Discovery:
    """Return a section in words alone, for a report whose evidence could not be drawn."""
    lines = [finding.sentence, *finding.provisional, *finding.notes, *finding.failures]
    return _discovery(finding, model, [Listing(tuple(lines))])


def _discovery(finding: Finding, model: Path | str | None, blocks: list[Block]) -> Discovery:
    shown = Section("discovery", "The missing effect", tuple(blocks))
    return Discovery(missing_answer(finding), shown, finding_as_json(finding, model))


def steps(
    finding: Finding, model: Path | str | None = None, *, effects: Mapping[str, Effect] | None = None
) -> tuple[Section, ...]:
    """Return the steps of the case, numbered; arguments as in `section`."""
    known = candidates_of(finding, effects)
    parts: list[tuple[str, str, list[Block]]] = [
        ("verdict", "What do these trials say?", _verdict(finding, known, model)),
        ("small", "Effects that do not matter here", _table(tables.effects_table(
            finding, known, finding.small, small=True))),
        ("where", "Where does the model disagree?", _where(finding)),
        ("candidates", "Which candidates were tried?", _candidates(finding, known)),
        ("could-show", "What could these trials have shown?", _could_show(finding, known)),
        ("latency", "How late are the stamps of the IMU?", _latency(finding)),
        ("scales", "What was learnt of sand and sensors?",
         [*_table(tables.scales_table(finding)), *_table(tables.sand_table(finding))]),
        ("held-out", "Does it hold on trials and speeds that were left out?", _held_out(finding)),
        ("dropped", "Which trials could not be used?", _table(tables.dropped_table(finding))),
        ("limits", "What could not be told?", _listing([in_plain_words(n, finding) for n in finding.notes])),
        ("failures", "What failed?", _listing(finding.failures)),
        ("next", "What next?", _listing(next_steps(finding, model))),
    ]  # fmt: skip
    full = [(id_, title, blocks) for id_, title, blocks in parts if blocks]
    return tuple(
        Section(f"found-{id_}", f"{k}. {title}", tuple(blocks))
        for k, (id_, title, blocks) in enumerate(full, 1)
    )


def candidates_of(finding: Finding, effects: Mapping[str, Effect] | None) -> dict[str, Effect]:
    """Return the candidates by id, those of the package where none are given."""
    if effects is None:
        from granite_lab.effects import library  # noqa: PLC0415, heavy

        effects = library()
    return dict(effects) | {a.effect.id: a.effect for a in finding.active}


def _gallery(*drawings: Figure | None) -> Iterator[Block]:
    there = tuple(d for d in drawings if d is not None)
    if there:
        yield Gallery(there)


def _table(table: Table | None) -> list[Block]:
    return [] if table is None else [table]


def _listing(lines: tuple[str, ...] | list[str]) -> list[Block]:
    return [Listing(tuple(lines))] if lines else []


def _folded(title: str, *found: Table | None) -> Iterator[Block]:
    there = tuple(t for t in found if t is not None)
    if there:
        yield Fold(title, there)


def _verdict(finding: Finding, known: Mapping[str, Effect], model: Path | str | None) -> list[Block]:
    probability = f"Posterior probability of this verdict: {percent(finding.probability)}."
    blocks: list[Block] = [
        Words(f"{in_plain_words(finding.sentence, finding)} {probability}"),
        *_listing([in_plain_words(reason, finding) for reason in finding.provisional]),
        *_table(tables.effects_table(finding, known, finding.effects)),
    ]
    formulas = law_formulas(finding)
    if formulas:
        blocks += [Words(SYMBOLS), Listing(formulas)]
    if model and any(not e.empirical for e in finding.effects):
        blocks.append(Words(f"The model with these numbers is in {model}."))
    return blocks


def _where(finding: Finding) -> list[Block]:
    text = "What the sensors read, and what the model says they should have read: without an effect"
    text += f" (before), and {with_found(finding)} (after)." if finding.effects else "."
    return [
        *_gallery(plot_gap.gap_drawing(finding), plot_gap.discrepancy_drawing(finding)),
        *_gallery(plot_where.intervals_drawing(finding)),
        *_folded(
            "All channels, and the largest intervals in seconds",
            tables.gaps_table(finding),
            tables.intervals_table(finding, finding.where),
            tables.intervals_table(finding, finding.left, after=True) if finding.effects else None,
        ),
        Words(text),
        *_gallery(*history_drawings(finding)),
    ]


def _candidates(finding: Finding, known: Mapping[str, Effect]) -> list[Block]:
    return [
        *_gallery(plot_which.candidates_drawing(finding)),
        *_folded("Every candidate, and what it means", tables.candidates_table(finding, known)),
    ]


def _could_show(finding: Finding, known: Mapping[str, Effect]) -> list[Block]:
    found = [
        *_gallery(plot_sizes.detectable_drawing(finding, known), plot_which.confusion_drawing(finding)),
        *_folded("Smallest sizes, with units", tables.detectable_table(finding, known)),
        *_folded("What would come first, and what it would be taken for", tables.confusion_table(finding)),
    ]
    text = (
        "A search that finds nothing says little unless it would have found something. Noise, tolerance and "
        "design of these trials say how small each candidate may be and still be named."
    )
    return [Words(text), *found] if found else []


def _latency(finding: Finding) -> list[Block]:
    text = latency_in_words(finding.latency)
    return [Words(f"{text}.")] if text else []


def _held_out(finding: Finding) -> list[Block]:
    drawing = plot_gap.held_out_drawing(finding)
    if drawing is None:
        return []
    text = (
        "An effect that only fits the noise of the trials it was found on fails on others. Each trial, and "
        "then all trials of one speed, were left out of the fit and predicted from the rest."
    )
    return [Words(text), *_gallery(drawing), *_folded("The numbers", tables.left_out_table(finding))]
