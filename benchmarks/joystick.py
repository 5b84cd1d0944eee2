"""Runs driven by a person's stick, half of the sets by a controller that the tool does not know.

`hide --command joystick` and `--command recorded` make the runs. The first seeds hide nothing: a_θ of each
run and of each set is held against the true one. Each seed of the second range is a laboratory whose first
set hides nothing and states the sizes that can be seen; the others hide one effect at five times that size.
A run that was interrupted goes on where it ended; results of other code are refused. --jobs 0 writes the
page only.

``python -m benchmarks.joystick [--runs 60] [--seeds 9] [--jobs 2] [--out docs/joystick.md]``
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

import granite_lab
from benchmarks.blind import Task, sizes_of
from benchmarks.blind_code import ROOT, commit
from benchmarks.command_line import parser_of_sets
from benchmarks.joystick_page import page
from benchmarks.judging import Work, as_judged, judged, searched, short
from benchmarks.lines import Line, add, read, show
from granite_lab.errors import EstimateError, LabError
from granite_lab.estimate import Estimate
from granite_lab.fitting.fit import K92Fit
from granite_lab.hidden.catalogue import LIBRARY
from granite_lab.hidden.sealed import open_answer
from granite_lab.parameters import is_driven
from granite_lab.running.cache import code

RESULTS = ROOT / "benchmarks" / "results" / "joystick.jsonl"

FIRST, SEARCHED = 640_000, 612_000
"""First seeds of the sets by which a_θ is judged, and of the laboratories in which effects are hidden."""

RUNS = 4
"""Runs of a set: a stick in the place of each variant of Table 2."""

EFFECTS, STRENGTH = 3, 5.0
"""Effects that are hidden in a laboratory, one in each set, and their size over the smallest that is seen."""


def drive(seed: int) -> dict[str, Any]:
    """Return how the runs of a seed are driven: four sorts in turn, half of them by an unknown controller."""
    recorded = seed % 2 == 1
    return {
        "command": "recorded" if recorded else "joystick", "log_command": recorded,
        "controller": "unknown" if seed // 2 % 2 else "paper",
    }  # fmt: skip


def law(seed: int) -> Line:
    """Make and judge a set in which nothing is hidden."""
    line: Line = {"part": "law", "key": f"law/{seed}", "seed": seed, **drive(seed)}
    with tempfile.TemporaryDirectory(prefix="granite-joystick-") as name:
        folder, start = Path(name), time.monotonic()
        try:
            granite_lab.hide("none", folder, seed=seed, repetitions=1, **drive(seed))
        except EstimateError as error:
            return line | {"status": "not made", "error": error.message}
        answer = open_answer(folder)
        line |= {"controller_is": answer["controller"]["id"], "true": answer["lab_a_theta"]}
        fits: Sequence[K92Fit] = ()
        of_set = None
        try:
            fits = list(granite_lab.fit_k92(sorted(folder.glob("*.csv")), jobs=1, cache=False))
            with suppress(EstimateError):
                of_set = granite_lab.fit_a_theta(fits).a_theta
        except LabError as error:
            line |= {"error": error.message}
        by_name = {fit.trial: fit for fit in fits}
        runs = [run_of(name, trial["a_theta"], by_name.get(name)) for name, trial in answer["trials"].items()]
    return line | {
        "status": "judged", "seconds": round(time.monotonic() - start, 1), "runs": runs,
        "a_theta": None if of_set is None else [short(of_set.value), short(of_set.std)],
    }  # fmt: skip


def run_of(name: str, true: float, fit: K92Fit | None) -> Line:
    """Return what was found of a run: true a_θ, and [value, std] by its steady slip and by its trajectory."""
    line: Line = {"trial": name, "true": short(true), "slip": None, "trajectory": None, "wheels": None}
    if fit is None:
        return line
    if fit.status == "ok":
        line["slip"] = exponent(fit.k92, fit.variant.velocity)
    if fit.status_trajectory == "ok":
        line["trajectory"] = exponent(fit.k92_trajectory, fit.variant.velocity)
    return line | {"wheels": is_driven(fit.variant), "speed": fit.variant.velocity}


def exponent(k92: Estimate, speed: float) -> list[float | None]:
    """Return a_θ and its std [s/m] of k_92 = exp(−a_θ v)."""
    if not k92.value > 0:
        return [None, None]
    return [short(-math.log(k92.value) / speed), short(k92.std / (k92.value * speed))]


def effects_of(seed: int) -> list[str]:
    """Return the effects that are hidden in a laboratory: all of the library in turn."""
    names, place = sorted(LIBRARY), EFFECTS * (seed - SEARCHED)
    return [names[7 * (place + k) % len(names)] for k in range(EFFECTS)]


def search(seed: int, effect: str, detectable: Mapping[str, float | None]) -> Line:
    """Make, search and judge a set with one effect, or none."""
    kind = "null" if effect == "none" else "single"
    task = Task(kind, effect, 0.0 if kind == "null" else STRENGTH, seed, "bench")
    line: Line = {"part": "names", "key": f"names/{seed}/{effect}", "seed": seed, "kind": kind}
    line |= {"effect": effect, **drive(seed)}
    with tempfile.TemporaryDirectory(prefix="granite-joystick-") as name:
        folder = Path(name)
        try:
            sizes, reached = sizes_of(task, detectable)
            granite_lab.hide(effect, folder, seed=seed, sizes=sizes, repetitions=1, **drive(seed))
        except (LabError, ValueError) as error:
            return line | {"status": "not made", "error": str(error)}
        answer = open_answer(folder)
        line |= {"reached": reached, "controller_is": answer["controller"]["id"]}
        line |= judged(searched(sorted(folder.glob("*.csv"))), answer)
    if kind != "null":
        line.pop("detectable", None)
    return line


def work_of(runs: int, seeds: int, done: Mapping[str, Line]) -> list[Work[Line]]:
    """Return what can be made now, the sets by which a_θ is judged first.

    In a laboratory the set without an effect comes first: without its sizes no other one can be made.

    Args:
        runs: by which a_θ is judged.
        seeds: laboratories in which effects are hidden.
        done: lines of the sets that are judged, by their keys.
    """
    laws = [FIRST + k for k in range(-(-runs // RUNS))]
    found: list[Work[Line]] = [(law, (seed,)) for seed in laws if f"law/{seed}" not in done]
    nulls: list[Work[Line]] = []
    for seed in (SEARCHED + k for k in range(seeds)):
        first = done.get(f"names/{seed}/none")
        if first is None:
            nulls.append((search, (seed, "none", {})))
            continue
        others = [name for name in effects_of(seed) if f"names/{seed}/{name}" not in done]
        found += [(search, (seed, name, first.get("detectable") or {})) for name in others]
    return found + nulls


def judge(options: argparse.Namespace, lines: list[Line], version: Line) -> None:
    """Make and judge the sets that are missing; each is kept as soon as it is judged."""
    begun: list[Work[Line]] = []

    def following() -> Work[Line] | None:
        done = {line["key"]: line for line in lines}
        waiting = [w for w in work_of(options.runs, options.seeds, done) if w not in begun]
        begun.extend(waiting[:1])
        return waiting[0] if waiting else None

    with ProcessPoolExecutor(options.jobs) as pool:
        add(options.results, lines, as_judged(pool, following, options.jobs), version)


def main() -> None:
    """Continue the benchmark and write its page."""
    parser = parser_of_sets(__doc__, RESULTS)
    parser.add_argument(
        "--runs", type=int, default=60, help="runs by which a_θ is judged; 0: those of before stay"
    )
    parser.add_argument(
        "--seeds",
        type=int,
        default=9,
        help="laboratories in which effects are hidden; 0: those of before stay",
    )
    options = parser.parse_args()
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    version = {"code": code()[:10], "commit": commit()}
    lines = read(options.results)
    continued = {part for part, count in (("law", options.runs), ("names", options.seeds)) if count}
    other = any(x["part"] in continued and x["code"] != version["code"] for x in lines)
    if options.jobs and other:
        sys.exit(f"error: {options.results} is of other code\nhint: move it away to begin anew, or --jobs 0")
    if options.jobs:
        judge(options, lines, version)
    show(lines, page, options.out)


if __name__ == "__main__":
    main()
