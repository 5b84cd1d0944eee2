"""Where a robot does not drive straight ahead, no slip ratio is taken."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from granite_lab.chain import slope_effects, soil_doubt
from granite_lab.estimation import Motion
from granite_lab.estimation.outcome import find_phases
from granite_lab.estimation.straight import straightness_of
from granite_lab.logs.sensors.pitch_rate import contradicted
from granite_lab.logs.trial import Trial
from granite_lab.options import Options
from granite_lab.parameters import load_robot
from tests.truth.motion import estimate
from tests.truth.trials import TruthTrial, generate

T = np.arange(0.0, 30.0, 0.01)
RESTS = ((0.0, 2.0), (28.0, 30.0))


def speed() -> np.ndarray:
    return np.where((T > 2) & (T < 28), 0.5, 0.0)


def yaw(begin: float, end: float, angle: float) -> np.ndarray:
    """Yaw rate that turns by an angle [deg], and noise of a consumer gyro."""
    rate = np.radians(angle) / (end - begin)
    noise = 0.01 * np.random.default_rng(1).standard_normal(T.size)
    return noise + np.where(np.abs(T - 0.5 * (begin + end)) < 0.5 * (end - begin), rate, 0.0)


def test_a_straight_course_is_no_bend() -> None:
    course = straightness_of(T, yaw(10, 20, 12.0), speed(), RESTS, load_robot())
    assert not course.off.any()
    assert course.warnings == ()
    unknown = straightness_of(T, np.full(T.size, np.nan), speed(), RESTS, load_robot())
    assert not unknown.off.any()


@pytest.mark.parametrize("angle", [180.0, -90.0, 30.0])
def test_a_bend_is_found_and_what_is_straight_is_offered(angle: float) -> None:
    course = straightness_of(T, yaw(12, 15, angle), speed(), RESTS, load_robot())
    ((begin, end), turned) = course.bends[0]
    assert len(course.bends) == 1
    assert (begin, end) == pytest.approx((12.0, 15.0), abs=0.5)
    assert np.degrees(turned) == pytest.approx(angle, abs=5.0)
    first, second = course.straight
    assert first == pytest.approx((0.0, begin), abs=0.05)
    assert second == pytest.approx((end, 29.99), abs=0.05)
    assert "the robot turns at" in course.warnings[0]
    assert f"--from {first[0]:.1f} --to {first[1]:.1f}" in course.warnings[0]


def test_the_way_back_is_no_part_of_a_drive_ahead() -> None:
    back = np.where(T > 20, -0.5, 1.0) * speed()
    course = straightness_of(T, yaw(0, 1, 0.0), back, RESTS, load_robot())
    (only,) = course.back
    assert only == pytest.approx((20.0, 28.0), abs=0.5)
    assert "drives back at" in course.warnings[0]
    whole = straightness_of(T, yaw(0, 1, 0.0), -speed(), RESTS, load_robot())
    assert not whole.off.any()


def test_a_drive_that_is_never_steady_has_a_slip_ratio_by_its_straight_part_only() -> None:
    pace = np.where((T > 2) & (T < 28), 0.5 + 0.3 * np.sin(2 * T), 0.0)
    parts = [(T > 4) & (T < 20), T > 1, np.zeros(T.size, dtype=bool)]
    steady = [find_phases(T, pace, ((0.0, 2.0), (28.0, 30.0)), off).steady for off in parts]
    assert steady[0] == pytest.approx((20.0, 28.0), abs=0.05)
    assert np.isnan(steady[1]).all()
    assert steady[2] == pytest.approx((2.0, 28.0), abs=0.05)


@cache
def truth() -> TruthTrial:
    return generate(71, velocity=0.3, grade="consumer")


def run(trial: Trial) -> Motion:
    return estimate(trial, load_robot("granite", "consumer"))


def test_no_steady_part_is_taken_from_a_bend() -> None:
    trial, plain = truth().trial, run(truth().trial)
    _, end = plain.steady
    rate = trial.imu.angular_rate.copy()
    turns = trial.imu.t > end - 1.0
    turns &= trial.imu.t < end + 0.5
    rate[turns, 2] += np.radians(60.0)
    motion = run(replace(trial, imu=replace(trial.imu, angular_rate=rate)))
    assert motion.steady[1] < end - 0.7
    assert any("the robot turns at" in line for line in motion.warnings)
    assert not any("the robot turns" in line for line in plain.warnings)


def test_the_sign_of_the_pitch_rate_is_not_judged_by_a_motion_that_turns() -> None:
    trial, robot = truth().trial, load_robot("granite", "consumer")
    assert trial.imu is not None
    assert robot.imu_grade is not None
    wrong = replace(trial.imu, angular_rate=trial.imu.angular_rate * [1, -8, 1])
    rests = run(trial).health.rests
    judged = contradicted(wrong, np.eye(3), rests, robot.imu_grade)
    rate = wrong.angular_rate.copy()
    moving = (trial.imu.t > rests[0][1]) & (trial.imu.t < rests[-1][0])
    rate[moving, 2] += np.radians(60.0) / np.ptp(trial.imu.t[moving])
    assert judged is not None
    assert contradicted(replace(wrong, angular_rate=rate), np.eye(3), rests, robot.imu_grade) is None


def test_a_stated_slope_enters_the_model_and_an_assumed_soil_is_told() -> None:
    trial = truth().trial
    uphill = replace(trial, info=replace(trial.info, extra={"slope_deg": "4.0"}))
    assert slope_effects(trial) == ()
    (active,) = slope_effects(uphill)
    assert (active.id, active.values) == ("ground_slope", (4.0,))
    husky, unnamed = load_robot("husky"), replace(trial, info=replace(trial.info, soil=None))
    assert "dry sand is assumed" in str(soil_doubt(unnamed, husky, Options()))
    assert soil_doubt(unnamed, husky, Options(soil="dry_sand")) is None
    assert soil_doubt(unnamed, load_robot(), Options()) is None
    moon = replace(trial, info=replace(trial.info, soil="regolith"))
    assert "'regolith' of the log is not known" in str(soil_doubt(moon, husky, Options()))
