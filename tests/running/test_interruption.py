"""A study that is killed or interrupted, at any point, ends as if nothing had happened."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.running.processes import SOAK, begin, gone, members, results, trials, unfinished

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc"),
]

KILLS = 30 if SOAK else 3
SEARCH = "--discover" if SOAK else "--no-discover"
STUDY = ("study", "logs", "--out", "report", "--jobs", "2", "--no-recordings", SEARCH)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, bytes], float]:
    """What a study gives that nobody disturbs, and how long it takes [s]."""
    folder = tmp_path_factory.mktemp("undisturbed")
    trials(folder, "virtual_v0.2_r1", "virtual_v0.7_r2")
    start = time.monotonic()
    run = begin(folder, *STUDY, cache=folder / "cache")
    _, errors = run.communicate()
    assert run.returncode == 0, errors
    return results(folder / "report"), time.monotonic() - start


def test_killed_at_random_points_it_resumes_and_ends_with_the_same_bytes(
    undisturbed: tuple[dict[str, bytes], float], tmp_path: Path
) -> None:
    expected, wall = undisturbed
    rng = random.Random(6)
    kills, completed, round_ = 0, 0, 0
    folder = tmp_path / "0"
    trials(folder, "virtual_v0.2_r1", "virtual_v0.7_r2")
    while True:
        run = begin(folder, *STUDY, cache=folder / "cache")
        try:
            _, errors = run.communicate(timeout=rng.uniform(0.2, 0.9) * wall if kills < KILLS else None)
        except subprocess.TimeoutExpired:
            run.kill()
            kills += 1
            assert gone(run.pid), "processes stay behind"
            run.communicate()
            continue
        assert run.returncode == 0, errors
        completed += 1
        assert results(folder / "report") == expected
        assert unfinished(folder / "report") == []
        assert [p.name for p in folder.iterdir() if p.name.startswith(".")] == []
        if kills >= KILLS:
            break
        round_ += 1
        folder = tmp_path / str(round_)
        trials(folder, "virtual_v0.2_r1", "virtual_v0.7_r2")
    assert completed >= 1


def test_ctrl_c_ends_it_at_once_with_130_one_line_and_no_process_left(tmp_path: Path) -> None:
    trials(tmp_path, "virtual_v0.2_r1", "virtual_v0.7_r2")
    run = begin(tmp_path, *STUDY, cache=tmp_path / "cache")
    while len(members(run.pid)) < 3:  # the command and its two workers
        assert run.poll() is None, run.communicate()
        time.sleep(0.02)
    time.sleep(random.Random(1).uniform(0, 2))
    os.killpg(run.pid, signal.SIGINT)  # as a terminal does: to all of them
    output, errors = run.communicate(timeout=30)
    assert run.returncode == 130
    assert (output, errors) == ("", "interrupted\n")
    assert gone(run.pid)
    assert not (tmp_path / "report").exists()
    assert unfinished(tmp_path) == []
