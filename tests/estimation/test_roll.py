"""The roll of the sensor, by standstills and gyro, on a robot that leans as told."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from granite_lab.estimation.mounting import BodyImu, given, to_body
from granite_lab.estimation.nominal import roll_angle
from granite_lab.logs.trial import ImuStream
from granite_lab.parameters import load_robot

ROBOT = load_robot("granite", "industrial")
T = np.arange(0.0, 14.0, 0.005)
REST = (T < 2.0) | (T > 12.0)


def leaning(roll: np.ndarray, *, bias: float = 0.0, rate_bias: float = 0.0) -> BodyImu:
    """Samples of a robot that goes straight and leans by `roll` [rad]."""
    force = np.stack([0.0 * T, 9.81 * np.sin(roll) + bias, 9.81 * np.cos(roll)], axis=1)
    rate = np.stack([np.gradient(roll, T) + rate_bias, 0.0 * T, 0.0 * T], axis=1)
    return to_body(ImuStream(T, force, rate), given(ROBOT))


def tilting(start: float, end: float) -> np.ndarray:
    """From one roll to another, by way of a third."""
    share = np.clip((T - 2.0) / 10.0, 0.0, 1.0)
    return start + (end - start) * share + 0.004 * np.sin(2 * np.pi * share)


@pytest.mark.parametrize("end", [0.01, -0.02])
def test_ground_that_leans_otherwise_at_the_end_does_not_shift_the_whole_motion(end: float) -> None:
    truth = tilting(0.01, end)
    found, std = roll_angle(leaning(truth), REST, ROBOT)
    assert np.abs(found - truth).max() < 0.3 * std
    assert np.ptp(found - truth) < 1e-4


def test_drift_of_the_gyro_between_standstills_is_taken_out() -> None:
    truth = tilting(0.01, 0.0)
    imu = leaning(truth)
    # a bias that is there only in motion shows at the end
    drifting = dataclasses.replace(imu, roll_rate=imu.roll_rate + np.where(REST, 0.0, 5e-4))
    found, _ = roll_angle(drifting, REST, ROBOT)
    assert np.ptp(found - truth) < 2e-4


def test_bias_of_the_accelerometer_stays_within_the_stated_std() -> None:
    truth = tilting(0.005, -0.01)
    found, std = roll_angle(leaning(truth, bias=ROBOT.imu_grade.accel_bias), REST, ROBOT)
    assert 0.5 * std < np.abs(found - truth).max() < 1.3 * std


def test_without_gravity_or_standstill_the_roll_is_not_known() -> None:
    imu = leaning(tilting(0.01, 0.01))
    for found, std in (
        roll_angle(dataclasses.replace(imu, gravity=0.0), REST, ROBOT),
        roll_angle(imu, np.zeros(T.size, dtype=bool), ROBOT),
    ):
        assert not found.any()
        assert std > np.radians(0.9)
