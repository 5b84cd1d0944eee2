"""Estimates on real logs of other robots against their references; virtual robots that slip."""

import dataclasses
from functools import cache

import numpy as np
import pandas as pd
import pytest

from benchmarks.against_truth import Velocities, errors, inside, rms, slip_ratio
from benchmarks.log_set import LogSet, wheel_speed
from benchmarks.real_logs import FIRM, boreal, delay, delays, husky, only, small_car, standstills
from benchmarks.slipping_robots import (
    KINDS,
    RESTS,
    SLIP,
    by_least_squares,
    draw_sensors,
    make_course,
    page,
    sense,
)
from granite_lab.estimation.smoother import slow_excess
from granite_lab.logs.trial import Series, Trial, TrialInfo, WheelStream
from tests.real_logs import DATA, MARKS


@cache
def the_husky(soil: str = FIRM) -> LogSet:
    return husky(DATA, soil)


@cache
def the_small_car() -> LogSet:
    return small_car(DATA)


class TestWithTheLogs:
    pytestmark = MARKS

    @pytest.mark.parametrize("number", range(3))
    def test_the_small_car_is_known_twice_as_well_as_its_wheels_tell(self, number: int) -> None:
        run = the_small_car().runs[number]
        assert run.t.size > 1000
        assert rms(errors([run], "wheels")) > max(0.25, 2.0 * rms(errors([run])))
        assert inside([run]) >= 0.92
        skids = only(run, np.abs(slip_ratio(run)) > 0.2)
        assert skids.t.size > 100
        # 2.2 times and more: far from standstills the filter goes by firm ground, which skids are not
        assert rms(errors([skids], "wheels")) > 2.0 * rms(errors([skids]))

    def test_the_husky_goes_as_fast_as_gps_says_within_its_noise(self) -> None:
        (run,) = the_husky().runs
        assert run.t.size > 900
        # GPS scatters by about as much as estimate and wheels differ from it
        assert run.truth_std == pytest.approx(0.18, abs=0.02)
        assert rms(errors([run])) < 0.30
        assert abs(np.mean(errors([run]))) < 0.10
        assert inside([run]) >= 0.88

    def test_two_std_of_the_husky_reach_as_far_from_its_wheels_as_unknown_ground_lets_them_slip(self) -> None:
        assert self.reach("dry_sand") == pytest.approx(1.0, rel=0.2)

    def test_on_firm_ground_they_are_widened_by_the_slow_innovations_of_the_wheels(self) -> None:
        (health,) = (motion.health for motion in the_husky(FIRM).motions.values())
        wheel = np.array(health.kind) == "wheel"
        excess = slow_excess(health.innovation[wheel] / health.innovation_std[wheel])
        assert any("std is widened" in reason for reason in health.reasons)
        assert self.reach(FIRM) == pytest.approx(0.07 * np.sqrt(excess), rel=0.1)

    @staticmethod
    def reach(soil: str) -> float:
        """Return the median of two std in parts of the wheels' speed."""
        (run,) = the_husky(soil).runs
        moving = only(run, run.wheels > 0.3)
        return float(np.median(2.0 * moving.std / moving.wheels))

    def test_the_husky_stands_still_when_gps_does(self) -> None:
        (run,) = the_husky().runs
        rest = only(run, (run.t > 240.0) & (run.t < 246.0))  # by the notes of the data set
        assert np.max(np.abs(rest.v)) < 0.02
        assert rms(rest.truth) < 0.05

    def test_the_huskys_clocks_differ_by_what_its_yaw_rates_say(self) -> None:
        (motion,) = the_husky().motions.values()
        imu, odometry = (pd.read_csv(DATA / "husky_gps" / name) for name in ("imu.csv", "odom.csv"))
        t = np.arange(imu.stamp.iloc[0] + 2.0, imu.stamp.iloc[-1] - 2.0, 0.02)
        yaw = np.interp(t, imu.stamp, imu.wy)  # gravity lies on the sensor's y axis
        shifts = np.arange(-1.0, 1.0, 0.02)
        alike = [np.corrcoef(yaw, np.interp(t, odometry.stamp + s, odometry.wz))[0, 1] for s in shifts]
        offset = motion.clock_offset
        assert abs(offset.value - shifts[int(np.argmax(alike))]) < 2 * offset.std < 0.2

    def test_without_a_standstill_the_estimate_says_so_and_is_wide(self) -> None:
        found = boreal(DATA)
        assert len(found.motions) == 3
        for name, motion in found.motions.items():
            assert not motion.health.good, name
            assert any("no standstill" in line for line in motion.warnings), name
            # a steady slip of up to 100 % is not excluded
            assert 0.4 < motion.distance.std / motion.distance.value < 0.7, name
            way = motion.distance.value - motion.distance_wheels.value
            assert abs(way) < 2 * motion.distance.std, name


def made_up(late: float = 0.0) -> Velocities:
    t = np.arange(0, 10, 0.02)
    wheels = np.interp(t, [1, 3, 5, 8], [0, 2, 1, 0])
    zero = np.zeros(t.size)
    return Velocities("", t, np.interp(t - late, t, wheels), zero, zero, wheels, "good")


@pytest.mark.parametrize("late", [-0.1, 0.0, 0.12])
def test_the_delay_of_a_reference_is_found(late: float) -> None:
    run = made_up(late)
    found = delay(run, run.wheels)
    assert found.by == pytest.approx(late, abs=0.006)
    assert found.rmse < 0.01


def test_a_low_pass_in_the_reference_is_found_from_how_it_comes_to_rest() -> None:
    run = made_up()
    for k in range(1, run.t.size):
        run.truth[k] = run.truth[k - 1] + (1 - np.exp(-0.02 / 0.05)) * (run.wheels[k] - run.truth[k - 1])
    run.v[10] = 0.2  # while the wheels stand
    late = delays(LogSet([run]))
    assert late.unseen == {"": 0.2}
    assert late.decay == pytest.approx(0.05, rel=0.01)
    estimate, wheels = late.scenes[""]
    assert estimate.by != wheels.by == pytest.approx(0.05, abs=0.011)


def test_standstills_are_the_ends_at_which_the_reference_stands() -> None:
    t = np.arange(0, 10, 0.1)
    reference = Series(t, np.where((t > 2.0) & (t < 9.8), 1.0, 0.02))
    trial = Trial("run", TrialInfo(), reference_v=reference)
    ((begin, end),) = standstills(trial)
    assert begin == 0.0
    assert end == pytest.approx(2.0)


def test_the_wheels_alone_are_the_mean_of_those_that_are_logged() -> None:
    t = np.arange(0, 1, 0.1)
    angle = np.outer(t, [1.0, 3.0, np.nan, np.nan])
    trial = Trial("run", TrialInfo(), wheels=WheelStream(t, angle))
    stamps, v = wheel_speed(trial, "granite")
    assert stamps == pytest.approx(t)
    assert v == pytest.approx(np.full(t.size, 2 * 0.0965))


@pytest.mark.parametrize("kind", KINDS)
def test_the_imu_without_noise_measures_the_motion(kind: str) -> None:
    rng = np.random.default_rng(5)
    course = make_course(kind, rng)
    sensors = dataclasses.replace(
        draw_sensors(rng), accel=0, gyro=0, accel_bias=0, gyro_bias=0, shake=0, late=0, imu_rate=200
    )
    imu = sense(course, sensors, rng).imu
    rate = imu.angular_rate[:, 1]
    pitch = course.pitch[0] + np.cumsum(rate) / 200
    force = imu.specific_force[:, 0] + 9.81 * np.sin(pitch) + 0.10 * rate**2
    v = np.cumsum(force) / 200 - 0.12 * rate
    ends = imu.t + 0.5 / 200  # a sample is the mean over its interval
    assert v == pytest.approx(np.interp(ends, course.t, course.v), abs=4e-3)


def test_each_robot_slips_as_its_name_says() -> None:
    courses = {kind: make_course(kind, np.random.default_rng(2)) for kind in KINDS}
    for course in courses.values():
        assert np.max(np.abs(course.v[[0, -1]])) < 2e-3
    stands = np.abs(courses["is stuck"].v) < 1e-3
    assert np.ptp(courses["is stuck"].t[stands & (courses["is stuck"].wheel > 0.1)]) > 1.5
    through = courses["slips through"]
    ratio = 1 - through.v / np.maximum(through.wheel, 0.1)
    assert 1.0 < np.sum((ratio > 0.85) & (through.wheel > 0.1)) / 1000 < 3.0
    slope = courses["brakes on a slope"]
    assert np.max(slope.v[slope.wheel == 0]) > 0.03
    assert np.deg2rad(4) < slope.pitch[-1] - slope.pitch[0] < np.deg2rad(14)
    rings = courses["rings"]
    after = rings.v[rings.t > rings.t[np.flatnonzero(rings.wheel > 0)[-1]]]
    crossings = np.flatnonzero(np.diff(np.sign(after)))[:4]
    assert np.diff(crossings) / 1000 == pytest.approx(0.25, abs=0.03)


def test_who_is_told_more_knows_more() -> None:
    squares = {True: 0.0, False: 0.0}
    for seed in range(4):
        rng = np.random.default_rng(seed)
        course, sensors = make_course("is stuck", rng), draw_sensors(rng)
        imu = sense(course, sensors, rng).imu
        v = np.interp(imu.t - sensors.late, course.t, course.v)
        for told in squares:
            squares[told] += rms(by_least_squares(course, sensors, imu, slip_told=told) - v) ** 2
    assert squares[True] < squares[False] < 4 * 0.01**2


def judged(error: float, std: float, told: float) -> Velocities:
    z = np.random.default_rng(0).standard_normal(2000)
    zero = np.zeros(z.size)
    others = {RESTS: zero + told, SLIP: zero + told}
    return Velocities("", zero, zero, error * z, zero + std, zero + 0.1, "good", others)


def test_errors_and_coverage_are_those_of_the_samples() -> None:
    runs = [judged(0.01, 0.01, 0.002), judged(0.01, 0.002, 0.002)]
    assert rms(errors(runs)) == pytest.approx(0.01, rel=0.05)
    assert rms(errors(runs, "wheels")) == pytest.approx(0.1)
    assert rms(errors(runs, SLIP)) == pytest.approx(0.002)
    assert inside(runs[:1]) == pytest.approx(0.954, abs=0.015)
    assert inside(runs) == pytest.approx(0.5 * (0.954 + 0.311), abs=0.02)
    assert np.isnan(inside(runs, low=1.5))


def test_the_page_says_which_aims_are_missed() -> None:
    text = page({
        "a": [judged(0.003, 0.003, 0.002), "a, seed 1: no standstill"],
        "b": [judged(0.01, 0.003, 0.002)] * 2,
        "c": [judged(0.003, 0.3, 0.002)] * 2,
    })  # fmt: skip
    assert "Both are reached for:\na." in text
    assert "| a | 2 |" in text
    assert "| 10.0 | 2.0 | 2.0 | **5.0** |" in text
    assert "| **100** |" in text
    assert "1 / 0 / 0 | 1 |" in text
