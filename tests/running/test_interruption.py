"""A study or a search that is killed or interrupted, at any point, ends as if nothing had happened."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.running.processes import (
    STUDY,
    TWO,
    begin,
    everything,
    gone,
    members,
    trials,
    undisturbed,
    unfinished,
)
from tests.soak import SOAK

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc"),
]


@dataclass(frozen=True)
class Job:
    """A command that is killed again and again."""

    args: tuple[str, ...]
    logs: tuple[str, ...]
    kills: int


JOBS = {
    "study": Job(STUDY, TWO, 30 if SOAK else 1),
    "discover": Job(("discover", "logs", "--out", "report", "--jobs", "2"), TWO[1:], 30 if SOAK else 1),
}


def entries(cache: Path) -> dict[str, int]:
    """Return what is remembered, and in which file: one that was made again is another."""
    return {path.name: path.stat().st_ino for path in cache.glob("*/*.bin")}


def doing(folder: Path, trials: int, *, searches: bool) -> str:
    """Say what a run was doing when it was killed, by what it left."""
    done = len(entries(folder / "cache"))
    if done < trials:
        return "analysing trials"
    return "searching" if searches and done == trials else "writing"


@pytest.mark.parametrize("name", JOBS)
def test_killed_at_random_points_it_resumes_and_ends_with_the_same_bytes(
    name: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    job = JOBS[name]
    if name == "study":
        analysed, (folder, wall) = len(job.logs), request.getfixturevalue("studied")
    else:
        analysed, (folder, wall) = 0, undisturbed(tmp_path / "undisturbed", *job.args, logs=job.logs)
    expected, remembered = everything(folder / "report"), set(entries(folder / "cache"))

    rng = random.Random(6)
    killed: Counter[str] = Counter()
    round_ = 0
    while killed.total() < job.kills:
        folder = tmp_path / str(round_)
        trials(folder, *job.logs)
        known: dict[str, int] = {}
        while True:
            run, begun = begin(folder, *job.args, cache=folder / "cache"), time.monotonic()
            try:
                wait = rng.uniform(0.05, 0.95) * wall if killed.total() < job.kills else None
                _, errors = run.communicate(timeout=wait)
            except subprocess.TimeoutExpired:
                run.kill()
                assert gone(run.pid), "processes stay behind"
                run.communicate()
                killed[doing(folder, analysed, searches="--no-discover" not in job.args)] += 1
                assert known.items() <= entries(folder / "cache").items(), "what was finished is done again"
                known = entries(folder / "cache")
                continue
            if not known:
                wall = time.monotonic() - begun  # less than of the first run, which compiled
            break
        assert run.returncode == 0, errors
        assert everything(folder / "report") == expected
        assert known.items() <= entries(folder / "cache").items(), "what was finished is done again"
        assert set(entries(folder / "cache")) == remembered
        assert unfinished(folder / "report") == []
        assert [p.name for p in folder.iterdir() if p.name.startswith(".")] == []
        round_ += 1
    print(f"{name}: killed {killed.total()} times: " + ", ".join(f"{n} {w}" for w, n in killed.items()))
    assert not SOAK or killed["searching"] >= 5


def test_ctrl_c_ends_it_at_once_with_130_one_line_and_no_process_left(tmp_path: Path) -> None:
    trials(tmp_path, *TWO)
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
