"""The components of the std of λ_R add up to it, and each is what the estimate really moves by."""

from __future__ import annotations

import dataclasses
import math

import pytest

from granite_lab.estimation import Motion, estimate
from granite_lab.logs.trial import Trial
from granite_lab.parameters import load_robot
from tests.truth.trials import generate

ROBOT = load_robot("granite", "industrial")


@pytest.fixture(scope="module")
def trial() -> Trial:
    return generate(3, velocity=0.3, grade="industrial", clock_offset=0.05).trial


@pytest.fixture(scope="module")
def motion(trial: Trial) -> Motion:
    return estimate(trial, ROBOT)


def total(motion: Motion) -> float:
    return math.sqrt(sum(part.contribution**2 for part in motion.slip_parts))


def test_the_components_add_up_to_the_stated_std(motion: Motion) -> None:
    assert total(motion) == pytest.approx(motion.slip_ratio.std, rel=0.01)
    assert len({part.name for part in motion.slip_parts}) == len(motion.slip_parts) > 5


@pytest.mark.parametrize(("velocity", "grade"), [(0.2, "consumer"), (0.7, "industrial")])
def test_they_do_at_other_speeds_and_with_a_cheap_imu(velocity: float, grade: str) -> None:
    trial = generate(5, velocity=velocity, grade=grade)
    motion = estimate(trial.trial, load_robot("granite", grade))
    assert total(motion) == pytest.approx(motion.slip_ratio.std, rel=0.001)


def test_a_bias_in_motion_moves_the_slip_by_its_sensitivity(trial: Trial, motion: Motion) -> None:
    assert trial.imu is not None
    bias = 0.002
    (_, begin), (end, _) = motion.health.rests[0], motion.health.rests[-1]
    force = trial.imu.specific_force.copy()
    force[(trial.imu.t > begin) & (trial.imu.t < end), 0] += bias
    wrong = dataclasses.replace(trial, imu=dataclasses.replace(trial.imu, specific_force=force))
    moved = estimate(wrong, ROBOT).slip_ratio.value - motion.slip_ratio.value
    only = next(p for p in motion.slip_parts if p.name == "bias that is there only in motion")
    assert abs(moved) == pytest.approx(only.sensitivity * bias, rel=0.1)
