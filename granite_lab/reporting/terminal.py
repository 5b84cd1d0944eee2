"""The output of commands on a terminal: answers, tables and lists, within 80 columns."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from rich.text import Text

from granite_lab import reporting, results
from granite_lab.columns import Cell, Column, Table, good, words
from granite_lab.model.effect import EFFECT_PARAMETERS
from granite_lab.parameters.catalogue import VARIANTS, provenance_table
from granite_lab.reporting.table import TONES, VIRTUAL, clean, say, show_table
from granite_lab.rounding import percent, significant, tidy_unit

if TYPE_CHECKING:
    from pathlib import Path

    from rich.console import Console

    from granite_lab.comparison.compare import Comparison
    from granite_lab.discovery.finding import Finding
    from granite_lab.estimation.motion import Judgement, Motion
    from granite_lab.fitting.fit import AThetaFit, K92Fit
    from granite_lab.logs.inspection import FileReport, Inspection, StreamReport
    from granite_lab.logs.quantities import ColumnReport
    from granite_lab.model.effect import Effect
    from granite_lab.model.run import Run
    from granite_lab.parameters import Variant
    from granite_lab.parameters.catalogue import Provenance
    from granite_lab.planning.plan import CandidateTrial, Plan, Proposal
    from granite_lab.reporting.answers import Answer
    from granite_lab.results import StudyResult


def show_study(
    result: StudyResult, console: Console, folder: str = "", model: Path | str | None = None
) -> None:
    """Print the answers of a study, as on the first screen of its report, and the tables of a search alone.

    `folder` and `model` are named in commands.
    """
    answers = reporting.answers.of_study(result, model, folder)
    say(console, answers.lead)
    if answers.table is not None:
        console.print()
        show_table(answers.table, console)
    _answers(answers.questions, console)
    if result.finding is not None and not result.trials:
        _search(result.finding, console)
    for failure in result.failures:
        say(console, f"left out: {failure.trial}: {failure.message}", "red")
    doubts = sum(bool(results.warnings_of(r)) for r in result.trials)
    if doubts:
        text = f"{doubts} of {len(result.trials)} trials have warnings; the report lists them."
        say(console, text, "yellow")


def _search(finding: Finding, console: Console) -> None:
    if finding.virtual and not finding.effects:
        say(console, f"{VIRTUAL}.", "yellow")
    effects_table = reporting.search_tables.effects_table
    named, likely, small = (
        f"effect{'s' * (len(some) > 1)}" for some in (finding.effects, finding.likely, finding.small)
    )
    tables = (
        (f"missing {named}", effects_table(finding, finding.effects)),
        (f"likely {likely}, not certain", effects_table(finding, finding.likely, "likely")),
        ("description, not a cause", effects_table(finding, finding.causeless, "described")),
        (f"small {small}", effects_table(finding, finding.small, "small")),
    )
    for title, table in tables:
        if table.rows:
            console.print()
            say(console, title, "bold")
            show_table(table, console, only=("effect", "number", "value ± std", "probability"))
    if most := reporting.search_tables.ceiling_in_words(finding):
        say(console, most)
    if latency := reporting.names.latency_in_words(finding.latency):
        say(console, f"{latency}.")
    for trial, reason in finding.dropped:
        say(console, f"left out: {trial}: {reason}", "red")
    for note in finding.notes:
        say(console, f"note: {reporting.names.in_plain_words(note, finding)}", "yellow")


def _answers(questions: Sequence[Answer], console: Console) -> None:
    for answer in questions:
        verdict = clean(f"{answer.verdict}. " if answer.verdict else "", TONES.get(answer.tone, ""))
        say(console, Text.assemble(clean(f"{answer.question} ", "bold"), verdict, clean(answer.text)))
        if answer.command:
            console.print(clean(f"  {answer.command}"), soft_wrap=True)


MOTIONS: Table[Motion] = Table(
    "motions",
    "Estimates",
    Column("trial", lambda m: m.trial),
    Column("speed", lambda m: m.variant.velocity, "speed_mps", unit="m/s", form=".3g"),
    Column("distance", lambda m: m.distance, "distance_m distance_std_m", unit="m"),
    Column("slip λ_R", lambda m: m.slip_ratio, "slip_ratio slip_ratio_std", unit="%", scale=100, widest=1.0),
    Column("wheel stamps late", lambda m: m.stamps_late, "late_s late_std_s", unit="ms", scale=1000),
    Column("estimate", lambda m: good(m.health.good)),
)


def show_motions(
    rows: Sequence[tuple[Motion, Path, Sequence[Judgement] | None]],
    console: Console,
    referred: Collection[str] = (),
) -> None:
    """Print what was estimated of each trial, where its table stands, and how it meets a reference.

    In trials that are `referred`, the reference entered the estimate; the estimate without it is judged.
    """
    motions = [motion for motion, _, _ in rows]
    show_table(MOTIONS.fill(motions, virtual=any(m.virtual for m in motions)), console)
    for motion, path, judged in rows:
        if not motion.health.good:
            say(console, f"{motion.trial}: {motion.health.verdict}", "yellow")
        for j in judged or ():
            without = "estimated without the reference: " if motion.trial in referred else ""
            say(console, f"{motion.trial}: {without}{_against_reference(j)}")
        say(console, f"{motion.trial}: {path}", "dim")


def _against_reference(judged: Judgement) -> str:
    """Say in one sentence how an estimate, or the wheels where there is none, meets the reference."""
    unit = "m/s" if judged.quantity == "velocity" else "m"
    wheels, slip = f"{significant(judged.rmse_wheels, 2)} {unit}", f"{significant(100 * judged.slip, 3)} %"
    slip = f"apparent slip {slip} by the reference's way"
    judged_wheels = math.isfinite(judged.rmse_wheels) and math.isfinite(judged.slip)
    if not math.isfinite(judged.rmse):
        text = f"{slip}, rms difference {wheels}" if judged_wheels else "unknown"
        return f"{judged.quantity} of the wheels against the reference: {text}"
    alone = f", wheels alone {wheels}, {slip}" if judged_wheels else ""
    return (
        f"{judged.quantity} against the reference: rms error {significant(judged.rmse, 2)} {unit}, mean "
        f"{significant(judged.bias, 2)} {unit}{alone}; within ±2σ {significant(100 * judged.coverage, 2)} % "
        f"of {judged.samples} samples"
    )


def show_k92_fits(fits: Sequence[K92Fit], console: Console, *, notes: bool = False) -> None:
    """Print k_92 of each trial by steady slip and by trajectory, and the notes of the fits if asked to."""
    show_table(reporting.tables.k92_table(fits), console)
    notes_of_trials = reporting.names.shared([(fit.trial, fit.notes) for fit in fits])
    for note in notes_of_trials if notes else ():
        say(console, reporting.names.sensors_in_words(note), "yellow")
    if notes_of_trials and not notes:
        say(console, f"{len(notes_of_trials)} notes of the fits: --verbose lists them", "dim")


def show_a_theta(fit: AThetaFit, console: Console) -> None:
    """Print a_θ beside the paper's and the laws that compete with it."""
    _answers([reporting.answers.law_answer(fit)], console)
    if fit.laws:
        table = reporting.tables.law_table(fit, False)
        show_table(table, console)
        say(console, table.note)
    for note in fit.notes:
        say(console, note, "yellow")


def show_misfits(comparisons: Sequence[Comparison], console: Console) -> None:
    """Print the difference of simulation and measurement by quantity, over all trials."""
    judged = reporting.channels.judged_channels(results.pooled_misfits(comparisons))
    table = reporting.channels.CHANNEL_TABLE.fill(judged, virtual=any(c.motion.virtual for c in comparisons))
    columns = ("quantity", "verdict", "difference, rms", "noise", "largest value")
    show_table(table, console, only=columns)


def show_run(run: Run, console: Console) -> None:
    """Print means over the steady part of a simulated run."""
    steady = (run.t >= run.steady[0]) & (run.t <= run.steady[1])

    def mean(signal: str) -> float:
        return float(run[signal][steady].mean())

    table = Table[tuple[str, str, float, str]](
        "run",
        "Means over the steady part",
        Column("quantity", lambda row: row[0]),
        Column("front", lambda row: row[2] * mean(row[1].format("f")), "front", form=".2f"),
        Column("rear", lambda row: row[2] * mean(row[1].format("r")), "rear", form=".2f"),
        Column("unit", lambda row: row[3]),
    )
    rows = (
        ("slip ratio", "slip_{}", 100.0, "%"),
        ("sinkage", "sinkage_{}_m", 1000.0, "mm"),
        ("driving torque", "torque_{}_Nm", 1.0, "N m"),
        ("motor current", "current_{}_A", 1.0, "A"),
    )
    show_table(table.fill(rows), console)


def show_inspection(inspection: Inspection, console: Console) -> None:
    """Print what was recognised in each file: layout, columns, clocks, standstills, motion, doubts."""
    for i, report in enumerate(inspection.files):
        if i:
            console.print()
        say(console, str(report.path), "bold")
        if report.problem:
            say(console, report.problem, TONES["bad"])
        if report.hint:
            say(console, f"hint: {report.hint}", "dim")
        if report.columns or not report.problem:
            _file(report, console)


def _file(report: FileReport, console: Console) -> None:
    guessed = "no known layout; columns guessed from names and values"
    layout = f"layout “{report.layout}”" if report.layout else guessed
    say(console, f"{layout}, {percent(report.confidence)} sure")
    if report.dialect is not None:
        d = report.dialect
        encoding = d.encoding.upper().removesuffix("-SIG")
        text = (
            f"text: {encoding}, {d.delimiter_name} between columns, decimal “{d.decimal}”, header in line "
            f"{d.header_line}, first row in line {d.data_line}"
        )
        say(console, text, "dim")
    show_table(LOG_COLUMNS.fill(report.columns), console)
    if report.streams:
        console.print()
        show_table(CLOCKS.fill(report.streams), console)
    rests = ", ".join(f"{start:.2f}–{end:.2f} s" for start, end in report.rests)
    say(console, f"standstills: {rests or 'none found'}")
    if report.motion is not None:
        m = report.motion
        which = f"variant {m.variant.velocity:g} m/s of Table 2" if m.variant else "no variant of Table 2"
        text = (
            f"motion: {significant(m.velocity)} m/s, {significant(m.acceleration, 2)} m/s², "
            f"{significant(m.distance)} m at the wheels, {which} ({percent(m.confidence)} sure)"
        )
        say(console, text)
    for doubt in report.doubts:
        say(console, f"doubt: {doubt}", "yellow")


def _sure(column: ColumnReport) -> Cell:
    """Return how sure it is what a column is [%]; empty where it is not used."""
    tone = "good" if column.confidence >= 0.9 else "fair" if column.confidence >= 0.6 else "bad"
    return words(f"{100 * column.confidence:.0f}" if column.to else "", tone)


LOG_COLUMNS: Table[ColumnReport] = Table(
    "log_columns",
    "Columns of a log",
    Column("column", lambda c: c.name or f"(column {c.place + 1})"),
    Column("becomes", lambda c: ", ".join(c.to) or words(c.why or "not used", "faint")),
    Column("unit", lambda c: words(tidy_unit(c.unit) if c.to else "")),
    Column("sure", _sure, "sure", unit="%"),
    Column("from", lambda c: c.low, "low"),
    Column("to", lambda c: c.high, "high"),
)

CLOCKS: Table[StreamReport] = Table(
    "clocks",
    "Clocks of a log",
    Column("clock", lambda s: s.what),
    Column("samples", lambda s: s.samples, "samples"),
    Column("from", lambda s: s.start, "start", unit="s", form=".2f"),
    Column("to", lambda s: s.end, "end", unit="s", form=".2f"),
    Column("rate", lambda s: s.rate, "rate", unit="Hz"),
    Column("jitter", lambda s: s.jitter, "jitter", unit="ms", scale=1000, digits=2),
    Column("gaps", lambda s: f"{s.gaps} (≤ {significant(s.longest_gap, 2)} s)" if s.gaps else "0", "gaps"),
)


def show_parameters(parameters: Sequence[Provenance], variants: Sequence[Variant], console: Console) -> None:
    """Print every parameter in force with symbol, unit, allowed range and origin."""
    for group in dict.fromkeys(row.group for row in parameters):
        members = [row for row in parameters if row.group == group]
        common = Counter(row.origin for row in members).most_common(1)[0][0]
        say(console, Text.assemble((group, "bold"), (f"  from {common}", "dim")))
        others = any(p.origin != common for p in members)
        show_table(provenance_table(origin=others).fill(members), console)
        console.print()
    say(console, "variants (Table 2)", "bold")
    show_table(VARIANTS.fill(variants), console)


def show_effect(effect: Effect, console: Console) -> None:
    """Print what an effect is: equation, source, what an observer sees, parameters."""
    say(console, f"{effect.id}: {effect.title}", "bold")
    texts = {"equation": effect.equation, "source": effect.source, "signature": effect.signature}
    for label, text in texts.items():
        say(console, Text.assemble(clean(f"{label}: ", "dim"), clean(text)))
    show_table(EFFECT_PARAMETERS.fill(effect.parameters), console)


PROPOSALS = 8
"""Proposed trials that are printed at most."""


def show_plan(plan: Plan, console: Console) -> None:
    """Print a plan so that it fits 80 columns."""
    names = reporting.names
    sharpens = plan.question.kind == "sharpen"

    def change(p: Proposal) -> str:
        before, after = plan.now[p.improves], p.after[p.improves]
        if sharpens:
            return f"{significant(100 * before, 2)} % → {significant(100 * after, 2)} %"
        return f"{after - before:+.{0 if after - before >= 9.95 else 1}f}".replace("-", "−")

    def command(o: CandidateTrial) -> str:
        v, under = o.variant, o.conditions.words
        motion = f"{v.velocity:g} m/s, {v.acceleration:g} m/s², {v.distance:g} m"
        return f"{motion}, {under}" if under else motion

    def because(p: Proposal) -> str:
        return f"{names.outlook(p.improves)}: {p.trial.why}" if len(plan.now) > 1 else p.trial.why

    count = sum(int(d.count) for d in plan.design.driven)
    trials = f"the {count} trials at hand" if count > 1 else "the one trial at hand"
    say(console, asked(plan) + (" (virtual data)" if plan.design.virtual else ""), "bold")
    if sharpens:
        ((name, std),) = plan.now.items()
        say(
            console,
            f"Relative standard deviation with {trials}: {names.outlook(name)} {significant(100 * std, 2)} "
            f"%. The error of a formula, {reporting.search_tables.FORMULA}, is not part of it: no trial "
            "lowers it. The report adds it.",
        )
    else:
        say(
            console,
            f"Adds: expected gain of the logarithm of the Bayes factor between two of them, over {trials}, "
            "if their formulas are exact. 3 decides (20 to 1).",
        )
    if not plan.worth:
        why = "none lowers the std by a fifth" if sharpens else "none adds 3 to a log Bayes factor (20 to 1)"
        say(console, f"No trial is recommended: {why}.", "bold")
    table: Table[tuple[int, Proposal]] = Table(
        "plan",
        "Proposals",
        Column("", lambda row: row[0], "rank"),
        Column("next trial", lambda row: command(row[1].trial)),
        Column("std" if sharpens else "adds", lambda row: change(row[1]), "change"),
        Column("because", lambda row: because(row[1])),
    )
    show_table(table.fill(enumerate(plan.proposals[:PROPOSALS], 1)), console)
    if plan.worth:
        best = plan.proposals[0].trial
        say(console, f"First choice, {command(best)}: {best.how}.")
        if best.conditions.lines:
            lines = ", ".join(f"'{line}'" for line in best.conditions.lines)
            say(console, f"Write {lines} into its log, so that discover knows.")
    if plan.failed:
        say(console, f"{plan.failed} commands cannot be simulated and were left out.")


def asked(plan: Plan) -> str:
    """Return the question."""
    names = reporting.names
    rivals = [names.plain(rival) for rival in plan.question.rivals]
    if plan.question.kind == "apart":
        return f"Which trial distinguishes {names.listed(rivals)}?"
    if plan.question.kind == "show":
        return f"Which trial shows {names.listed(rivals, 'or')}, if it is present?"
    return "Which trial lowers the largest relative standard deviation of a strength?"
