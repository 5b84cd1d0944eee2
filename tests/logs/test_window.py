"""`--from` and `--to`: a window of every log."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import granite_lab as gl
from granite_lab.errors import InputError
from granite_lab.logs import read_trial
from granite_lab.running import Options
from tests.corpus import cli
from tests.logs import make

SAMPLE = Path(__file__).parent.parent.parent / "data" / "samples" / "virtual_v0.3_r1.csv"


@pytest.fixture
def twice(tmp_path: Path) -> Path:
    """Write a log of two drives: the second begins 6 s after the first, and its clock goes on."""
    lines = make.lines()
    later = []
    last = [float(x) for x in lines[-1].split(",")]
    for line in lines[1:]:
        row = [float(x) for x in line.split(",")]
        row[0] += 6.0
        row[7:] = [a + b for a, b in zip(row[7:], last[7:], strict=True)]
        later.append(",".join(f"{x:.9g}" for x in row))
    path = tmp_path / "twice.csv"
    path.write_text("\n".join([*lines, *later]) + "\n")
    return path


def test_the_window_holds_its_samples_unchanged_and_only_these(twice: Path) -> None:
    whole, part = read_trial(twice), read_trial(twice, window=(6.0, 11.5))
    for name in ("imu", "wheels"):
        t, cut = getattr(whole, name).t, getattr(part, name).t
        np.testing.assert_array_equal(cut, t[(t >= 6.0) & (t <= 11.5)])
    inside = np.isin(whole.imu.t, part.imu.t)
    np.testing.assert_array_equal(part.imu.specific_force, whole.imu.specific_force[inside])


def test_the_window_of_one_drive_gives_the_motion_of_that_drive(twice: Path, tmp_path: Path) -> None:
    one = tmp_path / "one.csv"
    one.write_text(make.text())
    alone = gl.ingest(one, jobs=1)[0].motion
    first = gl.ingest(twice, window=(-np.inf, 5.995), jobs=1)[0].motion
    assert first.distance.value == pytest.approx(alone.distance.value, rel=1e-9)
    done = cli.lab("ingest", twice, "--to", 5.995, "--out", tmp_path / "out", "-q", "-j", 1, "--json")
    assert done.code == 0, done.err
    assert json.loads(done.out)["trials"][0]["distance_m"]["value"] == pytest.approx(alone.distance.value)
    assert pd.read_csv(tmp_path / "out" / "twice.csv").iloc[:, 0].max() < 6


def test_a_fault_outside_the_window_does_not_matter(twice: Path) -> None:
    lines = twice.read_text().splitlines()
    lines[1000:] = [f"{float(x.partition(',')[0]) - 9:.9g},{x.partition(',')[2]}" for x in lines[1000:]]
    twice.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match="time runs backwards"):
        read_trial(twice)
    assert read_trial(twice, window=(6.0, 9.5)).imu is not None


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
        x for name, value in (("--from", start), ("--to", end)) if value is not None for x in (name, value)
    ]
    done = cli.lab("ingest", twice, *limits, "--out", tmp_path / "out", "-q", "-j", 1)
    assert done.code == 3
    assert f"error: {twice}: {said}" in done.err
    assert "\nhint: " in done.err
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


def test_the_window_is_told_to_who_computes_a_result_again() -> None:
    for window in ((1772366400.123456, np.inf), (-np.inf, 3.0), (1.0, 2.0)):
        options = Options(window=window)
        assert Options.from_given([(key, str(value)) for key, value in options.given()]) == options
