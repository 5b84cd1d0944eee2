"""From a study or a search to a report: which answers, figures and tables stand where."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Iterator, Mapping, Sequence
from importlib import metadata
from pathlib import Path

from granite_lab.discovery.finding import Finding
from granite_lab.effects import library
from granite_lab.model.effect import Effect
from granite_lab.parameters import load_paper
from granite_lab.reporting import answers as decide
from granite_lab.reporting import plot_motion, plot_quality, plot_results, plot_search, tables
from granite_lab.reporting.answers import Answers
from granite_lab.reporting.budgets import budget_tables
from granite_lab.reporting.content import Source, StudyResult
from granite_lab.reporting.document import Block, Code, Fold, Gallery, Listing, Report, Section, Words
from granite_lab.reporting.figures import Figure
from granite_lab.reporting.names import in_plain_words, latency_in_words, law_formulas, percent, shared
from granite_lab.reporting.summary import Gap, gaps

OPEN_SPEEDS = 4
"""So many time histories stand open; of more speeds the slowest and fastest do."""

LONGEST = 1000
"""So many characters of a command are shown: where logs were named one by one, it may have no end."""

LIBRARIES = ("numpy", "scipy", "casadi", "matplotlib")

LAW_NOTE = (
    "The empirical law describes the disagreement; it is no physics and holds for trials like these only. "
    "v: speed of the robot; s: slip ratio of the wheel; x and t: distance and time since the start; θ: "
    "angle of the wheel; z: its sinkage."
)


def study_report(
    result: StudyResult,
    *,
    model: Path | str | None = None,
    effects: Mapping[str, Effect] | None = None,
    folder: str = "",
) -> Report:
    """Lay out the report of a study.

    Args:
        result: the study.
        model: path of the model file with what was found, as the report names it.
        effects: candidates of the search by id; those of the package by default.
        folder: of the report, as its commands name it.
    """
    decided = decide.of_study(result, model, folder)
    paper, found = load_paper(), gaps([r.comparison for r in result.trials])
    sections: list[Section] = []
    if result.trials:
        virtual = bool(decided.virtual)
        sections += [
            Section("slip", "Slip and k_92", (
                Gallery((
                    plot_results.slip_figure(decided, paper),
                    plot_results.k92_figure(decided, result.a_theta, paper),
                )),
                *_more("k_92 over slip, and laws compared", [
                    Gallery((plot_results.k92_over_slip(decided, result.a_theta, paper),)),
                    *([tables.law_table(result.a_theta, virtual)] if result.a_theta else []),
                    *_listing(result.a_theta.notes if result.a_theta else ()),
                ]),
                *_more("Uncertainty budgets", budget_tables(result, decided.speeds)),
            )),
            Section("model", "Model and measurement", tuple(_model(decided, found))),
        ]  # fmt: skip
    if result.finding is not None:
        sections.append(Section("missing", "What is missing", tuple(_missing(result.finding, effects))))
    if result.trials:
        sections.append(Section("trials", "Quality of the trials", tuple(_quality(result))))
    sections.append(_provenance(result.source, decided.steps[1:]))
    failures = [f"{f.trial}: {f.message}" + (f" ({f.hint})" if f.hint else "") for f in result.failures]
    if failures and not result.trials:
        sections.insert(0, Section("trials", "Trials that could not be used", (Listing(tuple(failures)),)))
    return Report(
        result.name, "Report of a study", decided, tables.slip_table(decided) if decided.speeds else None,
        tuple(sections),
    )  # fmt: skip


def search_report(
    finding: Finding,
    name: str,
    source: Source,
    *,
    model: Path | str | None = None,
    effects: Mapping[str, Effect] | None = None,
    folder: str = "",
) -> Report:
    """Lay out the report of a search for the missing effect.

    Args:
        finding: the record.
        name: of the report.
        source: where it comes from.
        model, effects, folder: as in `study_report`.
    """
    decided = decide.of_search(finding, model, folder or name)
    sections = (
        Section("missing", "What is missing", tuple(_missing(finding, effects))),
        _provenance(source, decided.steps[1:]),
    )
    return Report(
        name, "Report of a search for a missing effect", decided, None, sections, "finding.json",
    )  # fmt: skip


def candidates_of(finding: Finding, effects: Mapping[str, Effect] | None) -> dict[str, Effect]:
    """Return the candidates by id, those of the package where none are given."""
    return dict(library() if effects is None else effects) | {a.effect.id: a.effect for a in finding.active}


def _more(title: str, blocks: Sequence[Block | None]) -> tuple[Fold, ...]:
    """Return a fold with the blocks that are there; nothing without any."""
    there = tuple(b for b in blocks if b is not None)
    return (Fold(title, there),) if there else ()


def _gallery(*figures: Figure | None) -> list[Block]:
    there = tuple(f for f in figures if f is not None)
    return [Gallery(there)] if there else []


def _listing(lines: Sequence[str]) -> list[Block]:
    return [Listing(tuple(lines))] if lines else []


def _model(
    decided: Answers, found: dict[tuple[str, str], Gap]
) -> Iterator[Block]:  # fmt: skip
    virtual = bool(decided.virtual)
    drawn = [plot_motion.motion_figure(s) for s in decided.speeds]
    half = OPEN_SPEEDS // 2
    few = len(drawn) <= OPEN_SPEEDS
    shown, rest = (drawn, []) if few else ([*drawn[:half], *drawn[-half:]], drawn[half:-half])
    yield Words(
        "Blue: measured; orange: simulated, with k_92 fitted to the slip of the trial and all else from "
        "the parameter files. Grey: the steady part of the motion, over which λ_R is taken. Bands: ±2σ of "
        "the measurement. Triangles: a spike leaves the panel."
    )
    misfit = plot_quality.misfit_figure(found, decided.channels, virtual)
    fills = len(shown) % 2 == 1  # the second place of the last row
    yield from _gallery(*shown, misfit if fills else None)
    yield tables.channel_table(decided.channels, virtual)
    yield from _more("Differences by phase", [
        *_gallery(*rest, None if fills else misfit),
        tables.misfit_table(found, virtual) if found else None,
    ])  # fmt: skip


def _missing(finding: Finding, effects: Mapping[str, Effect] | None) -> Iterator[Block]:
    known = candidates_of(finding, effects)
    yield Words(
        "The model is fitted to the readings of the sensors, together with the sand of each trial, the "
        "time offset of the IMU, and offsets and gains of the sensors, so that none of these can pass for "
        "a missing effect. What all repetitions of a command share and no parameter explains is held "
        f"against each candidate effect. Differences up to {percent(finding.tolerance)} of a sensor's rms "
        "are tolerated."
    )
    yield from _gallery(plot_search.gap_figure(finding), plot_search.candidates_figure(finding))
    if finding.effects:
        yield tables.effects_table(finding, known, finding.effects)
    formulas = law_formulas(finding)
    if formulas:
        yield Words(LAW_NOTE)
        yield Listing(formulas)
    latency = latency_in_words(finding.latency)
    notes = [in_plain_words(note, finding) for note in (*finding.provisional, *finding.notes)]
    dropped = [f"{trial} is in no fit: {reason}" for trial, reason in finding.dropped]
    yield from _listing([*notes, *dropped, *([f"{latency}."] if latency else ()), *finding.failures])
    yield from _more("When the model disagrees, sensor by sensor", [
        *_gallery(plot_search.intervals_figure(finding), *plot_search.history_figures(finding)),
        tables.gaps_table(finding),
    ])  # fmt: skip
    yield from _more(
        "Prediction of trials and speeds left out of the fit",
        _gallery(plot_search.held_out_figure(finding)),
    )
    yield from _more("Candidates, and what these trials could have shown of them", [
        tables.candidates_table(finding, known) if finding.candidates else None,
        tables.effects_table(finding, known, finding.small, small=True) if finding.small else None,
        tables.detectable_table(finding, known) if finding.detectable else None,
        tables.confusion_table(finding),
    ])  # fmt: skip
    yield from _more("Sand and sensors, as fitted", [tables.fitted_table(finding)])


def _quality(result: StudyResult) -> Iterator[Block]:
    n = len(result.trials)
    doubtful = [r for r in result.trials if not r.comparison.motion.health.good]
    text = f"All {n} estimates of the motion are good." if n > 1 else "The estimate of the motion is good."
    if doubtful:
        text = f"{n - len(doubtful)} of {n} estimates of the motion are good. Exceptions:"
    yield Words(f"{text} Good: velocity is fixed at both ends and the measurements agree with their noise.")
    yield from _listing([f"{r.trial.name}: {r.comparison.motion.health.verdict}" for r in doubtful])
    failed = [f"{f.trial}: {f.message}" + (f" ({f.hint})" if f.hint else "") for f in result.failures]
    if failed:
        yield Words("Trials that could not be used:")
        yield Listing(tuple(failed))
    warnings = shared(
        [(r.trial.name, (*r.trial.warnings, *r.comparison.motion.warnings)) for r in result.trials]
    )
    if warnings:
        yield Words("Warnings:")
        yield Listing(warnings)
    yield from _more("Results of each trial", [tables.trial_table(result)])
    drawn = tuple(plot_quality.health_figure(r.comparison.motion, i) for i, r in enumerate(result.trials, 1))
    yield from _more("Checks of each estimate", [Gallery(drawn)])


def _provenance(source: Source, steps: Sequence[str]) -> Section:
    blocks = [
        *([Words("Further steps:"), Listing(tuple(steps))] if steps else ()),
        Words(f"Made by {made_by(source)}. This command repeats it:"),
        Code(_shortened(source.command)),
        *_more("Parameters in force", [tables.parameter_table(source)] if source.parameters else []),
        *_more("Files that were read", [tables.input_table(source)] if source.inputs else []),
    ]
    return Section("provenance", "How to repeat this", tuple(blocks))


def today() -> str:
    """Return the date of today, ISO 8601, which SOURCE_DATE_EPOCH overrides."""
    return time.strftime("%Y-%m-%d", time.gmtime(int(os.environ.get("SOURCE_DATE_EPOCH", time.time()))))


def made_by(source: Source) -> str:
    """Return version, code, libraries and the date of today, which SOURCE_DATE_EPOCH overrides."""
    code = f" (code {source.code[:8]})" if source.code else ""
    libraries = ", ".join(f"{name} {metadata.version(name)}" for name in LIBRARIES)
    return f"granite-lab {source.version}{code} on {today()}, Python {platform.python_version()}, {libraries}"


def _shortened(command: str) -> str:
    """Return a command of bearable length: its start, and its end with the options."""
    if len(command) <= LONGEST:
        return command
    return f"{command[: LONGEST // 2]} … {command[-LONGEST // 2 :]} (shortened)"
