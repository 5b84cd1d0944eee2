"""`granite-lab check` is green for a good run, and red with a reason for a bad one."""

from __future__ import annotations

import io
import json
import resource
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

import granite_lab as gl
from tests.corpus.cli import SAMPLES, lab, succeeded

SAMPLE = SAMPLES / "virtual_v0.7_r1.csv"


def changed(folder: Path, **columns: float) -> Path:
    """Return a copy of the sample in which columns are constant."""
    lines = SAMPLE.read_text(encoding="utf-8").splitlines(keepends=True)
    head = [line for line in lines if line.startswith("#")]
    table = pd.read_csv(io.StringIO("".join(lines[len(head) :])))
    for name, value in columns.items():
        table[name] = table[name].where(table[name].isna(), value)
    path = folder / "run.csv"
    path.write_text("".join(head) + table.to_csv(index=False), encoding="utf-8")
    return path


@pytest.mark.parametrize("sample", sorted(SAMPLES.glob("virtual_*_r1.csv")), ids=lambda p: p.stem)
def test_a_good_run_is_green_on_one_screen(sample: Path) -> None:
    done = succeeded("check", sample)
    assert "The run is good." in done.out
    assert "virtual data" in done.out
    assert len(done.out.splitlines()) <= 24
    assert max(map(len, done.out.splitlines())) <= 80


def test_a_check_takes_two_seconds_half_of_it_to_load_scipy() -> None:
    """Of a processor's time: the check itself less than 2 s; a process less than 3 s, with its imports."""

    def cost() -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        code = "from granite_lab.cli import main; main()"
        subprocess.run([sys.executable, "-c", code, "check", str(SAMPLE)], capture_output=True, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    gl.check(SAMPLE)
    start = time.process_time()
    gl.check(SAMPLE)
    assert time.process_time() - start < 2
    assert any(cost() < 3 for _ in range(5))


@pytest.mark.parametrize(
    ("columns", "named"),
    [
        ({"imu_ax_mps2": 0.01}, ("imu_ax_mps2", "acceleration x")),  # by the reader, or by the check
        ({"imu_gy_radps": 0.0}, ("imu_gy_radps", "rate y")),
        ({"enc_fl_rad": 0.3}, ("no motion: fl",)),
        ({"cur_rr_A": 0.0}, ("constant: rr",)),
    ],
)
def test_a_dead_channel_is_named(tmp_path: Path, columns: dict[str, float], named: tuple[str, ...]) -> None:
    done = lab("check", changed(tmp_path, **columns), "--json")
    assert done.code == 3
    document = json.loads(done.out)
    assert not document["good"]
    bad = " ".join(c["found"] for c in document["checks"] if not c["good"])
    assert any(name in bad for name in named)
    assert done.err.startswith("error: ")
    assert "hint: " in done.err


def test_a_run_without_a_standstill_at_its_end_is_red(tmp_path: Path) -> None:
    lines = SAMPLE.read_text(encoding="utf-8").splitlines(keepends=True)
    start = next(i for i, line in enumerate(lines) if not line.startswith("#")) + 1
    end = next(i for i, line in enumerate(lines[start:], start) if float(line.split(",")[0]) > 6.0)
    path = tmp_path / "run.csv"
    path.write_text("".join(lines[:end]), encoding="utf-8")
    done = lab("check", path)
    assert done.code == 4
    assert "standstills" in done.err
    assert "BAD" in done.out


def test_a_log_that_cannot_be_read_is_red(tmp_path: Path) -> None:
    path = tmp_path / "notes.csv"
    path.write_text("hello\nworld\n", encoding="utf-8")
    done = lab("check", path)
    assert done.code == 3
    assert "BAD" in done.out
    found = gl.check(path)
    assert not found.good
    assert isinstance(found.error, gl.InputError)
    assert list(found.to_frame()["good"]) == [False]
    with pytest.raises(gl.UsageError, match="12 logs"):
        gl.check(SAMPLES)
