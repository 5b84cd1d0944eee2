"""Does `discover` find what it was never told? A frozen range of hidden sets, judged once by one code.

Each seed is a laboratory of its own (`hide --lab wild`). Its first set hides nothing: it is a null, and
states the smallest sizes that can be seen there. The other sets of the seed hide effects of twice and
five times those sizes, pairs, and influences outside the library. Some seeds are of the old laboratory.
A run that was interrupted goes on where it ended; results of other code are refused.

``python -m benchmarks.blind [--minutes 60] [--jobs 2] [--afresh] [--out docs/blind.md]``
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind_code import ROOT
from benchmarks.blind_page import DIAGRAM, every_stated, page
from benchmarks.command_line import parser_of_sets
from benchmarks.judging import Work, as_judged, judged, searched, short
from benchmarks.lines import Line, add, continued, current, show
from benchmarks.reliability import write_diagram
from granite_lab.api.hidden import hide
from granite_lab.effects import library
from granite_lab.errors import EstimateError, LabError
from granite_lab.hidden.catalogue import LIBRARY, OUTSIDE, influence
from granite_lab.hidden.influence import Size
from granite_lab.hidden.sealed import open_answer
from granite_lab.hidden.spec import Spec, chosen

RESULTS = ROOT / "benchmarks" / "results" / "blind.jsonl"

FIRST_SEED, LABS, OLD = 475_000, 104, 5
"""The frozen range: seeds of the wild laboratories, and of the old one."""

LIMIT = 600
"""Processor time that a set may take [s]; how busy the machine is does not matter."""

TYPICAL = 40.0
"""Expected time of a set before one was made [s]."""

SENSIBLE = 3.0
"""An effect is at most this many times as large as its library entry expects: a robot, not a wreck."""

SHRINK = 0.7
"""Step by which an effect is made smaller under which the robot would dig itself in."""


@dataclass(frozen=True)
class Task:
    """One set.

    Attributes:
        kind: "null", "single", "pair", "outside", or "old" for a single effect in the old laboratory.
        effect: ids joined by ``+``, or "none".
        strength: multiple of the smallest size that can be seen in this laboratory; for what is outside the
            library, of the size that `hide` draws.
        seed, lab: of the set.
    """

    kind: str
    effect: str
    strength: float
    seed: int
    lab: str = "wild"

    @property
    def key(self) -> str:
        """The set in one word."""
        return f"{self.seed}/{self.lab}/{self.kind}/{self.effect}/{self.strength:g}"

    @property
    def reference(self) -> str:
        """Key of the set without an effect in the same laboratory."""
        return Task("null", "none", 0.0, self.seed, self.lab).key


def schedule() -> list[Task]:
    """Return all sets: each effect four times at either strength, outside influences four times.

    The null of a laboratory comes first: without it none of its other sets can be made. Laboratories follow
    one another, so that a run that ends early has judged sets of every kind.
    """
    inside, outside, tasks = sorted(LIBRARY), sorted(OUTSIDE), []
    for k in range(LABS):
        seed, i = FIRST_SEED + k, 7 * k  # 7 has no factor in common with 26 or 9: no order of the alphabet
        tasks.append(Task("null", "none", 0.0, seed))
        tasks.append(Task("single", inside[i % len(inside)], 2.0, seed))
        tasks.append(Task("single", inside[(i + 12 + k // len(inside)) % len(inside)], 5.0, seed))
        if k % 3 == 0:
            beside = f"+{inside[(i + 5) % len(inside)]}" if k % 4 == 0 else ""
            tasks.append(Task("outside", outside[7 * (k // 3) % 9] + beside, 2.0, seed))
        elif k % 3 == 1:
            tasks.append(Task("pair", "+".join(chosen(Spec("pair", seed))), 5.0, seed))
    for k in range(OLD):
        seed = FIRST_SEED + 1000 + k
        tasks.append(Task("null", "none", 0.0, seed, "bench"))
        tasks += [Task("old", name, 5.0, seed, "bench") for name in inside[k::OLD]]
    return tasks


def sizes_of(task: Task, detectable: Mapping[str, float | None]) -> tuple[dict[str, float], dict[str, float]]:
    """Return the sizes to hide, by ``id.name``, and the strength that each effect reaches.

    Of an effect with two amounts either one is hidden, or both at strength/√2: with signatures at right
    angles that is as easily seen. The strength is lower than asked where a size would leave what is
    sensible.

    Args:
        task: which set.
        detectable: smallest sizes that can be seen, by ``id.parameter`` of the library.

    Raises:
        ValueError: the design shows no size of an effect.
    """
    sizes: dict[str, float] = {}
    reached: dict[str, float] = {}
    for place, name in enumerate(n for n in task.effect.split("+") if n in LIBRARY):
        rng = np.random.default_rng([task.seed, 77, place])
        amounts = [size for size in influence(name).declared if size.kind != "shape"]
        needed = {size.name: detectable.get(f"{name}.{counterpart(size)}") for size in amounts}
        seen = [size for size in amounts if needed[size.name]]
        if not seen:
            raise ValueError(f"the design shows no size of '{name}'")
        both = len(seen) == 1 or seen[0].kind == "amplitude"
        used = seen if both else [seen, seen[:1], seen[1:]][int(rng.integers(3))]
        factor, own = 1.0, dict.fromkeys((size.name for size in amounts), 0.0)
        for size in used:
            sign = float(rng.choice((-1.0, 1.0))) if size.signed else 1.0
            value = sign * task.strength * float(needed[size.name] or 0.0) / float(np.sqrt(len(used)))
            own[size.name] = value
            factor = min(factor, limit(name, size, value) / abs(value))
        sizes |= {f"{name}.{key}": factor * value for key, value in own.items()}
        reached[name] = factor * task.strength
    return sizes, reached


def counterpart(size: Size) -> str:
    """Return the parameter of the library's effect that a hidden size corresponds to."""
    return size.name.replace("amplitude_", "cos_") if size.kind == "amplitude" else size.name


def limit(name: str, size: Size, value: float) -> float:
    """Return the largest sensible magnitude in the direction of a value."""
    bound = abs(size.most if value > 0 else size.least)
    own = next(p for p in library()[name].parameters if p.name == counterpart(size))
    expected = SENSIBLE * max(abs(own.prior_low), own.prior_high)
    return float(min(bound, 0.8 * (own.high if value > 0 else -own.low), expected))


def made(task: Task, detectable: Mapping[str, float | None], folder: Path) -> dict[str, float]:
    """Write the set of a task; return the strength that each effect reached.

    Raises:
        ValueError: the design shows no size of the effect.
        EstimateError: the robot digs itself in whatever the size.
    """
    sizes, reached = sizes_of(task, detectable)
    strength = task.strength or 1.0
    for attempt in range(8):
        factor = SHRINK**attempt
        smaller = {key: factor * value for key, value in sizes.items()}
        try:
            hide(
                task.effect, folder, seed=task.seed, lab=task.lab, sizes=smaller,
                strength=factor * strength if task.kind == "outside" else 1.0,
            )  # fmt: skip
        except EstimateError:
            if task.effect == "none" or attempt == 7:
                raise
            continue
        return {name: round(factor * x, 2) for name, x in reached.items()}
    raise AssertionError


def one(task: Task, detectable: Mapping[str, float | None]) -> Line:
    """Make, search and judge one set."""
    line: Line = asdict(task) | {"key": task.key}
    if task.kind not in ("null", "outside") and not detectable:
        return judged(line | {"status": "crashed", "error": "the set without an effect has no sizes"}, {})
    with tempfile.TemporaryDirectory(prefix="granite-blind-") as name:
        folder, start = Path(name), time.monotonic()
        try:
            reached = made(task, detectable, folder)
        except (LabError, ValueError) as error:
            return line | {"status": "not made", "error": str(error)}
        answer = open_answer(folder)
        line |= {
            "reached": reached,
            "making": round(time.monotonic() - start, 1),
            "lab_drawn": told(answer["lab"]),
        }
        line |= judged(searched(sorted(folder.glob("*.csv"))), answer)
    line["truth"] = {
        e["id"]: {name: short(p["value"]) for name, p in e["parameters"].items()} for e in answer["effects"]
    }
    if task.kind != "null":
        line.pop("detectable", None)
    return line


def told(lab: Mapping[str, Any]) -> dict[str, object]:
    """Return what of a laboratory the page groups by."""
    if lab["name"] != "wild":
        return {}
    return {
        "repetitions": lab["repetitions"],
        "other robot": lab["robot"]["name"] == "robot.toml",
        "other sand": lab["soil"]["filed"]["name"] != "dry_sand",
        "IMU more than 4 ms late": lab["logger"]["late"] > 0.004,
        "gears that lock": lab["near_rest"]["holds_below"] > 0,
    }


class Workers:
    """Sets in processes of their own, which end with this one; `longest` is the time that a set takes [s]."""

    def __init__(self) -> None:
        self.running: set[subprocess.Popen[str]] = set()
        self.stopped = False
        self.longest = TYPICAL

    def run(self, task: Task, detectable: Mapping[str, float | None]) -> Line:
        """Run one set; whatever happens there becomes a line."""
        single = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        asked, begin = json.dumps({"task": asdict(task), "detectable": detectable}), time.monotonic()
        process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.blind", "--one", asked], cwd=ROOT, env=os.environ | single,
            text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip
        self.running.add(process)
        try:
            printed, said = process.communicate()
            line: Line = json.loads(printed)
        except ValueError:
            late = process.returncode == -signal.SIGXCPU
            error = f"more than {LIMIT} s of processor time" if late else said[-2000:]
            line = judged({"status": "crashed", "error": error}, {})
        finally:
            self.running.discard(process)
            self.longest = max(0.9 * self.longest, time.monotonic() - begin)
        if self.stopped:
            raise InterruptedError
        return asdict(task) | {"key": task.key} | line

    def stop(self) -> None:
        """End all that runs."""
        self.stopped = True
        for process in list(self.running):
            process.kill()


def ready(
    waiting: Sequence[Task], done: Mapping[str, Line]
) -> Iterator[tuple[Task, dict[str, float | None]]]:
    """Yield the sets that can be made now: the first of each laboratory, and those that have it."""
    for task in waiting:
        if task.kind == "null":
            yield task, {}
        elif task.reference in done:
            yield task, done[task.reference].get("detectable") or {}


def run(path: Path, lines: list[Line], minutes: float, jobs: int, version: dict[str, str]) -> None:
    """Make and judge sets until there are none left or the time is up."""
    workers, end = Workers(), time.monotonic() + 60 * minutes
    judged_before = {line["key"] for line in lines}
    waiting = [task for task in schedule() if task.key not in judged_before]

    def following() -> Work[Line] | None:
        done = {line["key"]: line for line in lines}
        found = next(ready(waiting, done), None) if time.monotonic() + workers.longest < end else None
        if found is None:
            return None
        waiting.remove(found[0])
        return workers.run, found

    pool = ThreadPoolExecutor(jobs)
    try:
        add(path, lines, as_judged(pool, following, jobs), version)
    except KeyboardInterrupt:
        print("interrupted; what is done is kept", file=sys.stderr)
    finally:
        workers.stop()
        pool.shutdown(wait=True, cancel_futures=True)


def main() -> None:
    """Continue the benchmark and write its page."""
    parser = parser_of_sets(__doc__, RESULTS)
    parser.add_argument("--minutes", type=float, default=60, help="0: only the page")
    parser.add_argument("--afresh", action="store_true", help="drop results of other code")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        resource.setrlimit(resource.RLIMIT_CPU, (LIMIT, LIMIT + 1))
        asked = json.loads(options.one)
        print(json.dumps(one(Task(**asked["task"]), asked["detectable"]), allow_nan=False))
        return
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    lines, version = continued(options, judges=options.minutes > 0, page_only="--minutes 0")
    run(options.results, lines, options.minutes, options.jobs, version)
    show(lines, partial(page, planned=len(schedule())), options.out)
    if options.out is not None:
        write_diagram(every_stated(current(lines)), options.out, DIAGRAM)


if __name__ == "__main__":
    main()
