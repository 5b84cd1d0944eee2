"""A trial with faults, corrected, is the good trial: sample by sample, within noise."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from granite_lab.estimation import Motion, correct
from granite_lab.logs.trial import Correction, Trial
from granite_lab.parameters import WHEELS
from tests.truth import faults
from tests.truth.trials import TruthTrial, generate, robot


@cache
def good() -> TruthTrial:
    return generate(61, velocity=0.5, duration=5.0, grade="industrial", clock_offset=0.003)


@cache
def plain() -> tuple[Trial, Motion]:
    return correct(good().trial, robot())


def channels(trial: Trial) -> np.ndarray:
    """(N, 6) force and rate of a corrected trial at the good one's stamps."""
    imu = trial.imu
    both = np.hstack([imu.specific_force, imu.angular_rate])
    place = np.searchsorted(imu.t, good().trial.imu.t)
    return both[np.clip(place, 0, imu.t.size - 1)]


def said(trial: Trial, what: str) -> list[Correction]:
    return [made for made in trial.corrections if what in made.what]


def test_good_trial_is_left_as_it_is() -> None:
    clean, _ = plain()
    logged = good().trial
    assert clean.corrections == ()
    assert clean.imu.robot_axes
    assert np.array_equal(clean.imu.specific_force, logged.imu.specific_force)
    assert np.array_equal(clean.wheels.angle, logged.wheels.angle)
    assert np.array_equal(clean.wheels.t, logged.wheels.t)
    assert np.array_equal(clean.currents.current, logged.currents.current)


def test_corrected_trial_is_estimated_as_the_log_was() -> None:
    turned = faults.flipped(faults.spikes(good().trial, 3, 8, 30.0), "rl")
    clean, motion = correct(turned, robot())
    again, repeated = correct(clean, robot())
    apart = repeated.v - np.interp(repeated.t, motion.t, motion.v)
    assert np.all(np.abs(apart) < np.interp(repeated.t, motion.t, motion.v_std) + 3e-4)
    assert again.corrections == clean.corrections


@pytest.mark.parametrize("wheels", [("fl",), ("fl", "rl"), ("fr", "rr"), ("fr", "rl"), WHEELS])
def test_reversed_encoders_are_the_good_ones(wheels: tuple[str, ...]) -> None:
    clean, motion = correct(faults.flipped(good().trial, *wheels), robot())
    assert np.array_equal(clean.wheels.angle, plain()[0].wheels.angle)
    assert np.array_equal(motion.v, plain()[1].v)
    assert {made.where for made in said(clean, "sign turned")} == {f"encoder {name}" for name in wheels}


def test_spikes_are_absent_and_the_rest_untouched() -> None:
    thrown = faults.spikes(good().trial, 3, 8, 30.0)
    clean, _ = correct(thrown, robot())
    hit = (thrown.imu.specific_force != good().trial.imu.specific_force).any(axis=1)
    found = channels(clean)
    far = hit & (np.abs(thrown.imu.specific_force - good().trial.imu.specific_force).max(axis=1) > 3.0)
    assert np.isnan(found[far]).all()
    assert np.isnan(found).any(axis=1).sum() <= hit.sum()
    kept = np.isfinite(found)
    kept[hit] = False
    assert np.array_equal(found[kept], channels(plain()[0])[kept])
    assert said(clean, "thrown off")[0].value == np.isnan(found).any(axis=1).sum()


@pytest.mark.parametrize("angles", [(0.0, 0.0, 90.0), (180.0, 0.0, 0.0), (10.0, -80.0, 35.0)])
def test_imu_in_other_axes_is_in_the_robots(angles: tuple[float, float, float]) -> None:
    turn = Rotation.from_euler("ZYX", angles[::-1], degrees=True).as_matrix()
    clean, _ = correct(faults.turned(good().trial, turn.T), robot(rotation=angles))
    assert channels(clean) == pytest.approx(channels(plain()[0]), abs=1e-9)
    assert said(clean, "robot axes")


def test_imu_whose_axes_are_found_is_in_the_robots_but_for_tilt_and_heading() -> None:
    turn = Rotation.from_euler("ZYX", [120.0, 20.0, -70.0], degrees=True).as_matrix()
    clean, motion = correct(faults.turned(good().trial, turn.T), robot(forward="find"))
    apart = channels(clean) - channels(plain()[0])
    rest = motion.t < 1.0
    apart -= apart[rest].mean(axis=0)  # levelling takes the tilt out
    # a heading that is off by a degree or two, and the same share of what the other axes feel
    assert np.sqrt(np.mean(apart[:, 0] ** 2)) < 0.05 * np.std(channels(plain()[0])[:, 1]) + 0.02
    assert np.sqrt(np.mean(apart[:, 4] ** 2)) < 0.05 * np.std(channels(plain()[0])[:, 5]) + 0.002


def test_restart_of_the_imu_leaves_no_step() -> None:
    jump = {"accel_jump": np.array([0.15, -0.1, 0.1]), "gyro_jump": np.array([0.01, 0.02, -0.01])}
    clean, motion = correct(faults.imu_restart(good().trial, 4.0, gap=0.2, **jump), robot())
    after = good().trial.imu.t > 4.3
    apart = (channels(clean) - channels(plain()[0]))[after]
    step = said(clean, "accelerometer")[0]
    # gravity at the end is levelled by what the pitch is known to there
    assert abs(np.mean(apart[:, 0])) < 3.0 * step.std
    assert step.value == pytest.approx(0.15, abs=3.0 * step.std)
    assert step.std < 0.1
    assert abs(np.mean(apart[:, 4])) < 3.0 * said(clean, "pitch gyro")[0].std < 0.002
    gap = (clean.imu.t > 4.0) & (clean.imu.t < 4.2)
    assert gap.sum() == 2
    assert np.isnan(clean.imu.specific_force[gap]).all()
    assert motion.health.gaps


@pytest.mark.parametrize("offset", [0.03, -0.05])
def test_large_clock_offset_is_taken_out_of_the_stamps(offset: float) -> None:
    late = faults.late(good().trial, -offset)
    clean, motion = correct(late, robot())
    made = said(clean, "clock")[0]
    apart = clean.wheels.t - plain()[0].wheels.t
    assert np.ptp(apart) < 1e-12
    left = motion.clock_left.value - plain()[1].clock_left.value
    assert abs(apart[0] + left) < 0.5 * made.std + 1e-4  # stamps and what is left of the offset agree
    assert abs(apart[0]) < 2.0 * made.std
    assert clean.currents.t[0] - late.currents.t[0] == pytest.approx(made.value)
    assert motion.clock_applied == made.value


def test_offset_given_by_hand_is_in_the_stamps() -> None:
    info = replace(good().trial.info, clock_offset=0.123)
    clean, motion = correct(replace(good().trial, info=info), robot())
    assert clean.wheels.t == pytest.approx(good().trial.wheels.t + 0.123)
    assert clean.info.clock_offset is None
    assert motion.clock_left.value == 0.0


@pytest.mark.parametrize("how", ["frozen", "missing", "zero"])
def test_encoder_that_was_dead_goes_on_level_with_the_others(how: str) -> None:
    clean, _ = correct(faults.dead_encoder(good().trial, "rl", 3.0, 4.0, how), robot())
    column, t = WHEELS.index("rl"), clean.wheels.t
    assert np.isnan(clean.wheels.angle[(t > 3.05) & (t < 3.95), column]).all()
    after = (t > 4.1) & (t < 4.6)
    apart = clean.wheels.angle[after, column] - good().trial.wheels.angle[after, column]
    rolled = 0.5 / robot().wheels.radius
    assert np.abs(apart).max() < 0.03 * rolled


@pytest.mark.parametrize("wheels", [("fl",), ("fr", "rr"), WHEELS])
def test_currents_of_the_wrong_sign_are_turned(wheels: tuple[str, ...]) -> None:
    currents = good().trial.currents
    sign = np.array([-1.0 if name in wheels else 1.0 for name in WHEELS])
    wrong = replace(good().trial, currents=replace(currents, current=currents.current * sign))
    clean, _ = correct(wrong, robot())
    assert np.array_equal(clean.currents.current, currents.current)
    assert {made.where for made in said(clean, "sign turned")} == {f"current {name}" for name in wheels}


def test_gravity_that_the_logger_removed_is_put_back() -> None:
    clean, _ = correct(good().without_gravity(), robot())
    apart = (channels(clean) - channels(plain()[0]))[:, [0, 2]]
    made = said(clean, "gravity put back")[0]
    assert not clean.imu.gravity_removed
    assert np.sqrt(np.mean(apart**2)) < 3.0 * made.std
    assert np.std(apart[:, 0]) < 0.05
