"""Check of the axis and the sign of the pitch rate.

Between two standstills the velocity is the integral of specific force less gravity's part by the pitch, and
the pitch is the integral of the pitch rate. With the right axis both return: the pitch to the level that
gravity gives at the second standstill, the velocity to zero. Noise, drift, scale, turning and mounting leave
something of both with the right axis, too. Their joint normal distribution gives each reading of the axes a
likelihood, and the logged one is refused only where another one is more likely by far [1].

[1] R. E. Kass, A. E. Raftery, Bayes factors, J. Am. Stat. Assoc. 90 (1995).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from granite_lab.logs.counters import integral
from granite_lab.logs.trial import Array, ImuStream
from granite_lab.parameters import GRAVITY, ImuGrade

DECISIVE = float(np.log(5 * 100 * 100))
"""Logarithm of the likelihood ratio from which another reading is certain to 99 %, where one log in a hundred
has wrong axes and each of five other readings is as probable."""

FITS = 13.8
"""A reading fits below this squared distance from zero: the 0.999 quantile of chi-squared of two degrees."""

SCALE, CROSS = 0.03, 0.02
"""Std of a gyroscope's scale error and share of a turn about another axis in it: the tolerances in the data
sheet of the MPU-6050 (InvenSense, 2013)."""

MISALIGNED = float(np.radians(2.0))
"""Std of the roll of a sensor mounted by hand [rad]."""

TURNS_ABOUT = 0.3
"""Std of the place along x about which a robot turns [m]: anywhere between its axles."""

SEGMENTS = 4
"""Parts of a motion in each of which the roll may be another one."""

TURNED, SLOPED = float(np.radians(30.0)), float(np.radians(6.0))
"""A robot that turns by more than this, or stands on more of a slope, explains what is left with the right
axis, too: on a slope gravity comes from the side, and yaw turns it into pitch [rad]."""

LONGEST = 60.0
"""The drift of a motion longer than this hides everything [s]."""

BLOCKS = 8
"""Blocks for an Allan variance, at least."""


class Reading(NamedTuple):
    """A reading of the axes: which one turns the pitch, and what is left with it."""

    name: str  # axis with sign
    speed: float  # velocity left at standstill, the median of the motions [m/s]
    distance: float  # its median squared distance from zero, in variances


class Motion(NamedTuple):
    """Specific force and rates from one standstill to the next."""

    t: Array  # (N,) [s]
    force: Array  # (N,) specific force along x [m/s^2]
    rate: Array  # (N, 3) rates, without their means at the standstills [rad/s]
    level: Array  # (2,) pitch by gravity at both standstills [rad]
    level_std: Array
    slope: float  # largest angle of the robot against the vertical there [rad]


def contradicted(
    imu: ImuStream, matrix: Array, still: Sequence[tuple[float, float]], grade: ImuGrade
) -> tuple[Reading, Reading] | None:
    """Return how the logged pitch rate fares, and the reading of the axes that fits far better, if any does.

    The IMU is turned to robot axes by `matrix` (3, 3); `still` are standstills [s].
    """
    force, rate = imu.specific_force @ matrix.T, np.nan_to_num(imu.angular_rate) @ matrix.T
    motions = [m for before, after in pairwise(still) if (m := _between(imu.t, force, rate, before, after))]
    if not motions:
        return None
    covariances = [_covariance(motion, grade) for motion in motions]
    readings = []
    for axis, letter in enumerate("xyz"):
        for sign, mark in ((1, "+"), (-1, "-")):
            left = np.array([remainder(motion, sign * motion.rate[:, axis]) for motion in motions])
            far = [z @ np.linalg.solve(C, z) for z, C in zip(left, covariances, strict=True)]
            speed = float(np.median(np.abs(left[:, 1])))
            readings.append(Reading(mark + letter, speed, float(np.median(far))))
    logged = next(r for r in readings if r.name == "+y")
    best = min(readings, key=lambda reading: reading.distance)
    # one motion in which the robot is lifted or pushed must not decide: all count as the median does
    ratio = 0.5 * len(motions) * (logged.distance - best.distance)
    return (logged, best) if ratio > DECISIVE and best.distance < FITS else None


def _between(
    t: Array, force: Array, rate: Array, before: tuple[float, float], after: tuple[float, float]
) -> Motion | None:
    """Cut the motion between two standstills out of force and rates (N, 3); None where it tells nothing."""
    a, b, c, d = np.searchsorted(t, np.add([*before, *after], [0.1, -0.1, 0.1, -0.1]))
    first, last, motion = slice(a, b), slice(c, d), slice(b, c)
    if min(part.stop - part.start for part in (first, last, motion)) < 10 or after[0] - before[1] > LONGEST:
        return None
    up = np.array([force[rest].mean(axis=0) for rest in (first, last)])
    level = np.arcsin(np.clip(up[:, 0] / -GRAVITY, -1.0, 1.0))
    # a body that still rocks is levelled no better than the means of its blocks agree
    means = np.array([[p.mean() for p in np.array_split(force[r, 0], BLOCKS)] for r in (first, last)])
    std = means.std(axis=1, ddof=1) / np.sqrt(BLOCKS) / GRAVITY
    bias = 0.5 * (rate[first].mean(axis=0) + rate[last].mean(axis=0))
    slope = float(np.max(np.arctan2(np.hypot(up[:, 0], up[:, 1]), np.abs(up[:, 2]))))
    if slope > SLOPED or np.ptp(integral(t[motion], rate[motion, 2] - bias[2])) > TURNED:
        return None
    return Motion(t[motion], force[motion, 0], rate[motion] - bias, level, std, slope)


def remainder(motion: Motion, rate: Array) -> Array:
    """(2,) pitch [rad] and velocity [m/s] that are left at the second standstill with this pitch rate (N,).

    What is left of the pitch is taken out along a straight line before the velocity is integrated.
    """
    turned = integral(motion.t, rate)
    drift = motion.level[1] - motion.level[0] - turned[-1]
    pitch = motion.level[0] + turned + _ramp(motion.t) * drift
    return np.array([drift, np.trapezoid(motion.force + GRAVITY * np.sin(pitch), motion.t)])


def _covariance(motion: Motion, grade: ImuGrade) -> Array:
    """(2, 2) covariance of `remainder` with the right pitch rate."""
    t, dt = motion.t, float(np.median(np.diff(motion.t)))
    T = float(t[-1] - t[0])
    accel = max(floor_density(motion.force, dt), grade.accel_noise)
    gyro = max(floor_density(motion.rate[:, 1], dt), grade.gyro_noise)
    C = np.diag([
        gyro**2 * T + (grade.gyro_bias * T) ** 2 + np.sum(motion.level_std**2),
        accel**2 * T + (2.0 * grade.accel_instability * T) ** 2 + GRAVITY**2 * gyro**2 * T**3 / 12.0,
    ])  # fmt: skip
    C[1, 1] += np.sum((0.5 * GRAVITY * T * motion.level_std) ** 2)
    C[1, 1] += (TURNS_ABOUT * float(np.trapezoid(motion.rate[:, 2] ** 2, t))) ** 2
    rolled = float(np.hypot(MISALIGNED, motion.slope))
    turning = [(SCALE, motion.rate[:, 1]), (CROSS, motion.rate[:, 0]), (rolled, motion.rate[:, 2])]
    part = np.minimum((_ramp(t) * SEGMENTS).astype(int), SEGMENTS - 1)
    turning += [(rolled, np.where(part == i, motion.rate[:, 2], 0.0)) for i in range(SEGMENTS)]
    for std, rate in turning:
        angle = integral(t, rate)
        along = np.trapezoid(angle - _ramp(t) * angle[-1], t)
        wrong = std * np.array([-angle[-1], GRAVITY * along])
        C += np.outer(wrong, wrong)
    return C


def _ramp(t: Array) -> Array:
    """(N,) from 0 to 1 over the stamps."""
    return np.asarray((t - t[0]) / (t[-1] - t[0]))


def floor_density(signal: Array, dt: float) -> float:
    """White noise density (std times sqrt(s)) of a signal (N,): the least Allan deviation times sqrt of time.

    Vibration adds to the short averages and motion to the long ones, so none is below the white noise.
    """
    least, size = np.inf, 1
    while signal.size // size >= BLOCKS:
        step = np.diff(signal[: signal.size // size * size].reshape(-1, size).mean(axis=1))
        least, size = min(least, 0.5 * float(np.mean(step**2)) * size * dt), 2 * size
    return float(np.sqrt(least)) if np.isfinite(least) else float(np.std(signal) * np.sqrt(dt))
