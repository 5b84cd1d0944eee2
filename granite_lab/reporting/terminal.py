"""What commands print at their end: tables that fit 80 columns, colours only on a terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.text import Text

from granite_lab.comparison.record import Comparison
from granite_lab.estimation.judgement import Judgement
from granite_lab.estimation.motion import Motion
from granite_lab.fitting.fit import AThetaFit, K92Fit
from granite_lab.parameters import load_paper
from granite_lab.reporting import answers
from granite_lab.reporting.content import StudyResult
from granite_lab.reporting.discovery.answers import missing_answer
from granite_lab.reporting.document import Answer
from granite_lab.reporting.grid import TONES, grid, row_of, say
from granite_lab.reporting.listings import show_effect, show_effects, show_inspection, show_parameters
from granite_lab.reporting.rounding import interval, plus_minus, shown_as, significant, tidy_unit
from granite_lab.reporting.study_tables import STATUS
from granite_lab.reporting.summary import NOISE, PHASES, VISIBLE, by_speed, gaps

__all__ = [
    "show_a_theta",
    "show_effect",
    "show_effects",
    "show_inspection",
    "show_k92_fits",
    "show_misfits",
    "show_motions",
    "show_parameters",
    "show_study",
]

VIRTUAL = "virtual data: written by a simulator"


def show_study(result: StudyResult, console: Console) -> None:
    """Print the answers of a study: slip and k_92 per speed beside the paper, then the verdicts."""
    speeds = by_speed(result, load_paper())
    found = gaps([r.comparison for r in result.trials], wheels_as_one=True)
    say(console, answers.lead(result, speeds))
    if result.virtual:
        say(console, f"{VIRTUAL}.", "yellow")
    table = grid(
        "speed\n[m/s]", "slip\n[%]", "95 %\n[%]", "paper\n[%]", "model\n[%]", "\nk_92", "\npaper", "\ntrials"
    )  # fmt: skip
    for s in speeds:
        table.add_row(
            *row_of(
                f"{s.velocity:g}", significant(100 * s.slip.value),
                interval(s.slip.low, s.slip.high, scale=100),
                significant(100 * s.published.slip_measured) if s.published else "–",
                significant(100 * s.simulated), plus_minus(s.k92.estimate),
                f"{s.published.k92:g}" if s.published else "–", str(s.slip.count),
            )
        )  # fmt: skip
    console.print(table)
    _answer(console, answers.law_answer(result.a_theta))
    _answer(console, answers.model_answer(found))
    if result.finding is not None:
        _answer(console, missing_answer(result.finding))
    elif result.unsearched:
        _answer(console, answers.missing_answer(found, result.unsearched))
    for failure in result.failures:
        say(console, f"left out: {failure.trial}: {failure.message}", "red")
    doubts = sum(bool(r.trial.warnings or r.comparison.motion.warnings) for r in result.trials)
    if doubts:
        say(
            console,
            f"{doubts} of {len(result.trials)} trials carry warnings; the report lists them.",
            "yellow",
        )


def _answer(console: Console, answer: Answer) -> None:
    line = Text()
    line.append(f"{answer.question} ", "bold")
    if answer.verdict:
        line.append(f"{answer.verdict.capitalize()}. ", TONES.get(answer.tone, ""))
    line.append(answer.text)
    console.print(line)


def show_motions(rows: Sequence[tuple[Motion, Path, Sequence[Judgement] | None]], console: Console) -> None:
    """Print what was estimated of each trial, where its table stands, and how it compares with a "
    "reference."""
    table = grid(
        "trial",
        "speed\n[m/s]",
        "distance\n[m]",
        "slip λ_R\n[%]",
        "wheel stamps\nlate [ms]",
        "filter",
        words=(0, 5),
    )
    for motion, _, _ in rows:
        table.add_row(
            *row_of(
                _name(motion.trial, motion.virtual), significant(motion.variant.velocity),
                plus_minus(motion.distance),
                plus_minus(motion.slip_ratio, scale=100), plus_minus(motion.stamps_late, scale=1e3),
                Text("good", TONES["good"]) if motion.health.good else Text("doubtful", TONES["bad"]),
            )
        )  # fmt: skip
    console.print(table)
    _virtual_note(console, any(motion.virtual for motion, _, _ in rows))
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


def show_k92_fits(fits: Sequence[K92Fit], console: Console) -> None:
    """Print k_92 of each trial, by the steady slip and by the whole trajectory."""
    table = grid(
        "trial",
        "speed [m/s]",
        "λ_R measured\n[%]",
        "simulated\n[%]",
        "k_92 by\nsteady slip",
        "k_92 by\ntrajectory",
        words=(0,),
    )
    for fit in fits:
        table.add_row(
            *row_of(
                _name(fit.trial, fit.virtual), significant(fit.variant.velocity),
                plus_minus(fit.slip_measured, scale=100),
                significant(100 * fit.slip_simulated), _fitted(plus_minus(fit.k92), fit.status),
                _fitted(plus_minus(fit.k92_trajectory), fit.status_trajectory),
            )
        )  # fmt: skip
    console.print(table)
    _virtual_note(console, any(fit.virtual for fit in fits))
    for fit in fits:
        for note in fit.notes:
            say(console, f"{fit.trial}: {note}", "yellow")


def _fitted(text: str, status: str) -> Text:
    return Text(text) if status == "ok" else Text(f"{text} {STATUS[status]}", "yellow")


def show_a_theta(fit: AThetaFit, console: Console) -> None:
    """Print a_θ beside the paper's and the rival laws."""
    _answer(console, answers.law_answer(fit))
    say(
        console,
        f"The paper's way (log-linear least squares): {significant(fit.log_linear, 4)} s/m; on k_92 itself: "
        f"{significant(fit.ordinary, 4)} s/m; scatter between trials: {significant(100 * fit.scatter, 2)} %.",
    )
    if fit.laws:
        table = grid("law", "fitted", "rms", "AICc", "ΔAICc", "weight", words=(0,))
        for law in fit.laws:
            table.add_row(
                *row_of(
                    law.formula, str(law.n_parameters), significant(law.rms, 2), _tenths(law.aicc),
                    _tenths(law.aicc - fit.laws[0].aicc), significant(law.weight, 2),
                )
            )  # fmt: skip
        console.print(table)
        free = next((law for law in fit.laws if law.id == "free"), None)
        if free:
            values = ", ".join(f"{name} = {plus_minus(value)}" for name, value in free.parameters.items())
            say(console, f"Free constants: {values}", "dim")
    for note in fit.notes:
        say(console, note, "yellow")


def _tenths(value: float) -> str:
    return f"{value:.1f}".replace("-", "−") if math.isfinite(value) else "–"


def show_misfits(comparisons: Sequence[Comparison], console: Console) -> None:
    """Print the misfit of each channel in each phase, over all trials; colour says how far beyond the "
    "noise."""
    found = gaps(comparisons, wheels_as_one=True)
    table = grid("rms of the\ndifference", "unit", "all", *PHASES, "all over\nnoise", words=(0, 1))
    for channel in dict.fromkeys(channel for channel, _ in found):
        cells = [found.get((channel, phase)) for phase in ("all", *PHASES)]
        known = next(g for g in cells if g is not None)
        unit, scale = shown_as(known.unit)
        whole = cells[0].normalised if cells[0] else math.nan
        table.add_row(
            *row_of(
                known.name, tidy_unit(unit),
                *(Text("–") if g is None else Text(significant(g.rms * scale, 2),
                _tone(g.normalised)) for g in cells),
                Text(significant(whole, 2), _tone(whole)),
            )
        )  # fmt: skip
    console.print(table)
    _virtual_note(console, any(c.motion.virtual for c in comparisons))


def _tone(normalised: float) -> str:
    if not math.isfinite(normalised):
        return ""
    return TONES["good"] if normalised <= NOISE else TONES["fair"] if normalised <= VISIBLE else TONES["bad"]


def _name(trial: str, virtual: bool) -> str:
    return f"{trial}*" if virtual else trial


def _virtual_note(console: Console, virtual: bool) -> None:
    if virtual:
        say(console, f"* {VIRTUAL}", "yellow")
