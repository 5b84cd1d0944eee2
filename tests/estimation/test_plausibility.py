"""The last look: what wheels, ground, clocks and innovations contradict is never called good."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from granite_lab.estimate import Estimate
from granite_lab.estimation import Motion, correct
from granite_lab.estimation.plausibility import Doubt, with_plausibility
from granite_lab.logs import read_trial
from granite_lab.parameters import load_robot, load_soil
from tests.soak import sampled
from tests.truth import field

SAND = load_soil()
FIRM = replace(SAND, slip=0.005, slip_std=0.02)


@cache
def good() -> Motion:
    return correct(read_trial(field.SAMPLES[3]), load_robot("granite"))[1]


def test_a_good_estimate_passes_unchanged() -> None:
    assert good().health.grade == "good"
    assert with_plausibility(good(), SAND) is good()


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
    seen = with_plausibility(wrong, SAND)
    assert seen.health.grade == "poor"
    assert not seen.health.good
    assert reason in seen.health.verdict
    assert seen.health.verdict.startswith("Look twice")
    # the true slip ratio of this sample is within two of the std that are stated now
    slip = 0.0970
    assert abs(seen.distance.value - good().distance.value) < 2.5 * seen.distance.std
    assert abs(seen.slip_ratio.value - slip) < 2.5 * seen.slip_ratio.std
    assert np.all(seen.v_std >= wrong.v_std)


def test_wheels_that_roll_a_little_farther_than_their_file_says_widen_the_std_by_that_of_a_radius() -> None:
    unsure, wrong = (replace(good(), slip_ratio=Estimate(-0.06, std)) for std in (0.02, 0.01))
    assert with_plausibility(unsure, SAND).health.grade == "good"
    seen = with_plausibility(wrong, SAND)
    assert seen.health.grade == "fair"
    assert "hard floor" in seen.health.verdict
    assert seen.slip_ratio.std == pytest.approx(0.04)


@pytest.mark.parametrize("amplitude", [0.3, 1.0])
def test_a_body_that_swings_on_steady_wheels_is_never_good(amplitude: float) -> None:
    """A tone of the motors that sampling folds to 0.5 Hz begins and ends with the motion."""
    motion = good()
    moving = np.array([phase != "rest" for phase in motion.phase])
    since = np.where(moving, motion.t - motion.t[moving][0], 0.0)
    swing = amplitude * (1.0 - np.cos(np.pi * since)) / np.pi
    seen = with_plausibility(replace(motion, v=motion.v + np.where(moving, swing, 0.0)), SAND)
    assert seen.health.grade != "good"
    assert "swings" in seen.health.verdict or "reaches" in seen.health.verdict
    missed = float(np.mean(swing[moving])) / 0.3
    assert seen.slip_ratio.std > 0.4 * missed


def slipping(share: float, steady: float) -> Motion:
    """The sample with a slip of 60 % in the first `share` of the steady part, and of `steady` in the rest."""
    motion = good()
    on = np.array([phase == "steady" for phase in motion.phase])
    begin, end = motion.t[on][0], motion.t[on][-1]
    wheels = motion.v_wheel.mean(axis=1)
    slip = np.where(motion.t < begin + share * (end - begin), 0.6, steady)
    mean = 0.6 * share + steady * (1.0 - share)
    return replace(motion, v=np.where(on, wheels * (1.0 - slip), motion.v), slip_ratio=Estimate(mean, 0.003))


def test_wheels_that_lose_half_their_way_all_the_time_may_be_of_another_gear() -> None:
    seen = with_plausibility(slipping(1.0, 0.6), SAND)
    assert seen.health.grade == "poor"
    assert "gear ratio" in seen.health.verdict
    assert abs(seen.slip_ratio.value - 0.2) < 2.0 * seen.slip_ratio.std


def test_wheels_that_grip_now_and_then_are_of_the_right_gear() -> None:
    assert "gear ratio" not in with_plausibility(slipping(0.8, 0.15), SAND).health.verdict


def test_a_soil_on_which_wheels_slip_so_much_may_be_stated() -> None:
    mud = replace(SAND, slip=0.6, slip_std=0.1)
    assert "gear ratio" not in with_plausibility(slipping(1.0, 0.6), mud).health.verdict


def test_driving_down_a_slope_explains_wheels_that_brake() -> None:
    down = replace(good(), slip_ratio=Estimate(-0.2, 0.01), pitch=good().pitch + 0.2)
    assert with_plausibility(down, SAND).health.grade == "good"
    level = replace(down, pitch=good().pitch)
    assert with_plausibility(level, SAND).health.grade == "poor"


def test_a_slip_far_from_what_the_soil_states_is_poor() -> None:
    assert with_plausibility(good(), FIRM).health.grade == "poor"
    assert "contradicts the soil's 0.5 ± 2.0 %" in with_plausibility(good(), FIRM).health.verdict


def test_innovations_far_beyond_their_prediction_are_poor() -> None:
    loud = replace(good(), health=replace(good().health, nis={"wheel": 25.0}))
    assert with_plausibility(loud, SAND).health.grade == "poor"
    assert "5.0 times" in with_plausibility(loud, SAND).health.verdict


def test_a_slip_ratio_known_to_several_points_is_not_called_good() -> None:
    vague = replace(good(), slip_ratio=Estimate(0.13, 0.08))
    assert with_plausibility(vague, SAND).health.grade == "fair"
    assert "± 8 points" in with_plausibility(vague, SAND).health.verdict


@pytest.mark.parametrize("share", [0.6, 0.8, 1.25])
def test_a_wheel_that_rolls_unlike_three_that_agree_is_in_the_slip_of_the_robot(share: float) -> None:
    turned = good().v_wheel * np.array([1.0, 1.0, share, 1.0])
    way = good().distance.value / (1.0 - 0.0970)
    rolled = way * (3.0 + share) / 4.0
    slip = Estimate(1.0 - good().distance.value / rolled, good().slip_ratio.std)
    odd = replace(good(), v_wheel=turned, slip_ratio=slip, distance_wheels=Estimate(rolled, 1e-4))
    seen = with_plausibility(odd, SAND)
    assert seen.health.grade == "fair"
    assert f"wheel rl rolls {100 * abs(share - 1):.0f} %" in seen.health.verdict
    assert abs(seen.slip_ratio.value - 0.0970) < 2.0 * seen.slip_ratio.std
    assert abs(seen.distance_wheels.value - way) < 2.0 * seen.distance_wheels.std
    assert seen.distance == odd.distance


@pytest.mark.parametrize("shares", [(1.0, 1.0, 0.92, 1.0), (0.7, 1.0, 0.7, 1.0), (1.0, 1.1, 1.2, 1.35)])
def test_wheels_of_several_radii_and_sides_that_differ_are_no_odd_wheel(shares: tuple[float, ...]) -> None:
    other = replace(good(), v_wheel=good().v_wheel * np.array(shares))
    assert with_plausibility(other, SAND) is other


def test_what_was_put_right_keeps_the_grade_from_good() -> None:
    seen = with_plausibility(good(), SAND, (Doubt("the IMU is 8.0 deg off level", grade="fair"),))
    assert seen.health.grade == "fair"
    assert "8.0 deg" in seen.health.verdict


def surge(size: float) -> Motion:
    """The sample with a body that swings about its velocity at 1 Hz, by a share of it, on steady wheels."""
    motion = good()
    on = np.array([phase == "steady" for phase in motion.phase])
    swing = size * motion.v * np.sin(2.0 * np.pi * (motion.t - motion.t[0]))
    return replace(motion, v=motion.v + np.where(on, swing, 0.0))


def test_a_body_that_swings_ahead_of_its_steady_wheels_is_poor() -> None:
    """As by a tone that a slow IMU folds to 1 Hz: the slip ratio over all looks usual."""
    seen = with_plausibility(surge(0.5), SAND)
    assert seen.health.grade == "poor"
    assert "while the wheels turn steadily" in seen.health.verdict
    assert seen.slip_ratio.std > 0.2
    assert with_plausibility(surge(0.05), SAND).health.grade == "good"


def test_a_wheel_that_loses_its_way_in_moments_is_in_the_slip_of_the_robot() -> None:
    """Its encoder slips for half a second; over all it is 8 % short, within three std of a tyre."""
    motion = good()
    a, b = motion.steady
    share = np.ones((motion.t.size, 4))
    begin = a + 0.3 * (b - a)
    share[(motion.t >= begin) & (motion.t < begin + 0.5), 1] = 0.5
    inside = (motion.t >= a) & (motion.t <= b)
    lost = 1.0 - float(np.mean(share[inside, 1]))
    slip = Estimate(1.0 - (1.0 - motion.slip_ratio.value) / (1.0 - lost / 4.0), motion.slip_ratio.std)
    seen = with_plausibility(replace(motion, v_wheel=motion.v_wheel * share, slip_ratio=slip), SAND)
    assert seen.health.grade == "fair"
    assert "wheel fr rolls" in seen.health.verdict
    assert "in some moments" in seen.health.verdict
    assert abs(seen.slip_ratio.value - motion.slip_ratio.value) < 2.0 * seen.slip_ratio.std


def logged_as_rates(folder: Path, *, missing: bool) -> tuple[Motion, float]:
    """A sample whose encoders give rates: 0.3 s of it are missing, or its clock is set forward by them."""
    source = field.of_sample(field.SAMPLES[6])
    imu = pd.DataFrame(np.hstack([source.force, source.rate]), columns=[*field.FORCE, *field.TURN])
    rate = np.gradient(source.angle, source.t_wheels, axis=0)
    wheels = pd.DataFrame(rate, columns=[f"enc_{wheel}_radps" for wheel in field.WHEELS])
    log = pd.concat([imu.assign(t_s=source.t_imu), wheels.assign(t_s=source.t_wheels)])
    log = log.sort_values("t_s").set_index("t_s")
    middle = 0.5 * source.t_imu[-1]
    if missing:
        log = log[(log.index < middle) | (log.index > middle + 0.3)]
    else:
        log.index = log.index.where(log.index < middle, log.index + 0.3)
    log.to_csv(folder / "rates.csv")
    motion = correct(read_trial(folder / "rates.csv", robot="granite"), load_robot("granite"))[1]
    return motion, source.distance


@pytest.mark.parametrize("missing", sampled([True, False]))
def test_a_hole_in_all_sensors_that_may_be_a_step_of_the_clock_is_in_the_distance(
    tmp_path: Path, missing: bool
) -> None:
    motion, distance = logged_as_rates(tmp_path, missing=missing)
    assert motion.health.grade == "fair"
    assert any("the clock was set forward" in reason for reason in motion.health.reasons)
    assert abs(motion.distance.value - distance) < 2.0 * motion.distance.std < 0.4


def test_clocks_that_the_ramps_do_not_bring_together_are_poor() -> None:
    trial = read_trial(field.SAMPLES[3])
    assert trial.imu is not None
    assert trial.wheels is not None
    moving = (trial.imu.t > 2.0) & (trial.imu.t < trial.imu.t[-1] - 2.0)
    noise = np.random.default_rng(0).normal(0.0, 5.0, trial.imu.specific_force.shape) * moving[:, None]
    loud = replace(trial.imu, specific_force=trial.imu.specific_force + noise)
    late = replace(trial.wheels, t=trial.wheels.t - 3.0)
    motion = correct(replace(trial, imu=loud, wheels=late), load_robot("granite"))[1]
    assert motion.health.grade == "poor"
    assert any("their clocks may be apart" in reason for reason in motion.health.reasons)
    assert not any("does not show" in reason for reason in motion.health.reasons)
