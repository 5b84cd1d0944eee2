"""A load that a robot tows, by the robot's file or the log of a trial, as a part of what drives its runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from granite_lab.errors import EstimateError, InputError
from granite_lab.estimation.motion import Motion
from granite_lab.inference.binning import means
from granite_lab.logs.trial import Series, Trial
from granite_lab.model.command import duration, hauling
from granite_lab.parameters import Robot, parse_path
from granite_lab.parameters.course import corners_of

KEY = "tow_N"
"""Of a log's own metadata: a force [N], or a list of times [s, the log's time] and forces. A column has this
name, too."""

SPACING = 0.05
"""Time over which a logged force is averaged, and from one of its corners to the next at least [s]: a robot
answers in 0.1 s and more."""

CLASS = 0.005
"""Share of the largest force within which corners are left out: so large may, by its data sheet, be the error
of a load cell over its range."""


def with_towed_load(motion: Motion, trial: Trial, robot: Robot) -> Motion:
    """Return the motion with the trial's towed load in its command, and a line on it.

    Args:
        motion: with what drives its runs.
        trial: whose stated force counts before the logged one, and that before the one of the robot's file.
        robot: whose file states the height at which the load pulls; by default that of the wheel centres.

    Raises:
        InputError: the trial's force cannot be understood.
        EstimateError: it changes with time, and the start of the command is unknown.
    """
    points = _points(motion, trial, robot)
    if not any(force for _, force in points):
        return motion
    height = robot.tow.height if robot.tow else 0.0
    start, (t1, t2) = motion.t_start.value, motion.steady
    stretch = (t1 - start, t2 - start) if math.isfinite(t1 - start) else None
    forces = [force for _, force in points]
    size = f"{max(forces):g} N" if min(forces) == max(forces) else f"{min(forces):g} to {max(forces):g} N"
    line = f"a towed load of {size} is in the model, {1000 * height:g} mm above the wheel centres"
    variant = hauling(motion.variant, points, height, stretch)
    return replace(motion, variant=variant, warnings=(*motion.warnings, line))


def _points(motion: Motion, trial: Trial, robot: Robot) -> Sequence[tuple[float, float]]:
    """Return (time since the start of the command [s], force [N]) of the load."""
    text = trial.info.extra.get(KEY, "").strip().strip('"')
    if not text:
        return constant(robot) if trial.tow is None else _logged(motion, trial.tow)
    try:
        points = parse_path(text) if ":" in text else ((0.0, float(text)), (math.inf, float(text)))
        if not all(0 <= force < math.inf for _, force in points):
            raise ValueError
    except ValueError:
        raise InputError(
            f"trial '{trial.name}': {KEY} = {text} cannot be used",
            f'write a force of 0 N or more, as {KEY} = 30, or times [s] and forces: "2:0, 3:30, 9:30"',
        ) from None
    if ":" not in text:
        return points
    return [(t - _start(motion), force) for t, force in points]


def _start(motion: Motion) -> float:
    """Return the start of the command [s, the log's time]."""
    if not math.isfinite(motion.t_start.value):
        raise EstimateError(
            f"{motion.trial}: the start of its command is unknown, so the towing force has no time",
            f"state the command, or a constant {KEY}",
        )
    return motion.t_start.value


def _logged(motion: Motion, logged: Series) -> Sequence[tuple[float, float]]:
    """Return (time since the start of the command [s], force [N]) of a logged force, its noise averaged."""
    known, end = np.isfinite(logged.value), duration(motion.variant)
    t, force = logged.t[known] - _start(motion), logged.value[known]
    driven = (t >= 0) & (t <= end)
    if np.count_nonzero(driven) < 2:
        raise InputError(
            f"trial '{motion.trial}': {KEY} has no samples while the robot is driven",
            f"leave the column out, or state a constant {KEY}",
        )
    if np.median(force[driven]) < -CLASS * np.abs(force).max():
        raise InputError(
            f"trial '{motion.trial}': {KEY} is negative while the robot is driven",
            "a load pulls back with a positive force; a column map turns the sign with scale = -1",
        )
    at = np.linspace(0.0, end, max(round(end / SPACING), 1) + 1)
    span = (np.clip(at + side * SPACING / 2, t[0], t[-1]) for side in (-1, 1))
    pulls = np.maximum(means(t, *span) @ force, 0.0)  # a rope does not push
    keep = corners_of(at, pulls, CLASS * float(pulls.max()))
    return list(zip(at[keep].tolist(), pulls[keep].tolist(), strict=True))


def constant(robot: Robot) -> tuple[tuple[float, float], ...]:
    """Return the constant load of a robot's file; no points where the robot tows no load."""
    return () if robot.tow is None else ((0.0, robot.tow.force), (math.inf, robot.tow.force))
