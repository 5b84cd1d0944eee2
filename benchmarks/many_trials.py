"""Cost per trial of a study of 12, 120 and 1,200 trials, in processor time and memory.

    python -m benchmarks.many_trials [--counts 12,120] [--remembered 1200] [--jobs 2] [--out PAGE]

The trials are the twelve of data/samples, copied under further names: each copy is read, estimated,
fitted and compared anew. Processor time counts all processes; each count runs in processes of its own.
Of a count given as `--remembered` only the first twelve are analysed; the results of the others are put into
the cache under their names, so that memory and the cost of the report can be had without half an hour of
analysis.
"""

from __future__ import annotations

import argparse
import json
import platform
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import cast

from benchmarks.command_line import parser_of
from granite_lab.chain import analyse, over_trials
from granite_lab.comparison.compare import Comparison
from granite_lab.options import Options
from granite_lab.reporting import write_report
from granite_lab.running import Cache, Execution
from granite_lab.running.cache import trial_key
from granite_lab.running.codec import encode

FIRST = "_000"
"""End of the name of the first copy of a sample."""

SAMPLES = Path(__file__).parent.parent / "data" / "samples"

PAGE = """# Many trials

The analysis time per trial does not depend on the number of trials: {verdict}. Each further trial takes
{growth:.2f} MB of memory.

| trials | start [s] | analysis [s] | over {first} | report [s] | again [s] | worker [MB] | main [MB] |
|---|---|---|---|---|---|---|---|
{rows}

* **start**: start of the processes, measured with {jobs} trials and subtracted from the analysis.
* **analysis**, **report**, **again**: processor time per trial, of all processes. *Again* is a second run
  with cached results. – means that all results were cached before.
* **over {first}**: analysis time over that of {first} trials.
* **worker**, **main**: largest memory of a worker and of the command.

Method: {machine}, Python {python}, {jobs} processes;
`python -m benchmarks.many_trials --counts {counts}{option} --out docs/bench-many.md` (`make bench-many`).
"""

ALLOWED = 0.2
"""By how much the analysis of a trial may cost more or less than among the fewest."""


@dataclass(frozen=True)
class Cost:
    """What a study of so many trials took: processor time [s], memory [MB]; None where none was analysed."""

    trials: int
    start: float | None
    analysis: float | None
    report: float
    again: float
    worker: float
    main: float


def processor() -> float:
    """Return the processor time of this process and of those it has waited for [s]."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


def megabytes(who: int) -> float:
    """Return the largest memory so far [MB]."""
    return resource.getrusage(who).ru_maxrss / 1024


def renamed(result: Comparison, name: str) -> Comparison:
    """Return a result as that of a trial of another name."""
    trial, motion = replace(result.trial, name=name), replace(result.motion, trial=name)
    return replace(result, trial=trial, motion=motion, fit=replace(result.fit, trial=name))


def remember(logs: Sequence[Path], cache: Cache, jobs: int) -> None:
    """Analyse one log of each sample, and remember the results of its copies, which differ in their names."""
    firsts = [log for log in logs if log.stem.endswith(FIRST)]
    over_trials(firsts, Options(), execution=Execution(jobs, cache=cache))
    for first in firsts:
        result = cast(Comparison, cache.get(trial_key(analyse.__qualname__, first, Options())))
        for log in (log for log in logs if log.stem[: -len(FIRST)] == first.stem[: -len(FIRST)]):
            copy = encode(((), renamed(result, log.stem)))
            cache.put(trial_key(analyse.__qualname__, log, Options()), copy)


def measure(folder: Path, jobs: int, *, remembered: bool) -> Cost:
    """Run the study of a folder in this process and its workers."""
    logs = sorted((folder / "logs").glob("*.csv"))
    few = Execution(jobs, cache=Cache(folder / "few"))
    all_ = Execution(jobs, cache=Cache(folder / "cache"))
    marks = [processor()]
    if remembered:
        remember(logs, Cache(folder / "cache"), jobs)
    else:
        over_trials(logs[:jobs], Options(), execution=few)
    marks.append(processor())
    result = over_trials(logs, Options(), execution=all_)
    marks.append(processor())
    write_report(result, folder / "report")
    marks.append(processor())
    worker, main = megabytes(resource.RUSAGE_CHILDREN), megabytes(resource.RUSAGE_SELF)
    before = processor()
    again = over_trials(logs, Options(), execution=all_)
    last = processor() - before
    assert len(again.trials) == len(result.trials) == len(logs)
    first, whole, report = (b - a for a, b in pairwise(marks))
    n = len(logs)
    if remembered:
        return Cost(n, None, None, report / n, last / n, worker, main)
    each = (whole - first) / (n - jobs)
    return Cost(n, first - jobs * each, each, report / n, last / n, worker, main)


def cost_of(count: int, jobs: int, *, remembered: bool = False) -> Cost:
    """Measure in a process of its own, so that memory and start-up belong to this count alone."""
    with tempfile.TemporaryDirectory(prefix="granite-lab-many-") as temporary:
        folder = Path(temporary)
        (folder / "logs").mkdir()
        samples = sorted(SAMPLES.glob("*.csv"))
        for i in range(count):
            sample = samples[i % len(samples)]
            shutil.copy(sample, folder / "logs" / f"{sample.stem}_{i // len(samples):03d}.csv")
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.many_trials", "--folder", str(folder), "--jobs", str(jobs),
             *(["--remembered", str(count)] if remembered else [])],
            stdout=subprocess.PIPE, text=True, check=True,
        )  # fmt: skip
    return Cost(**json.loads(done.stdout))


def row(cost: Cost, first: Cost) -> str:
    """Return one row of the table."""
    analysis = "– | – | –"
    if cost.analysis is not None and first.analysis is not None:
        analysis = f"{cost.start:.1f} | {cost.analysis:.2f} | {cost.analysis / first.analysis:.2f}"
    memory = f"{cost.worker:.0f} | {cost.main:.0f}"
    return f"| {cost.trials} | {analysis} | {cost.report:.2f} | {cost.again:.3f} | {memory} |"


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--counts", default="12,120", help="numbers of trials")
    parser.add_argument("--remembered", type=int, help="a further number, whose results are remembered")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--out", type=Path, help="page to write")
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.folder:
        print(json.dumps(asdict(measure(given.folder, given.jobs, remembered=bool(given.remembered)))))
        return
    costs = []
    for count in map(int, given.counts.split(",")):
        costs.append(cost_of(count, given.jobs))
        print(row(costs[-1], costs[0]), flush=True)
    apart = [abs(c.analysis / costs[0].analysis - 1) for c in costs if c.analysis and costs[0].analysis]
    if given.remembered:
        costs.append(cost_of(given.remembered, given.jobs, remembered=True))
        print(row(costs[-1], costs[0]), flush=True)
    constant = max(apart) <= ALLOWED
    page = PAGE.format(
        counts=given.counts,
        option=f" --remembered {given.remembered}" if given.remembered else "",
        machine=platform.machine(),
        python=platform.python_version(),
        jobs=given.jobs,
        first=costs[0].trials,
        rows="\n".join(row(c, costs[0]) for c in costs),
        growth=(costs[-1].main - costs[0].main) / max(1, costs[-1].trials - costs[0].trials),
        verdict=f"the largest difference is {100 * max(apart):.0f} %"
        + ("" if constant else f", more than the {100 * ALLOWED:.0f} % that are allowed"),
    )
    if given.out:
        given.out.write_text(page, encoding="utf-8")
    sys.exit(not constant)


if __name__ == "__main__":
    main()
