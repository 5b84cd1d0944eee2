"""Whole runs: same in, same out, byte by byte, after kills, too; verified, and kept apart from each other."""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import pytest

from granite_lab.errors import LabError
from granite_lab.running.output import locked
from granite_lab.stored import root
from tests.corpus.cli import lab, refused, succeeded
from tests.effects.example import EXAMPLE
from tests.remembered import made_once
from tests.running.processes import (
    AMONG_FEW,
    STUDY,
    TWO,
    begin,
    everything,
    fit_by_slip,
    gone,
    members,
    one_picture,
    results,
    trials,
    undisturbed,
    unfinished,
)
from tests.soak import SOAK, whole

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("one_picture")]
on_linux = pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")


@made_once
def study_of_two() -> Path:
    """Return a folder with `logs` and `report`, whose fits go by the slip alone."""
    folder = root() / "study-of-two"
    trials(folder, *TWO)
    with pytest.MonkeyPatch.context() as patch:
        fit_by_slip(folder / "cache", patch)
        one_picture(patch)
        succeeded("study", "logs", "--out", "report", "--no-recordings", "--no-discover", cwd=folder)
    return folder


@pytest.fixture(scope="module")
def studied() -> Path:
    """A study of two trials."""
    return study_of_two()


class Job(NamedTuple):
    """A command that is killed again and again."""

    args: tuple[str, ...]
    logs: tuple[str, ...]


SEARCH = ("discover", "logs", "--out", "report", "--jobs", "2")
JOBS = {"study": Job(STUDY, TWO), "discover": Job(SEARCH, TWO[1:])}
KILLS = 30


def entries(cache: Path) -> dict[str, int]:
    """Return what is remembered, and in which file: one that was made again is another."""
    return {path.name: path.stat().st_ino for path in cache.glob("results/*.result")}


def doing(folder: Path, trials: int, *, searches: bool) -> str:
    """Say what a run was doing when it was killed, by what it left."""
    done = len(entries(folder / "cache"))
    if done < trials:
        return "analysing trials"
    return "searching" if searches and done == trials else "writing"


@whole
@on_linux
@pytest.mark.parametrize("name", JOBS)
def test_killed_at_random_points_it_resumes_and_ends_with_the_same_bytes(name: str, tmp_path: Path) -> None:
    """`make test` kills a search in the test of order and processes."""
    job = JOBS[name]
    analysed = len(job.logs) if name == "study" else 0
    folder, wall = undisturbed(tmp_path / "undisturbed", *job.args, logs=job.logs)
    expected, remembered = everything(folder / "report"), set(entries(folder / "cache"))

    rng = random.Random(6)
    killed: Counter[str] = Counter()
    round_ = 0
    while killed.total() < KILLS:
        folder = tmp_path / str(round_)
        trials(folder, *job.logs)
        known: dict[str, int] = {}
        while True:
            run, begun = begin(folder, *job.args, cache=folder / "cache"), time.monotonic()
            try:
                wait = rng.uniform(0.05, 0.95) * wall if killed.total() < KILLS else None
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
        kept = set(entries(folder / "cache"))
        by_folder = int(name == "study")  # what was written where
        assert len(kept - remembered) == len(remembered - kept) == by_folder
        assert unfinished(folder / "report") == []
        assert [p.name for p in folder.iterdir() if p.name.startswith(".")] == []
        round_ += 1
    print(f"{name}: killed {killed.total()} times: " + ", ".join(f"{n} {w}" for w, n in killed.items()))
    assert killed["searching"] >= 5


@on_linux
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


NAMES = ("short_v0.7_r1", "short_v0.7_r2")
"""Of one speed, so that a search is short."""


def begin_in(
    environment: Mapping[str, str], folder: Path, *args: object, cache: Path | None
) -> subprocess.Popen[str]:
    with pytest.MonkeyPatch.context() as patch:
        for name, value in environment.items():
            patch.setenv(name, value)
        return begin(folder, "study", *args, cache=cache, first="" if SOAK else AMONG_FEW)


def study(folder: Path, *args: object, cache: Path | None = None, **environment: str) -> None:
    run = begin_in(environment, folder, *args, cache=cache)
    _, errors = run.communicate()
    assert run.returncode == 0, errors


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study with its search for a missing effect, nothing remembered, by two processes."""
    folder = tmp_path_factory.mktemp("same")
    logs = trials(folder, *NAMES)
    study(folder, *logs, "--out", "a/report", "--no-recordings", "--no-cache", "--jobs", "2")
    return folder


ELSEWHERE = {
    "LC_ALL": "de_DE.UTF-8", "LANG": "de_DE.UTF-8", "PYTHONHASHSEED": "7", "OPENBLAS_NUM_THREADS": "1",
    "TZ": "Asia/Tokyo",
}  # fmt: skip


def test_order_processes_language_memory_and_a_killed_search_change_no_byte(folder: Path) -> None:
    logs, cache = [f"logs/{name}.csv" for name in NAMES], folder / "cache"
    given = (*reversed(logs), "--no-recordings", "--out")
    killed = begin_in(ELSEWHERE, folder, *given, "b/report", "--jobs", "2", cache=cache)  # with workers
    while doing(folder, len(logs), searches=True) != "searching":
        assert killed.poll() is None, killed.communicate()
        time.sleep(0.02)
    time.sleep(random.Random(7).uniform(0, 2 if SOAK else 0.5))  # the search among few is short
    killed.kill()
    assert gone(killed.pid), "processes stay behind"
    killed.communicate()
    known = entries(cache)
    assert len(known) == len(logs), "killed after the search"
    for out, remembered in (("b/report", False), ("c/report", True)):
        study(folder, *given, out, "--jobs", "1", cache=cache, **ELSEWHERE)
        assert known.items() < entries(cache).items(), "what was finished is done again"
        assert results(folder / out) == results(folder / "a" / "report"), f"remembered: {remembered}"
    assert unfinished(folder / "b") == []
    origin = json.loads((folder / "a" / "report" / "report.json").read_bytes())["provenance"]
    assert [(i["file"], len(i["sha256"])) for i in origin["inputs"]] == [(log, 64) for log in logs]
    assert len(origin["code_sha256"]) == 64
    assert (bool(origin["version"]), origin["options"]) == (True, [])
    assert {"robot.wheels.radius_m", "soil.cohesion_Pa"} <= {p["key"] for p in origin["parameters"]}


@pytest.mark.usefixtures("estimates_anew", "fits_by_slip")
def test_verify_finds_the_same_again_and_says_what_was_changed(tmp_path: Path, studied: Path) -> None:
    for name in ("logs", "report"):
        shutil.copytree(studied / name, tmp_path / name)
    done = succeeded("study", "--verify", "report", cwd=tmp_path)
    assert done.out.strip() == "report/report.json: identical, recomputed from 2 logs"

    edited = tmp_path / "report" / "report.json"
    document = json.loads(edited.read_bytes())
    document["a_theta"]["value"] += 1e-12
    edited.write_text(json.dumps(document), encoding="utf-8")
    table = next((tmp_path / "report" / "tables").glob("*.csv"))
    table.write_text("0\n", encoding="utf-8")
    moved = tmp_path / "moved"
    shutil.copytree(tmp_path / "logs", moved)
    with (moved / f"{TWO[0]}.csv").open("a", encoding="utf-8") as log:
        log.write("\n")
    done = lab("study", "moved", "--verify", "report", "--json", cwd=tmp_path)
    assert done.code == 1
    found = json.loads(done.out)
    assert found["same"] is False
    told = "\n".join(found["differences"])
    assert "a_theta.value: " in told
    assert f"files.tables/{table.name}: " in told
    assert f"inputs.{TWO[0]}.csv: " in told
    assert "differs in" in done.err


def test_verify_runs_no_file_that_a_report_names(tmp_path: Path, studied: Path) -> None:
    """The report of a stranger names an effect file, which would do anything."""
    for name in ("logs", "report"):
        shutil.copytree(studied / name, tmp_path / name)
    trap = tmp_path / "trap.py"
    trap.write_text("from pathlib import Path\nPath('sprung').write_text('')\n" + EXAMPLE, encoding="utf-8")
    report = tmp_path / "report" / "report.json"
    document = json.loads(report.read_bytes())
    document["provenance"]["options"] = [{"name": "effects", "value": "trap.py"}]
    report.write_text(json.dumps(document), encoding="utf-8")
    done = lab("study", "--verify", "report", cwd=tmp_path)
    refused(done, 2, "report.json: was made with the effect file 'trap.py', which a verification would run")
    assert done.hint.endswith("add --effects trap.py")
    assert not (tmp_path / "sprung").exists()

    document["provenance"]["options"] = []
    report.write_text(json.dumps(document), encoding="utf-8")
    done = lab("study", "--verify", "report", "--effects", "trap.py", cwd=tmp_path)
    refused(done, 2, "was made without an effect file")


@pytest.mark.usefixtures("fits_by_slip")
def test_verify_takes_the_effects_that_it_is_given(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(EXAMPLE, encoding="utf-8")
    trials(tmp_path, *TWO[1:])
    succeeded(*STUDY[:4], "--no-recordings", "--no-discover", "--effects", "own.py", cwd=tmp_path)
    (tmp_path / "read").mkdir()
    shutil.move(tmp_path / "own.py", tmp_path / "read" / "own.py")
    done = succeeded("study", "--verify", "report", "--effects", "read/own.py", cwd=tmp_path)
    assert done.out.strip() == "report/report.json: identical, recomputed from 1 log"


def test_verify_refuses_what_is_no_report(tmp_path: Path) -> None:
    refused(lab("study", "--verify", "report.json", cwd=tmp_path), 3, "report.json: cannot be read: does not")
    other = "expected schema"
    for text, said in (("{", "not JSON"), ("[]", other), ('{"schema": "granite-lab/report/1"}', other)):
        (tmp_path / "report.json").write_text(text, encoding="utf-8")
        refused(lab("study", "--verify", "report.json", cwd=tmp_path), 3, f"report.json: {said}")


def test_two_runs_do_not_write_into_one_folder(tmp_path: Path) -> None:
    with (
        locked(tmp_path / "report"),
        pytest.raises(LabError, match="another run"),
        locked(tmp_path / "report"),
    ):
        pass
    assert not (tmp_path / "report").exists()
