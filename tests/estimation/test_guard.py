"""The last look: what wheels, ground, clocks and innovations contradict is never called good."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from granite_lab.estimate import Estimate
from granite_lab.estimation import Motion, correct
from granite_lab.estimation.guard import guard
from granite_lab.logs import read_trial
from granite_lab.parameters import load_robot, load_soil
from tests.truth import field

SAND = load_soil()
FIRM = replace(SAND, slip=0.005, slip_std=0.02)


@cache
def good() -> Motion:
    return correct(read_trial(field.SAMPLES[3]), load_robot("granite"))[1]


def test_a_good_estimate_passes_unchanged() -> None:
    assert good().health.grade == "good"
    assert guard(good(), SAND) is good()


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"slip_ratio": Estimate(-0.31, 0.02)}, "-31 ± 2 % in the steady part"),
        ({"slip_ratio": Estimate(5.72, 0.24)}, "572 ± 24 %"),
        ({"distance": Estimate(-1.23, 0.19)}, "over all"),
        ({"distance": Estimate(15.59, 0.19)}, "over all"),
    ],
)
def test_slip_that_rolling_wheels_cannot_have_is_poor_and_its_std_covers_it(
    changed: dict[str, Any], reason: str
) -> None:
    wrong = replace(good(), **changed)
    seen = guard(wrong, SAND)
    assert seen.health.grade == "poor"
    assert not seen.health.good
    assert reason in seen.health.verdict
    assert seen.health.verdict.startswith("Look twice")
    # the true slip ratio of this sample is within two of the std that are stated now
    slip = 0.0970
    assert abs(seen.distance.value - good().distance.value) < 2.5 * seen.distance.std
    assert abs(seen.slip_ratio.value - slip) < 2.5 * seen.slip_ratio.std
    assert np.all(seen.v_std >= wrong.v_std)


def test_wheels_that_run_a_little_faster_than_their_file_says_are_no_contradiction() -> None:
    near = replace(good(), slip_ratio=Estimate(-0.04, 0.01))
    assert guard(near, SAND).health.grade == "good"


def test_driving_down_a_slope_explains_wheels_that_brake() -> None:
    down = replace(good(), slip_ratio=Estimate(-0.2, 0.01), pitch=good().pitch + 0.2)
    assert guard(down, SAND).health.grade == "good"
    level = replace(down, pitch=good().pitch)
    assert guard(level, SAND).health.grade == "poor"


def test_a_slip_far_from_what_the_soil_states_is_poor() -> None:
    assert guard(good(), FIRM).health.grade == "poor"
    assert "contradicts the soil's 0.5 ± 2.0 %" in guard(good(), FIRM).health.verdict


def test_a_time_offset_that_does_not_show_is_never_good() -> None:
    unseen = replace(good(), clock_offset=Estimate(0.0))
    assert guard(unseen, SAND).health.grade == "fair"
    assert "time offset" in guard(unseen, SAND).health.verdict


def test_innovations_far_beyond_their_prediction_are_poor() -> None:
    loud = replace(good(), health=replace(good().health, nis={"wheel": 25.0}))
    assert guard(loud, SAND).health.grade == "poor"
    assert "5.0 times" in guard(loud, SAND).health.verdict


def test_a_slip_ratio_known_to_several_points_is_not_called_good() -> None:
    vague = replace(good(), slip_ratio=Estimate(0.13, 0.08))
    assert guard(vague, SAND).health.grade == "fair"
    assert "± 8 points" in guard(vague, SAND).health.verdict


def test_what_was_put_right_keeps_the_grade_from_good() -> None:
    seen = guard(good(), SAND, ("the IMU is 8.0 deg off level",))
    assert seen.health.grade == "fair"
    assert "8.0 deg" in seen.health.verdict
