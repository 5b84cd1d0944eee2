"""Estimates on real logs of other robots, against GPS, motion capture and yaw rates."""

from __future__ import annotations

from functools import cache

import numpy as np
import pandas as pd
import pytest

from benchmarks.against_truth import Velocities, errors, inside, rms, slip_ratio
from benchmarks.log_set import LogSet, wheel_speed
from benchmarks.real_logs import boreal, delay, delays, husky, only, small_car, standstills
from granite_lab.logs.trial import Series, Trial, TrialInfo, WheelStream
from tests.real_logs import DATA, MARKS


@cache
def the_husky() -> LogSet:
    return husky(DATA)


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
        # 2.7 to 3.8 times: far from standstills the filter goes by firm ground, which skids are not
        assert rms(errors([skids], "wheels")) > 2.5 * rms(errors([skids]))

    def test_the_husky_goes_as_fast_as_gps_says_within_its_noise(self) -> None:
        (run,) = the_husky().runs
        assert run.t.size > 900
        # GPS scatters by about as much as estimate and wheels differ from it
        assert run.truth_std == pytest.approx(0.18, abs=0.02)
        assert rms(errors([run])) < 0.30
        assert abs(np.mean(errors([run]))) < 0.10
        assert inside([run]) >= 0.88
        # the ground is not known, so two std reach from the wheels' speed to rest
        moving = only(run, run.wheels > 0.3)
        assert np.median(2.0 * moving.std / moving.wheels) == pytest.approx(1.0, abs=0.2)

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
