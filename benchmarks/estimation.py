"""Are the velocity and slip estimates, and their uncertainties, true? Measured on seeded virtual trials.

The trials come from the independent truth generator in `tests.truth`: each cell of the table has
its own seeds, so that a run repeats exactly.

``python -m benchmarks.estimation [--trials N] [--quick] [--processes P] [--out docs/bench-estimation.md]``
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import zlib
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, astuple
from pathlib import Path

import numpy as np

from benchmarks.estimation_causes import CAUSES
from benchmarks.estimation_cell import KINDS, Cell, Score, Summary, score, summarise, together
from benchmarks.intervals import Interval, around, excludes, wilson

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
"""Largest mean error of λ_R [points]; the mean absolute error has none, see the page."""

OFFSET_LIMIT = 5.0
"""Largest RMS error of the clock offset [ms]."""

MAIN_HEAD = (
    "| IMU | duration [s] | v [m/s] | RMSE of v [mm/s] | worst 5 % | distance [%] | λ_R: mean error [points] "
    "| λ_R: mean absolute | λ_R: stated std | NEES | 2σ of v [%] | 2σ of distance [%] | 2σ of λ_R [%] "
    "| refused |"
)
OFFSET_HEAD = "| injected [ms] |" + "".join(
    f" {grade}: RMS error [ms] | mean error [ms] | RMSE of v [mm/s] |" for grade in GRADES
)


def seed_of(cell: Cell, index: int) -> int:
    """Return the seed of a trial; no two cells share one."""
    return zlib.crc32(repr(cell).encode()) * 10_000 + index


def one(job: tuple[Cell, int]) -> Score:
    """Judge one trial, in whatever process."""
    cell, index = job
    return score(cell, seed_of(cell, index))


def drawn(cells: dict[Cell, int]) -> list[tuple[Cell, int]]:
    """List the trials so that a run that ends early has about the same share of each cell."""
    jobs = [(cell, index) for cell, trials in cells.items() for index in range(trials)]
    return sorted(jobs, key=lambda job: (job[1] + 0.5) / cells[job[0]])


def measured(
    jobs: list[tuple[Cell, int]], processes: int, ends: float
) -> Iterator[tuple[tuple[Cell, int], Score]]:
    """Yield trials and their scores until an instant of `time.monotonic`, and say how far it is."""
    begin = time.monotonic()
    with ProcessPoolExecutor(processes) as pool:
        asked = [(job, pool.submit(one, job)) for job in jobs]
        for done, (job, result) in enumerate(asked, 1):
            yield job, result.result()
            if done % 100 == 0:
                left = (time.monotonic() - begin) / done * (len(jobs) - done)
                print(f"{done}/{len(jobs)} trials, {left:.0f} s left", file=sys.stderr, flush=True)
            if time.monotonic() > ends:
                pool.shutdown(cancel_futures=True)
                return


def remembered(path: Path | None) -> dict[tuple[Cell, int], Score]:
    """Read the scores that an earlier run of the same code has kept, one a line."""
    if path is None or not path.exists():
        return {}
    lines = (json.loads(line) for line in path.read_text(encoding="utf-8").splitlines())
    return {
        (Cell(*cell), index): Score(**{**found, "white": tuple(found["white"])})
        for cell, index, found in lines
    }


def summaries(
    cells: dict[Cell, int], processes: int, *, minutes: float = np.inf, kept: Path | None = None
) -> dict[Cell, Summary]:
    """Return the summary of each cell from its number of trials.

    Args:
        cells: how many trials of each.
        processes: how many at the same time.
        minutes: after which no new trial is begun.
        kept: where scores are kept as they come, and found again.
    """
    jobs = drawn(cells)
    found = remembered(kept)
    for job, result in measured(
        [j for j in jobs if j not in found], processes, time.monotonic() + 60.0 * minutes
    ):
        found[job] = result
        if kept is not None:
            with kept.open("a", encoding="utf-8") as file:
                file.write(json.dumps([astuple(job[0]), job[1], asdict(result)]) + "\n")
    return {
        cell: summarise([found[job] for job in jobs if job[0] == cell and job in found]) for cell in cells
    }


def flagged(text: str, good: bool) -> str:
    """Set a figure that misses its aim in bold."""
    return text if good else f"**{text}**"


def covered(share: float, interval: Interval) -> str:
    """Write a coverage in percent with its interval, bold where no value in it meets the aim."""
    low, high = interval
    return flagged(f"{100 * share:.0f}", not excludes(interval, COVER_LIMITS)) + (
        f" ({100 * low:.0f}–{100 * high:.0f})"
    )


def main_row(cell: Cell, s: Summary) -> str:
    """Return a cell's row of the main table."""
    key = cell.grade, cell.duration
    v, distance, bias, size = 1e3 * s.v_rmse, 100 * s.distance_rmse, 100 * s.slip_mean, 100 * s.slip_size
    biased = excludes(around(bias, 100 * s.slip_error), (-SLIP_LIMIT, SLIP_LIMIT))
    n = s.trials - s.refused
    return (
        f"| {cell.grade} | {cell.duration:g} | {cell.velocity:g} "
        f"| {flagged(f'{v:.2f}', v <= V_LIMIT.get(key, 1e9))} | {1e3 * s.v_worst:.2f} "
        f"| {flagged(f'{distance:.2f}', distance <= DISTANCE_LIMIT.get(key, 1e9))} "
        f"| {flagged(f'{bias:+.2f}', not biased)} ± {100 * s.slip_error:.2f} "
        f"| {size:.2f} | {100 * s.slip_stated:.2f} "
        f"| {flagged(f'{s.nees:.2f}', not excludes(around(s.nees, s.nees_error), NEES_LIMITS))} "
        f"± {s.nees_error:.2f} "
        f"| {covered(s.v_cover, around(s.v_cover, s.v_cover_error, 0.0, 1.0))} "
        f"| {covered(s.distance_cover, wilson(s.distance_cover, n))} "
        f"| {covered(s.slip_cover, wilson(s.slip_cover, n))} | {s.refused}/{s.trials} |"
    )


def offset_row(offset: float, found: Sequence[Summary]) -> str:
    """Return the row of a clock offset [s], a summary for each IMU."""
    cells = [f"{1e3 * offset:+.0f}"]
    for s in found:
        rms = 1e3 * s.offset_rmse
        cells += [
            flagged(f"{rms:.2f}", rms <= OFFSET_LIMIT),
            f"{1e3 * s.offset_mean:+.2f}",
            f"{1e3 * s.v_rmse:.2f}",
        ]
    return f"| {' | '.join(cells)} |"


def rule(head: str) -> str:
    """Return the line between a table's head and its body."""
    return "|---" * (head.count("|") - 1) + "|"


def ranges(values: Iterable[float], form: str) -> str:
    """Write the smallest and the largest of some numbers."""
    texts = [f"{value:{form}}" for value in sorted(values)]
    return texts[0] if texts[0] == texts[-1] else f"{texts[0]} to {texts[-1]}"


def reached(main: dict[Cell, Summary], offsets: dict[Cell, Summary]) -> list[str]:
    """Say what was reached, one list item a line."""

    def of(name: str, factor: float, form: str) -> str:
        return "; ".join(
            f"{grade}, {duration:g} s: " + ranges([factor * getattr(s, name) for s in cells], form)
            for grade in GRADES
            for duration in DURATIONS
            if (cells := [s for c, s in main.items() if (c.grade, c.duration) == (grade, duration)])
        )

    return [
        f"* **RMSE of v** [mm/s]. {of('v_rmse', 1e3, '.1f')}.",
        f"* **Mean absolute error of λ_R** [percentage points]. {of('slip_size', 100, '.2f')}.",
        f"* **Uncertainty.** NEES {ranges((s.nees for s in main.values()), '.2f')} (ideally 1).",
        f"  {together(list(main.values()))}",
        f"* **Clock offset.** RMS error {ranges((1e3 * s.offset_rmse for s in offsets.values()), '.1f')} ms.",
    ]


def report(main: dict[Cell, Summary], offsets: dict[Cell, Summary], command: str) -> str:
    """Return the Markdown report."""
    counts = sorted({s.trials for s in main.values()})
    trials = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    white = (
        f"{kind.replace('_', ' ')} {ranges((s.white[k] for s in main.values()), '+.2f')}"
        for k, kind in enumerate(KINDS)
    )
    seen = ranges((100 * s.observable for s in offsets.values()), ".0f")
    inside = ranges((100 * s.offset_cover for s in offsets.values()), ".0f")
    return "\n".join([
        "# Estimation on virtual trials",
        "",
        *reached(main, offsets),
        "",
        "## Method",
        "",
        f"`{command}`, {trials} seeded trials per cell. All trials are virtual:",
        "random motion over sand with 2 s of standstill before and after, and the sensors of `tests/truth`,",
        "which shares no code with the package. Errors are taken from the start of the command to 0.5 s",
        "after its end, those of λ_R over the steady part.",
        "",
        "± is a standard error; brackets have the 95 % interval of a coverage. **Bold**: outside the aim;",
        "for coverage, NEES and the mean error of λ_R, if their whole interval is outside.",
        "",
        "Aims: RMSE of v and of distance 2 mm/s and 0.6 % (industrial, 8 s), 6 mm/s and 2 % (consumer, 8 s),",
        "18 mm/s and 5 % (consumer, 30 s); mean error of λ_R 0.5 points; NEES 0.74 to 1.30; 2σ coverage",
        "92 to 98 %; RMS error of the clock offset 5 ms.",
        "",
        "## Velocity, distance and slip",
        "",
        MAIN_HEAD,
        rule(MAIN_HEAD),
        *(main_row(cell, s) for cell, s in main.items()),
        "",
        "Correlation of successive innovations, mean of each cell (white: 0): " + "; ".join(white) + ".",
        "",
        "## Clock offset",
        "",
        f"Offsets in trials of 8 s at 0.5 m/s; observable in {seen} %, inside 2σ in {inside} %.",
        "",
        OFFSET_HEAD,
        rule(OFFSET_HEAD),
        *(offset_row(o, [s for c, s in offsets.items() if c.offset == o]) for o in OFFSETS),
        "",
        CAUSES,
    ])  # fmt: skip


def main() -> None:
    """Measure, print and write the report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--trials", type=int, default=100, help="trials a cell")
    parser.add_argument("--quick", action="store_true", help="5 trials a cell, 8 s only")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=np.inf, help="begin no trial after so long")
    parser.add_argument("--scores", type=Path, help="keep each trial's score here, and begin with those")
    parser.add_argument("--out", type=Path, help="write the report here too")
    options = parser.parse_args()
    trials = 5 if options.quick else options.trials
    durations = DURATIONS[:1] if options.quick else DURATIONS
    main_cells = [Cell(g, d, v) for g in GRADES for d in durations for v in VELOCITIES]
    shifted = [Cell(g, 8.0, 0.5, offset) for g in GRADES for offset in OFFSETS]
    cells = dict.fromkeys(main_cells, trials) | dict.fromkeys(shifted, max(5, trials // 4))
    found = summaries(cells, options.processes, minutes=options.minutes, kept=options.scores)
    words = [f"--trials {trials}"] if not options.quick else ["--quick"]
    if np.isfinite(options.minutes):
        words.append(f"--minutes {options.minutes:g}")
    command = " ".join(["python -m benchmarks.estimation", *words])
    text = report({c: found[c] for c in main_cells}, {c: found[c] for c in shifted}, command)
    print(text)
    if options.out is not None:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
