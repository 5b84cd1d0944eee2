"""Speed and accuracy of the simulator, beside the paper's fixed-step method, in one run.

    python -m benchmarks.simulator [--repeats N] [--out docs/bench-simulator.md]

Both methods integrate the same trials (standstill before, command, coasting after) on one core; the
compiled code of the fixed-step method is warmed up first, and so is the simulator. Times are
medians; compare ratios, not seconds.
"""

from __future__ import annotations

import argparse
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks import rk4
from granite_lab.model import Accuracy, simulate
from granite_lab.model.command import duration
from granite_lab.model.instants import COAST
from granite_lab.parameters import load_paper, load_robot, load_soil, variant_of

PAGE = """# Speed and accuracy of the simulator

Written by `make bench-simulator` (`python -m benchmarks.simulator --out docs/bench-simulator.md`).
One core, {machine}, Python {python}; medians, warm. Both methods ran in turn in one process, so
compare the ratios.

The fixed-step method is the paper's: Runge–Kutta of fourth order at 0.05 ms, compiled with numba
(`benchmarks/rk4.py`, written independently). The simulator integrates the same trial with CVODES
at relative tolerance 10⁻⁴ and evaluates all outputs on a grid of 5 ms. Δv is the largest difference
in velocity from the start of the command on, the last but one column that at tolerance 10⁻⁶.

| v [m/s] | trial [s] | this [ms] | fixed step [ms] | ratio | Δv [mm/s] | Δv at 10⁻⁶ [mm/s] | λ_R [%] |
|---|---|---|---|---|---|---|---|
{rows}

Whole processes: `granite-lab --help` {help:.2f} s, `granite-lab simulate --variant 0.5` {whole:.2f} s.
"""


def median_time(work: Callable[[], object], repeats: int) -> float:
    """Return the median time of a call [s], after one that is not counted."""
    work()
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return statistics.median(times)


def process_time(arguments: list[str], repeats: int) -> float:
    """Return the median wall time of a whole process [s]."""
    command = [sys.executable, "-c", "from granite_lab.cli import main; main()", *arguments]
    return median_time(lambda: subprocess.run(command, capture_output=True, check=True), repeats)


def table(repeats: int) -> str:
    """Measure and return the Markdown page."""
    robot, soil = load_robot(), load_soil()
    rows = []
    for column in load_paper().table3:
        variant = variant_of(column.velocity)

        fast = partial(simulate, variant, robot, soil, k92=column.k92)
        slow = partial(rk4.simulate, variant, robot, soil, k92=column.k92, after=COAST)
        run, trace = fast(), slow()
        tight = fast(accuracy=Accuracy(1e-6, 1e-8))
        slow_v = np.interp(run.t, trace.t, trace.v)
        error, error_tight = (np.abs(slow_v - other["v_mps"])[run.t >= 0].max() for other in (run, tight))
        seconds = median_time(fast, 4 * repeats), median_time(slow, max(3, repeats // 2))
        rows.append(
            f"| {variant.velocity:g} | {1 + duration(variant) + COAST:.1f} | {1000 * seconds[0]:.1f} "
            f"| {1000 * seconds[1]:.0f} | {seconds[1] / seconds[0]:.0f} | {1000 * error:.3f} "
            f"| {1000 * error_tight:.4f} | {100 * run.slip_ratio:.2f} |"
        )
    help_time = process_time(["--help"], repeats)
    with tempfile.TemporaryDirectory() as folder:
        whole = process_time(["simulate", "--variant", "0.5", "--out", f"{folder}/run.csv"], repeats)
    return PAGE.format(
        machine=platform.machine(),
        python=platform.python_version(),
        rows="\n".join(rows),
        help=help_time,
        whole=whole,
    )


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=10)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    text = table(options.repeats)
    print(text)
    if options.out:
        options.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
