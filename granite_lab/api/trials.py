"""`fit_k92`, `fit_a_theta`, `compare`, `study`, `discover`, `plan_next`: the model held against trials."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from granite_lab import fitting, reporting
from granite_lab.api.arguments import (
    Changes,
    Exclude,
    File,
    Logs,
    Rests,
    Topics,
    Window,
    execution_of,
    options_of,
    path,
    refuse_outside,
)
from granite_lab.api.project import choose
from granite_lab.api.records import Records
from granite_lab.chain import analyse, find_effect, over_trials, source_of, with_simulation_input
from granite_lab.comparison.compare import Comparison
from granite_lab.discovery.finding import DESIGN, MODEL, Finding
from granite_lab.effects import library
from granite_lab.errors import InputError, UsageError
from granite_lab.estimate import Estimate
from granite_lab.files import refuse_special
from granite_lab.fitting.fit import AThetaFit, K92Fit
from granite_lab.folders import files_of
from granite_lab.inference.constants import LATENCY_LIMIT, TOLERANCE
from granite_lab.options import Options
from granite_lab.origin import NOWHERE, Origin, Written
from granite_lab.processes import Progress
from granite_lab.results import RECORDINGS, StudyResult, of_search
from granite_lab.running import Execution, each_trial, split_failures
from granite_lab.running.cache import code, digest_of, fingerprint
from granite_lab.running.codec import content, encode
from granite_lab.running.output import Guard, locked

if TYPE_CHECKING:
    from granite_lab.planning.plan import Plan

PAGES = ("index.html", "report.md")
"""Files of every report; where a file of the user has such a name, the command ends before any work."""

Done = Callable[[Path], None]


def _analysed(
    command: str, logs: Logs, options: Options, execution: Execution, strict: bool, done: Done
) -> tuple[list[Comparison], Origin]:
    """Return the trials that passed the chain, with source, failures and warnings of all."""
    chosen = choose(logs, options)
    outcomes = each_trial(analyse, chosen.files, chosen.options, execution=execution, done=done)
    results, failed = split_failures(chosen.files, outcomes, strict=strict)
    lines = [f"{r.trial.name}: {line}" for r in results for line in r.motion.warnings]
    source = source_of(command, chosen.files, [r.trial for r in results], chosen.options)
    return results, Origin(source, (*chosen.excluded, *failed), (*lines, *execution.doubts()))


def fit_k92(
    logs: Logs,
    *,
    robot: File = None, soil: File = None, column_map: File = None, topics: Topics = None,
    window: Window = None, changes: Changes = None,
    rests: Rests = (), body_rests: Rests = (), distance_measured: Estimate | None = None,
    use_reference: bool = False, ref_v_std: float | None = None, ref_x_std: float | None = None,
    drive: str = "auto", model: File = None, effects: File = None,
    strict: bool = False, jobs: int = 0, scheduler: str | None = None, cache: bool = True,
    done: Done = lambda _: None,
) -> Records[K92Fit]:  # fmt: skip
    """Fit k_92 of each trial: by the steady slip ratio, as in the paper, and by the whole trajectory.

    Args:
        logs: paths of logs, or of folders with logs.
        robot, soil, column_map, topics, window, changes: options on the logs, as in `ingest`.
        rests, body_rests, distance_measured, use_reference, ref_v_std, ref_x_std: metadata of the trials,
            as in `ingest`.
        drive: what drives the simulation: "wheels", as they were measured; "command"; or "auto", the command
            where it is stated and the wheels follow it, else the wheels.
        model: file (model.toml) of the paper's model with effects switched on.
        effects: your own effect file (.py). It is executed: use only code you trust.
        strict: a trial that fails is an error; by default it is left out and listed in the result.
        jobs: number of processes; 0 means one per core.
        scheduler: address of a Dask scheduler that does the work.
        cache: store results and reuse those with the same inputs.
        done: called with each path once it is finished.

    Returns:
        one fit a trial; the table has a row for each.

    Raises:
        InputError: a log or file cannot be used.
        EstimateError: an estimate or fit is not possible.
    """
    options = options_of(locals())
    execution = execution_of(jobs, scheduler, cache=cache)
    results, origin = _analysed("fit-k92", logs, options, execution, strict, done)
    return Records([result.fit for result in results], (), origin)


def fit_a_theta(
    logs: Logs | Sequence[K92Fit] = (),
    *,
    published: bool = False,
    robot: File = None, soil: File = None, column_map: File = None, topics: Topics = None,
    window: Window = None, changes: Changes = None,
    exclude: Exclude = None,
    rests: Rests = (), body_rests: Rests = (), distance_measured: Estimate | None = None,
    use_reference: bool = False, ref_v_std: float | None = None, ref_x_std: float | None = None,
    drive: str = "auto", model: File = None, effects: File = None,
    strict: bool = False, jobs: int = 0, scheduler: str | None = None, cache: bool = True,
    done: Done = lambda _: None,
) -> AThetaFit:  # fmt: skip
    """Estimate a_θ of k_92 = exp(-a_θ v) over trials, beside the paper's 4.919 and rival laws.

    Args:
        logs: paths of logs or of folders, or the fits of `fit_k92`.
        published: use Table 3 of the paper instead of trials.
        robot, soil, column_map, topics, window, changes: options on the logs, as in `ingest`.
        exclude: as in `study`.
        rests, body_rests, distance_measured, use_reference, ref_v_std, ref_x_std: metadata of the trials,
            as in `ingest`.
        drive, model, effects, strict, jobs, scheduler, cache, done: as in `fit_k92`.

    Returns:
        the fit; its table has a row for each trial.

    Raises:
        UsageError: both or neither of `logs` and `published`.
        InputError, EstimateError: as in `fit_k92`, or the trials do not allow the fit.
    """
    options = options_of(locals())
    given = [logs] if isinstance(logs, (str, Path)) else list(logs)
    if published:
        if given:
            raise UsageError("--published takes no trials", "leave out one of the two")
        return fitting.published_fit()
    fits, origin = [item for item in given if isinstance(item, K92Fit)], NOWHERE
    if not fits:
        paths = [item for item in given if not isinstance(item, K92Fit)]
        execution = execution_of(jobs, scheduler, cache=cache)
        results, origin = _analysed("fit-atheta", paths, options, execution, strict, done)
        fits = [result.fit for result in results]
    by_name = sorted(fits, key=lambda fit: fit.trial)  # sums do not depend on the order of the logs
    fit = fitting.fit_a_theta(by_name)
    left_out = (f"{failure.trial} left out: {failure.reason}" for failure in origin.left_out)
    return replace(fit, notes=(*fit.notes, *left_out), origin=origin)


def compare(
    logs: Logs,
    *,
    out: File = None,
    robot: File = None, soil: File = None, column_map: File = None, topics: Topics = None,
    window: Window = None, changes: Changes = None,
    rests: Rests = (), body_rests: Rests = (), distance_measured: Estimate | None = None,
    use_reference: bool = False, ref_v_std: float | None = None, ref_x_std: float | None = None,
    drive: str = "auto", model: File = None, effects: File = None,
    strict: bool = False, jobs: int = 0, scheduler: str | None = None, cache: bool = True,
    done: Done = lambda _: None,
) -> Records[Comparison]:  # fmt: skip
    """Compare measured and simulated motion: velocity, wheel speed, slip, torques and pitch.

    Args:
        logs: paths of logs, or of folders with logs.
        out: folder for tables and figures; without it nothing is written.
        robot, soil, column_map, topics, window, changes: options on the logs, as in `ingest`.
        rests, body_rests, distance_measured, use_reference, ref_v_std, ref_x_std: metadata of the trials,
            as in `ingest`.
        drive, model, effects, strict, jobs, scheduler, cache, done: as in `fit_k92`.

    Returns:
        one comparison a trial; the table has a row for each trial, channel and phase.

    Raises:
        InputError, EstimateError: as in `fit_k92`.
        LabError: a file cannot be written.
    """
    options = options_of(locals())
    execution = execution_of(jobs, scheduler, cache=cache)
    results, origin = _analysed("compare", logs, options, execution, strict, done)
    if out is not None:
        files = tuple(reporting.write_comparison(results, Path(out)))
        origin = replace(origin, written=Written(files=files))
    return Records(results, [result.trial.name for result in results], origin)


def study(
    logs: Logs,
    *,
    out: File = None, discover: bool = True, recordings: bool = True,
    robot: File = None, soil: File = None, column_map: File = None, topics: Topics = None,
    window: Window = None, changes: Changes = None,
    exclude: Exclude = None,
    rests: Rests = (), body_rests: Rests = (), distance_measured: Estimate | None = None,
    use_reference: bool = False, ref_v_std: float | None = None, ref_x_std: float | None = None,
    drive: str = "auto", model: File = None, effects: File = None,
    tolerance: float = TOLERANCE, latency: float = LATENCY_LIMIT,
    strict: bool = False, jobs: int = 0, scheduler: str | None = None, cache: bool = True,
    done: Done = lambda _: None, progress: Progress = lambda *_: None,
) -> StudyResult:  # fmt: skip
    """Analyse trials: estimate, fit, simulate, compare, a_θ, and the missing effect.

    A trial that cannot be used is left out and listed with the reason.

    Args:
        logs: paths of logs, or of folders with logs.
        out: folder for the report; without it nothing is written. A report that is there already, of the
            same logs by the same code, is kept.
        discover: search for an effect that the model lacks.
        recordings: also write a Rerun recording of each trial into `out`.
        robot, soil, column_map, topics, window, changes: options on the logs, as in `ingest`.
        exclude: trials to leave out, by the names of their logs without the ending, and why, as
            ``{"run04": "a wheel hit a stone"}``.
        rests, body_rests, distance_measured, use_reference, ref_v_std, ref_x_std: metadata of the trials,
            as in `ingest`.
        drive, model, effects, strict, jobs, scheduler, cache, done: as in `fit_k92`.
        tolerance, latency: as in `discover`.
        progress: called with what is done, how many steps of it are done, and of how many at most; 0 where
            that is not known.

    Returns:
        the results; the table has a row for each trial. `written` lists the files, and what could not be
        written.

    Raises:
        LabError: no trial went through, or the folder cannot be written.
    """
    options = options_of(locals())
    execution, folder = execution_of(jobs, scheduler, cache=cache), path(out)
    chosen = choose(logs, options)
    with locked(folder, PAGES) if folder else nullcontext():
        result = over_trials(
            chosen.files, chosen.options, execution=execution,
            discover=discover, strict=strict, done=done, progress=progress,
        )  # fmt: skip
        result = replace(result, failures=(*result.failures, *chosen.excluded))
        if folder is not None:
            result = replace(result, name=folder.name)
            result = _write(result, chosen.options, folder, execution, recordings, progress)
    import granite_lab.reporting.render  # noqa: F401, PLC0415, heavy: how a notebook shows the result

    return replace(result, warnings=execution.doubts())


def _write(
    result: StudyResult,
    options: Options,
    folder: Path,
    execution: Execution,
    recordings: bool,
    progress: Progress,
) -> StudyResult:
    """Write a study into its folder, unless all of it is there already."""
    from granite_lab.study_folder import record as record_trials  # noqa: PLC0415, heavy
    from granite_lab.study_folder import write  # noqa: PLC0415, heavy

    cache, jobs, guard = execution.cache, execution.jobs, Guard(folder)
    # A recording has an id of its own: the same study in another folder is not the same files.
    place = str(folder.resolve())
    key = digest_of(code(shows=True), content(result), content(options), recordings, place)
    hashes: dict[str, str] | None = cache.get(key) if cache is not None else None
    if hashes and all(fingerprint(folder / name) == sha for name, sha in hashes.items()):
        model = folder / MODEL if MODEL in hashes else None
        return replace(result, written=Written(folder / "index.html", model, unchanged=True))
    if recordings:
        recorded = folder / RECORDINGS
        guard.run("recordings", lambda: record_trials(result, recorded, jobs=jobs, progress=progress))
    progress("report", 0, 0)
    result = write(result, options, folder, failures=guard.lines, jobs=jobs)
    if cache is not None and not result.written.failures:
        hashes = {file.relative_to(folder).as_posix(): fingerprint(file) for file in files_of(folder)}
        cache.put(key, encode(((), hashes)))
    return result


def record(result: StudyResult, folder: str | Path) -> tuple[Path, ...]:
    """Write a Rerun recording of each trial of a study; return their paths.

    Args:
        result: the study.
        folder: of the recordings.

    Raises:
        LabError: a file cannot be written.
    """
    from granite_lab.study_folder import record as record_trials  # noqa: PLC0415, heavy

    return tuple(record_trials(result, Path(folder)))


def report(result: StudyResult, folder: str | Path) -> Path:
    """Write the report of a study; return its first page.

    Args:
        result: the study.
        folder: of the report.

    Raises:
        LabError: a file cannot be written.
    """
    model = MODEL if result.finding is not None else None
    return reporting.write_report(result, Path(folder), model=model)


def discover(
    logs: Logs,
    *,
    out: File = None,
    robot: File = None, soil: File = None, column_map: File = None, topics: Topics = None,
    window: Window = None, changes: Changes = None,
    exclude: Exclude = None,
    rests: Rests = (), body_rests: Rests = (), distance_measured: Estimate | None = None,
    use_reference: bool = False, ref_v_std: float | None = None, ref_x_std: float | None = None,
    drive: str = "auto", effects: File = None,
    tolerance: float = TOLERANCE, latency: float = LATENCY_LIMIT,
    strict: bool = False, jobs: int = 0, scheduler: str | None = None, cache: bool = True,
    progress: Progress = lambda *_: None,
) -> Finding:  # fmt: skip
    """Find the physical effect that the model lacks.

    Args:
        logs: paths of logs, or of folders with logs; all of one robot on one soil.
        out: folder for the report, finding.json, design.json (for `plan_next`) and model.toml; without it
            nothing is written.
        robot, soil, column_map, topics, window, changes: options on the logs, as in `ingest`.
        exclude: as in `study`.
        rests, body_rests, distance_measured, use_reference, ref_v_std, ref_x_std: metadata of the trials,
            as in `ingest`.
        tolerance: accepted discrepancy, as a share of a channel's rms in motion.
        latency: largest delay between the stamps of two sensors that counts as latency [s].
        drive, effects, strict, jobs, scheduler, cache: as in `fit_k92`.
        progress: called with what is done, how many steps of it are done, and of how many at most; 0 where
            that is not known.

    Returns:
        the finding; its table has a row for each candidate. Its `failures` list what could not be written.

    Raises:
        InputError: a log cannot be used, or no command is stated.
        EstimateError: a trial has no sensor to compare with, or the simulation fails.
    """
    options = options_of(locals())
    execution, folder = execution_of(jobs, scheduler, cache=cache), path(out)
    chosen = choose(logs, options)
    options = chosen.options

    def ahead(_: Path) -> None:  # import while other processes work on the trials
        import granite_lab.study_folder  # noqa: F401, PLC0415, heavy

    outcomes = each_trial(with_simulation_input, chosen.files, options, execution=execution, done=ahead)
    from granite_lab.study_folder import write  # noqa: PLC0415, heavy

    read, failed = split_failures(chosen.files, outcomes, strict=strict)
    left_out = (*chosen.excluded, *failed)
    trials, motions = [trial for trial, _, _ in read], [motion for _, _, motion in read]
    finding = find_effect(trials, options, motions=motions, execution=execution, progress=progress)
    notes = (*finding.notes, *(f"{failure.trial} left out: {failure.message}" for failure in left_out))
    lines = tuple(f"{trial.name}: {line}" for trial in trials for line in trial.warnings)
    origin = Origin(source_of("discover", chosen.files, trials, options), left_out, lines)
    finding = replace(finding, notes=notes, origin=origin)
    if folder is not None:
        progress("writing the report", 0, 0)
        with locked(folder, PAGES):
            searched = list(zip(trials, motions, strict=True))
            result = write(of_search(finding, folder), options, folder, searched, jobs=execution.jobs)
        finding = result.finding or finding
        origin = replace(origin, written=result.written)
    return replace(finding, origin=replace(origin, warnings=(*lines, *execution.doubts())))


def plan_next(
    folder: str | Path,
    *,
    room: float | None = None,
    max_speed: float | None = None,
    effects: File = None,
    jobs: int = 0,
    progress: Progress = lambda *_: None,
) -> Plan:
    """Propose the most useful next trial.

    Args:
        folder: folder written by `discover` or `study`.
        room: longest distance that fits on the sand [m], 0.1 or more; by default the longest so far.
        max_speed: fastest command [m/s], 0.02 or more; by default 1.25 times the fastest so far.
        effects, jobs: as in `fit_k92`.
        progress: called with what is done, how many trials are looked at, and of how many.

    Returns:
        the proposals; the table has a row for each.

    Raises:
        InputError: the folder holds no search.
        UsageError: a named effect is neither in the library nor in the effect file.
        EstimateError: the trials at hand cannot be simulated.
    """
    refuse_outside("room", room, 0.1)
    refuse_outside("max-speed", max_speed, 0.02)
    refuse_outside("jobs", jobs, 0)
    refuse_special(Path(folder))
    design = Path(folder) / DESIGN
    if not design.is_file():
        raise InputError(
            f"{folder}: holds no search for a missing effect ('{DESIGN}' is missing)",
            f"run 'granite-lab discover TRIALS… --out {folder}', or 'study' without --no-discover, first; "
            "plans are made from trials whose command is a trapezoid",
        )
    from granite_lab.planning.design import load_design  # noqa: PLC0415, heavy
    from granite_lab.planning.plan import plan_next as rank  # noqa: PLC0415, heavy

    return rank(
        load_design(design), library(effects),
        room=room, max_speed=max_speed, jobs=jobs or os.cpu_count() or 1, progress=progress,
    )  # fmt: skip
