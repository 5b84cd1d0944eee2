"""An offset between the clocks of IMU and encoders is recovered with the std it is given."""

from __future__ import annotations

import numpy as np
import pytest

from granite_lab.estimate import Estimate
from granite_lab.estimation import estimate
from granite_lab.parameters import load_robot
from tests.truth import faults
from tests.truth.trials import TruthTrial, generate

OFFSETS = [0.005, -0.005, 0.02, -0.02, 0.05, -0.05, 0.2, -0.2]
"""By which the encoders' stamps lie behind [s]."""

TRIALS = [
    (800 + i, offset, (0.2, 0.3, 0.5, 0.7)[(i // 2) % 4], ("industrial", "consumer")[i % 2])
    for i, offset in enumerate(OFFSETS * 3)
]
"""Seed, offset, velocity, grade."""


def draw(seed: int, offset: float, velocity: float, grade: str) -> TruthTrial:
    return generate(seed, velocity=velocity, grade=grade, duration=4.0, still=(1.2, 1.2), clock_offset=offset)


@pytest.fixture(scope="module")
def found() -> list[Estimate]:
    return [estimate(draw(*spec).trial, load_robot("granite", spec[3])).clock_offset for spec in TRIALS]


def test_injected_offsets_are_recovered_to_five_milliseconds(found: list[Estimate]) -> None:
    error = np.array([one.value - spec[1] for one, spec in zip(found, TRIALS, strict=True)])
    assert np.sqrt(np.mean(error**2)) <= 0.005
    assert abs(np.mean(error)) < 0.0025  # and no lag of the body behind the wheels is taken for one


def test_stated_std_of_the_offset_is_true(found: list[Estimate]) -> None:
    error = np.array([one.value - spec[1] for one, spec in zip(found, TRIALS, strict=True)])
    std = np.array([one.std for one in found])
    assert np.mean(np.abs(error) < 2 * std) >= 0.9
    assert np.median(std) < 0.005  # not true by being wide


def test_offset_is_corrected_in_what_the_wheels_are_said_to_do() -> None:
    truth = draw(*TRIALS[6])
    motion = estimate(truth.trial, load_robot("granite", TRIALS[6][3]))
    ramp = (motion.t > truth.start) & (motion.t < truth.start + 0.3)
    error = motion.v_wheel[ramp] - truth.at(motion.t[ramp], "v_wheel")
    unmoved = truth.at(motion.t[ramp] - 0.2, "v_wheel") - truth.at(motion.t[ramp], "v_wheel")
    assert np.sqrt(np.nanmean(error**2)) < 0.15 * np.sqrt(np.mean(unmoved**2))


def test_offset_is_unobservable_where_nothing_accelerates() -> None:
    """A log of standstill; one of constant speed, a standstill named by hand so that there is an estimate."""
    truth = generate(820, velocity=0.3, duration=8.0)
    standing = faults.cut(truth.trial, start=0.0, stop=1.8)
    motion = estimate(standing, load_robot("granite", "industrial"))
    assert motion.clock_offset.value == 0.0
    assert np.isnan(motion.clock_offset.std)
    assert any("unobservable" in line for line in motion.warnings)
    steady = faults.cut(truth.trial, start=4.0, stop=8.0)
    motion = estimate(steady, load_robot("granite", "industrial"), rests=[(4.0, 4.05)])
    assert np.isnan(motion.clock_offset.std) or motion.clock_offset.std > 0.05
