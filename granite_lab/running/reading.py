"""From paths to corrected trials and their motion."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from granite_lab.estimation.motion import Motion
from granite_lab.logs import read_trial
from granite_lab.logs.trial import Trial
from granite_lab.parameters import Robot, load_robot
from granite_lab.running.options import Options


def read(path: Path, options: Options) -> tuple[Trial, Robot]:
    """Read a log.

    Returns:
        the trial as it was logged, and its robot.

    Raises:
        InputError: the log cannot be used.
    """
    names = ("imu", "encoders", "currents", "reference", "rows", "robot", "info", "window")
    said: dict[str, Any] = {name: getattr(options, name) for name in names}
    trial = read_trial(path, map=options.column_map, topics=dict(options.topics), **said)
    return trial, load_robot(options.robot or trial.info.robot or "granite")


def estimate(trial: Trial, robot: Robot, options: Options) -> tuple[Trial, Motion]:
    """Return the corrected trial and its motion.

    Raises:
        EstimateError: the motion cannot be had from it.
    """
    from granite_lab.estimation import correct  # noqa: PLC0415, heavy

    return correct(trial, robot, rests=options.rests, distance_measured=options.distance_measured)


def corrected(path: Path, options: Options) -> tuple[Trial, Motion]:
    """Read a log, correct it and estimate its motion.

    Returns:
        the corrected trial, which later stages read in place of the log, and its motion.

    Raises:
        InputError: the log cannot be used.
        EstimateError: the motion cannot be had from it.
    """
    return estimate(*read(path, options), options)
