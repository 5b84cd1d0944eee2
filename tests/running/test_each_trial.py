"""Work on each of many trials: what was done is remembered, and what fails leaves the others alone."""

import multiprocessing
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from granite_lab.errors import InputError, LabError
from granite_lab.estimate import Estimate
from granite_lab.inference.pool import Scenario, SimulationPool, Task
from granite_lab.options import Options
from granite_lab.parameters import load_robot, load_soil, load_variants
from granite_lab.processes import SHORT_OF_MEMORY
from granite_lab.running import Cache, Execution, cache, each_trial
from tests.corpus.cli import GRANITE
from tests.running.work import measure, worked


@pytest.fixture
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    worked.clear()
    monkeypatch.chdir(tmp_path)
    for i in range(4):
        Path(f"{i}.csv").write_text("x" * (i + 1), encoding="utf-8")
    return [tmp_path / f"{i}.csv" for i in range(4)]


@pytest.fixture
def how(tmp_path: Path) -> Execution:
    return Execution(1, cache=Cache(tmp_path / "cache"))


def run(logs: list[Path], how: Execution, options: Options = Options()) -> list[Estimate | LabError]:  # noqa: B008
    worked.clear()
    return each_trial(measure, logs, options, execution=how)


def test_nothing_is_done_twice_but_a_changed_log(logs: list[Path], how: Execution) -> None:
    first = run(logs, how)
    assert worked == ["0.csv", "1.csv", "2.csv", "3.csv"]
    assert run(logs, how) == first
    assert worked == []
    logs[2].write_text("other", encoding="utf-8")
    found = run(logs, how)
    assert worked == ["2.csv"]
    assert found[2] == Estimate(5.0, load_robot().chassis.body_mass)
    logs[2].write_text("xxx", encoding="utf-8")  # as it was: remembered, too
    run(logs, how)
    assert worked == []


@pytest.mark.skipif(os.name == "nt", reason="Windows does not pass a process on to another parent")
def test_a_worker_whose_parent_has_ended_before_it_begins_ends_too() -> None:
    code = "import time; from granite_lab.processes import init_worker; init_worker(0); time.sleep(60)"
    done = subprocess.run([sys.executable, "-c", code], timeout=40, check=False)
    assert done.returncode == 1


@pytest.mark.parametrize("by", ["option", "log"])
def test_an_edited_robot_counts_whoever_names_it(logs: list[Path], how: Execution, by: str) -> None:
    mine, old = Path("mine.toml"), f"body_mass_kg = {load_robot().chassis.body_mass:g}"
    mine.write_text(GRANITE.replace(old, "body_mass_kg = 5.0"), encoding="utf-8")
    options = Options(robot="mine.toml") if by == "option" else Options()
    if by == "log":
        logs[1].write_text("robot=mine.toml", encoding="utf-8")
    assert run(logs[1:2], how, options)[0].std == 5.0
    assert run(logs[1:2], how, options)[0].std == 5.0
    assert worked == []
    mine.write_text(GRANITE.replace(old, "body_mass_kg = 6.0"), encoding="utf-8")
    assert run(logs[1:2], how, options)[0].std == 6.0
    assert worked == ["1.csv"]


def test_a_new_sidecar_an_option_and_new_code_count(
    logs: list[Path], how: Execution, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(logs, how)
    Path("0.toml").write_text("", encoding="utf-8")
    run(logs, how)
    assert worked == ["0.csv"]
    run(logs, how, Options(rows="run = 1"))
    assert len(worked) == 4
    monkeypatch.setattr(cache, "code", lambda **_: "another version")
    run(logs, how)
    assert len(worked) == 4


def test_a_damaged_entry_is_made_again(logs: list[Path], how: Execution) -> None:
    first = run(logs, how)
    entries = sorted(how.cache.folder.iterdir())
    data = entries[0].read_bytes()
    entries[0].write_bytes(data[: len(data) // 2])
    entries[1].write_bytes(data.replace(b"value", b"valve"))
    entries[2].write_bytes(b"")
    entries[3].write_bytes(data[:120] + bytes([data[120] ^ 1]) + data[121:])
    assert run(logs, how) == first
    assert len(worked) >= 3


def test_a_cache_that_cannot_be_written_costs_nothing_but_time(logs: list[Path], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    how = Execution(1, cache=Cache(tmp_path / "file" / "cache"))
    assert len(run(logs, how)) == 4
    assert "cannot be written" in how.cache.trouble


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such modes")
def test_results_that_others_could_have_written_are_made_again(logs: list[Path], how: Execution) -> None:
    first = run(logs, how)
    how.cache.folder.chmod(0o777)
    assert run(logs, how) == first
    assert len(worked) == len(logs)
    (line,) = how.doubts()
    assert "can be written by others" in line


def test_trials_run_side_by_side_beside_a_thread_of_the_terminal(
    logs: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A process of several threads cannot fork safely: another kind of pool does the work."""
    monkeypatch.setattr(os, "cpu_count", lambda: 2)  # as many processes where no number is asked
    shown = threading.Event()
    thread = threading.Thread(target=shown.wait)
    thread.start()
    try:
        found = each_trial(measure, logs, Options(), execution=Execution())
    finally:
        shown.set()
        thread.join()
    assert worked == []  # by this process
    assert found == each_trial(measure, logs, Options(), execution=Execution(1))


@pytest.mark.parametrize("jobs", [1, 3])
def test_errors_and_faults_of_one_trial_leave_the_others_alone_each_time(tmp_path: Path, jobs: int) -> None:
    texts = ["a", "wrong", "bb", "fault", "ccc"]
    logs = [tmp_path / f"{i}.csv" for i in range(len(texts))]
    for log, text in zip(logs, texts, strict=True):
        log.write_text(text, encoding="utf-8")
    for _ in range(2):
        how = Execution(jobs, cache=Cache(tmp_path / "cache"))
        found = each_trial(measure, logs, Options(), execution=how)
        lengths = [f.value for f in found if isinstance(f, Estimate)]
        assert lengths == [1, 2, 3]
        assert isinstance(found[1], InputError)
        assert (found[1].message, found[1].hint) == (f"{logs[1]}: is wrong", "mend it")
        assert isinstance(found[3], LabError)
        assert "ZeroDivisionError in work.py" in found[3].message
        assert "report it" in found[3].hint


def test_a_process_that_dies_fails_only_the_trial_that_kills_it(logs: list[Path]) -> None:
    logs[2].write_text("die", encoding="utf-8")
    finished: list[Path] = []
    found = each_trial(measure, logs, Options(), execution=Execution(2), done=finished.append)
    assert isinstance(found[2], LabError)
    assert "2.csv: the process that worked on it died" in found[2].message
    values = [f.value for f in found if isinstance(f, Estimate)]
    assert values == [1, 2, 4]
    assert sorted(finished) == logs
    assert multiprocessing.active_children() == []


class Deadly(Scenario):
    """A world in which no simulation is survived."""

    def respond(self, task: Task) -> None:  # noqa: ARG002, as the real one
        os._exit(9)


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a search runs in one process")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_search_whose_processes_die_says_so() -> None:
    scenario = Deadly(load_robot(), load_soil(), load_variants(), {})
    with (
        SimulationPool(scenario, 2) as pool,
        pytest.raises(LabError, match="that simulated has died") as caught,
    ):
        pool.run([Task(0, (0.01 * k,) * 7) for k in range(4)])
    assert caught.type is LabError  # a fit takes an EstimateError for a start that fails, and goes on
    assert caught.value.hint == SHORT_OF_MEMORY
    assert multiprocessing.active_children() == []


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a search runs in one process")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_what_runs_side_by_side_gives_what_one_process_gives_and_counts_its_simulations() -> None:
    scenario = Scenario(load_robot(), load_soil(), load_variants(), {})
    last = []
    with SimulationPool(scenario) as alone, SimulationPool(scenario, 2) as pool:
        for one in (alone, pool):

            def velocity(k: int, one: SimulationPool = one) -> float:
                (response,) = one.run([Task(0, (0.01 * k,) * 7)])
                return float(response[-1].max()) if response is not None else 0.0

            last.append(one.parallel(velocity, range(3)))
        assert last[0] == last[1]
        assert len(set(last[0])) == 3
        assert alone.runs == pool.runs == 3
        assert min(alone.seconds, pool.seconds) > 0.0
        assert pool.run([Task(0, (0.05,) * 7)])[0] is not None  # it still simulates for itself
    assert multiprocessing.active_children() == []
