"""What makes an estimate doubtful is in its std, and its components are what the estimate moves by."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from granite_lab.estimation import Motion, estimate
from granite_lab.estimation.mounting import BodyImu, given, to_body
from granite_lab.estimation.noise import stamp_noise
from granite_lab.logs.trial import ImuStream, Trial
from granite_lab.parameters import load_robot
from tests.truth import TruthTrial, generate

ROBOT = load_robot("granite", "industrial")


def shaken(rng: np.random.Generator, scatter: float) -> tuple[BodyImu, float]:
    """Half a second of a 20 Hz shake, whose integral is known, under scattered stamps; and by them."""
    t = np.arange(0.0, 0.5 + 1e-9, 0.005)
    force = np.zeros((t.size, 3))
    force[:, 0] = 2.0 * np.sin(2 * np.pi * 20.0 * t)
    stamps = t + scatter * rng.standard_normal(t.size)
    stamps[[0, -1]] = t[[0, -1]]
    imu = to_body(ImuStream(stamps, force, np.zeros((t.size, 3))), given(ROBOT))
    return imu, float(np.trapezoid(force[:, 0], stamps))


def test_scattered_stamps_make_white_noise_of_a_shake() -> None:
    """The velocity after half a second scatters by the stated density times the root of the time."""
    rng = np.random.default_rng(5)
    drawn = [shaken(rng, 1e-4) for _ in range(600)]
    std = np.std([velocity for _, velocity in drawn])
    density = np.mean([stamp_noise(imu, np.ones(imu.t.size, dtype=bool)) for imu, _ in drawn])
    # 600 draws know a std to 3 %
    assert density * np.sqrt(0.5) == pytest.approx(std, rel=0.1)


def test_even_stamps_make_none() -> None:
    imu, _ = shaken(np.random.default_rng(6), 0.0)
    assert stamp_noise(imu, np.ones(imu.t.size, dtype=bool)) < 1e-12


def cruising(truth: TruthTrial, motion: Motion) -> tuple[float, float]:
    """Mean error of v and mean std over the steady part [m/s]."""
    steady = (motion.t > truth.steady[0]) & (motion.t < truth.steady[1])
    error = motion.v - truth.at(motion.t, "v")
    return float(np.mean(error[steady])), float(np.mean(motion.v_std[steady]))


def test_scale_error_of_the_accelerometer_is_in_the_std() -> None:
    """Scale errors of 2 % shift the velocity by 2 %; the std is that of a grade that says so."""
    coarse = dataclasses.replace(ROBOT, imu_grade=dataclasses.replace(ROBOT.imu_grade, accel_scale=0.02))
    normalised = []
    for seed in range(4):
        truth = generate(800 + seed, velocity=0.5, duration=3.0, still=(0.6, 0.6), scale_error=0.02)
        error, std = cruising(truth, estimate(truth.trial, coarse))
        assert std == pytest.approx(0.02 * float(np.median(truth.v[truth.v > 0.3])), rel=0.1)
        normalised.append(error / std)
    assert 0.2 < np.sqrt(np.mean(np.square(normalised))) < 2.1
    _, fine = cruising(truth, estimate(truth.trial, ROBOT))
    assert fine < 0.3 * std


@pytest.fixture(scope="module")
def trial() -> Trial:
    return generate(3, velocity=0.3, grade="industrial", clock_offset=0.05).trial


@pytest.fixture(scope="module")
def motion(trial: Trial) -> Motion:
    return estimate(trial, ROBOT)


def test_the_components_add_up_to_the_stated_std(motion: Motion) -> None:
    """At other speeds and with a cheap IMU, too."""
    others = (
        estimate(generate(5, velocity=v, grade=grade).trial, load_robot("granite", grade))
        for v, grade in ((0.2, "consumer"), (0.7, "industrial"))
    )
    for one in (motion, *others):
        total = math.hypot(*(part.contribution for part in one.slip_parts))
        assert total == pytest.approx(one.slip_ratio.std, rel=0.01)
        assert len({part.name for part in one.slip_parts}) == len(one.slip_parts) > 5


def test_a_bias_in_motion_moves_the_slip_by_its_sensitivity(trial: Trial, motion: Motion) -> None:
    bias = 0.002
    (_, begin), (end, _) = motion.health.rests[0], motion.health.rests[-1]
    force = trial.imu.specific_force.copy()
    force[(trial.imu.t > begin) & (trial.imu.t < end), 0] += bias
    wrong = dataclasses.replace(trial, imu=dataclasses.replace(trial.imu, specific_force=force))
    moved = estimate(wrong, ROBOT).slip_ratio.value - motion.slip_ratio.value
    only = next(p for p in motion.slip_parts if p.name == "bias that is there only in motion")
    assert abs(moved) == pytest.approx(only.sensitivity * bias, rel=0.1)
