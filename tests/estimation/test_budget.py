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
