"""Parts of a log: a window that was asked for, what is left beside a gap."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import granite_lab as gl
from granite_lab.errors import InputError
from granite_lab.logs import Excerpt, read_trial
from tests.corpus import cli
from tests.logs import make
from tests.soak import sampled

SAMPLE = cli.SAMPLES / "virtual_v0.3_r1.csv"


@pytest.fixture
def twice(tmp_path: Path) -> Path:
    """Write a log of two drives: the second begins 6 s after the first, and its clock goes on."""
    header, *rows = make.lines()
    table = np.array([row.split(",") for row in rows], dtype=float)
    later = table + np.concatenate(([6.0], np.zeros(6), table[-1, 7:]))
    drives = [",".join(f"{x:.9g}" for x in row) for row in later]
    return make.written(tmp_path, "\n".join([header, *rows, *drives]) + "\n", "twice.csv")


def test_the_window_holds_its_samples_unchanged_and_only_these(twice: Path) -> None:
    whole, part = read_trial(twice), read_trial(twice, excerpt=Excerpt(window=(6.0, 11.5)))
    for name in ("imu", "wheels"):
        t, cut = getattr(whole, name).t, getattr(part, name).t
        np.testing.assert_array_equal(cut, t[(t >= 6.0) & (t <= 11.5)])
    inside = np.isin(whole.imu.t, part.imu.t)
    np.testing.assert_array_equal(part.imu.specific_force, whole.imu.specific_force[inside])


def test_the_window_of_one_drive_gives_the_motion_of_that_drive(twice: Path, tmp_path: Path) -> None:
    one = make.written(tmp_path, make.text(), "one.csv")
    alone = gl.ingest(one, jobs=1)[0].motion
    first = gl.ingest(twice, window=(-np.inf, 5.995), jobs=1)[0].motion
    assert first.distance.value == pytest.approx(alone.distance.value, rel=1e-9)
    done = cli.succeeded("ingest", twice, "--to", 5.995, "--out", tmp_path / "out", "-q", "-j", 1, "--json")
    assert json.loads(done.out)["trials"][0]["distance_m"]["value"] == pytest.approx(alone.distance.value)
    assert pd.read_csv(tmp_path / "out" / "twice.csv").iloc[:, 0].max() < 6


def test_a_fault_outside_the_window_does_not_matter(twice: Path) -> None:
    lines = twice.read_text().splitlines()
    rows = np.array([line.split(",") for line in lines[1000:]], dtype=float)
    rows[:, 0] -= 9
    rows[:, 7:] -= rows[0, 7:]  # the logger was started anew
    lines[1000:] = [",".join(f"{x:.9g}" for x in row) for row in rows]
    twice.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match="time runs backwards"):
        read_trial(twice)
    assert read_trial(twice, excerpt=Excerpt(window=(6.0, 9.5))).imu is not None


@pytest.mark.parametrize(
    ("start", "end", "said"),
    [
        (0.0, 0.9, "no motion between 0 and 0.9 s: the wheels do not turn there"),
        (11.2, None, "no motion after 11.2 s"),
        (20.0, None, "no sample after 20 s, the log runs from 0 to 11.99 s"),
        (None, -1.0, "no sample before -1 s"),
    ],
)
def test_a_window_without_motion_is_refused(
    start: float | None, end: float | None, said: str, twice: Path, tmp_path: Path
) -> None:
    limits = [
        x for key, value in (("--from", start), ("--to", end)) if value is not None for x in (key, value)
    ]
    done = cli.lab("ingest", twice, *limits, "--out", tmp_path / "out", "-q", "-j", 1)
    cli.refused(done, 3, f"{twice}: {said}")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "command", ["ingest", "study", "fit-k92", "fit-atheta", "compare", "discover", "check"]
)
def test_every_command_refuses_a_window_without_samples_and_one_that_ends_first(
    command: str, tmp_path: Path
) -> None:
    out = [] if command == "check" else ["--out", tmp_path / "out.csv", "-q", "-j", 1]
    done = cli.lab(command, SAMPLE, "--from", 9, "--to", 3, *out)
    assert done.code == 2
    assert done.err.startswith("error: --from 9 --to 3: not a window\nhint: --from comes before --to")
    done = cli.lab(command, SAMPLE, "--from", 100, *out)
    assert done.code == 3
    assert "no sample after 100 s, the log runs from" in done.err + done.out


def with_gap(folder: Path, prefix: str, begin: float, end: float) -> Path:
    """Write the sample without the cells of some columns, or without the rows, between two instants."""

    def change(table: pd.DataFrame) -> pd.DataFrame:
        inside = (table["t_s"] > begin) & (table["t_s"] < end)
        table.loc[inside, [name for name in table if name.startswith(prefix) and name != "t_s"]] = np.nan
        return table if prefix else table[~inside]

    return make.changed(folder, SAMPLE, change)


@pytest.mark.parametrize(
    "prefix", sampled(["imu_", "imu_gy", "enc_", "cur_", ""]), ids=lambda p: p or "whole rows"
)
def test_a_short_gap_is_bridged_and_widens_the_distance(prefix: str, tmp_path: Path) -> None:
    whole = gl.ingest(SAMPLE, jobs=1)[0].motion.distance
    path = with_gap(tmp_path, prefix, 4.0, 4.4)
    found = gl.ingest(path, jobs=1)[0]
    assert found.trial.imu.t[-1] == read_trial(SAMPLE).imu.t[-1]
    assert found.motion.distance.value == pytest.approx(whole.value, abs=2 * found.motion.distance.std)
    assert found.motion.distance.std >= 0.99 * whole.std
    assert (found.motion.distance.std > 2 * whole.std) == (prefix in ("imu_", "imu_gy", ""))
    assert any("gap" in line and "t = 3.99" in line for line in found.trial.warnings)


@pytest.mark.parametrize("prefix", ["imu_", "imu_gy", ""], ids=lambda p: p or "whole rows")
@pytest.mark.parametrize(("begin", "end", "kept"), [(4.0, 5.5, "after"), (7.0, 7.8, "before")])
def test_a_long_gap_cuts_the_log_to_its_longest_stretch_with_a_rest(
    prefix: str, begin: float, end: float, kept: str, tmp_path: Path
) -> None:
    trial = read_trial(with_gap(tmp_path, prefix, begin, end))
    t = read_trial(SAMPLE).imu.t
    expected = t[t >= end] if kept == "after" else t[t <= begin]
    np.testing.assert_array_equal(trial.imu.t, expected)
    for stream in (trial.wheels, trial.currents):
        assert expected[0] <= stream.t[0] < stream.t[-1] <= expected[-1]
    said = [line for line in trial.warnings if "the log is cut there" in line]
    assert len(said) == 1
    assert f"{expected[0]:.3f} to {expected[-1]:.3f} s" in said[0]


def test_a_long_gap_at_rest_cuts_nothing(tmp_path: Path) -> None:
    path = with_gap(tmp_path, "imu_", 10.5, 11.5)
    assert read_trial(path).imu.t[-1] == read_trial(SAMPLE).imu.t[-1]
