"""Logs of robots with unlike wheel radii or shared motors, converted to equal wheels with a motor each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.trial import CurrentStream, Trial, WheelStream
from granite_lab.parameters import Robot


def as_built(trial: Trial, robot: Robot) -> Trial:
    """Return a trial with what the robot's file says of single wheels and motors.

    Angles of wheels of several radii become those of wheels of `radius` that roll as far. The current of a
    motor that drives both wheels of a side stands in the columns of both.
    """
    radii, wheels = robot.wheels.radii_m, trial.wheels
    if radii and wheels is not None and max(radii) > min(radii):
        own = ", ".join(f"{1000 * r:g}" for r in radii)
        said = Doubt(f"wheels of {own} mm: angles are those of wheels of {1000 * robot.wheels.radius:g} mm")
        rolled = _rolled(wheels, np.array(radii) / robot.wheels.radius)
        trial = replace(trial, wheels=rolled, doubts=(*trial.doubts, said))
    if robot.motors == "side" and trial.currents is not None:
        said = Doubt(
            "a motor drives both wheels of a side: its current is compared with the sum of both torques"
        )
        trial = replace(trial, currents=_of_sides(trial.currents), doubts=(*trial.doubts, said))
    return trial


def _of_sides(currents: CurrentStream) -> CurrentStream:
    """Return the current of the motor of a wheel's side for each wheel, by whichever column holds it.

    Of columns that both hold one, as of two sensors of a motor, it is the mean.
    """
    front, rear = currents.current[:, :2], currents.current[:, 2:]
    side = np.where(np.isnan(front), rear, np.where(np.isnan(rear), front, (front + rear) / 2))
    return replace(currents, current=np.hstack([side, side]))


def _rolled(wheels: WheelStream, by: np.ndarray) -> WheelStream:
    """Return wheel angles, or rates, times (4,) factors."""
    return replace(
        wheels,
        angle=wheels.angle * by,
        rate=None if wheels.rate is None else wheels.rate * by,
        resolution=tuple((np.array(wheels.resolution) * by).tolist()),
        span=tuple((np.array(wheels.span) * by).tolist()),
    )
