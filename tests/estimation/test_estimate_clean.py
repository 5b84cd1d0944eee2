"""A clean virtual trial: the estimate is close, and as close as it says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from granite_lab.estimation import Motion, estimate
from granite_lab.logs import read_trial
from granite_lab.parameters import load_robot
from tests.truth import faults
from tests.truth.trials import TruthTrial, generate

SAMPLE = Path(__file__).parents[2] / "data" / "samples" / "virtual_v0.5_r1.csv"


@pytest.fixture(scope="module")
def trial() -> TruthTrial:
    return generate(3, velocity=0.3, grade="industrial", clock_offset=0.05, reference=True)


@pytest.fixture(scope="module")
def motion(trial: TruthTrial) -> Motion:
    return estimate(trial.trial, load_robot("granite", "industrial"))


def test_wheel_velocity_follows_each_wheel(trial: TruthTrial, motion: Motion) -> None:
    error = motion.v_wheel - trial.at(motion.t, "v_wheel")
    assert np.nanmax(np.abs(error)) < 0.04
    assert np.sqrt(np.nanmean(error**2)) < 0.005


def test_phases_stand_in_order_and_the_command_start_is_found(trial: TruthTrial, motion: Motion) -> None:
    order = [name for i, name in enumerate(motion.phase) if i == 0 or name != motion.phase[i - 1]]
    assert order == ["rest", "accelerate", "steady", "brake", "rest"]
    assert abs(motion.t_start.value - trial.start) < 0.1
    assert motion.variant.velocity == pytest.approx(0.3)


def test_log_that_ends_while_the_wheels_coast_is_anchored_by_them() -> None:
    """Cut where the wheels still turn at 2 mm/s; without that anchor it is 1 mm/s off the whole log's."""
    trial, robot = read_trial(SAMPLE), load_robot("granite")
    whole, motion = estimate(trial, robot), estimate(faults.cut(trial, stop=8.5), robot)
    assert motion.health.rests[-1][1] < 3.0
    off = motion.v - np.interp(motion.t, whole.t, whole.v)
    assert np.sqrt(np.mean(off**2)) < 0.0004
    assert motion.v_std[-1] < 0.002
