"""What happens in one process of a pool stays there."""

from __future__ import annotations

import multiprocessing
import os
import sys
from pathlib import Path

import pytest

from granite_lab.errors import InputError, LabError
from granite_lab.estimate import Estimate
from granite_lab.inference.bench import Bench, Task, World
from granite_lab.parameters import load_robot, load_soil, load_variants
from granite_lab.processes import SHORT_OF_MEMORY
from granite_lab.running import Cache, Execution, Options, each_trial
from tests.running.work import measure


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


def test_a_process_that_dies_fails_only_the_trial_that_kills_it(tmp_path: Path) -> None:
    logs = [tmp_path / f"{i}.csv" for i in range(5)]
    for i, log in enumerate(logs):
        log.write_text("die" if i == 2 else "x" * i, encoding="utf-8")
    finished: list[Path] = []
    found = each_trial(measure, logs, Options(), execution=Execution(2), done=finished.append)
    assert isinstance(found[2], LabError)
    assert "2.csv: the process that worked on it died" in found[2].message
    values = [f.value for f in found if isinstance(f, Estimate)]
    assert values == [0, 1, 3, 4]
    assert sorted(finished) == logs
    assert multiprocessing.active_children() == []


class Deadly(World):
    """A world in which no simulation is survived."""

    def respond(self, task: Task) -> None:  # noqa: ARG002, as the real one
        os._exit(9)


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a search runs in one process")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_search_whose_processes_die_says_so() -> None:
    world = Deadly(load_robot(), load_soil(), load_variants(), {})
    with (
        Bench(world, 2) as bench,
        pytest.raises(LabError, match="that simulated has died") as caught,
    ):
        bench.run([Task(0, (0.01 * k,) * 7) for k in range(4)])
    assert caught.type is LabError  # a fit takes an EstimateError for a start that fails, and goes on
    assert caught.value.hint == SHORT_OF_MEMORY
    assert multiprocessing.active_children() == []


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a search runs in one process")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_what_runs_side_by_side_gives_what_one_process_gives_and_counts_its_simulations() -> None:
    world = World(load_robot(), load_soil(), load_variants(), {})
    last = []
    with Bench(world) as alone, Bench(world, 2) as bench:
        for one in (alone, bench):

            def velocity(k: int, one: Bench = one) -> float:
                (response,) = one.run([Task(0, (0.01 * k,) * 7)])
                return float(response[-1].max()) if response is not None else 0.0

            last.append(one.side_by_side(velocity, 3))
        assert last[0] == last[1]
        assert len(set(last[0])) == 3
        assert alone.runs == bench.runs == 3
        assert bench.run([Task(0, (0.05,) * 7)])[0] is not None  # it still simulates for itself
    assert multiprocessing.active_children() == []
