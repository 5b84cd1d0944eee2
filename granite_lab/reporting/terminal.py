"""What commands print at their end: the answers and tables of the report, so that they fit 80 columns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.text import Text

from granite_lab.comparison.record import Comparison
from granite_lab.discovery.finding import Finding
from granite_lab.estimation.judgement import Judgement
from granite_lab.estimation.motion import Motion
from granite_lab.fitting.fit import AThetaFit, K92Fit
from granite_lab.reporting import answers as decide
from granite_lab.reporting import tables
from granite_lab.reporting.answers import Answer
from granite_lab.reporting.content import StudyResult
from granite_lab.reporting.grid import TONES, clean, grid, say
from granite_lab.reporting.listings import show_effect, show_effects, show_inspection, show_parameters
from granite_lab.reporting.names import in_plain_words, latency_in_words, shared
from granite_lab.reporting.rounding import significant
from granite_lab.reporting.summary import gaps
from granite_lab.reporting.table import Cell, Column, Table, estimate, tabulate

__all__ = [
    "show_a_theta",
    "show_effect",
    "show_effects",
    "show_finding",
    "show_inspection",
    "show_k92_fits",
    "show_misfits",
    "show_motions",
    "show_parameters",
    "show_study",
    "show_table",
]

VIRTUAL = "virtual data: written by a simulator"


def show_table(table: Table, console: Console, *, only: Sequence[str] = ()) -> None:
    """Print a table of the report.

    Args:
        table: the table.
        console: where to print.
        only: names of the columns to print, in the order of the table; all by default.
    """
    kept = [i for i, c in enumerate(table.columns) if not only or c.name in only]
    flush = [k for k, i in enumerate(kept) if not table.columns[i].number]
    shown = grid(*(_heading(table.columns[i]) for i in kept), words=flush)
    for row in table.rows:
        shown.add_row(*(clean(row[i].text, TONES.get(row[i].tone, "")) for i in kept))
    console.print(shown)
    if table.virtual:
        say(console, f"{VIRTUAL}.", "yellow")


def _heading(column: Column) -> str:
    """Return a heading on two lines: the words, and the unit below them or the second half of the words."""
    name = column.name
    if column.unit:
        return f"{name}\n[{column.unit}]" if len(name) < 12 else f"{_halves(name)} [{column.unit}]"
    return _halves(name) if len(name) > 9 else name


def _halves(text: str) -> str:
    parts = text.split(" ")
    if len(parts) < 2:
        return text
    cut = min(range(1, len(parts)), key=lambda k: max(len(" ".join(parts[:k])), len(" ".join(parts[k:]))))
    return f"{' '.join(parts[:cut])}\n{' '.join(parts[cut:])}"


def show_study(
    result: StudyResult, console: Console, folder: str = "", model: Path | str | None = None
) -> None:
    """Print the answers of a study, as on the first screen of its report.

    Args:
        result: the study.
        console: where to print.
        folder: of the report, as commands name it.
        model: path of the model file with what was found.
    """
    decided = decide.of_study(result, model, folder)
    say(console, decided.lead)
    if decided.speeds:
        console.print()
        show_table(tables.slip_table(decided), console)
    _answers(decided.questions, console)
    for failure in result.failures:
        say(console, f"left out: {failure.trial}: {failure.message}", "red")
    doubts = sum(bool(r.trial.warnings or r.comparison.motion.warnings) for r in result.trials)
    if doubts:
        say(
            console,
            f"{doubts} of {len(result.trials)} trials have warnings; the report lists them.",
            "yellow",
        )


def _answers(questions: Sequence[Answer], console: Console) -> None:
    for answer in questions:
        line = Text()
        line.append(f"{answer.question} ", "bold")
        if answer.verdict:
            line.append_text(clean(f"{answer.verdict}. ", TONES.get(answer.tone, "")))
        line.append_text(clean(answer.text))
        console.print(line)
        if answer.command:
            console.print(clean(f"  {answer.command}"), soft_wrap=True)


def show_motions(rows: Sequence[tuple[Motion, Path, Sequence[Judgement] | None]], console: Console) -> None:
    """Print what was estimated of each trial, where its table stands, and how it meets a reference."""
    table = tabulate(
        "motions", "Estimates", "", [motion for motion, _, _ in rows],
        [
            ("trial", "", lambda m: m.trial),
            ("speed [m/s]", "speed_mps", lambda m: Cell(f"{m.variant.velocity:.3g}", (m.variant.velocity,))),
            ("distance [m]", "distance_m distance_std_m", lambda m: estimate(m.distance)),
            ("slip λ_R [%]", "slip_ratio slip_ratio_std", lambda m: estimate(m.slip_ratio, 100)),
            ("wheel stamps late [ms]", "late_s late_std_s", lambda m: tables.late(m.stamps_late)),
            ("estimate", "", lambda m: tables.good(m.health.good)),
        ],
        virtual=any(m.virtual for m, _, _ in rows),
    )  # fmt: skip
    show_table(table, console)
    for motion, path, judged in rows:
        if not motion.health.good:
            say(console, f"{motion.trial}: {motion.health.verdict}", "yellow")
        for j in judged or ():
            say(console, f"{motion.trial}: {_against_reference(j)}")
        say(console, f"{motion.trial}: {path}", "dim")


def _against_reference(judged: Judgement) -> str:
    """Say in one sentence how an estimate, or the wheels where there is none, meets the reference."""
    unit = "m/s" if judged.quantity == "velocity" else "m"
    wheels = f"wheels alone {significant(judged.rmse_wheels, 2)} {unit}"
    slip = f"apparent slip {significant(100 * judged.slip, 3)} % by the reference's way"
    known = math.isfinite(judged.rmse_wheels) and math.isfinite(judged.slip)
    if not math.isfinite(judged.rmse):
        return f"{judged.quantity} of the wheels against the reference: " + (
            f"{slip}, rms difference {significant(judged.rmse_wheels, 2)} {unit}" if known else "unknown"
        )
    return (
        f"{judged.quantity} against the reference: rms error {significant(judged.rmse, 2)} {unit}, mean "
        f"{significant(judged.bias, 2)} {unit}"
        + (f", {wheels}, {slip}" if known else "")
        + f"; within ±2σ {significant(100 * judged.coverage, 2)} % of {judged.samples} samples"
    )


def show_k92_fits(fits: Sequence[K92Fit], console: Console, *, notes: bool = False) -> None:
    """Print k_92 of each trial by steady slip and by trajectory, and the notes of the fits if asked to."""
    show_table(tables.k92_table(fits), console)
    said = shared([(fit.trial, fit.notes) for fit in fits])
    for note in said if notes else ():
        say(console, note, "yellow")
    if said and not notes:
        say(console, f"{len(said)} notes of the fits: --verbose lists them", "dim")


def show_a_theta(fit: AThetaFit, console: Console) -> None:
    """Print a_θ beside the paper's and the laws that compete with it."""
    _answers([decide.law_answer(fit)], console)
    if fit.laws:
        table = tables.law_table(fit, False)
        show_table(table, console)
        say(console, table.caption)
    for note in fit.notes:
        say(console, note, "yellow")


def show_misfits(comparisons: Sequence[Comparison], console: Console) -> None:
    """Print the difference of simulation and measurement by quantity, over all trials."""
    judged = decide.channels_of(gaps(comparisons))
    virtual = any(c.motion.virtual for c in comparisons)
    show_table(tables.channel_table(judged, virtual), console, only=SHORT)


SHORT = ("quantity", "verdict", "difference, rms", "noise", "largest value")


def show_finding(
    finding: Finding, console: Console, folder: str = "", model: Path | str | None = None
) -> None:
    """Print the answers of a search and its tables; arguments as in `show_study`."""
    decided = decide.of_search(finding, model, folder)
    if finding.virtual and not finding.effects:
        say(console, f"{VIRTUAL}.", "yellow")
    _answers(decided.questions, console)
    for title, effects in (("missing", finding.effects), ("small", finding.small)):
        if effects:
            console.print()
            say(console, f"{title} effect{'s' if len(effects) > 1 else ''}", "bold")
            table = tables.effects_table(finding, {}, effects, small=title == "small")
            show_table(table, console, only=("effect", "number", "value ± std", "probability"))
    if latency := latency_in_words(finding.latency):
        say(console, f"{latency}.")
    for trial, reason in finding.dropped:
        say(console, f"left out: {trial}: {reason}", "red")
    for note in finding.notes:
        say(console, f"note: {in_plain_words(note, finding)}", "yellow")
