"""Rows that hold no new reading of an IMU or an encoder: the logger is faster, or samples were lost.

A logger that is faster repeats the last reading, or fills up the time between two along a straight line.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np

from granite_lab.logs.counters import Mask, flagged, runs
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.sensors.stamps import evened
from granite_lab.logs.sensors.standstill import FALSE_ALARM, step_of
from granite_lab.logs.trial import Array, ImuStream, part

_FEW = 20  # readings that change, by which the others are judged
_FALLS = 0.3  # least specific force of a wheeled robot, as a share of its median
_RULE = 0.2  # repeated rows beyond this share of all are the rule, not losses
_BESIDE = 0.05  # a logger that is faster by this share repeats a reading in each second of 20 samples
_COUNTS = 3  # a wheel that turns by so many counts from reading to reading does not stand in the next
_EVEN = 50  # readings whose spacing is judged: of those that a chance of 5 % drops, the places scatter more
_STRAIGHT = 2e-3  # a signal is straight where it bends by this share of the rms: once in 600 times by chance
_FINEST = 1e-9  # no logger writes stamps finer than this [s]
_FINE = (
    40.0  # a signal that bends by so many steps of its values is straight within two of them once in 25 times
)


def without_blanks(imu: ImuStream, doubts: list[Doubt]) -> ImuStream:
    """Leave out samples of an accelerometer that are 0 on all axes, where it always feels gravity else."""
    force = imu.specific_force[:, np.isfinite(imu.specific_force).all(axis=0)]
    blank = (force == 0).all(axis=1)
    if force.shape[1] < 2 or not 0 < np.count_nonzero(blank) < 0.5 * len(blank):
        return imu
    size = np.linalg.norm(force[~blank], axis=1)
    if size.min() < _FALLS * np.median(size):
        return imu
    seen = "of 0 on all axes"
    doubts += flagged(blank, imu.t, "sample", seen, "taken for missing", where="accelerometer")
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


def without_fill(imu: ImuStream, doubts: list[Doubt]) -> ImuStream:
    """Return the readings of an IMU between which a log was filled up along straight lines, where one was.

    Tables on one clock are made like this. The sensor then looks faster than it is, so that nothing shows
    that it folded vibration to slow frequencies.
    """
    both = np.hstack([imu.specific_force, imu.angular_rate])
    values, t = both[:, np.isfinite(both).all(axis=0)], imu.t
    if len(t) < 2 * _FEW or values.shape[1] == 0:
        return imu
    slope = np.diff(values, axis=0) / np.maximum(np.diff(t), _FINEST)[:, None]
    bend = np.abs(np.diff(slope, axis=0)) * (t[2:] - t[:-2])[:, None] / 2.0
    large, step = np.sqrt(np.mean(bend**2, axis=0)), step_of(values)
    fine = large > _FINE * step
    straight = (bend <= np.maximum(_STRAIGHT * large, 2.0 * step))[:, fine].all(axis=1)
    changes = (np.diff(values, axis=0)[1:, fine] != 0).any(axis=1)
    if not fine.any() or np.count_nonzero(straight & changes) < _RULE * len(t):
        return imu
    once = _corners(t, both, runs(straight))
    made = replace(imu, t=once[:, 0], specific_force=once[:, 1:4], angular_rate=once[:, 4:])
    rate = 1.0 / float(np.median(np.diff(made.t)))
    seen = (
        f"{straight.mean():.0%} of the rows lie on lines between others: the sensor gives {rate:.3g} a second"
    )
    doubts.append(Doubt(seen, "IMU", "the readings at their ends are used"))
    return made


def _corners(t: Array, values: Array, lines: list[tuple[int, int]]) -> Array:
    """(M, 1 + K) stamps and values where straight lines meet, of values (N, K) at stamps t (N,) [s].

    A line from sample a to b + 1 is given by (a, b). Samples on no line stay.
    """
    rows = np.column_stack([t, values])
    kept, behind, slope = [rows[:1]], 0, np.zeros(values.shape[1])
    for first, end in lines:
        last = end + 1
        after = (values[last] - values[first]) / (t[last] - t[first])
        if first == behind + 1 and behind > 0:  # they meet between two samples
            turn, apart = np.nan_to_num(after - slope), np.nan_to_num(values[first] - values[behind])
            since = float(
                turn @ (np.nan_to_num(after) * (t[first] - t[behind]) - apart) / max(turn @ turn, 1e-300)
            )
            at = t[behind] + min(max(since, 0.0), t[first] - t[behind])
            kept.append(np.append(at, values[behind] + slope * (at - t[behind]))[None])
        else:
            kept.append(rows[max(behind, 1) : first + 1])
        behind, slope = last, after
    kept.append(rows[max(behind, 1) :])
    return np.concatenate(kept)


def between_readings(t: Array, angle: Array, step: float) -> Mask:
    """(N,) True in rows that repeat an encoder's last reading, where the log has more rows than readings.

    A table on one clock is filled up so. While the wheel turns by several counts of a `step` [unit of the
    angle] from one reading to the next, the new ones are then evenly spaced within a row, or fewer than half
    of all rows. Counts that are lost, and readings that are not, come at any place.
    """
    made, repeats = np.abs(np.diff(angle)), np.zeros(len(t), dtype=bool)
    new = np.flatnonzero(made != 0) + 1
    if len(new) < 2 * _FEW or len(new) == len(t) - 1:
        return repeats
    made = made[new - 1]
    fast = made >= max(0.5 * float(np.quantile(made, 0.9)), _COUNTS * (step or float(made.min())))
    parts = [new[k : min(k + _EVEN, b)] for a, b in runs(fast) for k in range(a, b, _EVEN)]
    parts = [rows for rows in parts if len(rows) >= _FEW]
    if not parts:
        return repeats
    each = float(np.median([np.ptp(rows) / (len(rows) - 1) for rows in parts]))
    scatter = float(np.median([_unevenness(t[rows]) for rows in parts])) / float(np.median(np.diff(t)))
    if each * (1.0 - _BESIDE) < 1.0 or (each < 2.0 and scatter > 0.5):
        return repeats
    for a, b in pairwise(new):
        repeats[a + 1 : b] = b - a <= np.ceil(each) + 1
    return repeats


def _unevenness(t: Array) -> float:
    """Std of stamps (N,) about an even spacing [s]."""
    place = np.arange(len(t))
    return float(np.std(t - np.polyval(np.polyfit(place, t, 1), place)))


def without_held(imu: ImuStream, rolls: Mask, doubts: list[Doubt]) -> ImuStream:
    """Leave out samples that were not measured: they repeat the last one while the wheels turn, `rolls` (N,).

    A driver that loses samples may log the last one again. How often the finest axis of a sensor repeats its
    reading beside says whether that is chance, as by rounding.
    """
    keep, moving = np.ones(len(imu.t), dtype=bool), rolls[1:] & rolls[:-1]
    for values in (imu.specific_force, imu.angular_rate):
        equal = _equal(values)
        repeated = equal.all(axis=1) & moving
        changing = moving & ~repeated
        if equal.shape[1] < 2 or np.count_nonzero(changing) < _FEW:  # of one axis nothing tells the chance
            continue
        chance = _chance(equal[changing])
        for a, b in runs(repeated):
            if len(repeated) * chance ** (b - a) < FALSE_ALARM:
                keep[a + 1 : b + 1] = False
    doubts += flagged(~keep, imu.t, "sample", "that repeat the last one", "taken for missing", where="IMU")
    return imu if keep.all() else part(imu, keep)


def _equal(values: Array) -> Mask:
    """(N-1, K) True where an axis that was measured, of (N, 3) or more, repeats its reading."""
    return np.asarray(np.diff(values[:, np.isfinite(values).all(axis=0)], axis=0) == 0)


def _chance(equal: Mask) -> float:
    """Probability that the axis with the finest readings repeats one, by (M, K) in which not all did."""
    return float((equal.sum(axis=0).min() + 1.0) / (len(equal) + 2.0))
