"""Stamps as loggers write them: seconds and nanoseconds apart, dates, seconds since 1970."""

from __future__ import annotations

import datetime
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from granite_lab.errors import InputError
from granite_lab.logs import inspect_logs, read_trial
from granite_lab.logs.trial import Trial
from tests.corpus import cli
from tests.logs import make

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


def times(trial: Trial) -> np.ndarray:
    return trial.imu.t


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
    columns = {c.name: c for c in inspect_logs([path]).files[0].columns}
    whole, part = head.split(",")
    assert columns[whole].to == ("t",)
    assert (columns[part].to, columns[part].unit) == (("t_add",), unit)
    np.testing.assert_allclose(times(make.mapped(tmp_path, path)), TRUE, rtol=0, atol=1e-6)


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
    np.testing.assert_allclose(times(make.mapped(tmp_path, path)), TRUE, rtol=0, atol=1e-6)


def test_dates_under_a_known_name_need_no_map(tmp_path: Path) -> None:
    path = log(tmp_path / "log.csv", "t_s", DATES["zone Z"])
    np.testing.assert_allclose(times(read_trial(path)), TRUE, rtol=0, atol=1e-6)


def test_a_cell_that_is_no_date_is_named_with_its_line(tmp_path: Path) -> None:
    path = log(tmp_path / "log.csv", "t_s", lambda us: "yesterday" if us > 3_000_000 else iso(us))
    with pytest.raises(InputError, match=r"log.csv:302: column 't_s': 'yesterday' is not a date") as caught:
        read_trial(path)
    assert "ISO 8601" in caught.value.hint


def test_an_empty_date_leaves_the_sample_out(tmp_path: Path) -> None:
    path = log(tmp_path / "log.csv", "t_s", lambda us: "" if us == 3_000_123 else iso(us))
    trial = read_trial(path)
    np.testing.assert_allclose(times(trial), np.delete(TRUE, 300), rtol=0, atol=1e-6)
    assert any("1 samples without a time stamp" in line for line in trial.warnings)


def test_stamps_since_1970_stay_exact_to_the_microsecond_in_the_motion_table(tmp_path: Path) -> None:
    path = log(tmp_path / "log.csv", "t_s", lambda us: f"{START + us // 10**6}.{us % 10**6:06d}")
    np.testing.assert_allclose(times(read_trial(path)), TRUE, rtol=0, atol=3e-7)
    cli.succeeded("ingest", path, "--out", tmp_path / "out", "-q", "-j", 1)
    table = pd.read_csv(tmp_path / "out" / "log.csv")
    nearest = np.abs(table.iloc[:, 0].to_numpy()[:, None] - TRUE[None, :]).min(axis=1)
    assert nearest.max() < 1e-6


def test_the_guesses_about_an_unknown_log_stand_on_the_terminal(tmp_path: Path) -> None:
    path = log(tmp_path / "log.csv", "stamp.secs,stamp.nsecs", parts(10**9))
    done = cli.succeeded("inspect", path)
    assert "no known layout; columns guessed" in done.out
    rows = {words[0]: words[1:3] for line in done.out.splitlines() if len(words := line.split()) > 3}
    assert rows["stamp.secs"] == ["t", "s"]
    assert rows["stamp.nsecs"] == ["t_add", "ns"]
    assert rows["enc_rr_rad"] == ["enc_rr", "rad"]
