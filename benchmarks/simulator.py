"""Speed and accuracy of the simulator, beside CVODES and the paper's fixed-step method, in one run.

    python -m benchmarks.simulator [--repeats N] [--draws N] [--out docs/bench-simulator.md]

All methods integrate the same trials (standstill before, command, coasting after) on one core, in
turn, warmed up. Times are medians of CPU times; compare ratios, not seconds.
"""

from __future__ import annotations

import dataclasses
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar
from unittest.mock import patch

import numpy as np

from benchmarks import rk4
from benchmarks.command_line import parser_of
from granite_lab.effects import get, library
from granite_lab.errors import EstimateError
from granite_lab.logs.trial import Array
from granite_lab.model import Accuracy, interpreted, simulate, simulator
from granite_lab.model.command import duration
from granite_lab.model.effect import activate
from granite_lab.model.engine import INTERPRETED
from granite_lab.model.instants import COAST, USUAL, instants
from granite_lab.model.native import graphs
from granite_lab.model.simulator import parameter_vector, rest_state
from granite_lab.model.symbols import model_parameters
from granite_lab.parameters import load_paper, load_robot, load_soil, load_variants, variant_of
from granite_lab.stored import FOLDER
from tests.model.box import draw

T = TypeVar("T")

LEAN = Accuracy(relative=5e-5, absolute=1e-7, travel=0.0018, lean=True, order=3)
"""As the search for effects runs its simulations."""

TOGETHER = (
    ("tyre_windup", "contact_angle_lag"),
    ("slip_sinkage", "drivetrain_friction", "supply_sag"),
    ("radial_tyre_compliance", "rate_dependent_soil", "tyre_windup"),
)
"""Sets of two and three effects."""

SIGNALS = {"v_mps": 1e3, "imu_ax_mps2": 1e3, "imu_az_mps2": 1e3, "cur_f_A": 1e3}
"""What is compared, and the factor to mm/s, mm/s² and mA."""

PAGE = """# Speed and accuracy of the simulator

* **A trial of the paper takes {fastest:.1f} to {slowest:.1f} ms**, {least:.1f} to {most:.1f} times faster
  than with CVODES. The velocity differs by at most {error:.3f} mm/s from the paper's fixed-step method.
* A run with effects takes {median_ms:.1f} ms (median; worst {worst_ms:.1f} ms).
* Of {draws} random robots, soils, commands and effects {solved} converge with both methods and {refused}
  are refused by both. {compiled_only} converge only with machine code, {cvodes_only} only with CVODES.
* The first run of a process takes {cold:.2f} s, {warm:.2f} s with cached code and {never:.2f} s with
  CVODES. `granite-lab --help` takes {help:.2f} s, `granite-lab simulate --variant 0.5` {whole:.2f} s.

## Trials of the paper

| v [m/s] | trial [s] | compiled [ms] | CVODES [ms] | fixed step [ms] | Δv [mm/s] | Δv at 10⁻⁶ [mm/s] |
|---|---|---|---|---|---|---|
{rows}

Relative tolerance 10⁻⁴. Δv is the largest difference of velocity, with machine code, from the fixed step:
Runge–Kutta of fourth order, 0.05 ms, as in the paper.

## With effects

| | compiled [ms] | CVODES [ms] | Δv [mm/s] | Δa [mm/s²] | Δi [mA] | first [ms] |
|---|---|---|---|---|---|---|
{effects}

Over {sets} effects and pairs or triples of them ([each](tables/simulator-effects.csv)), with the settings of
the search (relative tolerance 5·10⁻⁵) and parameters at three quarters of the expected range. Differences are
the largest ones of machine code from CVODES at 10⁻⁹. "First" is the time to compile the graph.

## Random parameters

Draws within the bounds of the parameters, relative tolerance 10⁻⁴, compared with CVODES at 10⁻⁹
(median, worst): {box}.

## Method

The CasADi graph of the equations is compiled by LLVM (`llvmlite`) and integrated by RODASP2, a Rosenbrock
method of order 4, which restarts at each corner of the command. If it cannot be compiled, or with
`GRANITE_LAB_INTERPRETED=1`, CVODES integrates the interpreted graph.

`make bench-simulator` writes this page. One core, {machine}, Python {python}; medians of CPU time.
"""

CSV = "effects,compiled_ms,cvodes_ms,dv_mmps,da_mmps2,di_mA,first_ms"
"""Head of the table of effects."""


def median_times(works: Sequence[Callable[[], object]], repeats: int) -> list[float]:
    """Return the median CPU time of each call [s], in turn, after one round that is not counted."""
    times: list[list[float]] = [[] for _ in works]
    for _ in range(repeats + 1):
        for own, work in zip(times, works, strict=True):
            begin = time.thread_time()
            work()
            own.append(time.thread_time() - begin)
    return [statistics.median(own[1:]) for own in times]


def by_cvodes(work: Callable[[], T]) -> T:
    """Do something without machine code."""
    with patch.object(simulator, "engine_of", lambda *_: interpreted):
        return work()


def process_time(arguments: list[str], repeats: int) -> float:
    """Return the median wall time of a whole process [s]."""
    command = [sys.executable, "-c", "from granite_lab.cli import main; main()", *arguments]
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        subprocess.run(command, capture_output=True, check=True)
        times.append(time.perf_counter() - begin)
    return statistics.median(times)


FIRST = """
import time
from granite_lab.model import simulate
from granite_lab.parameters import load_robot, load_soil, variant_of
begin = time.process_time()
simulate(variant_of(0.5), load_robot(), load_soil())
print(time.process_time() - begin)
"""


def first_run(**environment: str) -> float:
    """Return how long the first run of a new process takes [s]."""
    done = subprocess.run(
        [sys.executable, "-c", FIRST], capture_output=True, check=True, text=True,
        env=os.environ | environment,
    )  # fmt: skip
    return float(done.stdout)


def paper_table(repeats: int) -> dict[str, Any]:
    """Return the rows of the paper's trials, and their ranges."""
    robot, soil = load_robot(), load_soil()
    rows, figures = [], []
    for column in load_paper().table3:
        variant = variant_of(column.velocity)
        fast = partial(simulate, variant, robot, soil, k92=column.k92)
        slow = partial(rk4.simulate, variant, robot, soil, k92=column.k92, after=COAST)
        run, trace = fast(), slow()
        tight = fast(accuracy=Accuracy(1e-6, 1e-8))
        slow_v = np.interp(run.t, trace.t, trace.v)
        errors = [1000 * np.abs(slow_v - r["v_mps"])[r.t >= 0].max() for r in (run, tight)]
        seconds = median_times([fast, partial(by_cvodes, fast)], 4 * repeats)
        seconds += median_times([slow], max(3, repeats // 2))
        figures.append((1000 * seconds[0], seconds[1] / seconds[0], errors[0]))
        rows.append(
            f"| {variant.velocity:g} | {1 + duration(variant) + COAST:.1f} | {1000 * seconds[0]:.1f} "
            f"| {1000 * seconds[1]:.1f} | {1000 * seconds[2]:.0f} | {errors[0]:.4f} | {errors[1]:.4f} |"
        )
    ms, ratios, off = zip(*figures, strict=True)
    return {
        "rows": "\n".join(rows), "fastest": min(ms), "slowest": max(ms), "least": min(ratios),
        "most": max(ratios), "error": max(off),
    }  # fmt: skip


def compile_time(ids: tuple[str, ...]) -> float:
    """Return how long a graph takes that is in no folder [s]."""
    begin = time.thread_time()
    graphs.equations(tuple(get(name) for name in ids))
    return time.thread_time() - begin


def effects_table(repeats: int) -> dict[str, Any]:
    """Return the rows of the effects, and of their median and worst."""
    robot, soil, a_theta = load_robot(), load_soil(), load_paper().a_theta
    fine = dataclasses.replace(LEAN, relative=1e-9, absolute=1e-11, order=5)
    moving = [(name,) for name in sorted(library()) if get(name).moves]
    rows, figures = [], []
    compile_time(("bulldozing",))  # with what all graphs share
    graphs.forget()
    for ids in ((), *moving, *TOGETHER):
        effects = tuple(get(name) for name in ids)
        first = compile_time(ids)
        active = [
            activate(e, {q.name: (q.prior_low + 3 * q.prior_high) / 4 for q in e.parameters}) for e in effects
        ]
        seconds, errors = [], []
        for variant in load_variants():
            p = model_parameters(robot, soil, variant, a_theta=a_theta)
            start, vector, t = rest_state(p, active), parameter_vector(p, active), instants(variant, LEAN)
            works = [
                partial(engine.run, effects, variant, LEAN, start, vector) for engine in (graphs, interpreted)
            ]
            seconds.append(median_times(works, repeats))
            truth, *found = (
                interpreted.outputs(effects, variant, tuple(SIGNALS), t, states, vector)
                for states in (
                    interpreted.run(effects, variant, fine, start, vector)[0], works[0]()[0], works[1]()[0],
                )
            )  # fmt: skip
            errors.append([np.abs(rows - truth).max(1) * list(SIGNALS.values()) for rows in found])
        ms = 1000 * np.median(seconds, 0)
        v, ax, az, i = np.max(errors, 0).T
        figures.append([*ms, *v, *np.maximum(ax, az), *i, 1000 * first])
        rows.append(",".join([" + ".join(ids) or "none", *_cells(figures[-1])]))
    median, worst = np.median(figures, 0), np.max(figures, 0)
    table = "\n".join(
        f"| {' | '.join([name, *_cells(f)])} |" for name, f in (("median", median), ("worst", worst))
    )
    return {
        "effects": table, "median_ms": float(median[0]), "worst_ms": float(worst[0]),
        "csv": "\n".join([CSV, *rows, ""]), "sets": len(rows) - 1,
    }  # fmt: skip


def _cells(f: Sequence[float] | Array) -> list[str]:
    return [f"{f[0]:.1f}", f"{f[1]:.1f}", f"{f[2]:.4f}", f"{f[4]:.2f}", f"{f[6]:.2f}", f"{f[8]:.0f}"]


def box(draws: int) -> dict[str, Any]:
    """Return the figures of random robots."""
    fine, counts, figures = Accuracy(1e-9, 1e-11), [0, 0, 0], []
    graphs.equations(())
    for number in range(draws):
        d = draw(5, number)
        p = model_parameters(
            d.robot, d.soil, d.variant, k92=d.k92,
            a_theta=load_paper().a_theta if d.a_theta is None else d.a_theta,
        )  # fmt: skip
        effects = tuple(e.effect for e in d.effects)
        try:
            start, t = rest_state(p, d.effects), instants(d.variant, USUAL)
        except EstimateError:
            counts[0] += 1
            continue
        vector, found, seconds = parameter_vector(p, d.effects), [], []
        graphs.equations(effects)
        for engine, accuracy in ((graphs, USUAL), (interpreted, USUAL), (interpreted, fine)):
            begin = time.thread_time()
            try:
                states = engine.run(effects, d.variant, accuracy, start, vector)
                found.append(interpreted.outputs(effects, d.variant, ("v_mps",), t, states, vector)[0])
            except EstimateError:
                found.append(None)
            seconds.append(time.thread_time() - begin)
        compiled, cvodes, truth = found
        if compiled is None or cvodes is None or truth is None:
            counts[0 if compiled is None and cvodes is None else 1 if compiled is not None else 2] += 1
            continue
        largest = max(np.abs(truth).max(), 1e-3)
        errors = [100 * np.abs(v - truth).max() / largest for v in (compiled, cvodes)]
        figures.append([*errors, *(1000 * s for s in seconds[:2])])
    names = ("Δv compiled {} % of the largest v", "CVODES {} %", "time compiled {} ms", "CVODES {} ms")
    told = [
        name.format(f"{np.median(f):.3g}, {np.max(f):.3g}")
        for name, f in zip(names, np.transpose(figures), strict=True)
    ]
    return {
        "draws": draws, "solved": len(figures), "refused": counts[0], "compiled_only": counts[1],
        "cvodes_only": counts[2], "box": "; ".join(told),
    }  # fmt: skip


def main() -> None:
    """Run the benchmark."""
    parser = parser_of(__doc__)
    parser.add_argument("--repeats", type=int, default=10)
    parser.add_argument("--draws", type=int, default=400)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        cold, warm = (first_run(**{FOLDER: folder}) for _ in range(2))
        never = first_run(**{INTERPRETED: "1"})
        whole = ["simulate", "--variant", "0.5", "--out", f"{folder}/run.csv"]
        figures = {
            "machine": platform.machine(), "python": platform.python_version(), "cold": cold, "warm": warm,
            "never": never, "help": process_time(["--help"], options.repeats),
            "whole": process_time(whole, options.repeats), **paper_table(options.repeats),
            **box(options.draws),
        }  # fmt: skip
        os.environ[FOLDER] = f"{folder}/empty"
        graphs.forget()
        figures |= effects_table(options.repeats)
    text = PAGE.format(**figures)
    print(text)
    if options.out:
        table = options.out.parent / "tables" / "simulator-effects.csv"
        table.write_text(figures["csv"], encoding="utf-8")
        options.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
