"""Does `discover` find what it was never told? Hidden sets, judged by their sealed answers.

Each run continues the schedule where the results file ends, so that the figures tighten with time.

``python -m benchmarks.blind [--minutes 60] [--jobs 2] [--only KIND] [--again] [--all] [--out docs/blind.md]``
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import fields
from pathlib import Path
from typing import Any

from benchmarks.blind_code import ROOT, code_hash, origin
from benchmarks.blind_misses import misses
from benchmarks.blind_schedule import LOUD, Task, schedule
from benchmarks.blind_tables import report
from granite_lab.files import write_text

RESULTS = ROOT / "benchmarks" / "results" / "blind.jsonl"

HORIZON = 20_000
"""Sets of the schedule that are looked through for what is asked."""

LIMIT = 4 * 3600.0
"""Longest that a set may take, on however busy a machine [s]."""

TYPICAL = 60.0
"""Expected time of a set before one was made [s]."""


class Results:
    """The results file: one line of JSON for each set, complete or not there at all."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lines: list[dict[str, Any]] = []
        text = path.read_text(encoding="utf-8") if path.exists() else ""
        for row in text.splitlines():
            try:
                self.lines.append(json.loads(row))
            except ValueError:  # the line on which an earlier run was killed
                continue
        self.torn = bool(text) and not text.endswith("\n")

    def append(self, line: dict[str, Any]) -> None:
        """Add a line and see it to the disk."""
        self.lines.append(line)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("a", encoding="utf-8") as file:
            file.write("\n" * self.torn + json.dumps(line, allow_nan=False, separators=(",", ":")) + "\n")
            file.flush()
            os.fsync(file.fileno())
        self.torn = False


class Workers:
    """Sets in processes of their own, which end with this one."""

    def __init__(self) -> None:
        self.running: set[subprocess.Popen[str]] = set()
        self.lock = threading.Lock()
        self.stopped = False

    def run(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Run `benchmarks.blind_set`; whatever happens there becomes a line."""
        one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        with self.lock:
            if self.stopped:
                raise InterruptedError
            process = subprocess.Popen(
                [sys.executable, "-m", "benchmarks.blind_set", json.dumps(asked)],
                cwd=ROOT, env=os.environ | one, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            )  # fmt: skip
            self.running.add(process)
        try:
            printed, said = process.communicate(timeout=LIMIT)
        except subprocess.TimeoutExpired:
            process.kill()
            printed, said = process.communicate()
            said = f"longer than {LIMIT:.0f} s\n{said}"
        finally:
            self.running.discard(process)
        if self.stopped:
            raise InterruptedError
        try:
            line: dict[str, Any] = json.loads(printed)
        except ValueError:
            task = Task(**asked["task"]) if "task" in asked else None
            line = {"key": task.key if task else "", **(asked.get("task") or {})}
            line |= origin() | {"status": "crashed", "error": said[-2000:], "exit": process.returncode}
        return line

    def stop(self) -> None:
        """End all that runs."""
        with self.lock:
            self.stopped = True
            for process in list(self.running):
                process.kill()


def detectable_sizes(path: Path, workers: Workers, *, again: bool) -> dict[str, dict[str, Any]]:
    """Return the smallest detectable sizes by noise, as the tool computes them for a set without an effect.

    They are found once for each design and kept, so that a strength means the same in all runs.
    """
    known: dict[str, dict[str, Any]] = {}
    if path.exists() and not again:
        known = json.loads(path.read_text(encoding="utf-8"))
    for noise in (1.0, LOUD):
        if f"{noise:g}" in known:
            continue
        print(f"smallest detectable sizes at {noise:g} times the noise", file=sys.stderr, flush=True)
        found = workers.run({"detectable_at": noise})
        if "sizes" not in found:
            sys.exit(f"error: the smallest detectable sizes cannot be found\n{found.get('error')}")
        known[f"{noise:g}"] = found
        write_text(path, json.dumps(known, indent=1) + "\n")
    return known


def waiting(done: set[int], only: str | None) -> Iterator[Task]:
    """Yield the sets of the schedule whose seeds are not spent, on whatever the schedule once had there."""
    for _, task in zip(range(HORIZON), schedule(), strict=False):
        words = (task.kind, task.effect, f"{task.strength:g}" if task.strength is not None else "drawn")
        if task.seed not in done and all(word in words for word in (only or "").split(":") if word):
            yield task


def missed_before(
    lines: Sequence[dict[str, Any]], again: Sequence[dict[str, Any]], code: str
) -> Iterator[Task]:
    """Yield the sets that older code missed and this code has not judged again.

    Args:
        lines: of the results file.
        again: of the file of sets that were judged again.
        code: hash of this code.
    """
    names = {field.name for field in fields(Task)}
    done = {line["key"] for line in again if line["code"] == code}
    for line in misses(lines):
        if line["key"] not in done and line.get("code") != code and line["status"] != "not made":
            yield Task(**{name: value for name, value in line.items() if name in names})


def run(
    results: Results, tasks: Iterator[Task], minutes: float, jobs: int, keep: Path | None, anew: bool
) -> None:
    """Make and judge sets until there are none left or the time is up."""
    workers, begin, most = Workers(), time.monotonic(), TYPICAL
    pool = ThreadPoolExecutor(jobs)
    try:
        sizes = detectable_sizes(results.path.with_name("detectable.json"), workers, again=anew)
        running: dict[Future[dict[str, Any]], float] = {}
        while True:
            while len(running) < jobs and time.monotonic() - begin + most < 60 * minutes:
                task = next(tasks, None)
                if task is None:
                    break
                noise = f"{LOUD if task.kind == 'loud' else 1.0:g}"
                folder = str(keep / task.key.replace("/", "_")) if keep else None
                asked = {"task": task.record(), "detectable": sizes[noise]["sizes"], "folder": folder}
                running[pool.submit(workers.run, asked)] = time.monotonic()
            if not running:
                return
            ready, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in ready:
                most = max(0.9 * most, time.monotonic() - running.pop(future))
                line = future.result()
                results.append(line)
                told = line.get("outcome") or line["status"]
                print(f"{len(results.lines)} {line['key']}: {told}", file=sys.stderr, flush=True)
    except KeyboardInterrupt:
        print("interrupted; what is done is kept", file=sys.stderr)
    finally:
        workers.stop()
        pool.shutdown(wait=True, cancel_futures=True)


def main() -> None:
    """Continue the benchmark and write its report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=60, help="0: only the report")
    parser.add_argument("--jobs", type=int, default=2, help="sets side by side")
    parser.add_argument("--only", help="a kind, an effect or a strength, or several joined by colons")
    parser.add_argument("--results", type=Path, default=RESULTS, help="one line for each set")
    parser.add_argument("--out", type=Path, help="write the report here too")
    parser.add_argument("--all", action="store_true", help="results of older code, too")
    parser.add_argument("--again", action="store_true", help="only the sets that older code missed")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="keep the sets in here")
    parser.add_argument("--detectable", action="store_true", help="find the smallest detectable sizes again")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    results = Results(options.results)
    again = Results(options.results.with_name("again.jsonl"))
    if options.again:
        tasks = missed_before(results.lines, again.lines, code_hash())
    else:
        tasks = waiting({line["seed"] for line in results.lines if "seed" in line}, options.only)
    if options.minutes > 0:
        into = again if options.again else results
        run(into, tasks, options.minutes, options.jobs, options.keep, options.detectable)
    text = report(results.lines, every=options.all, again=again.lines)
    print(text)
    if options.out is not None:
        write_text(options.out, text)


if __name__ == "__main__":
    main()
