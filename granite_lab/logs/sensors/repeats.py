"""Rows of an IMU that hold no new reading: the logger is faster than the sensor, or samples were lost."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from granite_lab.logs.counters import Mask, in_words, runs
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.sensors.stamps import evened
from granite_lab.logs.sensors.standstill import FALSE_ALARM
from granite_lab.logs.trial import Array, ImuStream, part

_FEW = 20  # readings that change, by which the others are judged
_FALLS = 0.3  # no wheeled robot loses so much of gravity as to feel this share of it
_RULE = 0.2  # repeated rows beyond this share of all are the rule, not losses


def without_blanks(imu: ImuStream, doubts: list[Doubt]) -> ImuStream:
    """Leave out samples of an accelerometer that are 0 on all axes, where it always feels gravity else."""
    force = imu.specific_force[:, np.isfinite(imu.specific_force).all(axis=0)]
    blank = (force == 0).all(axis=1)
    if force.shape[1] < 2 or not 0 < np.count_nonzero(blank) < 0.5 * len(blank):
        return imu
    size = np.linalg.norm(force[~blank], axis=1)
    if size.min() < _FALLS * np.median(size):
        return imu
    seen = in_words(blank, imu.t, "sample", "of 0 on all axes")
    doubts.append(Doubt(seen, "accelerometer", "taken for missing"))
    return part(imu, ~blank)


def read_once(imu: ImuStream, doubts: list[Doubt]) -> ImuStream:
    """Return the first row of each reading, where a logger writes most readings of an IMU several times.

    The copies shake the integral: a reading counts two times, the next one three times, which makes noise of
    vibration.
    """
    both = np.hstack([imu.specific_force, imu.angular_rate])
    equal = _equal(both)
    copies, changing = equal.all(axis=1), ~equal.all(axis=1)
    share = float(copies.mean()) if equal.size else 0.0
    if share < _RULE or np.count_nonzero(changing) < _FEW or share < 2.0 * _chance(equal[changing]):
        return imu
    once = part(imu, np.append(True, changing))
    t, scatter = evened(once.t)
    rate = 1.0 / float(np.median(np.diff(t)))
    seen = f"{share:.0%} of the rows repeat the reading before: the sensor gives {rate:.3g} a second"
    doubts.append(Doubt(seen, "IMU", "the first row of each is used"))
    return replace(once, t=t, stamp_std=math.hypot(imu.stamp_std, scatter))


def without_held(imu: ImuStream, rolls: Mask) -> tuple[ImuStream, Doubt | None]:
    """Leave out samples that were not measured: they repeat the last one while the wheels turn, `rolls` (N,).

    A driver that loses samples may log the last one again. How often the finest axis of a sensor repeats its
    reading beside says whether that is chance, as by rounding.
    """
    keep, moving = np.ones(len(imu.t), dtype=bool), rolls[1:] & rolls[:-1]
    for values in (imu.specific_force, imu.angular_rate):
        equal = _equal(values)
        repeated = equal.all(axis=1) & moving
        changing = moving & ~repeated
        if equal.shape[1] == 0 or np.count_nonzero(changing) < _FEW:
            continue
        chance = _chance(equal[changing])
        for a, b in runs(repeated):
            if len(repeated) * chance ** (b - a) < FALSE_ALARM:
                keep[a + 1 : b + 1] = False
    if keep.all():
        return imu, None
    seen = in_words(~keep, imu.t, "sample", "that repeat the last one")
    return part(imu, keep), Doubt(seen, "IMU", "taken for missing")


def _equal(values: Array) -> Mask:
    """(N-1, K) True where an axis that was measured, of (N, 3) or more, repeats its reading."""
    return np.asarray(np.diff(values[:, np.isfinite(values).all(axis=0)], axis=0) == 0)


def _chance(equal: Mask) -> float:
    """Probability that the axis with the finest readings repeats one, by (M, K) in which not all did."""
    return float((equal.sum(axis=0).min() + 1.0) / (len(equal) + 2.0))
