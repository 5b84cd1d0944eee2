"""Standstills that coarse encoders, or an IMU alone, cannot see sharply; rounded and muted IMUs."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binom

from granite_lab.estimation import correct
from granite_lab.logs import read_trial
from granite_lab.logs.trial import Array, ImuStream, Trial
from granite_lab.parameters import load_robot
from tests.cli.test_samples import LOGS, truth_of
from tests.soak import sampled

ROBOT = load_robot("granite")
PLACES = sampled(range(len(LOGS)), 3)
"""Of the samples; one at each speed, all in `make soak`."""
LEAST = int(binom.ppf(0.02, len(PLACES), 0.9545))
"""Of so many true numbers fewer lie within two std once in 50 times."""
G = 9.81


@cache
def read(place: int) -> tuple[Trial, pd.DataFrame, float]:
    truth, true = truth_of(LOGS[place])
    return read_trial(LOGS[place]), truth, true["slip_ratio"]


def counted(trial: Trial, counts: int, rounded: Callable[[Array], Array] = np.rint) -> Trial:
    wheels, q = trial.wheels, 2 * np.pi / counts
    assert wheels is not None
    angle = np.asarray(rounded(wheels.angle / q)) * q
    return replace(trial, wheels=replace(wheels, angle=angle, resolution=(q,) * 4))


def errors(changed: Callable[[Trial], Trial]) -> tuple[Array, Array, list[str]]:
    """(n, 2) errors of slip [points] and distance [m] over samples, their std, and the grades."""
    found, stds, grades = [], [], []
    for place in PLACES:
        trial, truth, slip = read(place)
        motion = correct(changed(trial), ROBOT)[1]
        begin, end = np.interp(motion.t[[0, -1]], truth["t_s"], truth["x_m"])
        ratio, way = motion.slip_ratio, motion.distance
        found.append([100 * (ratio.value - slip), way.value - (end - begin)])
        stds.append([100 * ratio.std, way.std])
        grades.append(motion.health.grade)
    return np.array(found), np.array(stds), grades


@pytest.mark.parametrize("counts", sampled([512, 1920, 4096], 3))
def test_slip_of_the_samples_is_true_at_any_resolution(counts: int) -> None:
    error, std, grades = errors(lambda trial: counted(trial, counts))
    # three tenths of a point over the twelve; a mean over fewer scatters by more
    assert abs(float(error[:, 0].mean())) < 0.3 * np.sqrt(len(LOGS) / len(PLACES))
    assert np.count_nonzero(np.abs(error) < 2 * std, axis=0).min() >= LEAST
    assert float(np.median(std[:, 0])) < 0.7
    assert "poor" not in grades


def test_distance_by_the_imu_alone_is_true_within_its_std() -> None:
    error, std, _ = errors(lambda trial: replace(trial, wheels=None, currents=None))
    assert np.count_nonzero(np.abs(error[:, 1]) < 2 * std[:, 1]) >= LEAST
    assert abs(float(error[:, 1].mean())) < 0.006
    assert float(np.median(std[:, 1])) < 0.012


def rounded(trial: Trial, force: float, rate: float) -> Trial:
    """Round the IMU's values to steps [m/s^2], [rad/s]; 0 leaves them."""
    imu = trial.imu
    assert imu is not None
    values = [
        np.round(x / q) * q if q else x for x, q in ((imu.specific_force, force), (imu.angular_rate, rate))
    ]
    return replace(trial, imu=ImuStream(imu.t, values[0], values[1]))


def muted(trial: Trial) -> Trial:
    """Let the gyro read 0 while the wheels stand, as one with a dead band."""
    imu, wheels = trial.imu, trial.wheels
    assert imu is not None
    assert wheels is not None
    mean = np.interp(imu.t, wheels.t, np.nan_to_num(wheels.angle).mean(axis=1))
    still = np.abs(np.gradient(mean, imu.t)) * ROBOT.wheels.radius < 0.01
    return replace(
        trial, imu=ImuStream(imu.t, imu.specific_force, np.where(still[:, None], 0.0, imu.angular_rate))
    )


def two_decimals(trial: Trial) -> Trial:
    return rounded(trial, 0.01, 0.01)


def two_decimals_in_g(trial: Trial) -> Trial:
    return rounded(trial, 0.01 * G, 0.0)


@pytest.mark.parametrize(
    ("change", "widest"), sampled([(two_decimals, 2.5), (two_decimals_in_g, 2.0), (muted, 1.0)])
)
def test_rounded_and_muted_imus_are_true_within_their_std(
    change: Callable[[Trial], Trial], widest: float
) -> None:
    error, std, _ = errors(change)
    assert np.count_nonzero(np.abs(error) < 2 * std, axis=0).min() >= LEAST
    assert np.abs(error / std).max() < 3
    assert float(np.median(std[:, 0])) < widest
