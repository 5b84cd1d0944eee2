"""Stamps and counters: units, order, wraps, dates, gaps; resets are told apart from motion."""

import datetime
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from granite_lab.errors import InputError
from granite_lab.logs import inspect_logs, read_trial
from granite_lab.logs.counters import quantum, unwrap
from granite_lab.logs.layouts import Column
from granite_lab.logs.quantities import find_unit
from granite_lab.logs.sensors.clock import set_back
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.sensors.encoders import Wheel, convert
from granite_lab.logs.sensors.stamps import doubt_gaps, tidy, unit_factor
from tests.corpus import cli
from tests.logs import make
from tests.soak import examples

T = np.arange(1000) / 100


def tidied(t: np.ndarray, values: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, list[str]]:
    doubts: list[Doubt] = []
    values = np.zeros((len(t), 1)) if values is None else values
    assert set_back(t, values) == []
    stamps = tidy(t, values, "x", lambda row: f"row {row}", doubts)
    return stamps.t, stamps.rows, [*map(str, doubts)]


@given(st.data())
@settings(max_examples=examples(60))
def test_late_and_double_samples_are_sorted_and_the_first_is_kept(data: st.DataObject) -> None:
    seed = data.draw(st.integers(0, 10_000))
    reach = data.draw(st.integers(1, 6))
    rng = np.random.default_rng(seed)
    order = np.argsort(np.arange(len(T)) + rng.uniform(0, reach, len(T)), kind="stable")
    order = np.insert(order, 500, order[480:486])  # too few for a new start
    t, rows, _ = tidied(T[order], rng.normal(size=(len(order), 2)))
    np.testing.assert_array_equal(t, T)
    # The first row of the file that has the stamp.
    np.testing.assert_array_equal(rows, [int(np.flatnonzero(order == k)[0]) for k in range(len(T))])


def test_blocks_are_sorted_and_read_once_but_a_new_start_is_a_step_of_the_clock() -> None:
    np.testing.assert_array_equal(tidied(np.concatenate((T[500:], T[:500])))[0], T)
    twice = np.concatenate((T[:600], T[400:]))
    values = np.sin(twice * 7)[:, None]
    np.testing.assert_array_equal(tidied(twice, values)[0], T)
    other = values.copy()
    other[600:] += 1
    assert set_back(twice, other) == [600]
    again = np.concatenate((T[:600], T[:300] + 0.003))
    assert set_back(again, np.zeros((900, 1))) == [600]


@pytest.mark.parametrize("bits", [16, 32])
def test_a_wrapped_clock_is_told_from_one_that_was_set_back_and_both_go_on(bits: int, tmp_path: Path) -> None:
    """[ms], 100 Hz; the other clock starts over a second before its wrap, while the wheels turn."""
    header, *rows = make.lines()
    wrapped = np.mod(2**bits - 3000 + 10 * np.arange(len(rows)), 2**bits)
    for offset in (0, 1000):
        stamps = np.where(wrapped > 2**15, wrapped - offset, wrapped)
        cells = [f"{k},{row.partition(',')[2]}" for k, row in zip(stamps, rows, strict=True)]
        trial = make.read(tmp_path, "\n".join([header.replace("t_s", "t_ms"), *cells]))
        np.testing.assert_allclose(np.diff(trial.imu.t), 0.01, atol=1e-9)
        said = [line for line in trial.warnings if "clock" in line]
        assert len(said) == 1
        assert (f"wrapped 1 times at {2**bits}" if offset == 0 else "was set back by") in said[0]


@given(
    rate=st.floats(5, 1500),
    true=st.sampled_from([1.0, 1e-3, 1e-6, 1e-9]),
    declared=st.sampled_from([1.0, 1e-3, 1e-6, 1e-9]),
)
@settings(max_examples=examples(200))
def test_a_unit_is_corrected_refused_or_right_but_never_wrong_by_thousands(
    rate: float, true: float, declared: float
) -> None:
    raw = np.arange(50) / rate / true
    try:
        factor, doubt = unit_factor(raw, declared, 4.0)
    except InputError:
        return
    assert (doubt == "") == (factor == declared)
    # Where a wrong unit passes, its rate is one that sensors have: only those lie within a thousand.
    assert factor == true or 4 <= rate * true / factor <= 20_000


@pytest.mark.parametrize(("unit", "scale"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_dates_name_their_own_unit(unit: str, scale: float) -> None:
    raw = (1.7e9 + T) * scale
    factor, doubt = unit_factor(raw, 1.0, 4.0)
    assert factor == 1 / scale
    assert f"stamps are in {unit}" in doubt


def test_gaps_are_counted_from_three_periods_on() -> None:
    t = np.delete(T, [100, 101, 500, 501, 502, 503])
    assert doubt_gaps(np.delete(T, [100]), "x") is None
    text = str(doubt_gaps(t, "x"))
    assert "the longest 0.050 s at t = 4.990 s" in text


START = 1_772_366_399  # 2026-03-01T11:59:59Z: the log crosses a full minute
UTC = datetime.UTC


def log(path: Path, head: str, stamp: Callable[[int], str]) -> Path:
    """Write the log of `make` with stamps in other columns.

    Args:
        path: the file.
        head: names of the columns of time.
        stamp: from microseconds since START to the cells.
    """
    header, *rows = make.lines()
    lines = [f"{head},{header.partition(',')[2]}"]
    for k, row in enumerate(rows):
        lines.append(f"{stamp(10_000 * k + 123)},{row.partition(',')[2]}")
    path.write_text("\n".join(lines) + "\n")
    return path


def iso(us: int, zone: datetime.timezone | None = UTC) -> str:
    moment = datetime.datetime.fromtimestamp(START, UTC) + datetime.timedelta(microseconds=us)
    return moment.astimezone(zone).isoformat() if zone else moment.replace(tzinfo=None).isoformat()


def parts(size: int) -> Callable[[int], str]:
    return lambda us: f"{START + us // 1_000_000},{us % 1_000_000 * size // 1_000_000}"


TRUE = START + 123e-6 + np.arange(600) / 100
DATES = {
    "zone Z": lambda us: iso(us).replace("+00:00", "Z"),
    "zone +02:00": lambda us: iso(us, datetime.timezone(datetime.timedelta(hours=2))),
    "no zone": lambda us: iso(us, None),
    "a blank": lambda us: iso(us, None).replace("T", " "),
    "other signs": lambda us: re.sub(r"\D", "_", iso(us, None)),
    "slashes": lambda us: iso(us, None).replace("-", "/").replace("T", " "),
}


@pytest.mark.parametrize(
    ("head", "size", "unit"),
    [
        ("sec,nanosec", 10**9, "ns"),
        ("stamp.secs,stamp.nsecs", 10**9, "ns"),
        ("header.stamp.sec,header.stamp.nanosec", 10**9, "ns"),
        ("time_s,time_ns", 10**9, "ns"),
        ("tv_sec,tv_usec", 10**6, "us"),
    ],
)
def test_seconds_and_their_parts_are_guessed_and_the_map_reads_them(
    head: str, size: int, unit: str, tmp_path: Path
) -> None:
    path = log(tmp_path / "log.csv", head, parts(size))
    done = cli.succeeded("inspect", path)
    assert "no known layout; columns guessed" in done.out
    rows = {words[0]: words[1:3] for line in done.out.splitlines() if len(words := line.split()) > 3}
    whole, part = head.split(",")
    assert (rows[whole], rows[part], rows["enc_rr_rad"]) == (["t", "s"], ["t_add", unit], ["enc_rr", "rad"])
    np.testing.assert_allclose(make.mapped(tmp_path, path).imu.t, TRUE, rtol=0, atol=1e-6)


def test_two_clocks_in_different_units_are_not_taken_for_one(tmp_path: Path) -> None:
    path = log(tmp_path / "log.csv", "time_s,time_ns", lambda us: f"{us / 1e6},{us * 1000}")
    to = {c.name: c.to for c in inspect_logs([path]).files[0].columns}
    assert "t_add" not in {channel for channels in to.values() for channel in channels}
    assert [name for name, channels in to.items() if channels == ("t",)] == ["time_s"]


@pytest.mark.parametrize("written", DATES)
def test_dates_are_guessed_and_the_map_reads_them(written: str, tmp_path: Path) -> None:
    path = log(tmp_path / "log.csv", "when", DATES[written])
    column = inspect_logs([path]).files[0].columns[0]
    assert (column.name, column.to, column.unit) == ("when", ("t",), "date")
    np.testing.assert_allclose(make.mapped(tmp_path, path).imu.t, TRUE, rtol=0, atol=1e-6)


def test_a_cell_that_is_no_date_is_named_with_its_line(tmp_path: Path) -> None:
    path = log(tmp_path / "log.csv", "t_s", lambda us: "yesterday" if us > 3_000_000 else iso(us))
    with pytest.raises(InputError, match=r"log.csv:302: column 't_s': 'yesterday' is not a date") as caught:
        read_trial(path)
    assert "ISO 8601" in caught.value.hint


def test_dates_under_a_known_name_need_no_map_and_an_empty_one_leaves_the_sample_out(tmp_path: Path) -> None:
    path = log(tmp_path / "log.csv", "t_s", lambda us: "" if us == 3_000_123 else iso(us))
    trial = read_trial(path)
    np.testing.assert_allclose(trial.imu.t, np.delete(TRUE, 300), rtol=0, atol=1e-6)
    assert any("1 samples without a time stamp" in line for line in trial.warnings)


def test_stamps_since_1970_stay_exact_to_the_microsecond_in_the_motion_table(tmp_path: Path) -> None:
    path = log(tmp_path / "log.csv", "t_s", lambda us: f"{START + us // 10**6}.{us % 10**6:06d}")
    np.testing.assert_allclose(read_trial(path).imu.t, TRUE, rtol=0, atol=3e-7)
    cli.succeeded("ingest", path, "--out", tmp_path / "out", "-q", "-j", 1)
    table = pd.read_csv(tmp_path / "out" / "log.csv")
    nearest = np.abs(table.iloc[:, 0].to_numpy()[:, None] - TRUE[None, :]).min(axis=1)
    assert nearest.max() < 1e-6


COUNTS = find_unit("counts")
PLAIN = Column(to=())


@st.composite
def motions(draw: st.DrawFn) -> tuple[np.ndarray, int, int]:
    """True counts of a drive that is smooth from sample to sample, and the width of the counter."""
    bits = draw(st.sampled_from([16, 32]))
    speed = draw(st.integers(1, 2 ** (bits - 6)))
    count = draw(st.integers(20, 300))
    sign = draw(st.sampled_from([-1, 1]))
    wobble = np.array(draw(st.lists(st.integers(0, speed), min_size=count, max_size=count)))
    start = draw(st.integers(0, 2**bits - 1))
    return start + sign * np.cumsum(wobble), bits, sign


@given(motion=motions(), signed=st.booleans())
@settings(max_examples=examples(150))
def test_every_wrap_is_undone_exactly(motion: tuple[np.ndarray, int, int], signed: bool) -> None:
    true, bits, _ = motion
    logged = np.mod(true, 2**bits)
    if signed:
        logged = np.where(logged >= 2 ** (bits - 1), logged - 2**bits, logged)
    values, wraps, width = unwrap(logged.astype(float), [2.0**16, 2.0**32])
    np.testing.assert_array_equal(values - values[0], (true - true[0]).astype(float))
    assert wraps == 0 or width == 2.0**bits


def test_a_reset_is_not_taken_for_a_wrap_but_taken_out_and_said() -> None:
    counts = np.concatenate((np.arange(0, 60_000, 50.0), np.arange(0, 5_000, 50.0)))
    assert unwrap(counts, [2.0**16, 2.0**32])[1] == 0
    t = np.arange(len(counts)) / 100
    angle = convert(t, counts, COUNTS, PLAIN, Wheel(10_000, 0.1), doubts := []).angle
    assert any("starts anew" in str(doubt) for doubt in doubts)
    np.testing.assert_allclose(np.diff(angle), 50 * 2 * np.pi / 10_000)


def test_a_reading_thrown_off_leaves_the_angle_after_it_as_it_was() -> None:
    true = np.arange(0, 60_000, 50.0)
    counts = true.copy()
    counts[[300, 700]] += 40_000, -25_000
    t = np.arange(len(counts)) / 100
    angle = convert(t, counts, COUNTS, PLAIN, Wheel(10_000, 0.1), doubts := []).angle
    np.testing.assert_allclose(angle, true * 2 * np.pi / 10_000)
    assert any("2 readings thrown off" in str(doubt) for doubt in doubts)


@pytest.mark.parametrize("width", [2 * np.pi, 2**16 * 2 * np.pi / 106_000], ids=["a turn", "counts"])
def test_an_angle_that_starts_again_is_unwrapped(width: float, tmp_path: Path) -> None:
    """After a turn, or because the logger has turned the counts of a 16-bit counter into an angle."""
    q = 2 * np.pi / 106_000
    true = q * (np.rint(3.0 * np.arange(600) / 100 / q) + 60_000)
    rows = [f"{k / 100}" + f",{np.mod(x, width):.9f}" * 4 for k, x in enumerate(true)]
    head = '# robot = "granite"\nt_s,enc_fl_rad,enc_fr_rad,enc_rl_rad,enc_rr_rad\n'
    angle = make.read(tmp_path, head + "\n".join(rows)).wheels.angle[:, 0]
    np.testing.assert_array_equal(np.rint((angle - angle[0]) / q), np.rint((true - true[0]) / q))


@given(
    step=st.floats(1e-6, 1.0),
    levels=st.lists(st.integers(-500, 500), min_size=60, max_size=200, unique=True),
)
@settings(max_examples=examples(60))
def test_the_resolution_is_found_and_a_uniform_motion_has_none(step: float, levels: list[int]) -> None:
    gaps = np.gcd.reduce(np.diff(np.sort(levels)))
    values = step * np.array(levels, dtype=float)
    found = quantum(values)
    assert found == pytest.approx(step * gaps, rel=1e-6) or found == 0.0
    # A dense grid is always found.
    assert quantum(step * np.repeat(np.arange(-50, 50.0), 4)) == pytest.approx(step, rel=1e-6)
    assert quantum(step * np.arange(500)) == 0.0
    assert quantum(step * np.random.default_rng(len(levels)).normal(size=500)) == 0.0


def test_velocity_and_distance_of_the_circumference_need_the_radius() -> None:
    t = np.arange(101) / 100
    for text, raw in (("m/s", np.full(101, 0.3)), ("m", 0.3 * t), ("mm", 300 * t)):
        unit = find_unit(text)
        angle, rate, *_ = convert(t, raw, unit, PLAIN, Wheel(0, 0.1), [])
        assert angle[-1] == pytest.approx(3.0)
        assert (rate is None) == (text != "m/s")


def test_steps_since_the_last_row_are_added_up() -> None:
    t = np.arange(11) / 10
    said = Column(to=(), scale=-1, increment=True)
    angle = convert(t, np.full(11, 7.0), COUNTS, said, Wheel(70, 0.1), []).angle
    assert angle[-1] - angle[0] == pytest.approx(-2 * np.pi)
