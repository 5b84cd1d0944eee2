"""Memory does not grow with the trials: their time series wait in a file, nothing else about them changes."""

from __future__ import annotations

import copy
import dataclasses
import errno
import os
import pickle
import re
import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from granite_lab.logs.trial import ImuStream, Trial, TrialInfo
from granite_lab.reporting import write, write_report
from granite_lab.running import Cache, Execution, Options, each_trial
from granite_lab.running.codec import encode
from granite_lab.running.shelf import Shelf
from tests.reporting.made_up import made_up_study
from tests.running.processes import ROOT

SAMPLES = 20_000


def long_trial(name: str) -> Trial:
    """Return a trial of 1.12 MB, each number of which says whose it is."""
    start = float(len(name))
    t = np.linspace(start, start + 1, SAMPLES)
    return Trial(
        name, TrialInfo(), imu=ImuStream(t, np.full((SAMPLES, 3), start), np.zeros((SAMPLES, 3)), False)
    )


def make(path: Path, options: Options) -> Trial:
    """Stand in for the chain."""
    return long_trial(path.stem)


@pytest.mark.parametrize("remembered", [True, False])
def test_many_results_take_little_memory(tmp_path: Path, remembered: bool) -> None:
    logs = [tmp_path / f"{'x' * k}.csv" for k in range(1, 41)]
    for log in logs:
        log.write_text("")
    how = Execution(1, cache=Cache(tmp_path / "cache") if remembered else None)
    each_trial(make, logs[:2], Options(), execution=how)
    tracemalloc.start()
    try:
        found = each_trial(make, logs, Options(), execution=how)
        kept, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept < 1_000_000  # of 45 MB
    for k, trial in enumerate(found, 1):
        assert isinstance(trial, Trial)
        assert encode(trial) == encode(long_trial("x" * k))


def test_a_laid_record_is_as_before() -> None:
    result = made_up_study(speeds=(0.5,), repetitions=1).trials[0]
    laid = Shelf().lay(result)
    assert type(laid.comparison).__qualname__ == type(result.comparison).__qualname__
    assert isinstance(laid.comparison, type(result.comparison))
    assert encode(laid) == encode(result)
    v = laid.comparison.motion.v
    assert v.tobytes() == result.comparison.motion.v.tobytes()
    changed = dataclasses.replace(laid.comparison.motion, v=2 * v)
    assert changed.v.tobytes() == (2 * v).tobytes()
    for again in (pickle.loads(pickle.dumps(laid)), copy.deepcopy(laid)):
        assert encode(again) == encode(result)
        assert type(again.comparison) is type(result.comparison)


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_nothing_is_left_in_the_folder_and_another_process_reads_too(tmp_path: Path) -> None:
    laid = Shelf(tmp_path).lay(long_trial("xx"))
    assert list(tmp_path.iterdir()) == []
    assert laid.imu is not None
    reader = os.fork() if hasattr(os, "fork") else None
    if reader == 0:  # pragma: no cover, the child
        os._exit(int(float(laid.imu.specific_force[0, 0])))
    if reader is not None:
        assert os.waitstatus_to_exitcode(os.waitpid(reader, 0)[1]) == 2


def open_files() -> int:
    """Return how many files this process holds open."""
    return sum(1 for _ in Path("/dev/fd").iterdir())


@pytest.mark.skipif(not Path("/dev/fd").is_dir(), reason="counts open files in /dev/fd")
def test_the_file_is_closed_with_the_last_record(tmp_path: Path) -> None:
    before = open_files()
    first, second = (Shelf(tmp_path).lay(long_trial("xx")) for _ in range(2))
    assert open_files() == before + 2
    del first
    assert open_files() == before + 1
    assert second.imu is not None
    del second
    assert open_files() == before


def test_a_record_that_lives_up_to_the_end_of_the_process_says_nothing() -> None:
    kept = (
        "import os; import numpy as np; from granite_lab.logs.trial import ImuStream;"
        "from granite_lab.running.shelf import Shelf; a = np.zeros((1000, 3));"
        "os.kept = Shelf().lay(ImuStream(a[:, 0], a, a, False)); print(os.kept.specific_force[0, 0])"
    )
    done = subprocess.run([sys.executable, "-c", kept], cwd=ROOT, capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("0.0\n", "")


def test_a_full_disk_leaves_the_records_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, "full")

    monkeypatch.setattr(os, "write", full)
    trial = long_trial("xx")
    assert Shelf().lay(trial) is trial


def test_a_page_of_many_trials_shows_the_figures_of_further_ones_from_their_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = made_up_study(speeds=(0.5,), repetitions=2)
    whole = write_report(result, tmp_path / "whole").read_text(encoding="utf-8")
    assert "<img" not in whole
    monkeypatch.setattr(write, "INLINE", 2)
    page = write_report(result, tmp_path / "few").read_text(encoding="utf-8")
    figures = {p.stem for p in (tmp_path / "few" / "figures").glob("*.svg")}
    assert figures == {p.stem for p in (tmp_path / "whole" / "figures").glob("*.svg")}
    images = re.findall(r'<img src="([^"]*)" .*width="(\d+)" height="(\d+)"', page)
    assert page.count("<img ") == len(images) == len(figures) - 2
    for name in figures:
        assert f'<figure id="{name}">' in page
    for path, width, height in images:
        svg = (tmp_path / "few" / path).read_text(encoding="utf-8")
        shape = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', svg)
        assert shape is not None
        assert int(width) / int(height) == pytest.approx(float(shape[1]) / float(shape[2]), rel=1e-2)
