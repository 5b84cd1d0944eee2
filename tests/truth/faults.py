"""Faults of sensors and loggers, injected into a good trial with IMU, encoders and perhaps currents."""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any, Literal

import numpy as np

from granite_lab.hidden.contact import Array
from granite_lab.logs.trial import Trial
from granite_lab.parameters import WHEELS


def _kept(stream: Any, keep: Array) -> Any:
    """Return the chosen samples of a stream."""
    columns = {f.name: getattr(stream, f.name) for f in fields(stream)}
    return replace(stream, **{k: v[keep] for k, v in columns.items() if isinstance(v, np.ndarray)})


def imu_dropout(trial: Trial, start: float, stop: float) -> Trial:
    """Lose the IMU's samples between two instants [s]."""
    t = trial.imu.t
    return replace(trial, imu=_kept(trial.imu, (t < start) | (t > stop)))


def wheel_dropout(trial: Trial, start: float, stop: float) -> Trial:
    """Lose the encoders' samples between two instants [s]."""
    t = trial.wheels.t
    return replace(trial, wheels=_kept(trial.wheels, (t < start) | (t > stop)))


def random_dropouts(trial: Trial, seed: int, share: float) -> Trial:
    """Lose single samples of IMU and encoders at random."""
    rng = np.random.default_rng(seed)
    imu, wheels = (_kept(s, rng.random(s.t.size) >= share) for s in (trial.imu, trial.wheels))
    return replace(trial, imu=imu, wheels=wheels)


def cut(trial: Trial, start: float = -np.inf, stop: float = np.inf) -> Trial:
    """Keep what was logged between two instants [s]: an end without standstill."""
    imu, wheels, currents = (
        s and _kept(s, (s.t >= start) & (s.t <= stop)) for s in (trial.imu, trial.wheels, trial.currents)
    )
    wheels = replace(wheels, angle=wheels.angle - wheels.angle[0])
    return replace(trial, imu=imu, wheels=wheels, currents=currents)


def saturated(trial: Trial, limit: float) -> Trial:
    """Let the accelerometer's x axis end at a rail [m/s^2], on both sides of its reading at rest."""
    force = trial.imu.specific_force.copy()
    middle = np.median(force[: max(10, trial.imu.t.size // 20), 0])
    force[:, 0] = np.clip(force[:, 0], middle - limit, middle + limit)
    return replace(trial, imu=replace(trial.imu, specific_force=force))


def imu_restart(trial: Trial, at: float, *, gap: float) -> Trial:
    """Let the IMU fall silent at an instant for `gap` [s] and come back with other biases (x: 0.15 m/s^2)."""
    imu = trial.imu
    after = (imu.t >= at)[:, None]
    force = imu.specific_force + after * [0.15, -0.1, 0.1]
    rate = imu.angular_rate + after * [0.01, 0.02, -0.01]
    jumped = replace(trial, imu=replace(imu, specific_force=force, angular_rate=rate))
    return imu_dropout(jumped, at, at + gap)


def spikes(trial: Trial, seed: int, count: int, size: float) -> Trial:
    """Throw single readings of the accelerometer off by a normal error of std `size` [m/s^2]."""
    rng, imu = np.random.default_rng(seed), trial.imu
    force = imu.specific_force.copy()
    hit = rng.choice(imu.t.size, count, replace=False)
    force[hit] += size * rng.standard_normal((count, 3))
    return replace(trial, imu=replace(imu, specific_force=force))


def _change_angle(trial: Trial, change: Callable[[Array, Array], Array]) -> Trial:
    wheels = trial.wheels
    return replace(trial, wheels=replace(wheels, angle=change(wheels.t, wheels.angle.copy())))


def dead_encoder(
    trial: Trial, wheel: str, start: float, stop: float, how: Literal["frozen", "missing", "zero"] = "frozen"
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
    order = [WHEELS.index({one: other, other: one}.get(wheel, wheel)) for wheel in WHEELS]
    return _change_angle(trial, lambda _, angle: angle[:, order])


def turned(trial: Trial, matrix: Array) -> Trial:
    """Mount the IMU in other axes: `matrix` (3, 3) takes a vector from the old axes to the new."""
    force, rate = (signal @ matrix.T for signal in (trial.imu.specific_force, trial.imu.angular_rate))
    return replace(trial, imu=replace(trial.imu, specific_force=force, angular_rate=rate))


def shifted_time(trial: Trial, origin: float) -> Trial:
    """Log under another origin of time [s], as epoch stamps do."""
    streams = {name: getattr(trial, name) for name in ("imu", "wheels", "currents", "command")}
    return replace(trial, **{name: s and replace(s, t=s.t + origin) for name, s in streams.items()})


def late(trial: Trial, by: float) -> Trial:
    """Stamp encoders and currents later than the IMU [s]."""
    wheels, currents = (s and replace(s, t=s.t + by) for s in (trial.wheels, trial.currents))
    return replace(trial, wheels=wheels, currents=currents)


SIDEWAYS = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Takes a vector from the robot's axes to those of an IMU that is mounted with its x axis to the left."""
