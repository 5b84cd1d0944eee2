"""Clocks that are seconds apart, and IMUs off level or off scale: right within the std, and said."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from granite_lab import estimation
from granite_lab.effects import get
from granite_lab.estimation import correct
from granite_lab.logs import read_trial
from granite_lab.logs.sensors.mounting import to_body
from granite_lab.logs.sensors.two_clocks import gross_offset
from granite_lab.logs.trial import Trial
from granite_lab.parameters import load_robot
from tests.soak import in_turn, sampled
from tests.truth import field

ROBOT = load_robot("granite")
AHEAD = ["virtual_v0.2_r1", "virtual_v0.3_r1", "virtual_v0.5_r2", "virtual_v0.7_r3"]


def sample(name: str) -> tuple[Trial, float]:
    path = next(p for p in field.SAMPLES if p.stem == name)
    return read_trial(path), field.of_sample(path).slip


def late(trial: Trial, by: float) -> Trial:
    """The encoders' computer has a clock that lies behind by some seconds."""
    assert trial.wheels is not None
    assert trial.currents is not None
    return replace(
        trial,
        wheels=replace(trial.wheels, t=trial.wheels.t - by),
        currents=replace(trial.currents, t=trial.currents.t - by),
    )


@pytest.mark.parametrize(("name", "by"), sampled(zip(AHEAD[::-1], [1.7e9, 3.1, -2.0, 1.5], strict=True), 4))
def test_offsets_of_seconds_are_found_by_the_ramps(name: str, by: float) -> None:
    trial, slip = sample(name)
    clean, motion = correct(late(trial, by), ROBOT)
    assert abs(motion.clock_offset.value - by) < 3 * motion.clock_offset.std < 0.15
    assert abs(motion.slip_ratio.value - slip) < 2.5 * motion.slip_ratio.std < 0.02
    assert any("brought together" in line for line in motion.warnings)
    assert clean.wheels is not None
    assert trial.wheels is not None
    assert clean.wheels.t[0] == pytest.approx(trial.wheels.t[0], abs=0.13)


def test_an_offset_of_milliseconds_is_left_to_the_refined_search() -> None:
    trial, _ = sample(AHEAD[1])
    assert trial.imu is not None
    assert trial.wheels is not None
    imu = to_body(trial.imu, Rotation.identity())
    for by in (0.0, 0.05, -0.2):
        wheels = late(trial, by).wheels
        assert wheels is not None
        assert gross_offset(imu, wheels, 0.1, forward_given=True).value == 0.0


def test_a_given_offset_of_seconds_is_taken_as_it_is() -> None:
    trial, slip = sample(AHEAD[2])
    moved = late(trial, 4.0)
    given = replace(moved, info=replace(moved.info, clock_offset=4.0))
    motion = correct(given, ROBOT)[1]
    assert motion.clock_offset.value == pytest.approx(4.0, abs=1e-6)
    assert abs(motion.slip_ratio.value - slip) < 3 * motion.slip_ratio.std


def test_wheels_that_repeat_one_ramp_for_ever_show_no_offset() -> None:
    """Every period fits as well as any other: none is chosen."""
    trial, _ = sample(AHEAD[0])
    assert trial.imu is not None
    assert trial.wheels is not None
    t = np.arange(0.0, 40.0, 0.01)
    speed = np.interp(t % 5.0, [0.0, 1.0, 1.5, 3.5, 4.0, 5.0], [0.0, 0.0, 0.3, 0.3, 0.0, 0.0])
    force = np.stack([np.gradient(speed, t), 0 * t, 9.81 + 0 * t], axis=1)
    imu = to_body(replace(trial.imu, t=t, specific_force=force, angular_rate=0 * force), Rotation.identity())
    angle = np.cumsum(np.repeat(speed[:, None], 4, axis=1), axis=0) * 0.01 / 0.1
    wheels = replace(trial.wheels, t=t + 1.5, angle=angle, rate=None)
    assert np.isnan(gross_offset(imu, wheels, 0.1, forward_given=True).std)


def turned(trial: Trial, degrees: float) -> Trial:
    """The IMU is mounted off level about y."""
    assert trial.imu is not None
    turn = Rotation.from_euler("y", degrees, degrees=True)
    imu = trial.imu
    return replace(
        trial,
        imu=replace(
            imu,
            specific_force=turn.apply(imu.specific_force),
            angular_rate=turn.apply(imu.angular_rate),
        ),
    )


@pytest.mark.parametrize(("name", "degrees"), in_turn(sampled(AHEAD, 4), [8.0, -12.0]))
def test_an_imu_off_level_is_levelled_and_never_good(name: str, degrees: float) -> None:
    trial, slip = sample(name)
    motion = correct(turned(trial, degrees), ROBOT)[1]
    assert abs(motion.slip_ratio.value - slip) < 2 * motion.slip_ratio.std
    assert motion.slip_ratio.std < 0.03
    assert motion.health.grade == "fair"
    assert "off level" in motion.health.verdict


@pytest.mark.parametrize(("name", "scale"), in_turn(sampled(AHEAD, 4), [0.96, 1.05, 1.02]))
def test_an_accelerometer_off_scale_is_scaled_by_gravity_and_never_good(name: str, scale: float) -> None:
    trial, slip = sample(name)
    assert trial.imu is not None
    imu = replace(trial.imu, specific_force=scale * trial.imu.specific_force)
    clean, motion = correct(replace(trial, imu=imu), ROBOT)
    assert abs(motion.slip_ratio.value - slip) < 2 * motion.slip_ratio.std
    # the scale may be that of the vertical axis alone
    assert motion.slip_ratio.std < abs(scale - 1.0)
    assert motion.health.grade == "fair"
    assert clean.imu is not None
    still = np.nanmean(clean.imu.specific_force[:100], axis=0)
    assert np.linalg.norm(still) == pytest.approx(9.81, abs=0.06)
    assert any("taken for a scale error" in warning for warning in motion.warnings)
    assert clean.imu.scaled == pytest.approx(scale, abs=0.01)
    np.testing.assert_allclose(
        np.nanmean(np.abs(clean.imu.specific_force[:, 2] * clean.imu.scaled)),
        np.mean(np.abs(imu.specific_force[:, 2])), rtol=1e-3,
    )  # fmt: skip


def test_a_scale_error_beside_what_estimation_scaled_is_stated_for_the_log() -> None:
    """The vertical axis reads 9 % too little; estimation divided all axes by 0.91."""
    effect, scaled = get("accel_scale_error"), 0.91
    forward, vertical = 1.0 / scaled - 1.0, 0.0  # what is left in the corrected trial
    assert effect.as_logged(forward, scaled) == pytest.approx(0.0, abs=1e-12)
    assert effect.as_logged(vertical, scaled) == pytest.approx(-0.09)
    assert get("com_offset").as_logged(0.01, scaled) == 0.01


def test_samples_within_their_grade_are_left_as_they_are() -> None:
    """Levelling or scaling within the grade would take a bias of the sensor for an error of mounting."""
    for name in sampled(AHEAD):
        trial, _ = sample(name)
        _, motion = estimation.correct(trial, ROBOT)  # which other tests estimate, too
        assert motion.health.grade == "good"
        assert not any("scale" in warning or "levelled" in warning for warning in motion.warnings)
