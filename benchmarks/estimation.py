"""Are the velocity and slip estimates, and their uncertainties, true? Measured on seeded virtual trials.

The trials come from the independent truth generator in `tests.truth`: each cell of the table has
its own seeds, so that a run repeats exactly.

``python -m benchmarks.estimation [--trials N] [--quick] [--processes P] [--out docs/bench-estimation.md]``
"""

from __future__ import annotations

import argparse
import sys
import time
import zlib
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from benchmarks.estimation_cell import KINDS, Cell, Score, Summary, score, summarise

GRADES = ("industrial", "consumer")
DURATIONS = (8.0, 30.0)
VELOCITIES = (0.2, 0.3, 0.5, 0.7)
OFFSETS = (-0.2, -0.05, -0.02, -0.005, 0.005, 0.02, 0.05, 0.2)

V_LIMIT = {("industrial", 8.0): 2.0, ("consumer", 8.0): 6.0, ("consumer", 30.0): 18.0}
"""Largest RMSE of v [mm/s]."""

DISTANCE_LIMIT = {("industrial", 8.0): 0.6, ("consumer", 8.0): 2.0, ("consumer", 30.0): 5.0}
"""Largest RMS error of the distance [%]."""

NEES_LIMITS = (0.74, 1.30)
COVER_LIMITS = (0.92, 0.98)
SLIP_LIMIT = 0.5
"""Largest RMS error of λ_R [points]."""

OFFSET_LIMIT = 5.0
"""Largest RMS error of the clock offset [ms]."""

MAIN_HEAD = (
    "| IMU | duration [s] | v [m/s] | RMSE of v [mm/s] | worst 5 % | distance [%] | λ_R [points] "
    "| mean λ_R error | NEES | 2σ: v | 2σ: distance | 2σ: λ_R | refused |"
)
OFFSET_HEAD = (
    "| IMU | injected [ms] | RMS error [ms] | mean error [ms] | 2σ cover | observable | RMSE of v [mm/s] |"
)


def seed_of(cell: Cell, index: int) -> int:
    """Return the seed of a trial; no two cells share one."""
    return zlib.crc32(repr(cell).encode()) * 10_000 + index


def one(job: tuple[Cell, int]) -> Score:
    """Judge one trial, in whatever process."""
    cell, index = job
    return score(cell, seed_of(cell, index))


def measured(jobs: list[tuple[Cell, int]], processes: int) -> Iterator[Score]:
    """Yield the scores in the order of the jobs, with progress on a terminal."""
    begin = time.perf_counter()

    def watched(scores: Iterable[Score]) -> Iterator[Score]:
        for done, result in enumerate(scores, 1):
            if sys.stderr.isatty() or done % 100 == 0:
                left = (time.perf_counter() - begin) / done * (len(jobs) - done)
                end = "\r" if sys.stderr.isatty() else "\n"
                print(f"{done}/{len(jobs)} trials, {left:.0f} s left ", end=end, file=sys.stderr, flush=True)
            yield result

    if processes == 1:
        yield from watched(map(one, jobs))
        return
    with ProcessPoolExecutor(processes) as pool:
        yield from watched(pool.map(one, jobs, chunksize=4))


def summaries(cells: list[Cell], trials: int, processes: int) -> dict[Cell, Summary]:
    """Return the summary of each cell."""
    jobs = [(cell, index) for cell in cells for index in range(trials)]
    scores: dict[Cell, list[Score]] = {cell: [] for cell in cells}
    for (cell, _), result in zip(jobs, measured(jobs, processes), strict=True):
        scores[cell].append(result)
    return {cell: summarise(found) for cell, found in scores.items()}


def flagged(text: str, good: bool) -> str:
    """Set a figure that misses its aim in bold."""
    return text if good else f"**{text}**"


def within(share: float) -> str:
    """Write a coverage in percent, bold where it leaves its limits."""
    return flagged(f"{100 * share:.1f}", COVER_LIMITS[0] <= share <= COVER_LIMITS[1])


def main_row(cell: Cell, s: Summary) -> str:
    """Return a cell's row of the main table."""
    key = cell.grade, cell.duration
    v, distance, slip = 1e3 * s.v_rmse, 100 * s.distance_rmse, 100 * s.slip_rmse
    return (
        f"| {cell.grade} | {cell.duration:g} | {cell.velocity:g} "
        f"| {flagged(f'{v:.2f}', v <= V_LIMIT.get(key, 1e9))} | {1e3 * s.v_worst:.2f} "
        f"| {flagged(f'{distance:.2f}', distance <= DISTANCE_LIMIT.get(key, 1e9))} "
        f"| {flagged(f'{slip:.2f}', slip <= SLIP_LIMIT or cell.duration > 8)} | {100 * s.slip_mean:+.2f} "
        f"| {flagged(f'{s.nees:.2f}', NEES_LIMITS[0] <= s.nees <= NEES_LIMITS[1])} "
        f"| {within(s.v_cover)} | {within(s.distance_cover)} | {within(s.slip_cover)} "
        f"| {s.refused}/{s.trials} |"
    )


def offset_row(cell: Cell, s: Summary) -> str:
    """Return a cell's row of the table of clock offsets."""
    rms = 1e3 * s.offset_rmse
    return (
        f"| {cell.grade} | {1e3 * cell.offset:+.0f} | {flagged(f'{rms:.2f}', rms <= OFFSET_LIMIT)} "
        f"| {1e3 * s.offset_mean:+.2f} | {100 * s.offset_cover:.0f} | {100 * s.observable:.0f} "
        f"| {1e3 * s.v_rmse:.2f} |"
    )


def white_row(cell: Cell, s: Summary) -> str:
    """Return a cell's row of the table of innovations."""
    cells = " | ".join(f"{w:+.2f}" for w in s.white)
    return f"| {cell.grade} | {cell.duration:g} | {cell.velocity:g} | {cells} |"


def rule(head: str) -> str:
    """Return the line between a table's head and its body."""
    return "|---" * (head.count("|") - 1) + "|"


def report(main: dict[Cell, Summary], offsets: dict[Cell, Summary], command: str, wall: float) -> str:
    """Return the Markdown report."""
    trials = next(iter(main.values())).trials
    white_head = "| IMU | duration [s] | v [m/s] | " + " | ".join(k.replace("_", " ") for k in KINDS) + " |"
    return "\n".join([
        "# Estimation on virtual trials",
        "",
        f"`{command}`, {trials} seeded trials a cell, {wall / 60:.0f} min.",
        "All trials are virtual: random motion over sand (2 s rest, the command, 2 s rest) under the sensors",
        "of the truth generator in `tests/truth`, which shares no code with the package. Errors are taken",
        "from the command's start to 0.5 s after its end; λ_R is compared over the steady part that the",
        "estimator chose. Bold: outside the aim. Aims: RMSE of v and of distance 2 mm/s and 0.6 %",
        "(industrial, 8 s), 6 mm/s and 2 % (consumer, 8 s), 18 mm/s and 5 % (consumer, 30 s), λ_R 0.5 points",
        "(8 s), NEES 0.74 to 1.30 and 2σ coverage 92 to 98 % everywhere.",
        "",
        MAIN_HEAD,
        rule(MAIN_HEAD),
        *(main_row(cell, s) for cell, s in main.items()),
        "",
        "## Offset between the clocks",
        "",
        "Injected into 8 s trials at 0.5 m/s; aim: RMS error of at most 5 ms.",
        "",
        OFFSET_HEAD,
        rule(OFFSET_HEAD),
        *(offset_row(cell, s) for cell, s in offsets.items()),
        "",
        "## Innovations",
        "",
        "Correlation of successive normalised innovations, mean over the trials; 0 is white.",
        "",
        white_head,
        rule(white_head),
        *(white_row(cell, s) for cell, s in main.items()),
        "",
    ])  # fmt: skip


def main() -> None:
    """Measure, print and write the report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--trials", type=int, default=100, help="trials a cell")
    parser.add_argument("--quick", action="store_true", help="5 trials a cell, 8 s only")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, help="write the report here too")
    options = parser.parse_args()
    trials = 5 if options.quick else options.trials
    durations = DURATIONS[:1] if options.quick else DURATIONS
    begin = time.perf_counter()
    cells = [Cell(g, d, v) for g in GRADES for d in durations for v in VELOCITIES]
    shifted = [Cell(g, 8.0, 0.5, offset) for g in GRADES for offset in OFFSETS]
    main_table = summaries(cells, trials, options.processes)
    offset_table = summaries(shifted, max(5, trials // 4), options.processes)
    words = [f"--trials {trials}"] if not options.quick else ["--quick"]
    command = " ".join(["python -m benchmarks.estimation", *words])
    text = report(main_table, offset_table, command, time.perf_counter() - begin)
    print(text)
    if options.out is not None:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
