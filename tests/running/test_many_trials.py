"""Memory does not grow with the trials: their time series wait in a file, nothing else about them changes."""

from __future__ import annotations

import copy
import dataclasses
import errno
import os
import pickle
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granite_lab.logs.trial import ImuStream, Trial, TrialInfo
from granite_lab.running import Cache, Execution, Options, each_trial
from granite_lab.running.cache import content
from granite_lab.running.codec import Arena, decode, encode
from tests.reporting.made_up import made_up_study

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
        assert content(trial) == content(long_trial("x" * k))


def held(record: Any, folder: Path | None = None) -> Any:
    return decode(Arena(folder).hold(encode(record)))


def test_a_record_in_a_file_is_as_before() -> None:
    result = made_up_study(speeds=(0.5,), repetitions=1).trials[0]
    kept = held(result)
    assert content(kept) == content(result)
    changed = dataclasses.replace(kept.comparison.motion, v=2 * kept.comparison.motion.v)
    assert changed.v.tobytes() == (2 * result.comparison.motion.v).tobytes()
    for again in (pickle.loads(pickle.dumps(kept)), copy.deepcopy(kept)):
        assert content(again) == content(result)


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_nothing_is_left_in_the_folder_and_another_process_reads_too(tmp_path: Path) -> None:
    kept = held(long_trial("xx"), tmp_path)
    assert list(tmp_path.iterdir()) == []
    reader = os.fork() if hasattr(os, "fork") else None
    if reader == 0:  # pragma: no cover, the child
        os._exit(int(float(kept.imu.specific_force[0, 0])))
    if reader is not None:
        assert os.waitstatus_to_exitcode(os.waitpid(reader, 0)[1]) == 2


def test_records_of_one_arena_do_not_touch_each_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("granite_lab.running.codec.CHUNK", 3_000_000)  # two trials
    arena = Arena(tmp_path)
    trials = [long_trial("x" * k) for k in range(1, 6)]
    kept = [decode(arena.hold(encode(trial))) for trial in trials]
    kept[0].imu.specific_force[:] = 99.0
    assert [content(k) for k in kept[1:]] == [content(t) for t in trials[1:]]


@pytest.mark.skipif(not Path("/dev/fd").is_dir(), reason="counts open files in /dev/fd")
def test_the_file_is_closed_with_the_last_record(tmp_path: Path) -> None:
    before = len(list(Path("/dev/fd").iterdir()))
    kept = held(long_trial("xx"), tmp_path)
    assert len(list(Path("/dev/fd").iterdir())) == before + 1
    del kept
    assert len(list(Path("/dev/fd").iterdir())) == before


def test_a_full_disk_leaves_the_records_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "full")

    monkeypatch.setattr("tempfile.TemporaryFile", full)
    trial = long_trial("xx")
    assert content(held(trial)) == content(trial)
