"""The case for a finding, step by step, each with a picture."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from granite_lab.discovery.as_json import finding_as_json
from granite_lab.discovery.finding import Finding
from granite_lab.model.effect import Effect
from granite_lab.reporting.canvas import Drawing
from granite_lab.reporting.discovery import plot_gap, plot_sizes, plot_where, plot_which, tables
from granite_lab.reporting.discovery.answers import closed, missing_answer, share_in_words
from granite_lab.reporting.discovery.names import (
    either,
    in_plain_words,
    listed,
    plain,
    what_found,
    with_found,
)
from granite_lab.reporting.discovery.next_steps import next_steps
from granite_lab.reporting.discovery.plot_closer import closer_drawings
from granite_lab.reporting.discovery.plot_history import history_drawings
from granite_lab.reporting.discovery.plot_law import law_drawing, law_formulas
from granite_lab.reporting.discovery.plot_left import left_drawing
from granite_lab.reporting.discovery.sizes import untried
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
from granite_lab.reporting.table import Table

HOW = (
    "How it works: the model is fitted to what the sensors read, not to the estimated motion; the sand of "
    "each trial, the start of the command and the sensors' offsets and gains are fitted along, so that "
    "they cannot pass for a missing effect. All differences are given as multiples of the noise, which the "
    "standstill and the repetitions show."
)

SYMBOLS = (
    "As formulas, while the wheels turn; v is the speed of the robot, s the slip ratio of the wheel, x the "
    "way and t the time since the start, θ the angle of the wheel, and z its sinkage:"
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
    blocks: list[Block] = [Words(HOW)]
    for step in steps(finding, model, effects=effects):
        blocks += [Heading(step.title), *step.blocks]
    return Discovery(
        missing_answer(finding),
        Section("discovery", "The missing effect", tuple(blocks)),
        finding_as_json(finding, model),
    )


def steps(
    finding: Finding, model: Path | str | None = None, *, effects: Mapping[str, Effect] | None = None
) -> tuple[Section, ...]:
    """Return the steps of the case, numbered; arguments as in `section`."""
    known = candidates_of(finding, effects)
    nothing = finding.verdict == "none"
    parts: list[tuple[str, str, list[Block]]] = [
        ("where", "Where do model and trials disagree?", _where(finding)),
        (
            "which",
            "Would any effect explain them better?" if nothing else "Which effect explains it?",
            _which(finding, known),
        ),
        ("held-out", "Does it hold on trials that were left out?", _held_out(finding)),
        ("twins", "What cannot be told apart?", _twins(finding)),
        ("sizes", "How large is it?", _sizes(finding, model)),
        ("law", "What does the missing quantity look like?", _law(finding, model)),
        ("gap", "How much of the gap closes?" if finding.effects else "How large is the gap?", _gap(finding)),
        (
            "histories",
            "Before and after, over time" if finding.effects else "Model and trials over time",
            _histories(finding),
        ),
        ("left", "What is left, and is it noise?", _left(finding)),
        ("could-show", "What could these trials show?", _could_show(finding, known)),
        ("limits", "What could not be told", _limits(finding)),
        ("next", "What next?", [Listing(next_steps(finding, model))]),
    ]
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


def _gallery(*drawings: Drawing | None) -> Iterator[Block]:
    there = tuple(d for d in drawings if d is not None)
    if there:
        yield Gallery(there)


def _folded(title: str, table: Table | None) -> Iterator[Block]:
    if table is not None:
        yield Fold(title, (table,))


def _where(finding: Finding) -> list[Block]:
    if finding.where:
        text = (
            "The model of the paper, without any effect, beside the trials. The first picture shows in which "
            "channel, phase of the motion and band of frequency it is off, the second one when."
        )
    else:
        text = (
            "The model of the paper, without any effect, beside the trials: nowhere is it further off than "
            "noise and chance explain."
        )
    return [
        Words(text),
        *_gallery(plot_where.map_drawing(finding), plot_where.intervals_drawing(finding)),
        *_folded("The strongest intervals, in seconds", tables.intervals_table(finding)),
    ]


def _which(finding: Finding, known: Mapping[str, Effect]) -> list[Block]:
    drawings = plot_which.candidate_drawings(finding)
    if not drawings:
        return []
    text = (
        "Each candidate is put into the model in turn. Its evidence is how much better the model then meets "
        "the trials, counted so that candidates with many numbers have no advantage. The dashed line is what "
        "chance alone reaches, with all candidates tried, in one set of trials in a hundred. What wins is "
        "put into the model, and the rest are tried again."
    )
    return [
        Words(text),
        *_gallery(*drawings),
        *_folded("Every candidate, and what it means", tables.candidates_table(finding, known)),
    ]


def _held_out(finding: Finding) -> list[Block]:
    drawing = plot_gap.held_out_drawing(finding) if finding.effects else None
    if drawing is None:
        return []
    text = (
        "An effect that only fits the noise of the trials it was found on fails on others. Each trial, and "
        "then all trials of one speed, were left out of the fit and predicted from the rest."
    )
    return [Words(text), *_gallery(drawing)]


def _twins(finding: Finding) -> list[Block]:
    if finding.verdict != "named":
        return []
    parts = [
        f"On these trials {plain(e.id)} cannot be told from {either([plain(t) for t in e.twins])}: put in "
        "its place, it explains them as well."
        for e in finding.effects
        if e.twins
    ]
    if parts:
        parts.append("The command plan-next proposes a trial that tells them apart.")
    alone = [plain(e.id) for e in finding.effects if not e.twins]
    if alone:
        parts.append(f"No other candidate explains the trials as well as {listed(alone)}.")
    return [Words(" ".join(parts)), *_gallery(plot_which.confusion_drawing(finding))]


def _sizes(finding: Finding, model: Path | str | None) -> list[Block]:
    table = tables.effects_table(finding)
    if table is None:
        return []
    saved = f"The model with these numbers is in {model}." if model else ""
    return [*_gallery(plot_sizes.sizes_drawing(finding)), table, *([Words(saved)] if saved else [])]


def _law(finding: Finding, model: Path | str | None) -> list[Block]:
    table = tables.law_table(finding)
    if table is None:
        return []
    share = share_in_words(closed(finding.gap.held_out if finding.trial_losses else finding.gap.train))
    closes = f" It closes {share.removesuffix(' of it')} of the gap" if share else ""
    if closes:
        closes += " on trials that were left out." if finding.trial_losses else " on the trial of the fit."
    text = (
        "No candidate explains the trials, so the missing force, moment and torque were fitted as a sum of "
        "simple terms: an empirical law. It is not physics. It says what to look for, not why it is there, "
        f"and holds for trials like these only.{closes}"
    )
    saved = f"{model} holds the paper's model alone: a law is not put into it." if model else ""
    return [
        Words(text), *_gallery(law_drawing(finding)),
        Words(SYMBOLS),
        Listing(law_formulas(finding)), table, *([Words(saved)] if saved else []),
    ]  # fmt: skip


def _gap(finding: Finding) -> list[Block]:
    return [
        *_gallery(plot_gap.gap_drawing(finding)),
        *_folded("All channels and phases", tables.gaps_table(finding)),
    ]


def _histories(finding: Finding) -> list[Block]:
    text = "What the sensors read, and what the model says they should have read: without an effect"
    if not finding.effects:
        return [Words(f"{text}."), *_gallery(*history_drawings(finding))]
    closer = closer_drawings(finding)
    text += f" (before), and {with_found(finding)} (after)."
    if closer:
        text += (
            f" First the moments in which {what_found(finding)} makes the most difference, then whole runs."
        )
    return [Words(text), *_gallery(*closer), *_gallery(*history_drawings(finding))]


def _limits(finding: Finding) -> list[Block]:
    notes = [in_plain_words(note, finding) for note in finding.notes]
    notes += [
        f"{plain(i)[0].upper()}{plain(i)[1:]} was not tried: the model with it could not be simulated here."
        for i in untried(finding)
    ]
    return [Listing(tuple(notes))] if notes else []


def _left(finding: Finding) -> list[Block]:
    after = plot_where.map_drawing(finding, after=True) if finding.effects else None
    return list(_gallery(left_drawing(finding), after))


def _could_show(finding: Finding, known: Mapping[str, Effect]) -> list[Block]:
    drawing = plot_sizes.detectable_drawing(finding, dict(known))
    alike = None if finding.verdict == "named" else plot_which.confusion_drawing(finding)
    text = (
        "A search that finds nothing says little unless it would have found something. From the noise of "
        "these very trials follows how small each candidate may be and still be seen."
    )
    found = list(_gallery(drawing, alike))
    if not found:
        return []
    return [
        Words(text),
        *found,
        *_folded("Smallest sizes, with units", tables.detectable_table(finding, known)),
        *_folded("What would be named, and what it would be taken for", tables.self_check_table(finding)),
    ]
