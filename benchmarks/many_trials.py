"""Cost per trial of a study of 12, 120 and 1,200 trials, in processor time and memory.

    python -m benchmarks.many_trials [--counts 12,120] [--jobs 2] [--out PAGE]

The trials are the twelve of data/samples, copied under further names: each copy is read, estimated,
fitted and compared anew. Processor time counts all processes; each count runs in processes of its own.
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
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

from benchmarks.command_line import parser_of
from granite_lab.chain import over_trials
from granite_lab.options import Options
from granite_lab.reporting import write_report
from granite_lab.running import Cache, Execution

SAMPLES = Path(__file__).parent.parent / "data" / "samples"

PAGE = """# Many trials

The analysis time per trial does not depend on the number of trials: {verdict}. Each further trial takes
{growth:.2f} MB of memory.

| trials | start [s] | analysis [s] | over {first} | report [s] | again [s] | worker [MB] | main [MB] |
|---|---|---|---|---|---|---|---|
{rows}

* **start**: start of the processes, measured with {jobs} trials and subtracted from the analysis.
* **analysis**, **report**, **again**: processor time per trial, of all processes. *Again* is a second run
  with cached results.
* **over {first}**: analysis time over that of {first} trials.
* **worker**, **main**: largest memory of a worker and of the command.

Method: {machine}, Python {python}, {jobs} processes;
`python -m benchmarks.many_trials --counts {counts} --out docs/bench-many.md` (`make bench-many`).
"""

ALLOWED = 0.2
"""By how much the analysis of a trial may cost more or less than among the fewest."""


@dataclass(frozen=True)
class Cost:
    """What a study of so many trials took: processor time [s], memory [MB]."""

    trials: int
    start: float
    analysis: float
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


def measure(folder: Path, jobs: int) -> Cost:
    """Run the study of a folder in this process and its workers."""
    logs = sorted((folder / "logs").glob("*.csv"))
    all_ = Execution(jobs, cache=Cache(folder / "cache"))
    marks = [processor()]
    over_trials(logs[:jobs], Options(), execution=Execution(jobs, cache=Cache(folder / "few")))
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
    each = (whole - first) / (n - jobs)
    return Cost(n, first - jobs * each, each, report / n, last / n, worker, main)


def cost_of(count: int, jobs: int) -> Cost:
    """Measure in a process of its own, so that memory and start-up belong to this count alone."""
    with tempfile.TemporaryDirectory(prefix="granite-lab-many-") as temporary:
        folder = Path(temporary)
        (folder / "logs").mkdir()
        samples = sorted(SAMPLES.glob("*.csv"))
        for i in range(count):
            sample = samples[i % len(samples)]
            shutil.copy(sample, folder / "logs" / f"{sample.stem}_{i // len(samples):03d}.csv")
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.many_trials", "--folder", str(folder), "--jobs", str(jobs)],
            stdout=subprocess.PIPE, text=True, check=True,
        )  # fmt: skip
    return Cost(**json.loads(done.stdout))


def row(cost: Cost, first: Cost) -> str:
    """Return one row of the table."""
    analysis = f"{cost.start:.1f} | {cost.analysis:.2f} | {cost.analysis / first.analysis:.2f}"
    memory = f"{cost.worker:.0f} | {cost.main:.0f}"
    return f"| {cost.trials} | {analysis} | {cost.report:.2f} | {cost.again:.3f} | {memory} |"


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--counts", default="12,120", help="numbers of trials")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--out", type=Path, help="page to write")
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.folder:
        print(json.dumps(asdict(measure(given.folder, given.jobs))))
        return
    costs = []
    for count in map(int, given.counts.split(",")):
        costs.append(cost_of(count, given.jobs))
        print(row(costs[-1], costs[0]), flush=True)
    apart = [abs(c.analysis / costs[0].analysis - 1) for c in costs]
    constant = max(apart) <= ALLOWED
    page = PAGE.format(
        counts=given.counts,
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
