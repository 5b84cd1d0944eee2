"""From paths to trials: their motion where it is asked for, as they are where a search reads them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from granite_lab.errors import LabError
from granite_lab.estimation.motion import Motion
from granite_lab.logs import read_trial
from granite_lab.logs.trial import Trial
from granite_lab.parameters import Robot, load_robot
from granite_lab.running.each import each_trial
from granite_lab.running.execution import Execution
from granite_lab.running.options import Options
from granite_lab.running.search import all_say


def ingest(path: Path, options: Options) -> tuple[Trial, Robot, Motion]:
    """Read a log and estimate its motion.

    Raises:
        InputError: the log cannot be used.
        EstimateError: the motion cannot be had from it.
    """
    from granite_lab.estimation import estimate  # noqa: PLC0415, heavy

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


def to_search(
    paths: Sequence[Path], options: Options, execution: Execution
) -> list[tuple[Trial, Motion | None] | LabError]:
    """Read the trials of a search; estimate them where a log does not say what was commanded.

    Args:
        paths: the logs.
        options: for all of them.
        execution: where estimates are made and remembered.

    Returns:
        trials, with their estimates if any is needed, and errors, in the order of `paths`.
    """
    read = each_trial(_read, paths, options, jobs=1)
    if all_say([trial for trial in read if isinstance(trial, Trial)]):
        return [trial if isinstance(trial, LabError) else (trial, None) for trial in read]
    return list(each_trial(_driven, paths, options, execution=execution))


def _read(path: Path, options: Options) -> Trial:
    return read_trial(path, map=options.column_map, robot=options.robot, topics=dict(options.topics))


def _driven(path: Path, options: Options) -> tuple[Trial, Motion | None]:
    trial, _, motion = ingest(path, options)
    return trial, motion
