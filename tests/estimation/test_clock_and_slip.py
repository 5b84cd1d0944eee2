"""Offsets of the clocks are found; twisting tyres are none, wheels may spin while the body stands."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from benchmarks.slipping_robots import run
from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate
from granite_lab.estimation import Motion, correct
from granite_lab.estimation.clock import bridged_rests, latency_of
from granite_lab.estimation.error_model import SIZE, Updates
from granite_lab.estimation.problem import Problem
from granite_lab.estimation.smoother import Innovations, mismatch
from granite_lab.logs.trial import Trial
from granite_lab.parameters import load_robot
from tests.soak import SOAK, in_turn, sampled
from tests.truth import faults
from tests.truth.motion import estimate
from tests.truth.trials import TruthTrial, generate

OFFSETS = [0.005, -0.005, 0.02, -0.02, 0.05, -0.05, 0.2, -0.2]
"""By which the encoders' stamps lie behind [s]."""

TRIALS = [
    (800 + i, offset, (0.2, 0.3, 0.5, 0.7)[(i // 2) % 4], ("industrial", "consumer")[i % 2])
    for i, offset in enumerate(OFFSETS * 3)
    if SOAK or i in (0, 3, 5, 6)
]
"""Seed, offset, velocity, grade; each size of offset, each velocity, both signs and grades at least."""


def draw(seed: int, offset: float, velocity: float, grade: str) -> TruthTrial:
    return generate(seed, velocity=velocity, grade=grade, duration=4.0, still=(1.2, 1.2), clock_offset=offset)


@pytest.fixture(scope="module")
def found() -> list[Estimate]:
    return [estimate(draw(*spec).trial, load_robot("granite", spec[3])).clock_offset for spec in TRIALS]


def test_readings_of_one_row_may_be_a_period_apart() -> None:
    t = np.arange(0.0, 5.0, 0.05)
    rows = SimpleNamespace(imu=SimpleNamespace(t=t, period=0.05), rolling=SimpleNamespace(t=t), stamp_std=0.0)
    assert latency_of(cast(Problem, rows)) == pytest.approx(0.05 / np.sqrt(3.0))
    own = SimpleNamespace(imu=rows.imu, rolling=SimpleNamespace(t=t + 0.01), stamp_std=0.0)
    assert latency_of(cast(Problem, own)) == pytest.approx(0.01 / np.sqrt(3.0))


def test_injected_offsets_are_recovered_to_five_milliseconds_and_to_their_std(found: list[Estimate]) -> None:
    error = np.array([one.value - spec[1] for one, spec in zip(found, TRIALS, strict=True)])
    assert np.sqrt(np.mean(error**2)) <= 0.005
    assert abs(np.mean(error)) < 0.0025  # and no lag of the body behind the wheels is taken for one
    std = np.array([one.std for one in found])
    assert np.mean(np.abs(error) < 2 * std) >= 0.9
    assert np.median(std) < 0.005  # not true by being wide


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
    assert motion.health.grade != "good"


ROBOT = load_robot("granite", "industrial")


@cache
def good(velocity: float) -> TruthTrial:
    return generate(91, velocity=velocity, duration=5.0, still=(1.5, 1.5), grade="industrial")


@cache
def plain(velocity: float) -> Motion:
    return estimate(good(velocity).trial, ROBOT)


def twisted(truth: TruthTrial, compliance: float) -> Trial:
    """Let the wheels turn ahead of the body by the compliance [s^2] times its acceleration and resistance."""
    wheels = truth.trial.wheels
    pace = truth.v_wheel.mean(axis=1)
    thrust = np.gradient(truth.v, truth.t) + 0.8 * np.tanh(pace / 0.1)
    ahead = compliance * np.interp(wheels.t, truth.t, thrust) / ROBOT.wheels.radius
    return replace(truth.trial, wheels=replace(wheels, angle=wheels.angle + ahead[:, None]))


@pytest.mark.parametrize(("velocity", "compliance"), sampled(in_turn([0.5, 0.2], [0.004, 0.001]), 2))
def test_twisting_tyres_bend_no_velocity_and_make_no_offset(velocity: float, compliance: float) -> None:
    truth = good(velocity)
    _, motion = correct(twisted(truth, compliance), ROBOT)
    off, std = truth.errors(motion)
    assert np.sqrt(np.mean(off**2)) < 2.0 * np.sqrt(np.mean(truth.errors(plain(velocity))[0] ** 2)) + 0.001
    assert np.mean(np.abs(off) < 2.0 * std) > 0.88
    assert motion.clock_applied == 0.0
    assert abs(motion.clock_offset.value) < 3.0 * motion.clock_offset.std


def spinning(truth: TruthTrial, duration: float | None = None) -> Trial:
    """Let the wheels turn on when the body has stopped, to the end or for some time [s]."""
    wheels = truth.trial.wheels
    on = np.clip(wheels.t - truth.stop, 0.0, duration) * 0.3 / ROBOT.wheels.radius
    return replace(truth.trial, wheels=replace(wheels, angle=wheels.angle + on[:, None]))


def test_standstill_named_by_hand_is_believed_where_wheels_spin() -> None:
    truth = good(0.5)
    end = float(truth.trial.imu.t[-1])
    motion = estimate(spinning(truth), ROBOT, rests=[(truth.stop + 0.7, end)])
    off, std = truth.errors(motion)
    assert np.sqrt(np.mean(off**2)) < 0.02
    assert np.mean(np.abs(off) < 2.0 * std) > 0.88
    rest = motion.t > truth.stop + 0.8
    assert np.abs(motion.v[rest]).max() < 0.001
    assert np.array(motion.phase)[rest].tolist() == ["rest"] * int(rest.sum())


def test_wheels_that_spin_on_bend_neither_velocity_nor_clock() -> None:
    truth = generate(91, velocity=0.5, duration=5.0, still=(1.5, 2.0), grade="industrial")
    motion = estimate(spinning(truth, 0.8), ROBOT)
    moving = (motion.t > truth.start) & (motion.t < truth.stop + 1.3)
    off = (motion.v - truth.at(motion.t, "v"))[moving]
    assert np.sqrt(np.mean(off**2)) < 0.006
    assert np.mean(np.abs(off) < 2.0 * motion.v_std[moving]) > 0.88
    assert motion.clock_applied == 0.0


def test_standstill_on_turning_wheels_is_found_by_the_imu() -> None:
    truth = generate(91, velocity=0.5, duration=5.0, still=(1.5, 5.0), grade="industrial")
    motion = estimate(spinning(truth, 3.0), ROBOT)
    ((begin, end),) = [(a, b) for a, b in motion.health.rests if b > truth.stop]
    assert begin < truth.stop + 0.7
    assert end > truth.stop + 4.5
    stands = (motion.t > begin) & (motion.t < end)
    assert np.abs(motion.v[stands]).max() < 0.001
    moves = plain(0.5).health.rests
    assert not any(good(0.5).start < a < good(0.5).stop for a, _ in moves)


def test_wheels_that_shake_a_standing_body_leave_its_velocity_as_it_is() -> None:
    """The first instant of the standstill holds up to 7 mm/s of vibration, no velocity of the body."""
    truth = generate(91, velocity=0.5, duration=5.0, still=(1.5, 5.0), grade="industrial")
    errors = []
    for phase in sampled(np.linspace(0.0, np.pi, 4), 4):
        trial = spinning(truth, 3.0)
        t, force, omega = trial.imu.t, trial.imu.specific_force.copy(), 2.0 * np.pi * 11.0
        size = np.interp(t, np.array([0.0, 0.3]) + truth.start, [0.0, 1.0])
        size *= np.interp(t, np.array([2.7, 3.0]) + truth.stop, [1.0, 0.0])
        force[:, 0] += np.gradient(0.5 / omega * size * np.sin(omega * t + phase), t)
        motion = estimate(replace(trial, imu=replace(trial.imu, specific_force=force)), ROBOT)
        errors.append(truth.errors(motion)[0])
    assert np.sqrt(np.mean(np.concatenate(errors) ** 2)) < 0.004


def test_standstills_between_which_no_wheel_turned_are_one() -> None:
    rests = [(0.0, 1.0), (1.2, 2.0), (5.0, 6.0)]
    assert bridged_rests(rests, np.array([2.5, 4.0])) == [(0.0, 2.0), (5.0, 6.0)]


@pytest.mark.parametrize("seed", sampled([20, 31]))
def test_a_body_that_swings_on_its_tyres_to_the_end_is_not_at_rest(seed: int) -> None:
    found = run("rings", seed)
    assert not isinstance(found, str)
    assert np.mean(np.abs(found.v - found.truth) < 2.0 * found.std) > 0.9


@pytest.mark.parametrize("seed", sampled([21, 26]))
def test_a_jolt_taken_for_a_reading_thrown_off_is_in_the_std(seed: int) -> None:
    """When these wheels brake, the body loses some 15 mm/s in a millisecond: one reading of the IMU."""
    found = run("brakes on a slope", seed)
    assert not isinstance(found, str)
    assert np.mean(np.abs(found.v - found.truth) < 2.0 * found.std) > 0.9
    assert np.sqrt(np.mean((found.v - found.truth) ** 2)) < 0.006


def test_standstill_named_where_the_robot_moved_is_refused() -> None:
    truth = good(0.5)
    with pytest.raises(EstimateError, match="moved in the standstill named") as refusal:
        estimate(truth.trial, ROBOT, rests=[(truth.start - 0.5, truth.start + 0.4)])
    assert "spin" in refusal.value.hint


def test_innovations_that_are_too_large_say_by_how_much() -> None:
    rng = np.random.default_rng(0)
    value = rng.normal(0.0, 3.0, 2000)
    value[:5] = 1e3  # a few wild ones say nothing of the rest
    ones, none = np.ones(2000), np.zeros((2000, SIZE))
    kind = np.repeat(["wheel", "zero_rate"], 1000)
    sizes = np.where(np.arange(2000) < 1000, value, value / 3.0)
    came = Innovations(Updates(np.arange(2000), kind, sizes, none, ones), sizes, ones, none)
    found = mismatch(came)
    assert found["wheel"] == pytest.approx(9.0, rel=0.15)
    assert found["zero_rate"] == 1.0


def test_three_grades() -> None:
    truth = good(0.5)
    assert plain(0.5).health.grade == "good"
    assert plain(0.5).health.good
    assert estimate(faults.imu_dropout(truth.trial, 3.0, 3.2), ROBOT).health.grade == "fair"
    late = faults.imu_dropout(truth.trial, -np.inf, truth.start + 1.0)
    motion = estimate(faults.imu_dropout(late, truth.stop - 0.5, np.inf), ROBOT)
    assert motion.health.grade == "poor"
    assert "Look twice" in motion.health.verdict
