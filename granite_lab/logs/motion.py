"""A first look at the motion, before any estimation: rests, plateau, ramp, variant."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from granite_lab.logs.clocks import Mask, runs
from granite_lab.logs.trial import Array, ImuStream, Trial, WheelStream
from granite_lab.parameters import Robot, Variant, load_variants

SHORTEST_REST = 0.5
"""A standstill lasts at least this long [s]."""


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
