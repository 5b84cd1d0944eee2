"""Logs of robots whose wheels or motors are not all alike, as those of one whose are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.trial import Trial, WheelStream
from granite_lab.parameters import Robot


def as_built(trial: Trial, robot: Robot) -> Trial:
    """Return a trial with what the robot's file says of single wheels and motors.

    Angles of wheels of several radii become those of wheels of `radius` that roll as far. Currents of motors
    that drive both wheels of a side belong to no axle: they are left out.
    """
    radii, wheels = robot.wheels.radii_m, trial.wheels
    if radii and wheels is not None and max(radii) > min(radii):
        own = ", ".join(f"{1000 * r:g}" for r in radii)
        said = Doubt(f"wheels of {own} mm: angles are those of wheels of {1000 * robot.wheels.radius:g} mm")
        rolled = _rolled(wheels, np.array(radii) / robot.wheels.radius)
        trial = replace(trial, wheels=rolled, doubts=(*trial.doubts, said))
    if robot.motors == "side" and trial.currents is not None:
        said = Doubt("a motor drives both wheels of a side: its current belongs to no axle and is not used")
        trial = replace(trial, currents=None, doubts=(*trial.doubts, said))
    return trial


def _rolled(wheels: WheelStream, by: np.ndarray) -> WheelStream:
    """Return wheel angles, or rates, times (4,) factors."""
    return replace(
        wheels,
        angle=wheels.angle * by,
        rate=None if wheels.rate is None else wheels.rate * by,
        resolution=tuple((np.array(wheels.resolution) * by).tolist()),
        span=tuple((np.array(wheels.span) * by).tolist()),
    )
