"""Stamps as loggers in the field write them, against the stamps that the sample was written with."""

from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import granite_lab as gl
from granite_lab.errors import InputError
from granite_lab.logs import inspect_logs, read_trial
from granite_lab.logs.sensors.clock import set_back, set_forward, stray
from granite_lab.logs.sensors.stamps import sampling_period, tidy
from granite_lab.logs.trial import Trial
from tests.corpus import cli
from tests.logs import make
from tests.soak import examples, in_turn, sampled

SAMPLE = cli.SAMPLES / "virtual_v0.3_r1.csv"
TRUE_SLIP, TRUE_DISTANCE = 0.0970, 1.809  # of the sample, by its simulator
GOOD = read_trial(SAMPLE)
PREFIX = {"imu": "imu_", "wheels": "enc_"}

Change = Callable[[pd.DataFrame], pd.DataFrame | None]


def read(folder: Path, change: Change) -> Trial:
    return read_trial(make.changed(folder, SAMPLE, change))


def batched(table: pd.DataFrame, prefix: str, sizes: list[int], *, at_end: bool = True) -> pd.DataFrame:
    """Give samples of a sensor the stamp of the last or the first of each batch; sizes take turns."""
    sampled = table.filter(regex=f"^{prefix}").notna().any(axis=1).to_numpy()
    t, begin, k = table.loc[sampled, "t_s"].to_numpy().copy(), 0, 0
    while begin < len(t):
        end = min(begin + sizes[k % len(sizes)], len(t))
        t[begin:end] = t[end - 1 if at_end else begin]
        begin, k = end, k + 1
    table.loc[sampled, "t_s"] = t
    return table.sort_values("t_s", kind="stable")


def said(trial: Trial, text: str) -> list[str]:
    return [line for line in trial.warnings if text in line]


# each size of batches, and both ways for each sensor
@pytest.mark.parametrize(
    ("sensor", "sizes", "at_end"),
    sampled(product(PREFIX, [[2], [5], [10], [3, 8, 5, 4]], [True, False]), 3),
)
def test_samples_of_a_fifo_get_stamps_of_their_own(
    sensor: str, sizes: list[int], at_end: bool, tmp_path: Path
) -> None:
    trial = read(tmp_path, lambda table: batched(table, PREFIX[sensor], sizes, at_end=at_end))
    good, got = getattr(GOOD, sensor), getattr(trial, sensor)
    np.testing.assert_array_equal(
        *(vars(x)["angle" if sensor == "wheels" else "angular_rate"] for x in (good, got))
    )
    late = got.t - good.t
    constant = float(np.median(late))
    assert (
        np.quantile(np.abs(late - constant), 0.99)
        < 1.1 * np.median(np.diff(good.t)) * np.ptp([0, *sizes]) ** 0.5
    )
    assert abs(constant) <= 2 * got.stamp_std + 1e-4
    assert len(said(trial, "have the stamp of another one")) == 1


@pytest.mark.parametrize("sizes", [[5], [10]], ids=str)
def test_the_motion_of_a_batched_log_is_that_of_the_sample(sizes: list[int], tmp_path: Path) -> None:
    path = make.changed(tmp_path, SAMPLE, lambda table: batched(table, "imu_", sizes))
    motion = gl.ingest(path, jobs=1)[0].motion
    for found, true in ((motion.slip_ratio, TRUE_SLIP), (motion.distance, TRUE_DISTANCE)):
        assert abs(found.value - true) < 2.5 * found.std
    assert motion.slip_ratio.std < 0.005


def test_batches_of_which_one_is_lost_leave_a_gap_there(tmp_path: Path) -> None:
    lost = (GOOD.imu.t > 5.0) & (GOOD.imu.t < 5.05)
    begin, end = np.flatnonzero(lost)[[0, -1]] // 5 * 5

    def change(table: pd.DataFrame) -> pd.DataFrame:
        out = batched(table, "imu_", [5])
        sampled = out.index[out["imu_ax_mps2"].notna()]
        return out.drop(sampled[begin:end])

    t = read(tmp_path, change).imu.t
    np.testing.assert_allclose(t, np.delete(GOOD.imu.t, np.arange(begin, end)), atol=6e-4)


@pytest.mark.parametrize("step", [1.0, 0.2])
def test_stamps_that_tick_too_rarely_are_refused_in_one_line(step: float, tmp_path: Path) -> None:
    def change(table: pd.DataFrame) -> None:
        table["t_s"] = np.floor(table["t_s"] / step) * step

    with pytest.raises(
        InputError, match=r"trial.csv:\d+: accelerometer: 9\d% of the samples have the stamp"
    ) as caught:
        read(tmp_path, change)
    assert f"a stamp every {step:g} s, expected every 0.1 s at least" in caught.value.message


@pytest.mark.parametrize("digits", [0.01, 0.02, 0.1])
@pytest.mark.parametrize("way", [np.floor, np.rint])
def test_rounded_stamps_are_spread_within_the_last_digit(
    digits: float, way: Callable[[np.ndarray], np.ndarray], tmp_path: Path
) -> None:
    def change(table: pd.DataFrame) -> None:
        table["t_s"] = way(table["t_s"].to_numpy() / digits) * digits

    trial = read(tmp_path, change)
    late = trial.imu.t - GOOD.imu.t
    assert np.std(late) < np.median(np.diff(GOOD.imu.t))
    assert abs(np.mean(late)) < trial.imu.stamp_std + 0.5 * np.median(np.diff(GOOD.imu.t))


def test_batches_whose_size_has_nothing_to_do_with_the_time_are_refused() -> None:
    rng = np.random.default_rng(1)
    sizes = np.where(np.arange(200) % 2, 1, 9)
    t = np.repeat(np.arange(200) * 0.05, sizes)
    with pytest.raises(InputError, match="from 1 to 9 whatever time has passed, expected a steady number"):
        tidy(t, rng.normal(size=(len(t), 3)), "x", lambda row: f"row {row}", [])


def test_a_row_written_twice_is_a_copy_and_no_batch(tmp_path: Path) -> None:
    trial = read(tmp_path, lambda table: table.loc[table.index.repeat(2)])
    make.same(trial, GOOD)
    assert not said(trial, "spread")
    assert len(said(trial, "duplicate stamps (trial.csv:")) == 3  # of the IMU, encoders and currents


def test_the_sampling_period_counts_samples_and_not_ticks() -> None:
    t = np.arange(1000) / 200
    assert sampling_period(t) == pytest.approx(0.005)
    assert sampling_period(np.floor(t)) == pytest.approx(0.005, rel=0.01)
    assert sampling_period(np.floor(t / 0.0125) * 0.0125) == pytest.approx(0.005, rel=0.02)
    assert sampling_period(np.zeros(5)) == 0


def stepped(size: float, at: float = 6.35) -> Change:
    def change(table: pd.DataFrame) -> None:
        table.loc[table["t_s"] >= at, "t_s"] += size

    return change


ANY = [-0.02, -0.05, -0.3, -3.0, -1.7e9, 1.7e9]  # with the robot at rest a short step forward is a gap


@pytest.mark.parametrize(
    ("size", "at"), [*in_turn(ANY, (0.5, 6.35, 12.3)), (-3.0, 6.35), (0.3, 6.35), (5.0, 6.35)]
)
def test_a_clock_that_was_set_goes_on(size: float, at: float, tmp_path: Path) -> None:
    trial = read(tmp_path, stepped(size, at))
    for sensor in PREFIX:
        good, got = getattr(GOOD, sensor), getattr(trial, sensor)
        # After 1970 a number holds a stamp to a quarter of a microsecond.
        np.testing.assert_allclose(got.t - got.t[0], good.t - good.t[0], atol=4e-4)
    np.testing.assert_array_equal(trial.wheels.angle, GOOD.wheels.angle)
    way = "back" if size < 0 else "forward"
    assert len(said(trial, f"the clock was set {way} by ")) == 1


@given(
    cut=st.integers(60, 940), size=st.floats(0.031, 30), jitter=st.floats(0, 0.001), seed=st.integers(0, 999)
)
@settings(max_examples=examples(150))
def test_every_step_back_is_found_where_it_is(cut: int, size: float, jitter: float, seed: int) -> None:
    # by as much as the log lasts, the parts stand end to end, as in a file whose rows were written late
    assume(abs(size - 10.0) > 0.02)
    rng = np.random.default_rng(seed)
    t = np.arange(1000) / 100 + rng.uniform(-jitter, jitter, 1000)
    t[cut:] -= size
    assert set_back(t, rng.normal(size=(1000, 3))) == [cut]


def test_counters_tell_a_step_forward_from_a_gap() -> None:
    t = np.arange(1000) / 100
    counts = np.repeat(np.floor(300 * t)[:, None], 4, axis=1)
    late = np.where(np.arange(1000) < 400, t, t + 2)
    assert set_forward(late, counts) == [400]
    assert (
        set_forward(np.delete(t, np.arange(400, 600)), np.delete(counts, np.arange(400, 600), axis=0)) == []
    )
    assert set_forward(late, np.zeros((1000, 4))) == []  # at rest nothing tells


def test_samples_that_arrive_late_and_at_once_are_refused_as_such(tmp_path: Path) -> None:
    """They are no step of the clock, and no rows off the time line."""

    def late(table: pd.DataFrame) -> None:
        for begin in (3.0, 4.4, 6.2, 7.5):
            table.loc[table["t_s"].between(begin, begin + 0.2), "t_s"] = begin + 0.2

    with pytest.raises(
        InputError, match=r"samples have the stamp 3.200 s, after 0.2.. s without any"
    ) as caught:
        read(tmp_path, late)
    assert "when they arrived" in caught.value.message


def test_rows_between_two_holes_are_on_the_time_line() -> None:
    t = np.delete(np.arange(1000) / 100, [*range(400, 420), *range(470, 490)])
    assert stray(t) == []
    t = np.arange(1000) / 100
    t[500:530] += 40.0
    assert stray(t) == [slice(500, 530)]


def test_a_logger_that_was_started_anew_is_refused_with_its_line(tmp_path: Path) -> None:
    def change(table: pd.DataFrame) -> None:
        wheels = [name for name in table if name.startswith("enc_")]
        after = table["t_s"] > 6
        table.loc[after, wheels] -= table.loc[after, wheels].dropna().iloc[0]
        table.loc[after, "t_s"] -= 6

    with pytest.raises(
        InputError, match=r"trial.csv:\d+: time runs backwards by 6.000 s and starts over"
    ) as caught:
        read(tmp_path, change)
    assert "the wheels' counters do not go on" in caught.value.message
    assert "cut the file there" in caught.value.hint


def test_without_counters_a_clock_that_starts_over_is_refused_and_one_that_was_set_goes_on(
    tmp_path: Path,
) -> None:
    def alone(table: pd.DataFrame, size: float) -> pd.DataFrame:
        stepped(size)(table)
        return table[["t_s", *make.IMU]].dropna()

    with pytest.raises(InputError, match="starts over"):
        read(tmp_path, lambda table: alone(table, -6.3))
    t = read(tmp_path, lambda table: alone(table, -3.0)).imu.t
    np.testing.assert_allclose(t, GOOD.imu.t, atol=4e-4)


def test_sensors_in_blocks_and_rows_in_the_order_of_arrival_are_no_steps_of_the_clock(tmp_path: Path) -> None:
    def blocks(table: pd.DataFrame) -> pd.DataFrame:
        kinds = [table[table[name].notna()] for name in ("imu_ax_mps2", "enc_fl_rad", "cur_fl_A")]
        return pd.concat(
            [kind.iloc[len(kind) * k // 20 : len(kind) * (k + 1) // 20] for k in range(20) for kind in kinds]
        )

    def arrived(table: pd.DataFrame) -> pd.DataFrame:
        late = np.where(table["enc_fl_rad"].notna(), 0.08, np.where(table.index % 50 == 7, 0.03, 0.0))
        return table.iloc[np.argsort(table["t_s"].to_numpy() + late, kind="stable")]

    for change in (blocks, arrived):
        trial = read(tmp_path, change)
        make.same(trial, GOOD)
        assert not said(trial, "clock")
    assert len(said(trial, "samples were not in the order of time (trial.csv:")) == 1


ROSTOPIC = "%time,field.header.stamp,field.twist.twist.linear.x"


@pytest.mark.parametrize("stamp", ["0", "1700000000123456789", "{second}000000000"])
def test_a_header_that_stands_still_gives_way_to_the_time_of_arrival(stamp: str, tmp_path: Path) -> None:
    start = 1_700_000_000_000_000_000
    rows = [
        f"{start + 20_000_000 * k},{stamp.format(second=1_700_000_000 + k // 50)},{0.3 + 0.01 * (k % 3)}"
        for k in range(300)
    ]
    trial = make.read(tmp_path, "\n".join([ROSTOPIC, *rows]), "odom.csv", robot="husky")
    np.testing.assert_allclose(np.diff(trial.wheels.t), 0.02, atol=1e-6)
    assert len(said(trial, "column 'field.header.stamp'")) == 1
    assert "the stamps are those of '%time'" in said(trial, "column 'field.header.stamp'")[0]


def test_a_hole_of_a_gyro_with_stamps_of_its_own_is_a_hole(tmp_path: Path) -> None:
    rates = make.IMU[3:]

    def change(table: pd.DataFrame, end: float) -> pd.DataFrame:
        own = table[["t_s", *rates]].dropna()
        own = own[(own["t_s"] < 4) | (own["t_s"] > end)].assign(t_s=lambda x: x["t_s"] + 0.0011)
        rest = table.drop(columns=rates).dropna(
            how="all", subset=[n for n in table if n not in ("t_s", *rates)]
        )
        return pd.concat([rest, own]).sort_values("t_s", kind="stable")

    trial = read(tmp_path, lambda table: change(table, 4.3))
    assert not ((trial.imu.t > 4.0) & (trial.imu.t < 4.29)).any()
    assert said(trial, "IMU: one gap, the longest 0.310 s at t = 3.99")
    trial = read(tmp_path, lambda table: change(table, 7.0))
    assert said(trial, "no IMU samples while the robot moved: 3.996 to 7.006 s")
    assert trial.imu.t[0] > 7


FORMS = {
    "rosbag_to_csv": "%Y/%m/%d/%H:%M:%S.%f",
    "twelve hours": "%m/%d/%Y %I:%M:%S.%f %p",
    "day first": "%d.%m.%Y %H:%M:%S.%f",
    "named month": "%d-%b-%Y %H:%M:%S.%f",
    "compact": "%Y%m%dT%H%M%S.%f",
    "offset": "%Y-%m-%d %H:%M:%S.%f+0100",
    "time of day": "%H:%M:%S.%f",
    "time of twelve hours": "%I:%M:%S.%f %p",
    "minutes": "%M:%S.%f",
}


@pytest.mark.parametrize(
    ("form", "start"), in_turn(FORMS.values(), ["2025-01-11T23:59:57", "2025-03-30T17:03:22.005166"])
)
def test_dates_and_times_of_day_are_time(form: str, start: str, tmp_path: Path) -> None:
    t, *_ = make.rows()
    header, *rows = make.lines()
    stamps = pd.Timestamp(start) + pd.to_timedelta(t, unit="s").round("us")
    lines = [
        f"{stamp},{row.partition(',')[2]}" for stamp, row in zip(stamps.strftime(form), rows, strict=True)
    ]
    path = make.written(tmp_path, "\n".join([header.replace("t_s", "time"), *lines]) + "\n")
    got = read_trial(path, robot="granite").imu.t
    np.testing.assert_allclose(got - got[0], t, atol=1e-6)
    np.testing.assert_allclose(make.mapped(tmp_path, path).imu.t, got, atol=1e-9)


def test_a_day_and_a_time_in_two_columns_are_one_clock(tmp_path: Path) -> None:
    t, *_ = make.rows()
    header, *rows = make.lines()
    stamps = pd.Timestamp("2025-03-30T23:59:57.5") + pd.to_timedelta(t, unit="s").round("us")
    cells = zip(stamps.strftime("%Y-%m-%d,%H:%M:%S.%f"), rows, strict=True)
    lines = [f"{stamp},{row.partition(',')[2]}" for stamp, row in cells]
    path = make.written(tmp_path, "\n".join([header.replace("t_s", "day,clock"), *lines]) + "\n")
    to = {column.name: (column.to, column.unit) for column in inspect_logs([path]).files[0].columns}
    assert (to["day"], to["clock"]) == ((("t",), "date"), (("t_add",), "date"))
    np.testing.assert_allclose(
        make.mapped(tmp_path, path).imu.t, (stamps - pd.Timestamp(0)) / pd.Timedelta(seconds=1), atol=1e-6
    )


@pytest.mark.parametrize("rate", [10, 20])
@pytest.mark.parametrize(
    "change", [lambda t: t, lambda t: np.where(t > 6, t - 0.4, t), lambda t: np.floor(t * 10) / 10]
)
def test_slow_sensors_are_read(rate: int, change: Callable[[np.ndarray], np.ndarray], tmp_path: Path) -> None:
    def thinned(table: pd.DataFrame) -> pd.DataFrame:
        kinds = [(table["imu_ax_mps2"].notna(), 200 // rate), (table["enc_fl_rad"].notna(), 100 // rate)]
        out = pd.concat([table[kind].iloc[::every] for kind, every in kinds]).sort_values(
            "t_s", kind="stable"
        )
        return out.assign(t_s=change(out["t_s"].to_numpy()))

    trial = read(tmp_path, thinned)
    assert np.median(np.diff(trial.imu.t)) == pytest.approx(1 / rate, rel=0.02)
    assert np.diff(trial.imu.t).max() < 1.6 / rate


def test_an_imu_and_encoders_in_two_logs_are_one_trial(tmp_path: Path) -> None:
    def part(name: str, prefix: str, late: float = 0.0) -> Path:
        def change(table: pd.DataFrame) -> pd.DataFrame:
            names = [column for column in table if column.startswith(prefix)]
            out = table[["t_s", *names]].dropna(how="all", subset=names)
            return out.assign(t_s=out["t_s"] + late)

        return make.changed(tmp_path, SAMPLE, change).rename(tmp_path / name)

    imu, wheels, later = part("a.csv", "imu_"), part("b.csv", "enc_"), part("c.csv", "enc_", 100)
    for order in ([imu, wheels], [wheels, imu]):
        found = gl.ingest(order, jobs=1)
        assert len(found) == 1
        make.same(found[0].trial, gl.ingest(imu, encoders=wheels, jobs=1)[0].trial)
        assert (
            found.origin.warnings[0] == "a.csv holds an IMU alone and b.csv encoders alone: read as one trial"
        )
    assert abs(found[0].motion.slip_ratio.value - TRUE_SLIP) < 2 * found[0].motion.slip_ratio.std
    apart = gl.ingest([imu, later], jobs=1)
    assert len(apart) == 2
    assert f"granite-lab ingest {imu} --encoders {later}" in apart.origin.warnings[0]
    assert len(gl.ingest([SAMPLE, imu], jobs=1)) == 2
