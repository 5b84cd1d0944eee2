"""IMUs that are loud, slow or drift in motion: the true distance and slip lie within the stated std."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import chi2

from granite_lab.estimation.motion import Motion
from granite_lab.logs import read_trial
from granite_lab.logs.sensors.pitch_rate import contradicted
from granite_lab.logs.trial import ImuStream
from granite_lab.parameters import GRAVITY, load_robot
from tests.soak import SOAK, sampled
from tests.truth import field
from tests.truth.motion import estimate

Rests = Sequence[tuple[float, float]]
SEEDS = range(20 if SOAK else 2)
SLIP, FIRM = 0.044, 11.2
"""Slip ratio and distance [m] of the fast robot on firm ground."""

ROBOT = """name = "loud"
title = "robot of a loud IMU"
[wheels]
radius_m = {radius}
[imu]
grade = "consumer"
x_m = 0.0
z_m = {height}
"""


def firm_ground(seed: int, rate: float) -> pd.DataFrame:
    """Rest 3 s, 28 s at 0.4 m/s, rest 3 s; white noise of a robot on rough ground, in motion only."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, 34, 1 / rate)
    v = np.interp(t, [0, 3, 3.5, 31, 31.5, 34], [0, 0, 0.4, 0.4, 0, 0])
    noise = np.where(v > 0.03, 0.45 * np.sqrt(rate / 20), 0.01)
    log = pd.DataFrame({"t_s": t, "imu_ax_mps2": np.gradient(v, t) + noise * rng.normal(size=t.size)})
    log["imu_ay_mps2"] = 0.01 * rng.normal(size=t.size)
    log["imu_az_mps2"] = 9.81 + noise * rng.normal(size=t.size)
    for axis in "xyz":
        log[f"imu_g{axis}_radps"] = 0.001 * rng.normal(size=t.size)
    angle = np.cumsum(v / (1 - SLIP)) / rate / 0.165
    for wheel in ("fl", "fr", "rl", "rr"):
        log[f"enc_{wheel}_rad"] = np.round(angle * 2000) / 2000
    return log.round(6)


def slow_robot(seed: int) -> pd.DataFrame:
    """Rest 2 s, 10 s at 78 mm/s without slip, rest 2 s; in motion the pitch gyro drifts and is loud."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, 14, 1 / 64)
    v = np.interp(t, [0, 2, 2.2, 12, 12.2, 14], [0, 0, 0.078, 0.078, 0, 0])
    moving, x = v > 0, np.cumsum(v) / 64
    bias = np.where(moving, rng.choice([-1, 1]) * rng.uniform(0.03, 0.07), 0.0)
    log = pd.DataFrame({"t_s": t})
    means = (np.gradient(v, t), 0.0, 9.81, 0.0, bias, 0.0)
    loud, calm = (0.45, 0.3, 0.35, 0.6, 1.5, 2.7), (0.02, 0.02, 0.02, 0.1, 0.1, 0.1)
    names = [*(f"imu_a{axis}_mps2" for axis in "xyz"), *(f"imu_g{axis}_dps" for axis in "xyz")]
    for name, mean, one, other in zip(names, means, loud, calm, strict=True):
        log[name] = mean + rng.normal(0, np.where(moving, one, other), t.size)
    for wheel in ("fl", "fr", "rl", "rr"):
        log[f"enc_{wheel}_rad"] = np.floor(x / 0.036 * 508.8 / 6.283185) / 508.8 * 6.283185
    return log.round(6)


def found(log: pd.DataFrame, folder: Path, radius: float, height: float, rests: Rests = ()) -> Motion:
    """Read and estimate a log as a user would."""
    robot = folder / "robot.toml"
    robot.write_text(ROBOT.format(radius=radius, height=height), encoding="utf-8")
    log.to_csv(folder / "log.csv", index=False)
    trial = read_trial(folder / "log.csv", robot=robot)
    return estimate(trial, load_robot(str(robot)), rests=rests)


def agree(errors: list[float]) -> None:
    """No error is beyond 4 std, and their squares sum up to what chance makes in 999 of 1000 cases."""
    assert np.max(np.abs(errors)) < 4.0
    assert np.sum(np.square(errors)) < chi2.ppf(0.999, len(errors))


@pytest.mark.parametrize("rate", sampled([20.0, 100.0]))
def test_white_noise_in_motion_widens_the_std_as_far_as_it_drifts(tmp_path: Path, rate: float) -> None:
    """It is 0.1 m/s^2 sqrt(s); taken for vibration, the distance was up to 23 std off."""
    distances, slips = [], []
    for seed in SEEDS:
        motion = found(firm_ground(seed, rate), tmp_path, 0.165, 0.0, rests=[(0.0, 2.9), (31.7, 33.9)])
        assert motion.noise["accel_noise_in_motion_mps2_sqrts"] == pytest.approx(0.1006, rel=0.25)
        distances.append((motion.distance.value - FIRM) / motion.distance.std)
        slips.append((motion.slip_ratio.value - SLIP) / motion.slip_ratio.std)
    for errors in (distances, slips):
        agree(errors)


@pytest.mark.parametrize("seed", sampled([2, 4]))
def test_a_loud_imu_feigns_no_offset_of_the_clocks(tmp_path: Path, seed: int) -> None:
    """Its onsets show -174 ± 114 and -203 ± 85 ms, which was applied as ± 6 ms: up to 21 points of slip."""
    motion = found(firm_ground(seed, 100.0), tmp_path, 0.165, 0.0)
    assert motion.clock_applied == 0.0
    assert abs(motion.clock_offset.value) < 2.0 * motion.clock_offset.std
    assert abs(motion.slip_ratio.value - SLIP) < 2.0 * motion.slip_ratio.std


def test_vibration_that_an_unfiltered_sensor_folds_is_in_the_std(tmp_path: Path) -> None:
    """25 of 200 samples a second: the frame rings near 25 Hz, which folds to frequencies of the motion."""
    robot, errors = load_robot("granite"), []
    for path in sampled(field.SAMPLES, 4):
        source = field.of_sample(path)
        imu = pd.DataFrame(np.hstack([source.force, source.rate]), columns=[*field.FORCE, *field.TURN])
        wheels = pd.DataFrame(source.angle, columns=[f"enc_{wheel}_rad" for wheel in field.WHEELS])
        slow = imu.assign(t_s=source.t_imu)[4::8]
        log = pd.concat([slow, wheels.assign(t_s=source.t_wheels)]).sort_values("t_s")
        log[["t_s", *log.columns.drop("t_s")]].to_csv(tmp_path / "slow.csv", index=False)
        slip = estimate(read_trial(tmp_path / "slow.csv", robot="granite"), robot).slip_ratio
        errors.append((slip.value - source.slip) / slip.std)
    agree(errors)


def test_a_gyro_that_drifts_in_motion_costs_precision_and_no_axis_is_refused(tmp_path: Path) -> None:
    """The slow robot rolls 0.78 m; the log was refused with "its sign is wrong" or "axes exchanged"."""
    errors = []
    for seed in range(20) if SOAK else (2, 3):
        motion = found(slow_robot(seed), tmp_path, 0.036, 0.05)
        errors.append((motion.distance.value - 0.78) / motion.distance.std)
        assert motion.distance.std < 0.3
    agree(errors)


def test_a_gyro_of_the_wrong_sign_is_found_on_uneven_ground_and_a_turn_on_a_slope_is_none() -> None:
    """Gravity turns with the right axis; a turn on a slope turns it without a pitch rate."""
    rng, t = np.random.default_rng(1), np.arange(0.0, 14.0, 0.01)
    still, grade = [(0.0, 2.0), (12.0, 14.0)], load_robot("granite", "consumer").imu_grade
    assert grade is not None
    going = (t > 2.0) & (t < 12.0)
    noise = 0.02 * rng.normal(size=(t.size, 3)), 0.001 * rng.normal(size=(t.size, 3))
    pitch = np.radians(3.0) * np.where(going, np.sin(np.pi * (t - 2.0) / 10.0) ** 2, 0.0)
    rolling = np.stack([-GRAVITY * np.sin(pitch), 0 * t, GRAVITY * np.cos(pitch)], axis=1)
    turning = np.stack([0 * t, np.gradient(pitch, t), 0 * t], axis=1)
    right, wrong = (ImuStream(t, rolling + noise[0], sign * turning + noise[1]) for sign in (1, -1))
    assert contradicted(right, np.eye(3), still, grade) is None
    verdict = contradicted(wrong, np.eye(3), still, grade)
    assert verdict is not None
    assert verdict[1].name == "-y"
    # a turn by 180 degrees on a slope of 6 degrees, late in the motion
    heading = np.interp(t, [0.0, 8.0, 11.0, 14.0], [0.0, 0.0, np.pi, np.pi])
    slope, rate = np.radians(6.0), np.gradient(heading, t)
    up = np.stack(
        [np.sin(slope) * np.cos(heading), -np.sin(slope) * np.sin(heading), 0 * t + np.cos(slope)], 1
    )
    turned = ImuStream(t, GRAVITY * up + noise[0], np.stack([0 * t, 0 * t, rate], axis=1) + noise[1])
    assert contradicted(turned, np.eye(3), still, grade) is None
