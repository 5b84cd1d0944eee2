"""Faults of sensors and loggers, injected into a good trial; each returns a new trial."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from granite_lab.hidden.contact import Array
from granite_lab.logs.trial import CurrentStream, ImuStream, Trial, WheelStream
from granite_lab.parameters import WHEELS

Mask = npt.NDArray[np.bool_]


def imu_of(trial: Trial) -> ImuStream:
    """Return the trial's IMU, which the fault needs."""
    if trial.imu is None:
        raise ValueError("the trial has no IMU")
    return trial.imu


def wheels_of(trial: Trial) -> WheelStream:
    """Return the trial's encoders, which the fault needs."""
    if trial.wheels is None:
        raise ValueError("the trial has no encoders")
    return trial.wheels


def _keep_imu(trial: Trial, keep: Mask) -> Trial:
    imu = imu_of(trial)
    return replace(
        trial,
        imu=replace(
            imu, t=imu.t[keep], specific_force=imu.specific_force[keep], angular_rate=imu.angular_rate[keep]
        ),
    )


def _keep_wheels(trial: Trial, keep: Mask) -> Trial:
    wheels = wheels_of(trial)
    return replace(
        trial,
        wheels=replace(
            wheels,
            t=wheels.t[keep],
            angle=wheels.angle[keep],
            rate=None if wheels.rate is None else wheels.rate[keep],
        ),
    )


def imu_dropout(trial: Trial, start: float, stop: float) -> Trial:
    """Lose the IMU's samples between two instants [s]."""
    t = imu_of(trial).t
    return _keep_imu(trial, (t < start) | (t > stop))


def wheel_dropout(trial: Trial, start: float, stop: float) -> Trial:
    """Lose the encoders' samples between two instants [s]."""
    t = wheels_of(trial).t
    return _keep_wheels(trial, (t < start) | (t > stop))


def random_dropouts(trial: Trial, seed: int, share: float) -> Trial:
    """Lose single samples of IMU and encoders at random."""
    rng = np.random.default_rng(seed)
    trial = _keep_imu(trial, rng.random(imu_of(trial).t.size) >= share)
    return _keep_wheels(trial, rng.random(wheels_of(trial).t.size) >= share)


def cut(trial: Trial, start: float | None = None, stop: float | None = None) -> Trial:
    """Keep what was logged between two instants [s]: an end without standstill."""
    low, high = -np.inf if start is None else start, np.inf if stop is None else stop
    t = imu_of(trial).t
    trial = _keep_imu(trial, (t >= low) & (t <= high))
    t = wheels_of(trial).t
    trial = _keep_wheels(trial, (t >= low) & (t <= high))
    wheels = wheels_of(trial)
    trial = replace(trial, wheels=replace(wheels, angle=wheels.angle - wheels.angle[0]))
    if trial.currents is not None:
        keep = (trial.currents.t >= low) & (trial.currents.t <= high)
        trial = replace(trial, currents=CurrentStream(trial.currents.t[keep], trial.currents.current[keep]))
    return trial


def saturated(trial: Trial, limit: float) -> Trial:
    """Let the accelerometer's x axis end at a rail [m/s^2], on both sides of its reading at rest."""
    imu = imu_of(trial)
    force = imu.specific_force.copy()
    middle = np.median(force[: max(10, imu.t.size // 20), 0])
    force[:, 0] = np.clip(force[:, 0], middle - limit, middle + limit)
    return replace(trial, imu=replace(imu, specific_force=force))


def imu_restart(
    trial: Trial, at: float, *, gap: float, accel_jump: Array | None = None, gyro_jump: Array | None = None
) -> Trial:
    """Let the IMU fall silent at an instant for `gap` [s] and come back with other biases."""
    imu = imu_of(trial)
    after = (imu.t >= at)[:, None]
    force = imu.specific_force + after * (np.zeros(3) if accel_jump is None else accel_jump)
    rate = imu.angular_rate + after * (np.zeros(3) if gyro_jump is None else gyro_jump)
    jumped = replace(trial, imu=replace(imu, specific_force=force, angular_rate=rate))
    return imu_dropout(jumped, at, at + gap)


def spikes(trial: Trial, seed: int, count: int, size: float) -> Trial:
    """Throw single readings of the accelerometer off by a normal error of std `size` [m/s^2]."""
    rng, imu = np.random.default_rng(seed), imu_of(trial)
    force = imu.specific_force.copy()
    hit = rng.choice(imu.t.size, count, replace=False)
    force[hit] += size * rng.standard_normal((count, 3))
    return replace(trial, imu=replace(imu, specific_force=force))


def _change_angle(trial: Trial, change: Callable[[Array, Array], Array]) -> Trial:
    wheels = wheels_of(trial)
    return replace(trial, wheels=replace(wheels, angle=change(wheels.t, wheels.angle.copy())))


def dead_encoder(
    trial: Trial,
    wheel: str,
    start: float,
    stop: float,
    how: Literal["frozen", "missing", "zero"] = "frozen",
) -> Trial:
    """Let one encoder die between two instants [s].

    Frozen: it repeats its last count and then counts on from there; missing: NaN, the count was
    kept; zero: it reads 0 and then counts on from 0, as after a reset.
    """
    column = WHEELS.index(wheel)

    def change(t: Array, angle: Array) -> Array:
        dead, after = (t >= start) & (t <= stop), t > stop
        first, last = int(np.argmax(dead)), int(np.flatnonzero(dead)[-1])
        held = 0.0 if how == "zero" else float(angle[max(first - 1, 0), column])
        if how == "missing":
            angle[dead, column] = np.nan
        else:
            angle[after, column] += held - angle[last, column]
            angle[dead, column] = held
        return angle

    return _change_angle(trial, change)


def flipped(trial: Trial, *wheels: str) -> Trial:
    """Count some wheels backwards."""
    sign = np.array([-1.0 if wheel in wheels else 1.0 for wheel in WHEELS])
    return _change_angle(trial, lambda _, angle: angle * sign)


def swapped(trial: Trial, one: str, other: str) -> Trial:
    """Exchange the encoders of two wheels."""
    order = [{one: other, other: one}.get(wheel, wheel) for wheel in WHEELS]
    return _change_angle(trial, lambda _, angle: angle[:, [WHEELS.index(wheel) for wheel in order]])


def rescaled(trial: Trial, *, accel: float = 1.0, gyro: float = 1.0, angle: float = 1.0) -> Trial:
    """Read in the wrong unit: multiply accelerometer, gyroscope or encoders."""
    imu = imu_of(trial)
    scaled = replace(imu, specific_force=imu.specific_force * accel, angular_rate=imu.angular_rate * gyro)
    return _change_angle(replace(trial, imu=scaled), lambda _, a: a * angle)


def turned(trial: Trial, matrix: Array) -> Trial:
    """Mount the IMU in other axes: `matrix` (3, 3) takes a vector from the old axes to the new."""
    imu = imu_of(trial)
    return replace(
        trial,
        imu=replace(
            imu, specific_force=imu.specific_force @ matrix.T, angular_rate=imu.angular_rate @ matrix.T
        ),
    )


def drifting_clock(trial: Trial, rate: float) -> Trial:
    """Let the encoders' clock run fast by a relative `rate` (1e-4 is 0.1 ms a second)."""
    wheels = wheels_of(trial)
    return replace(trial, wheels=replace(wheels, t=wheels.t[0] + (wheels.t - wheels.t[0]) * (1 + rate)))


def shifted_time(trial: Trial, origin: float) -> Trial:
    """Log under another origin of time [s], as epoch stamps do."""
    imu, wheels, currents = imu_of(trial), wheels_of(trial), trial.currents
    return replace(
        trial,
        imu=replace(imu, t=imu.t + origin),
        wheels=replace(wheels, t=wheels.t + origin),
        currents=None if currents is None else replace(currents, t=currents.t + origin),
    )
