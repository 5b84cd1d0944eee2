"""Rows of an IMU without a new reading: of a logger that is faster than its sensor, and of lost samples."""

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import granite_lab as gl
from granite_lab.logs import read_trial
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.sensors.encoders import caught_up
from granite_lab.logs.sensors.repeats import read_once, without_blanks, without_fill, without_held
from granite_lab.logs.trial import ImuStream
from tests.corpus import cli
from tests.logs import make
from tests.soak import in_turn

SAMPLE = cli.SAMPLES / "virtual_v0.5_r1.csv"
TRUE_SLIP = 0.1837  # of the sample's steady part, by its simulator


def imu(step: float = 1e-4, n: int = 1000) -> ImuStream:
    values = np.random.default_rng(2).normal(0.0, 0.05, (n, 6))
    values = np.round(values / step) * step
    return ImuStream(np.arange(n) / 100, values[:, :3], values[:, 3:], False)


def held(stream: ImuStream, begin: int, end: int) -> ImuStream:
    """Let the samples behind `begin` repeat it."""
    force, rate = stream.specific_force.copy(), stream.angular_rate.copy()
    force[begin:end], rate[begin:end] = force[begin], rate[begin]
    return dataclasses.replace(stream, specific_force=force, angular_rate=rate)


def holding(table: pd.DataFrame, at: list[float], length: float) -> None:
    for begin in at:
        rows = table.index[table["t_s"].between(begin, begin + length) & table["imu_ax_mps2"].notna()]
        table.loc[rows, make.IMU] = table.loc[rows[0], make.IMU].to_numpy(dtype=float)


@pytest.mark.parametrize("times", [2, 3, 5])
def test_of_a_logger_that_is_faster_than_its_sensor_each_reading_counts_once(times: int) -> None:
    stream, doubts = imu(), list[Doubt]()
    rows = np.repeat(np.arange(stream.t.size), times)
    t = np.arange(rows.size) / (100 * times)
    fast = ImuStream(t, stream.specific_force[rows], stream.angular_rate[rows], False)
    once = read_once(fast, doubts)
    np.testing.assert_allclose(once.t, stream.t, atol=1e-9)
    np.testing.assert_array_equal(once.specific_force, stream.specific_force)
    assert "the sensor gives 100 a second" in str(doubts[0])


def test_readings_that_come_two_and_three_times_in_turn_are_spaced_evenly() -> None:
    stream, doubts = imu(), list[Doubt]()
    t = np.arange(0.0, 9.98, 1 / 230)
    rows = np.searchsorted(stream.t, t, side="right") - 1
    once = read_once(ImuStream(t, stream.specific_force[rows], stream.angular_rate[rows], False), doubts)
    late = once.t - stream.t[: once.t.size]
    assert np.ptp(late[50:-50]) < 1 / 230
    assert once.stamp_std < 1 / 230


def test_samples_of_zeros_are_missing_where_gravity_is_felt() -> None:
    stream, doubts = imu(), list[Doubt]()
    up = stream.specific_force + np.array([0.0, 0.0, 9.8])
    up[[100, 400, 401]] = 0.0
    left = without_blanks(dataclasses.replace(stream, specific_force=up), doubts)
    assert left.t.size == 997
    assert "3 samples of 0 on all axes (t = 1.000, 4.000 s)" in str(doubts[0])
    # a logger that removes gravity may well read 0
    free = stream.specific_force.copy()
    free[[100, 400]] = 0.0
    same = dataclasses.replace(stream, specific_force=free)
    assert without_blanks(same, doubts) is same


def test_equal_readings_by_rounding_stay() -> None:
    coarse, doubts = imu(step=0.3), list[Doubt]()
    assert np.mean((np.diff(coarse.specific_force, axis=0) == 0).all(axis=1)) > 0.3
    assert read_once(coarse, doubts) is coarse
    assert without_held(coarse, np.ones(1000, dtype=bool), doubts) is coarse
    assert not doubts


@pytest.mark.parametrize("step", [1e-9, 1e-4])
@pytest.mark.parametrize(("rate", "to"), [(50, 200), (100, 200), (20, 100), (50, 500)])
def test_readings_are_found_again_between_which_a_log_was_filled_up(rate: int, to: int, step: float) -> None:
    stream, doubts = imu(step), list[Doubt]()
    t_read = np.arange(stream.t.size) / rate
    t = np.arange(round(t_read[-1] * to)) / to
    both = np.hstack([stream.specific_force, stream.angular_rate])
    filled = np.stack([np.interp(t, t_read, axis) for axis in both.T], axis=1)
    found = without_fill(ImuStream(t, filled[:, :3], filled[:, 3:], False), doubts)
    at = slice(0, found.t.size - 1)  # the log may end between two readings
    np.testing.assert_allclose(found.t[at], t_read[at], atol=1e-6)
    np.testing.assert_allclose(found.specific_force[at], stream.specific_force[at], atol=1e-6)
    assert f"the sensor gives {rate} a second" in str(doubts[0])


@pytest.mark.parametrize("step", [1e-9, 0.01, 0.3])
def test_noise_lies_on_no_lines(step: float) -> None:
    stream, doubts = imu(step), list[Doubt]()
    assert without_fill(stream, doubts) is stream
    assert not doubts


def test_vibration_that_a_slow_sensor_folded_shows_though_its_log_was_filled_up(tmp_path: Path) -> None:
    def fill(table: pd.DataFrame) -> None:
        rows = table.index[table["imu_ax_mps2"].notna()]
        t, values = table.loc[rows, "t_s"].to_numpy(), table.loc[rows, make.IMU].to_numpy(dtype=float)
        # a tone of 99 Hz, of which every fourth sample at 200 Hz makes one of 1 Hz
        shaken = (t > 2.5) & (t < 7.0)
        values[:, 0] += shaken * 0.3 * np.sin(2.0 * np.pi * 99.0 * t)
        read = slice(None, None, 4)
        table.loc[rows, make.IMU] = np.stack([np.interp(t, t[read], axis[read]) for axis in values.T], axis=1)

    motion = gl.ingest(make.changed(tmp_path, SAMPLE, fill))[0].motion
    assert any("the sensor gives 50 a second" in line for line in motion.warnings)
    assert abs(motion.slip_ratio.value - TRUE_SLIP) < 2.0 * motion.slip_ratio.std


def test_of_one_axis_that_repeats_itself_nothing_tells_that_samples_were_lost() -> None:
    stream = imu(step=0.05)
    rate = np.full_like(stream.angular_rate, np.nan)
    rate[:, 1] = stream.angular_rate[:, 1]
    one = dataclasses.replace(stream, specific_force=np.full_like(rate, np.nan), angular_rate=rate)
    assert without_held(one, np.ones(1000, dtype=bool), []) is one


def test_lost_samples_that_repeat_the_last_one_are_missing_while_the_wheels_turn() -> None:
    stream, rolls = held(held(imu(), 300, 310), 700, 720), np.arange(1000) < 500
    kept = without_held(stream, rolls, doubts := [])
    assert sorted(set(range(1000)) - set(np.rint(kept.t * 100).astype(int))) == list(range(301, 310))
    assert "9 samples that repeat the last one (t = 3.010 s)" in str(*doubts)
    one_sensor = dataclasses.replace(stream, angular_rate=imu().angular_rate)
    assert without_held(one_sensor, rolls, []).t.size == kept.t.size
    whole = imu()
    assert without_held(whole, rolls, doubts) is whole
    assert len(doubts) == 1


def test_a_slip_from_samples_that_were_lost_and_repeated_is_not_called_good(tmp_path: Path) -> None:
    path = make.changed(tmp_path, SAMPLE, lambda table: holding(table, [2.9, 3.6, 5.0, 6.3], 0.2))
    motion = gl.ingest(path)[0].motion
    assert motion.health.grade != "good"
    assert abs(motion.slip_ratio.value - TRUE_SLIP) < 2.0 * motion.slip_ratio.std
    assert any("that repeat the last one" in line for line in motion.warnings)


@pytest.mark.parametrize(
    ("span", "wheels"), in_turn([(3.2, 0.08), (4.1, 0.6), (6.0, 0.3)], [make.WHEELS, make.WHEELS[1:2]])
)
def test_counters_that_hang_and_catch_up_have_lost_no_way(
    span: tuple[float, float], wheels: list[str], tmp_path: Path
) -> None:
    begin, length = span

    def hang(table: pd.DataFrame) -> None:
        rows = table.index[table["t_s"].between(begin, begin + length) & table[make.WHEELS[0]].notna()]
        table.loc[rows, wheels] = table.loc[rows[0], wheels].to_numpy(dtype=float)

    trial, sample = read_trial(make.changed(tmp_path, SAMPLE, hang)), read_trial(SAMPLE)
    assert trial.wheels is not None
    assert sample.wheels is not None
    same = np.isin(sample.wheels.t, trial.wheels.t)
    angle, true = trial.wheels.angle, sample.wheels.angle[same]
    known = np.isfinite(angle)
    np.testing.assert_allclose(angle[known], true[known], atol=1e-9)
    assert known.all(axis=1).sum() < len(sample.wheels.t)
    assert any("readings that repeat the last one" in line for line in trial.warnings)


def test_a_wheel_that_stops_and_sets_off_again_does_not_hang() -> None:
    t = np.arange(400) / 50
    speed = 40.0 * np.clip(np.abs(((t + 0.5) % 2.0) - 1.0) - 0.3, 0.0, 0.5)  # [counts/s]
    stopping = np.floor(np.cumsum(speed / 50) * 9)
    assert not caught_up(t, stopping).any()
    running = np.floor(9.0 * np.arange(400.0))
    running[200:215] = running[200]
    assert np.flatnonzero(caught_up(t, running)).tolist() == list(range(201, 215))


def test_counts_that_are_lost_at_full_speed_are_added_again(tmp_path: Path) -> None:
    lost = [(3.2, 0.15), (4.1, 0.1), (5.5, 0.2)]

    def lose(table: pd.DataFrame) -> None:
        rows = table.index[table[make.WHEELS[0]].notna()]
        t, angle = table.loc[rows, "t_s"].to_numpy(), table.loc[rows, make.WHEELS].to_numpy(dtype=float)
        gone = np.any([(t > begin) & (t < begin + length) for begin, length in lost], axis=0)
        steps = np.diff(angle, axis=0, prepend=angle[:1])
        table.loc[rows, make.WHEELS] = angle[0] + np.cumsum(np.where(gone[:, None], 0.0, steps), axis=0)

    path = make.changed(tmp_path, SAMPLE, lose)
    trial, sample, motion = read_trial(path), read_trial(SAMPLE), gl.ingest(path)[0].motion
    assert trial.wheels is not None
    assert sample.wheels is not None
    np.testing.assert_allclose(trial.wheels.angle, sample.wheels.angle, atol=0.04)  # 4 mm
    assert motion.health.grade == "fair"
    assert abs(motion.slip_ratio.value - TRUE_SLIP) < 2.0 * motion.slip_ratio.std


@pytest.mark.parametrize("counts", [64, 512])
def test_coarse_counts_and_standstills_are_no_hang(counts: int, tmp_path: Path) -> None:
    def coarse(table: pd.DataFrame) -> None:
        step = 2 * np.pi / counts
        table[make.WHEELS] = np.floor(table[make.WHEELS] / step) * step

    trial, sample = read_trial(make.changed(tmp_path, SAMPLE, coarse)), read_trial(SAMPLE)
    assert trial.wheels is not None
    assert sample.wheels is not None
    assert trial.wheels.t.size == sample.wheels.t.size
    assert np.isfinite(trial.wheels.angle).all()


def test_a_log_that_holds_each_reading_for_two_rows_is_that_of_the_sample(tmp_path: Path) -> None:
    def twice(table: pd.DataFrame) -> pd.DataFrame:
        copies = table[table["imu_ax_mps2"].notna()].copy()
        copies["t_s"] += 0.5 * copies["t_s"].diff().median()
        return pd.concat([table, copies]).sort_values("t_s", kind="stable")

    trial, sample = read_trial(make.changed(tmp_path, SAMPLE, twice)), read_trial(SAMPLE)
    assert trial.imu is not None
    assert sample.imu is not None
    np.testing.assert_array_equal(trial.imu.specific_force, sample.imu.specific_force)
