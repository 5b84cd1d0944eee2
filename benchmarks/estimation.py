"""Are the velocity and slip estimates, and their uncertainties, true? Measured on seeded virtual trials.

The trials come from the independent truth generator in `tests.truth`: each cell of the table has
its own seeds, so that a run repeats exactly.

``python -m benchmarks.estimation [--trials N] [--quick] [--processes P] [--out docs/bench-estimation.md]``
"""

from __future__ import annotations

import json
import sys
import time
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, astuple
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.against_truth import table
from benchmarks.blind_code import commit
from benchmarks.command_line import parser_of
from benchmarks.estimation_causes import CAUSES
from benchmarks.estimation_cell import KINDS, Cell, Score, Summary, score, summarise, together
from benchmarks.intervals import around, excludes, wilson
from benchmarks.judging import parallel
from granite_lab.files import write_text

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


Job = tuple[Cell, int]
"""A cell, and the number of a trial in it."""


def seed_of(cell: Cell, index: int) -> int:
    """Return the seed of a trial; no two cells share one."""
    return zlib.crc32(repr(cell).encode()) * 10_000 + index


def one(job: Job) -> tuple[Job, Score]:
    """Judge one trial, in whatever process."""
    cell, index = job
    return job, score(cell, seed_of(cell, index))


def drawn(cells: dict[Cell, int]) -> list[Job]:
    """List the trials so that a run that ends early has about the same share of each cell."""
    jobs = [(cell, index) for cell, trials in cells.items() for index in range(trials)]
    return sorted(jobs, key=lambda job: (job[1] + 0.5) / cells[job[0]])


def measured(jobs: list[Job], processes: int, minutes: float) -> Iterator[tuple[Job, Score]]:
    """Yield trials and their scores, and say how far it is; none is begun after so many minutes."""
    begin = time.monotonic()
    for done, found in enumerate(parallel(one, jobs, minutes, processes), 1):
        yield found
        if done % 100 == 0:
            left = (time.monotonic() - begin) / done * (len(jobs) - done)
            print(f"{done}/{len(jobs)} trials, {left:.0f} s left", file=sys.stderr, flush=True)


def remembered(path: Path | None) -> dict[Job, Score]:
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
    for job, result in measured([j for j in jobs if j not in found], processes, minutes):
        found[job] = result
        if kept is not None:
            with kept.open("a", encoding="utf-8") as file:
                file.write(json.dumps([astuple(job[0]), job[1], asdict(result)]) + "\n")
    return {
        cell: summarise([found[job] for job in jobs if job[0] == cell and job in found]) for cell in cells
    }


def cell_row(cell: Cell, s: Summary) -> dict[str, object]:
    """Return a cell's row of the table; a figure that misses its aim stands in `missed`."""
    key = cell.grade, cell.duration
    n = s.trials - s.refused
    bias = around(100 * s.slip_mean, 100 * s.slip_error)
    aims = {
        "v": 1e3 * s.v_rmse <= V_LIMIT.get(key, np.inf),
        "distance": 100 * s.distance_rmse <= DISTANCE_LIMIT.get(key, np.inf),
        "slip": not excludes(bias, (-SLIP_LIMIT, SLIP_LIMIT)),
        "NEES": not excludes(around(s.nees, s.nees_error), NEES_LIMITS),
        "2σ of v": not excludes(around(s.v_cover, s.v_cover_error, 0.0, 1.0), COVER_LIMITS),
        "2σ of distance": not excludes(wilson(s.distance_cover, n), COVER_LIMITS),
        "2σ of slip": not excludes(wilson(s.slip_cover, n), COVER_LIMITS),
    }
    if cell.offset:
        aims = {"offset": 1e3 * s.offset_rmse <= OFFSET_LIMIT}
    return {
        "imu": cell.grade, "duration_s": cell.duration, "v_mps": cell.velocity,
        "offset_ms": 1e3 * cell.offset, "trials": s.trials, "refused": s.refused,
        "rmse_v_mmps": 1e3 * s.v_rmse, "rmse_v_worst_5_percent_mmps": 1e3 * s.v_worst,
        "distance_percent": 100 * s.distance_rmse,
        "slip_mean_error_points": 100 * s.slip_mean, "slip_mean_error_std_points": 100 * s.slip_error,
        "slip_mean_absolute_points": 100 * s.slip_size, "slip_stated_std_points": 100 * s.slip_stated,
        "nees": s.nees, "nees_std": s.nees_error, "v_inside": s.v_cover, "distance_inside": s.distance_cover,
        "slip_inside": s.slip_cover, "offset_rms_ms": 1e3 * s.offset_rmse,
        "offset_mean_ms": 1e3 * s.offset_mean, "missed": "; ".join(k for k, met in aims.items() if not met),
    }  # fmt: skip


def cell_table(cells: Mapping[Cell, Summary]) -> pd.DataFrame:
    """Return a row for each cell."""
    return pd.DataFrame([cell_row(cell, s) for cell, s in cells.items()]).round(4)


def ranges(values: Iterable[float], form: str) -> str:
    """Write the smallest and the largest of some numbers."""
    texts = [f"{value:{form}}" for value in sorted(values)]
    return texts[0] if texts[0] == texts[-1] else f"{texts[0]} to {texts[-1]}"


def main_table(main: Mapping[Cell, Summary]) -> str:
    """Return the ranges over the velocities, a row for each IMU and duration."""
    columns: dict[str, tuple[str, float, str]] = {
        "RMSE of v [mm/s]": ("v_rmse", 1e3, ".1f"),
        "distance [%]": ("distance_rmse", 100.0, ".1f"),
        "λ_R: mean absolute error [points]": ("slip_size", 100.0, ".2f"),
        "λ_R: mean error [points]": ("slip_mean", 100.0, "+.2f"),
        "NEES": ("nees", 1.0, ".2f"),
    }
    rows = []
    for grade, duration in product(GRADES, DURATIONS):
        cells = [s for c, s in main.items() if (c.grade, c.duration) == (grade, duration)]
        if cells:
            found = [ranges([k * getattr(s, name) for s in cells], f) for name, k, f in columns.values()]
            rows.append([f"{grade}, {duration:g} s", *found])
    return table(["IMU, trial", *columns], rows)


def report(main: Mapping[Cell, Summary], offsets: Mapping[Cell, Summary], command: str) -> str:
    """Return the Markdown report."""
    counts = ranges((s.trials for s in main.values()), "d")
    white = (
        f"{kind.replace('_', ' ')} {ranges((s.white[k] for s in main.values()), '+.2f')}"
        for k, kind in enumerate(KINDS)
    )
    seen = ranges((100 * s.observable for s in offsets.values()), ".0f")
    inside = ranges((100 * s.offset_cover for s in offsets.values()), ".0f")
    late = ranges((1e3 * s.offset_rmse for s in offsets.values()), ".1f")
    missed = [
        f"{row['missed']} ({row['imu']}, {row['duration_s']:g} s, {row['v_mps']:g} m/s)"
        for row in (cell_row(cell, s) for cell, s in {**main, **offsets}.items())
        if row["missed"]
    ]
    return f"""# Estimation on virtual trials

{main_table(main)}
Ranges over {ranges((c.velocity for c in main), "g")} m/s. [Each cell](tables/estimation.csv).

* **Aims missed**: {"; ".join(missed) or "none"}.
* **Uncertainty.** {together(list(main.values()))}
* **Clock offset.** The RMS error is {late} ms for {1e3 * min(OFFSETS):g} to {1e3 * max(OFFSETS):+g} ms.
  The offset is observable in {seen} % and within 2σ in {inside} %.
* **Correlation of successive innovations** (ideally 0): {"; ".join(white)}.

Aims: RMSE of v and of distance 2 mm/s and 0.6 % (industrial, 8 s), 6 mm/s and 2 % (consumer, 8 s),
18 mm/s and 5 % (consumer, 30 s); mean error of λ_R 0.5 points; NEES 0.74 to 1.30; 2σ coverage
92 to 98 %; RMS error of the clock offset 5 ms. Coverage, NEES and the mean error of λ_R miss their aim if
their whole 95 % interval is outside.

## Method

`{command}`, {counts} seeded trials per cell, code {commit()}. The trials are virtual:
random motion over sand with 2 s of standstill before and after, and the sensors of `tests/truth`,
which shares no code with the package. Errors are taken from the start of the command to 0.5 s
after its end, those of λ_R over the steady part.

{CAUSES}"""


def main() -> None:
    """Measure, print and write the report."""
    parser = parser_of(__doc__)
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
        judged = cell_table(found).to_csv(index=False)
        write_text(options.out.parent / "tables" / "estimation.csv", judged)
        write_text(options.out, text)


if __name__ == "__main__":
    main()
