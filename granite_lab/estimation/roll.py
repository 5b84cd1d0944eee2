"""Roll of the sensor, through which a turning robot's yaw rate shows in the pitch gyro."""

from __future__ import annotations

import numpy as np

from granite_lab.estimation.mounting import BodyImu
from granite_lab.estimation.rolling import runs
from granite_lab.logs.trial import Array
from granite_lab.parameters import GRAVITY, Robot

UNKNOWN = float(np.radians(1.0))
"""Std of the ground's roll where nothing is known of it [rad]."""

ACROSS = 1.5
"""Ground lies across by this many times what its roll varies along the path."""

LEAST = float(np.radians(0.5))
"""Std of the roll of ground that does not vary at all [rad]."""

EVIDENT = 2.5
"""A mean roll this many std from what ground and bias explain is the ground's."""


def roll_angle(imu: BodyImu, rest: np.ndarray, robot: Robot) -> tuple[Array, float]:
    """(N,) roll of the sensor about x against the vertical [rad], and the std of its constant error.

    At each standstill it is the lateral specific force over g; between them the gyro carries it on,
    and what its bias adds up to is taken out along a straight line. The ground at the end tilts
    differently than at the start, so no mean over the standstills would do. The accelerometer's bias
    is common to all of them: their mean is shrunk by what it may be, their differences are not.

    Args:
        imu: samples in robot axes.
        rest: (N,) True at standstill.
        robot: with an IMU grade, and how far the sensor may be tilted.
    """
    grade = robot.imu_grade
    assert grade is not None
    tilted = float(np.radians(0.0 if imu.levelled else robot.imu.tilt))
    doubt = grade.accel_bias / GRAVITY
    known = rest & np.isfinite(imu.left)
    if not imu.gravity or not known.any():
        return np.zeros(imu.t.size), float(np.hypot(tilted, UNKNOWN))
    rate = np.nan_to_num(imu.roll_rate)
    turned = cumulate(imu.t, rate - float(np.mean(rate[rest])), rest)
    places, seen = [], []
    for a, b in zip(*runs(rest), strict=True):
        if known[a:b].any():
            level = np.clip(np.mean(imu.left[a:b][known[a:b]]) / GRAVITY, -1.0, 1.0)
            places.append((imu.t[a], imu.t[b - 1]))
            seen.append((float(level), float(level - np.mean(turned[a:b]))))
    levels, drifts = np.array(seen).T
    drift = np.interp(imu.t, np.ravel(places), np.repeat(drifts, 2))
    level, angle = float(np.mean(levels)), turned + drift
    varied = float(np.std(angle[~rest])) if (~rest).any() else UNKNOWN
    prior = float(np.hypot(tilted, np.clip(ACROSS * varied, LEAST, UNKNOWN)))
    if abs(level) > EVIDENT * np.hypot(prior, doubt):
        prior = abs(level)
    weight = prior**2 / (prior**2 + doubt**2)
    common = (1.0 - weight) * level
    return angle - common, float(np.sqrt(weight) * doubt)


def cumulate(t: Array, rate: Array, rest: np.ndarray) -> Array:
    """(N,) integral by the trapezoidal rule from the first sample on; it stops between two at rest."""
    step = 0.5 * (rate[1:] + rate[:-1]) * np.diff(t)
    return np.concatenate([[0.0], np.cumsum(np.where(rest[1:] & rest[:-1], 0.0, step))])
