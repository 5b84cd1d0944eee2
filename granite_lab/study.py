"""The chain itself: log, estimate, fit, simulate, compare; then over all trials."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar

from granite_lab import __version__
from granite_lab.comparison import compare
from granite_lab.effects.model_file import load_model
from granite_lab.errors import EstimateError, LabError
from granite_lab.estimate import Estimate
from granite_lab.estimation import estimate
from granite_lab.estimation.motion import Motion
from granite_lab.fitting import fit_a_theta, fit_k92
from granite_lab.fitting.fit import AThetaFit
from granite_lab.logs import read_trial
from granite_lab.logs.trial import Trial, TrialInfo
from granite_lab.model.effect import Active
from granite_lab.parameters import Robot, Soil, load_robot, load_soil
from granite_lab.parameters.catalogue import in_force
from granite_lab.reporting.content import Failure, Source, StudyResult, TrialResult

T = TypeVar("T")


@dataclass(frozen=True)
class Options:
    """What a user may say about trials; None leaves it to the log and the catalogue.

    Attributes:
        robot, soil, column_map: names of the catalogue or paths of TOML files.
        imu, encoders, currents, reference: further files of a trial whose sensors were logged apart.
        rows: which rows of the log to take, as ``run_id = 4``.
        model: model.toml with effects to switch on.
        effects: the user's own effect file that the model may need.
        info: metadata that overrides the log's.
        rests: intervals in which the robot stood still (start, end) [s, the log's time].
        distance_measured: total distance by tape measure [m].
        topics: of a bag, what a topic is taken for (imu, joints, odom) and its name.
    """

    robot: str | None = None
    soil: str | None = None
    column_map: str | None = None
    imu: Path | None = None
    encoders: Path | None = None
    currents: Path | None = None
    reference: Path | None = None
    rows: str | None = None
    model: Path | None = None
    effects: Path | None = None
    info: TrialInfo | None = None
    rests: tuple[tuple[float, float], ...] = ()
    distance_measured: Estimate | None = None
    topics: tuple[tuple[str, str], ...] = ()


def ingest(path: Path, options: Options) -> tuple[Trial, Robot, Motion]:
    """Read a log and estimate its motion.

    Raises:
        InputError: the log cannot be used.
        EstimateError: the motion cannot be had from it.
    """
    trial = read_trial(
        path,
        imu=options.imu,
        encoders=options.encoders,
        currents=options.currents,
        reference=options.reference,
        rows=options.rows,
        map=options.column_map,
        robot=options.robot,
        info=options.info,
        topics=dict(options.topics),
    )
    robot = load_robot(options.robot or trial.info.robot or "granite")
    motion = estimate(trial, robot, rests=options.rests, distance_measured=options.distance_measured)
    return trial, robot, motion


def analyse(path: Path, options: Options) -> TrialResult:
    """Take one trial through the whole chain.

    Raises:
        LabError: any stage could not do its work; the message says which and why.
    """
    trial, robot, motion = ingest(path, options)
    soil, effects = ground(trial, options)
    fit = fit_k92(motion, trial, robot, soil, effects=effects)
    return TrialResult(trial, compare(motion, trial, fit, robot, soil, effects=effects))


def ground(trial: Trial, options: Options) -> tuple[Soil, tuple[Active, ...]]:
    """Return the soil of a trial and the effects that are switched on."""
    model = load_model(options.model, options.effects) if options.model else None
    soil = options.soil or (model.soil if model else None) or trial.info.soil or "dry_sand"
    return load_soil(soil), model.effects if model else ()


def each_trial(
    work: Callable[[Path, Options], T],
    paths: Sequence[Path],
    options: Options,
    *,
    jobs: int = 0,
    done: Callable[[Path], None] = lambda _: None,
) -> list[T | LabError]:
    """Apply `work` to each trial, in processes, and keep the order of the trials.

    Args:
        work: a module-level function of path and options.
        paths: the logs.
        options: for all of them.
        jobs: number of processes; 0 means one per core, 1 means this process.
        done: called with each path once it is finished.

    Returns:
        results and errors, in the order of `paths`.
    """
    workers = min(jobs or os.cpu_count() or 1, len(paths))
    results: dict[Path, T | LabError] = {}
    if workers <= 1:
        for path in paths:
            results[path] = _guarded(work, path, options)
            done(path)
        return [results[path] for path in paths]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        waiting = {pool.submit(_guarded, work, path, options): path for path in paths}
        try:
            for future in as_completed(waiting):
                results[waiting[future]] = future.result()
                done(waiting[future])
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return [results[path] for path in paths]


def _guarded(work: Callable[[Path, Options], T], path: Path, options: Options) -> T | LabError:
    try:
        return work(path, options)
    except LabError as error:
        return error


def study(
    paths: Sequence[Path],
    name: str,
    options: Options = Options(),
    *,
    jobs: int = 0,
    done: Callable[[Path], None] = lambda _: None,
) -> StudyResult:
    """Run the chain over trials.

    Args:
        paths: the logs.
        name: of the report.
        options: for all of them.
        jobs: number of processes; 0 means one per core.
        done: called with each path once it is finished.

    Raises:
        EstimateError: no trial went through; the message is that of the first.
    """
    outcomes = each_trial(analyse, paths, options, jobs=jobs, done=done)
    trials = tuple(o for o in outcomes if isinstance(o, TrialResult))
    failures = tuple(
        Failure(path.stem, outcome.message, outcome.hint)
        for path, outcome in zip(paths, outcomes, strict=True)
        if isinstance(outcome, LabError)
    )
    if not trials:
        raise next(o for o in outcomes if isinstance(o, LabError))
    return StudyResult(name, trials, failures, over_trials(trials), _source(paths, trials, options))


def over_trials(trials: Sequence[TrialResult]) -> AThetaFit | None:
    """Fit a_θ over trials; None where they do not allow it."""
    try:
        return fit_a_theta([trial.comparison.fit for trial in trials])
    except EstimateError:
        return None


def _source(paths: Sequence[Path], trials: Sequence[TrialResult], options: Options) -> Source:
    first = trials[0]
    rows = in_force(
        options.robot or first.trial.info.robot or "granite", options.soil or first.comparison.run.soil.name
    )
    return Source(
        version=__version__,
        command="granite-lab study " + " ".join(str(path) for path in paths),
        inputs=tuple(file for trial in trials for file in trial.trial.inputs),
        parameters=tuple((f"{p.group}.{p.key}", f"{p.value:g}", p.unit, p.origin) for p in rows),
    )


def record(result: StudyResult, folder: Path, *, done: Callable[[str], None] = lambda _: None) -> list[Path]:
    """Write a Rerun recording of each trial and one of the whole study.

    Raises:
        LabError: a file cannot be written.
    """
    from granite_lab.reporting.recording import record_study, record_trial  # noqa: PLC0415, heavy

    paths = []
    for trial in result.trials:
        path = folder / f"{trial.trial.name}.rrd"
        paths.append(record_trial(trial.trial, trial.comparison, path))
        done(trial.trial.name)
    paths.append(record_study(result, folder / "study.rrd"))
    done("study")
    return paths
