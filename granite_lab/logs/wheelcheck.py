"""Do the wheels turn as fast as the robot accelerates?"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from granite_lab.errors import InputError
from granite_lab.logs.trial import Array, ImuStream, WheelStream
from granite_lab.parameters import Robot

TOO_FAST = 30.0
"""No ground robot drives faster [m/s]."""

_UNITS = {
    "angle": {"rad": 1.0, "deg": math.pi / 180, "rev": 2 * math.pi},
    "rate": {"rad/s": 1.0, "deg/s": math.pi / 180, "rpm": math.pi / 30, "rev/s": 2 * math.pi},
}


def check_wheels(
    wheels: WheelStream, imu: ImuStream | None, robot: Robot, where: str, declared: str = "rad"
) -> tuple[WheelStream, list[str]]:
    """Check the wheels' unit against the speed that the IMU gains while the robot drives off.

    Args:
        wheels: as read.
        imu: the IMU, if there is one; only how fast it accelerates is used, in any direction.
        robot: for the wheel radius.
        where: the file, for messages.
        declared: unit that the columns were said to have.

    Returns:
        the stream with a corrected unit, and warnings.

    Raises:
        InputError: wheels faster than any ground robot's.
    """
    doubts: list[str] = []
    t, speed = mean_speed(wheels, robot)
    if len(t) < 10:
        return wheels, doubts
    doubts += _dead(wheels, imu)
    ratio = _ratio(t, speed, imu) if imu is not None else math.nan
    if not 0.3 < ratio < 8:
        units = next((kind for kind in _UNITS.values() if declared in kind), {})
        factors = {unit: size / units[declared] for unit, size in units.items() if unit != declared}
        fits = [(unit, f) for unit, f in factors.items() if 0.7 < ratio * f < 3]
        if len(fits) == 1:
            unit, factor = fits[0]
            doubts.append(
                f"the encoders, declared in {declared}, gain {ratio:.3g} times the speed that the IMU gains: "
                f"they are in {unit}; converted"
            )
            return _scaled(wheels, factor), doubts
        if not math.isnan(ratio):
            doubts.append(
                f"the wheels gain {ratio:.3g} times the speed that the IMU gains: check wheel radius, counts "
                "per revolution and units"
            )
    top = float(np.quantile(np.abs(speed), 0.95))
    if top > TOO_FAST:
        raise InputError(
            f"{where}: the wheels' circumference moves at {top:.4g} m/s, expected at most {TOO_FAST:g} m/s",
            "correct the encoders' unit, the counts per revolution or the wheel radius",
        )
    return wheels, doubts


def mean_speed(wheels: WheelStream, robot: Robot) -> tuple[Array, Array]:
    """Return stamps (M,) [s] and the wheels' mean circumferential speed (M,) [m/s]."""
    # A wheel may have rows of its own; in between its angle is a straight line.
    seen = [np.isfinite(angle) for angle in wheels.angle.T]
    angles = [
        np.interp(wheels.t, wheels.t[rows], angle[rows])
        for angle, rows in zip(wheels.angle.T, seen, strict=True)
        if np.count_nonzero(rows) > 1
    ]
    if not angles:
        return np.zeros(0), np.zeros(0)
    speed = np.diff(np.mean(angles, axis=0)) / np.diff(wheels.t) * robot.wheels.radius
    return (wheels.t[1:] + wheels.t[:-1]) / 2, np.asarray(speed)


def _ratio(t: Array, speed: Array, imu: ImuStream) -> float:
    """Return speed gained by the wheels over speed gained by the IMU on driving off, NaN if unknown."""
    plateau = float(np.quantile(np.abs(speed), 0.9))
    moving = np.abs(speed) > 0.1 * plateau
    if plateau == 0 or moving[:3].any() or not moving.any():
        return math.nan
    start = float(t[int(np.argmax(moving))])
    fast = np.abs(speed) > 0.8 * plateau
    reached = float(t[int(np.argmax(fast & (t >= start)))])
    begin, end = start - 0.3, reached + 0.3  # the two clocks may be apart
    force = imu.specific_force
    if reached - start > 3 or begin - imu.t[0] < 0.2 or end > imu.t[-1] or np.isnan(force).any():
        return math.nan
    rest = force[imu.t < begin].mean(axis=0)
    ramp = (imu.t >= begin) & (imu.t <= end)
    gained = np.trapezoid(force[ramp] - rest, imu.t[ramp], axis=0)
    # What a tilt by one degree or the bias could feign must stay far below.
    feigned = 0.17 * (end - begin)
    size = float(np.linalg.norm(gained))
    return plateau / size if size > max(0.08, 0.5 * feigned) else math.nan


def _dead(wheels: WheelStream, imu: ImuStream | None) -> list[str]:
    """Report wheels that stand while the others turn; a whole side may, where the robot turns about it."""
    names = ("fl", "fr", "rl", "rr")
    spans = np.array([np.ptp(a[np.isfinite(a)]) if np.isfinite(a).any() else np.nan for a in wheels.angle.T])
    if not np.nanmax(spans) > 1.0:
        return []
    still = spans < 0.01 * np.nanmax(spans)
    yaw = np.nan_to_num(imu.angular_rate) if imu is not None else np.zeros((1, 3))
    turned = float(np.abs(np.median(yaw, axis=0) - yaw).max())
    if (
        turned > 0.2
        and (still == [True, False, True, False]).all() | (still == [False, True, False, True]).all()
    ):
        return []
    return [
        f"encoder {name} stands still while the others turn: not connected?"
        for name, stands in zip(names, still, strict=True)
        if stands
    ]


def _scaled(wheels: WheelStream, factor: float) -> WheelStream:
    """Return the stream in another unit."""
    rate = None if wheels.rate is None else wheels.rate * factor
    return dataclasses.replace(wheels, angle=wheels.angle * factor, rate=rate, step=wheels.step * factor)
