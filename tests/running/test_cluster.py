"""The same results from a Dask cluster: a real scheduler and two workers over loopback, one of which dies."""

import contextlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from granite_lab.errors import LabError
from granite_lab.inference.pool import SIGNALS
from granite_lab.running import cache
from granite_lab.running.each import on_worker
from tests.corpus.cli import SAMPLES, lab, refused, succeeded
from tests.running.processes import BY_SLIP, begin, fit_by_slip, results, trials
from tests.soak import SOAK

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("one_picture")]

NAMES = ("short_v0.5_r1", "short_v0.7_r1", "short_v0.7_r2")
SEARCH = "--discover" if SOAK else "--no-discover"
FIRST = "" if SOAK else BY_SLIP
"""What a worker runs first; the whole fit takes twice as long."""


class Cluster(NamedTuple):
    address: str
    workers: list[subprocess.Popen[bytes]]


def start(folder: Path, module: str, *args: object, first: str = "") -> subprocess.Popen[bytes]:
    code = f"{first}\nfrom distributed.cli.{module} import main\nmain()"
    command = [sys.executable, "-W", "ignore", "-c", code, *map(str, args)]
    null = subprocess.DEVNULL
    return subprocess.Popen(command, cwd=folder, stdin=null, stdout=null, stderr=null)


def begin_worker(folder: Path, scheduler: Path) -> subprocess.Popen[bytes]:
    return start(
        folder, "dask_worker", "--scheduler-file", scheduler, "--nthreads", 1, "--no-nanny",
        "--no-dashboard", "--local-directory", folder, "--memory-limit", "2GB", "--host", "127.0.0.1",
        first=FIRST,
    )  # fmt: skip


def address_in(file: Path) -> str:
    """Return the address that the scheduler writes into a file: the file is there before its content."""
    end = time.monotonic() + 60
    while True:
        with contextlib.suppress(FileNotFoundError, json.JSONDecodeError):
            return str(json.loads(file.read_text(encoding="utf-8"))["address"])
        assert time.monotonic() < end
        time.sleep(0.1)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    folder = tmp_path_factory.mktemp("cluster")
    file = folder / "scheduler.json"
    scheduler = start(
        folder, "dask_scheduler", "--host", "127.0.0.1", "--port", 0, "--no-dashboard",
        "--scheduler-file", file,
    )  # fmt: skip
    workers = [begin_worker(folder, file) for _ in range(2)]
    try:
        yield Cluster(address_in(file), workers)
    finally:
        for process in (*workers, scheduler):
            process.kill()
            process.wait()


def test_nobody_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("granite_lab.running.each.PATIENCE", 0.5)
    done = lab("fit-k92", next(SAMPLES.glob("*.csv")), "--scheduler", "tcp://127.0.0.1:9", "--no-cache")
    refused(done, 2, "scheduler 'tcp://127.0.0.1:9' cannot be reached")


def test_simulations_of_a_search_are_the_same_on_a_cluster(cluster: Cluster, tmp_path: Path) -> None:
    """In a process of its own: dask.distributed warns of things that are not ours."""
    script = """
import sys
import numpy as np
from granite_lab.inference.pool import SimulationPool, Task, Scenario
from granite_lab.effects import library
from granite_lab.parameters import load_robot, load_soil, load_variants
from granite_lab.running import Execution
from granite_lab.running.simulations import on_cluster
scenario = Scenario(load_robot(), load_soil(), load_variants()[2:], library())
effect = library()["tyre_windup"]
sand = (0.0,) * 7
tasks = [Task(i, (0.01 * k, *sand[1:])) for i in range(2) for k in range(3)]
tasks.append(Task(0, sand, ((effect.id, tuple(p.prior_high for p in effect.parameters)),)))
tasks.append(Task(0, (9.0, *sand[1:])))
here = [scenario.respond(t) for t in tasks]
with (
    on_cluster(Execution(scheduler=sys.argv[1]), None) as respond,
    SimulationPool(scenario, respond=respond) as pool,
):
    there = pool.run(tasks)
np.savez("out.npz", **{f"{w}{i}": np.zeros(0) if x is None else x
                       for w, of in (("here", here), ("there", there)) for i, x in enumerate(of)})
"""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", script, cluster.address],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    with np.load(tmp_path / "out.npz") as found:
        for i in range(8):
            assert found[f"here{i}"].tobytes() == found[f"there{i}"].tobytes()
        assert found["here6"].shape[0] == len(SIGNALS)


def test_the_same_report_although_a_worker_dies_and_a_log_is_broken(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if FIRST:
        fit_by_slip(tmp_path / "by-slip", monkeypatch)
    good = (tmp_path / trials(tmp_path, *NAMES)[0]).read_text(encoding="utf-8")
    broken = tmp_path / "logs" / "broken.csv"
    broken.write_text(good.replace("t_s,", "when,", 1), encoding="utf-8")
    here = ("study", "logs", "--out", "here/r", "--no-recordings", "--no-cache", SEARCH)
    succeeded(*here, cwd=tmp_path)

    cache = tmp_path / "cache"
    run = begin(
        tmp_path, "study", "logs", "--out", "there/r", "--no-recordings", "--scheduler", cluster.address,
        SEARCH, cache=cache,
    )  # fmt: skip
    while not list(
        cache.glob("results/*.result")
    ):  # until the first trial is back: the others are in mid-run
        assert run.poll() is None, run.communicate()
        time.sleep(0.02)
    cluster.workers[0].kill()
    assert run.poll() is None
    _, errors = run.communicate(timeout=600)
    assert run.returncode == 0, errors
    assert len(list(cache.glob("results/*.result"))) >= len(NAMES)
    assert "broken: left out" in errors
    assert results(tmp_path / "there" / "r") == results(tmp_path / "here" / "r")


def test_a_worker_that_cannot_see_the_folder_says_so(tmp_path: Path) -> None:
    before = Path.cwd()
    try:
        lost = on_worker(len, "x.csv", str(tmp_path / "nowhere"), cache.code())
        assert isinstance(lost, LabError)
        assert "cannot see the folder" in lost.message
        other = on_worker(len, "x.csv", str(tmp_path), "other code")
        assert isinstance(other, LabError)
        assert "another version" in other.message
        assert on_worker(len, "x.csv", str(tmp_path), cache.code()) == 5
    finally:
        os.chdir(before)
