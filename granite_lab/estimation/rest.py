"""Where the robot stands still: the wheels give no counts and the IMU is quiet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from granite_lab.errors import EstimateError
from granite_lab.estimation.mounting import BodyImu
from granite_lab.estimation.wheels import Rolling, bridged
from granite_lab.logs.counters import integral, runs
from granite_lab.logs.trial import Array
from granite_lab.parameters import ImuGrade

Interval = tuple[float, float]

SHORTEST = 0.3
"""A standstill shorter than this [s] says too little about biases to be used."""

CREEP = 1.0e-4
"""Wheel velocity [m/s] below which the robot counts as standing. A robot whose motors cannot brake
coasts out over seconds, and a zero-velocity update at 1 mm/s there shifts the whole trial by that much."""

COAST = 0.01
"""Slip velocity goes with the wheel speed down to this [m/s]: below, play and settling move the body. A
body whose wheels coast to rest is then as slow as they are."""

STEADY = 3.0
"""An IMU that is this many times as loud as its grade may be moving."""

GAINED, TURNED = 0.15, 0.15
"""A robot whose IMU gains this velocity [m/s] or angle [rad] in a second does not stand."""

WINDOW = 0.2
"""Length of the window in which stillness is judged [s]."""

SWING, SAMPLES = 0.5, 5
"""Length of the window in which a swing of 2 Hz or faster on the tyres shows [s]; means in it."""


def wheels_still(rolling: Rolling) -> np.ndarray:
    """(M,) True where no wheel turns faster than a creep (or than its resolution allows to tell)."""
    t, known = rolling.t, np.isfinite(rolling.speed if rolling.by_rate else rolling.mean)
    dt = float(np.median(np.diff(t))) if t.size > 1 else 1.0
    size = max(round(WINDOW / dt), 1) | 1
    if rolling.by_rate:
        limit = max(1.01 * rolling.step, 3.0 * CREEP)
        moved = maximum_filter1d((np.abs(np.nan_to_num(rolling.velocity)) > limit).any(axis=1), size)
    else:
        limit, moved = max(CREEP * size * dt, 2.5 * rolling.step), np.zeros(t.size, dtype=bool)
        for distance in (*rolling.distance.T, rolling.mean):
            counted = np.isfinite(distance)
            if counted.any():
                filled = np.interp(t, t[counted], distance[counted])
                moved |= (maximum_filter1d(filled, size) - minimum_filter1d(filled, size) > limit) & counted
    return ~moved & known


def restlessness(imu: BodyImu, window: float = WINDOW, mean: float = 0.0) -> tuple[Array, Array]:
    """(N,) std of specific force [m/s^2] and of pitch and yaw rate [rad/s] in a sliding window [s].

    The samples are averaged over `mean` [s] before.
    """
    size, few = max(round(window / imu.period), 3), max(round(mean / imu.period), 1)

    def variance(signal: Array) -> Array:
        if not np.isfinite(signal).any():
            return np.zeros(signal.size)
        clean = uniform_filter1d(np.nan_to_num(signal - np.nanmedian(signal)), few, mode="nearest")
        power, level = (uniform_filter1d(s, size, mode="nearest") for s in (clean**2, clean))
        return np.maximum(power - level**2, 0.0)

    force = variance(imu.forward) + variance(imu.up)
    return np.sqrt(force), np.sqrt(variance(imu.pitch_rate) + variance(imu.yaw_rate))


def imu_quiet(
    imu: BodyImu, grade: ImuGrade, hint: np.ndarray | None = None, window: float = WINDOW
) -> np.ndarray:
    """(N,) True where the IMU is as quiet as it ever is in this log.

    The quiet level is the lower quartile over the samples where the wheels stand (`hint`), or a low
    percentile of all where there are none, so a motor that hums or a table that shakes is allowed
    for; the grade's noise is the floor. Without wheels, a log that is louder than the grade and no louder
    at any other time may be all steady motion: then nothing is called quiet.
    """
    quiet = np.ones(imu.t.size, dtype=bool)
    floors = (grade.accel_noise, grade.gyro_noise)
    mean = window / SAMPLES if window > WINDOW else imu.period
    for level, density in zip(restlessness(imu, window, mean), floors, strict=True):
        if not level.any():
            continue
        pool = level[hint] if hint is not None and hint.sum() * imu.period > SHORTEST else level
        base = float(np.percentile(pool, 25 if pool is not level else 5))
        usual = density / np.sqrt(mean)
        if hint is None and base > STEADY * usual and float(np.percentile(level, 90)) < STEADY * base:
            return np.zeros(imu.t.size, dtype=bool)
        quiet &= level <= 1.5 * max(base, usual)
    return quiet


def without_swings(imu: BodyImu, still: np.ndarray, grade: ImuGrade) -> np.ndarray:
    """(N,) `still` without the time in which the body yet swings on its tyres.

    What a slow swing adds to the noise shows in a longer window, in which the samples are averaged first. A
    standstill begins with its longest calm part, or is none. What is calm the quietest standstill tells,
    where the others are not as calm for a quarter of the time.
    """
    force = restlessness(imu, SWING, SWING / SAMPLES)[0]
    stands = [(a, b) for a, b in runs(still) if (b - a) * imu.period >= SHORTEST]
    if not stands:
        return still
    a, b = min(stands, key=lambda run: float(np.median(force[slice(*run)])))
    left, quietest = still.copy(), np.zeros(still.size, dtype=bool)
    quietest[a:b] = True
    loud = float(np.percentile(force[still], 25)) > 1.5 * float(np.median(force[a:b]))
    calm = imu_quiet(imu, grade, quietest if loud else still, SWING)
    calm = maximum_filter1d(calm, max(round(SWING / imu.period), 1))
    for a, b in stands:
        begin, end = max(runs(calm[a:b]), key=lambda run: run[1] - run[0], default=(0, 0))
        left[a : a + begin if (end - begin) * imu.period >= SHORTEST else b] = False
    return left


def find_rests(
    imu: BodyImu | None,
    rolling: Rolling | None,
    grade: ImuGrade,
    *,
    offset: float = 0.0,
    by_hand: Sequence[Interval] = (),
) -> tuple[Interval, ...]:
    """Find the intervals of standstill on the IMU's clock; those given by hand are taken as they are.

    Both wheels and IMU must be still where both exist. A wrong clock offset between them only
    shortens the intervals (or lets a coasting end in, whose velocity the update's std covers).
    """
    if imu is None:
        assert rolling is not None
        t = rolling.t + offset
    else:
        t = imu.t
    still = np.ones(t.size, dtype=bool)
    if rolling is not None:
        source, flags = rolling.t + offset, wheels_still(rolling)
        place = np.clip(np.searchsorted(source, t), 1, source.size - 1)
        still = flags[place] & flags[place - 1]
        still &= (t >= source[0] - WINDOW) & (t <= source[-1] + WINDOW)
    if imu is not None:
        quiet = imu_quiet(imu, grade, None if rolling is None else still)
        if rolling is None and not imu.gravity:
            quiet &= np.abs(imu.forward - np.nanmedian(imu.forward[quiet])) < 0.2
        still = without_swings(imu, still & quiet, grade)
    still |= inside(t, by_hand)
    found = []
    gap = 3.0 * float(np.median(np.diff(t)))
    for a, b in runs(bridged(t, still, 0.06)):
        given = any(begin <= t[a] <= end or begin <= t[b - 1] <= end for begin, end in by_hand)
        if t[b - 1] - t[a] >= (0.3 * gap if given else SHORTEST):
            found.append((float(t[a]), float(t[b - 1])))
    return tuple(found)


def coasts(
    imu: BodyImu, rolling: Rolling | None, grade: ImuGrade, offset: float, rests: Sequence[Interval]
) -> bool:
    """Whether the log ends while the wheels coast to rest, slower than `COAST`, and the IMU is quiet."""
    end = imu.t[-1]
    if rolling is None or not rests or rests[-1][1] > end - WINDOW:
        return False
    last = (rolling.t + offset >= end - WINDOW) & np.isfinite(rolling.speed)
    slow = last.any() and float(np.abs(rolling.speed[last]).max()) < COAST
    return bool(slow and imu_quiet(imu, grade, inside(imu.t, rests))[imu.t >= end - WINDOW].all())


def refuse_moved(imu: BodyImu, by_hand: Sequence[Interval]) -> None:
    """Refuse standstills named by hand in which the IMU shows that the robot moved.

    Raises:
        EstimateError: specific force, less its mean, gains a velocity there, or a gyro an angle.
    """
    for begin, end in by_hand:
        at = inside(imu.t, [(begin, end)])
        if np.count_nonzero(at) < 4:
            continue
        t = imu.t[at]
        force, pitch_rate, yaw_rate = np.nan_to_num([imu.forward, imu.pitch_rate, imu.yaw_rate])[:, at]
        turned = integral(t, pitch_rate)
        # it settles, which shows as gravity's share; the mean is bias and slope
        speed = integral(t, force + imu.gravity * turned)
        speed -= np.interp(t, t[[0, -1]], speed[[0, -1]])
        for gained, limit, what in (
            (speed, GAINED, "its velocity along x changes by {:.2f} m/s"),
            (turned, TURNED, "it turns about y by {:.2f} rad"),
            (integral(t, yaw_rate), TURNED, "it turns about z by {:.2f} rad"),
        ):
            if np.ptp(gained) > limit * max(1.0, float(np.sqrt(t[-1] - t[0]))):
                raise EstimateError(
                    f"the robot moved in the standstill named from {begin:g} s to {end:g} s: by the IMU "
                    + what.format(np.ptp(gained)),
                    "name the part in which the body stands; its wheels may spin",
                )


def cumulate(t: Array, rate: Array, rest: np.ndarray) -> Array:
    """(N,) integral by the trapezoidal rule from the first sample on; it stops between two at rest."""
    step = 0.5 * (rate[1:] + rate[:-1]) * np.diff(t)
    return np.append(0.0, np.cumsum(np.where(rest[1:] & rest[:-1], 0.0, step)))


def inside(t: Array, intervals: Sequence[Interval]) -> np.ndarray:
    """(N,) True where a stamp lies in one of the intervals."""
    mask = np.zeros(t.size, dtype=bool)
    for begin, end in intervals:
        mask |= (t >= begin) & (t <= end)
    return mask
