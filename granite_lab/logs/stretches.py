"""What the wheels say before any estimation: rests, plateau, ramp, variant, and whether they fit the IMU."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from granite_lab.errors import InputError
from granite_lab.logs.clocks import Mask, runs
from granite_lab.logs.trial import Array, ImuStream, Trial, WheelStream
from granite_lab.logs.units import factors
from granite_lab.parameters import WHEELS, Robot, Variant, load_variants

SHORTEST_REST = 0.5
"""A standstill lasts at least this long [s]."""

TOO_FAST = 30.0
"""No ground robot drives faster [m/s]."""


@dataclass(frozen=True)
class MotionGuess:
    """A first look at the motion, from the wheels alone (so slip is not taken off).

    Attributes:
        velocity: plateau of the wheels' circumferential velocity [m/s].
        acceleration: slope of the ramp up [m/s^2], NaN if there is none.
        distance: way of the circumference [m].
        variant: the variant of Table 2 that comes closest, None if none is close.
        confidence: 0 to 1.
    """

    velocity: float
    acceleration: float
    distance: float
    variant: Variant | None
    confidence: float


def rests(trial: Trial, robot: Robot) -> list[tuple[float, float]]:
    """Return intervals [s] in which the robot seems to stand still.

    From the wheels where there are any (they turn whenever the robot drives), else from an
    accelerometer that is far calmer than usual.
    """
    if trial.wheels is not None:
        t, speed = mean_speed(trial.wheels, robot)
        if len(t) > 5:
            limit = 0.02 * max(float(np.quantile(np.abs(speed), 0.95)), 0.05)
            return _intervals(t, np.abs(_smooth(speed, t)) < limit)
    if trial.imu is not None:
        return _calm(trial.imu)
    return []


def _calm(imu: ImuStream) -> list[tuple[float, float]]:
    """Return the calm intervals of an IMU, none if it is never much calmer than usual."""
    force = imu.specific_force[:, ~np.isnan(imu.specific_force).all(axis=0)]
    n = max(int(0.2 / float(np.median(np.diff(imu.t)))), 3)
    count = len(imu.t) // n
    if count < 5 or force.shape[1] == 0:
        return []
    spread = force[: count * n].reshape(count, n, -1).std(axis=1).max(axis=1)
    floor, usual = float(np.quantile(spread, 0.05)), float(np.median(spread))
    if floor > 0.3 * usual and floor > 0.05:
        return []
    return _intervals(imu.t[n // 2 : count * n : n][:count], spread < max(3 * floor, 0.05))


def _smooth(values: Array, t: Array) -> Array:
    """Average over about a fifth of a second, against quantisation."""
    n = max(1, int(0.2 / float(np.median(np.diff(t)))))
    padded = np.concatenate((np.full(n // 2, values[0]), values, np.full(n - 1 - n // 2, values[-1])))
    return np.convolve(padded, np.full(n, 1 / n), mode="valid")


def _intervals(t: Array, flags: Mask) -> list[tuple[float, float]]:
    """Return the stretches of flags that last long enough."""
    return [(float(t[a]), float(t[b])) for a, b in runs(flags) if t[b] - t[a] >= SHORTEST_REST]


def look(trial: Trial, robot: Robot) -> MotionGuess | None:
    """Guess plateau, ramp and variant from the wheels; None without wheels or motion."""
    if trial.wheels is None:
        return None
    t, raw = mean_speed(trial.wheels, robot)
    if len(t) < 10:
        return None
    speed = np.abs(_smooth(raw, t))
    top = float(np.quantile(speed, 0.95))
    if top < 0.01:
        return None
    plateau = float(np.mean(speed[speed > 0.7 * top]))
    rising = np.flatnonzero(speed > 0.8 * plateau)[0]
    low = np.flatnonzero(speed[:rising] < 0.2 * plateau)
    ramp = math.nan
    if len(low) and t[rising] > t[low[-1]]:
        ramp = float((speed[rising] - speed[low[-1]]) / (t[rising] - t[low[-1]]))
    distance = float(np.sum(speed[1:] * np.diff(t)))
    best = min(load_variants(), key=lambda v: abs(math.log(plateau / v.velocity)))
    # The wheels follow the desired velocity closely; variants lie 40 % and more apart.
    off = abs(math.log(plateau / best.velocity)) / 0.08
    off_distance = abs(math.log(max(distance, 1e-3) / best.distance)) / 0.3
    confidence = math.exp(-(off**2) / 2 - off_distance**2 / 8)
    return MotionGuess(plateau, ramp, distance, best if off < 2 else None, confidence if off < 2 else 0.0)


def check_wheels(
    wheels: WheelStream, imu: ImuStream | None, robot: Robot, where: str, declared: str, doubts: list[str]
) -> WheelStream:
    """Check the wheels' unit against the speed that the IMU gains while the robot drives off.

    Args:
        wheels: as read.
        imu: the IMU, if there is one; only how fast it accelerates is used, in any direction.
        robot: for the wheel radius.
        where: the file, for messages.
        declared: unit that the columns were said to have.
        doubts: warnings are added here.

    Returns:
        the stream with a corrected unit.

    Raises:
        InputError: wheels faster than any ground robot's.
    """
    t, speed = mean_speed(wheels, robot)
    if len(t) < 10:
        return wheels
    doubts += _dead(wheels, imu)
    ratio = _ratio(t, speed, imu) if imu is not None else math.nan
    if not 0.3 < ratio < 8:
        kinds = [factors("angle"), factors("angular rate")]
        sizes = next((kind for kind in kinds if declared in kind), {})
        changes = {unit: size / sizes[declared] for unit, size in sizes.items() if unit != declared}
        fits = [(unit, change) for unit, change in changes.items() if 0.7 < ratio * change < 3]
        if len(fits) == 1:
            unit, factor = fits[0]
            doubts.append(
                f"the encoders, declared in {declared}, gain {ratio:.3g} times the speed that the IMU gains: "
                f"they are in {unit}; converted"
            )
            rate = None if wheels.rate is None else wheels.rate * factor
            angle, step = wheels.angle * factor, wheels.step * factor
            return dataclasses.replace(wheels, angle=angle, rate=rate, step=step)
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
    return wheels


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
    spans = np.array([np.ptp(a[np.isfinite(a)]) if np.isfinite(a).any() else np.nan for a in wheels.angle.T])
    if not np.nanmax(spans) > 1.0:
        return []
    still = (spans < 0.01 * np.nanmax(spans)).tolist()
    yaw = np.nan_to_num(imu.angular_rate) if imu is not None else np.zeros((1, 3))
    turned = float(np.abs(np.median(yaw, axis=0) - yaw).max())
    if turned > 0.2 and still in ([True, False, True, False], [False, True, False, True]):
        return []
    return [
        f"encoder {name} stands still while the others turn: not connected?"
        for name, stands in zip(WHEELS, still, strict=True)
        if stands
    ]
