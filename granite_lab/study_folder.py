"""A study in its folder: the report, the recordings, and the model with what was found."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from granite_lab import __version__, reporting
from granite_lab.chain import names_of
from granite_lab.discovery.finding import DESIGN, MODEL, Finding
from granite_lab.effects import library
from granite_lab.effects.model_file import FittedEffect, ModelFile, save_model
from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Motion
from granite_lab.files import write_text
from granite_lab.folders import replacing
from granite_lab.logs.trial import Trial
from granite_lab.options import Options
from granite_lab.origin import Written
from granite_lab.parameters import Course, load_robot
from granite_lab.processes import Progress, forked_map
from granite_lab.results import StudyResult, recordings_of
from granite_lab.running.output import Guard


def write(
    result: StudyResult,
    options: Options,
    folder: Path,
    searched: Sequence[tuple[Trial, Motion]] = (),
    failures: Sequence[str] = (),
    jobs: int = 1,
) -> StudyResult:
    """Write the report of a study and the model with what was found; return the study with the written files.

    A part that fails costs nothing of the others.

    Args:
        result: the study; one without trials for a search alone.
        options: of it.
        folder: to write into.
        searched: trials of a search alone, with their motion.
        failures: what could not be written before.
        jobs: number of processes that draw figures.
    """
    guard, model = Guard(folder), None
    library(options.effects)  # the report takes words from the user's own effects, too
    finding = result.finding
    if finding is not None:
        pairs = searched or [(r.trial, r.motion) for r in result.trials]
        model = save_finding(finding, options, pairs, guard)
    name = model.name if model and result.trials else model

    def complete() -> StudyResult:
        whole = finding and replace(finding, failures=(*finding.failures, *guard.lines))
        return replace(result, finding=whole)

    page = guard.run("report", lambda: reporting.write_report(complete(), folder, model=name, jobs=jobs))
    if page is None and (unshown := complete().finding):
        guard.run("finding", lambda: reporting.write_finding(unshown, folder, name))
        if result.trials:
            unsearched = "the search could not be shown; see finding.json"
            without_search = replace(result, finding=None, unsearched=unsearched)
            page = guard.run("rest", lambda: reporting.write_report(without_search, folder))
    return replace(complete(), written=Written(page, model, failures=(*failures, *guard.lines)))


def record(
    result: StudyResult,
    folder: Path,
    *,
    jobs: int = 1,
    progress: Progress = lambda *_: None,
) -> list[Path]:
    """Write a Rerun recording of each trial.

    Args:
        result: the study.
        folder: of the recordings.
        jobs: as in `processes.forked_map`.
        progress: told what is written, how many are, and of how many.

    Raises:
        LabError: a file cannot be written.
    """
    names = recordings_of(result)
    with replacing(folder, "recordings") as new:
        paths = [new / name for name in names]
        done = forked_map(_record, (result, paths), len(paths), "wrote recordings", jobs=jobs)
        for k, _ in enumerate(done, 1):
            progress("recordings", k, len(paths))
    return [folder / name for name in names]


def _record(given: tuple[StudyResult, Sequence[Path]], k: int) -> None:
    """Write the recording of trial number `k`."""
    result, paths = given
    reporting.recording.record_trial(result.trials[k], paths[k], finding=result.finding)


def save_finding(
    finding: Finding, options: Options, pairs: Sequence[tuple[Trial, Motion]], guard: Guard
) -> Path | None:
    """Write the likeliest model as fitted, and beside it what a plan needs.

    The motions of the trials know what was commanded. Returns the path of the model file, None where it could
    not be written.
    """
    from granite_lab.planning.design import save_design  # noqa: PLC0415, a defect there is guarded

    trials = [trial for trial, _ in pairs]
    saved = guard.run("model", lambda: save_model_of(finding, options, trials, guard.folder))
    commanded = [(trial, motion.variant) for trial, motion in pairs]
    trapezoids = [(trial, variant) for trial, variant in commanded if not isinstance(variant, Course)]

    def design() -> None:
        with replacing(guard.folder, "design") as new:
            save_design(finding, trapezoids, new / DESIGN)

    def tracebacks() -> None:
        with replacing(guard.folder, "tracebacks") as new:
            if finding.tracebacks:
                write_text(new / "failure-search.txt", "\n".join(finding.tracebacks))

    if trapezoids:
        guard.run("design", design)
    guard.run("tracebacks", tracebacks)
    return saved


def save_model_of(finding: Finding, options: Options, trials: Sequence[Trial], folder: Path) -> Path:
    """Write the likeliest model: sand and a_θ that all trials share, and every term of it."""
    std = {(e.id, p.name): p.estimate.std for e in (*finding.small, *finding.terms) for p in e.parameters}
    twins = {e.id: e.twins for e in finding.effects}
    fitted = []
    for item in finding.active:
        values = {name: Estimate(v, std.get((item.id, name), math.nan)) for name, v in item.as_dict().items()}
        fitted.append(FittedEffect(item.effect, values, twins.get(item.id, ())))
    files = sorted((file.path.name, file.sha256) for t in trials for file in t.inputs)
    provenance = {
        "version": __version__,
        "verdict": finding.verdict,
        "virtual": finding.virtual,
        "inputs": [f"{name} sha256 {sha}" for name, sha in files],
    }
    sand = finding.fitted_sand
    law = sand.pop("a_theta")
    robot, soil = names_of(trials, options)
    lugs, changes = finding.robot.wheels.lugs, trials[0].info.changes
    model = ModelFile(
        robot, soil, "exponential", law, tuple(fitted), provenance, sand,
        lugs if lugs != load_robot(robot, changes=changes).wheels.lugs else None, changes,
    )  # fmt: skip
    with replacing(folder, "model") as new:
        save_model(model, new / MODEL)
    return folder / MODEL
