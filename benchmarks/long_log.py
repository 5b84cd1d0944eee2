"""What an hour of log costs: processor time and memory of `granite-lab ingest`, by a process of its own.

``python -m benchmarks.long_log [--minutes 60] [--courses trials straight winding] [--out FILE]``
"""

from __future__ import annotations

import argparse
import json
import platform
import resource
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from tests.truth.long_drives import Drive
from tests.truth.long_logs import COURSES, long_drive, write_log

TIME_LIMIT, MEMORY_LIMIT = 60.0, 1.5
"""For an hour: processor time [s], and the most memory held at a time [GB]."""

SAID = {
    "trials": "drives of 30 s on soft ground, a standstill after each, consumer IMU and vibration",
    "straight": "one drive straight ahead on firm, rough ground, standstill only at both ends",
    "winding": "the same, winding at a yaw rate of 0.2 rad/s (std)",
}


HEAD = (
    "| log | rows | size [MB] | processor time [s] | memory [GB] | RMSE of v [mm/s] | 2σ coverage of v [%] "
    "| error of the distance [%] |"
)


@dataclass(frozen=True)
class Cost:
    """What ingesting one log took, and how good the motion is.

    Attributes:
        course: which log.
        rows, size: of the file [-], [MB].
        time: processor time, with children's and the start of Python [s].
        memory: the most that was held [GB].
        rmse: of the velocity [m/s], at the IMU's stamps.
        coverage: share of velocities within two std.
        way: error of the distance [-].
    """

    course: str
    rows: int
    size: float
    time: float
    memory: float
    rmse: float
    coverage: float
    way: float


def measure(course: str, minutes: float, folder: Path) -> Cost:
    """Write a log, ingest it in a fresh process as a user would, and compare with the truth."""
    log = long_drive(course, 60.0 * minutes)
    path = folder / f"{course}.csv"
    write_log(path, log)
    command = [sys.executable, "-m", "benchmarks.long_log", "--ingest", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    used = json.loads(done.stdout.splitlines()[-1])
    rmse, coverage, way = quality(folder / "out" / f"{course}.csv", log)
    with path.open(encoding="utf-8") as file:
        rows = sum(1 for _ in file) - 2
    return Cost(course, rows, path.stat().st_size / 1e6, used["time"], used["memory"], rmse, coverage, way)


def quality(table: Path, log: Drive) -> tuple[float, float, float]:
    """RMSE of v [m/s], share within two std, relative error of the distance."""
    motion = pd.read_csv(table, usecols=["t_s", "x_m", "v_mps", "v_std_mps"])
    t = motion.t_s.to_numpy()
    error = motion.v_mps.to_numpy() - log.at(t, "v")
    within = np.abs(error) <= 2 * motion.v_std_mps.to_numpy()
    moving = log.at(t, "wheel") > 0
    travelled = float(np.trapezoid(log.v, log.t))
    way = float(motion.x_m.iloc[-1] - motion.x_m.iloc[0]) / travelled - 1.0
    return float(np.sqrt(np.mean(error**2))), float(np.mean(within[moving])), way


def ingest(path: Path) -> None:
    """Ingest a log as the command does, and print what this process took."""
    from granite_lab.cli import main as command_line  # noqa: PLC0415, the process that is measured

    sys.argv = [
        "granite-lab", "ingest", str(path), "--out", str(path.parent / "out"), "--quiet", "--json",
    ]  # fmt: skip
    code = 0
    try:
        command_line()
    except SystemExit as end:
        code = int(end.code or 0)
    if code:
        raise SystemExit(code)
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    time = sum(u.ru_utime + u.ru_stime for u in used)
    print(json.dumps({"time": time, "memory": max(u.ru_maxrss for u in used) / 2**20 * 1.073741824}))


def page(costs: list[Cost], minutes: float) -> str:
    """Return the page."""
    share = minutes / 60.0
    rows = [
        f"| {SAID[c.course]} | {c.rows} | {c.size:.0f} | {_flag(c.time, TIME_LIMIT * share, '.1f')} "
        f"| {_flag(c.memory, MEMORY_LIMIT, '.2f')} | {1e3 * c.rmse:.1f} | {100 * c.coverage:.0f} "
        f"| {100 * c.way:+.2f} |"
        for c in costs
    ]
    return f"""# Long logs

Written by `python -m benchmarks.long_log --minutes {minutes:g}`. {minutes:g} minutes of virtual log,
IMU 200 Hz and encoders 100 Hz in one CSV file (`tests/truth/long_logs.py`, by formula, with the truth), read,
estimated and written as a table by `granite-lab ingest` in a process of its own. Processor time, the
start of Python included; {platform.machine()}, Python {platform.python_version()}. Aim for an hour: at
most {TIME_LIMIT:g} s and {MEMORY_LIMIT:g} GB; bold: missed.

{HEAD}
|---|---|---|---|---|---|---|---|
{chr(10).join(rows)}

* All samples of the IMU are integrated, and the motion is told at each of its stamps. What is thinned, in
  motion of more than five minutes, are the nodes of the filter that estimates the *drift* of this
  integration: 60 000 at most, so every 12th sample (60 ms) of an hour's motion. Drift changes over seconds.
* Far from standstills (the second and the third log) velocity follows the wheels, less an assumed slip:
  see `docs/estimation.md`; its std says so. Coverage there is of one slip ratio, not of many.
* The table is formatted in blocks (`granite_lab/csv_rows.py`), to the letter as pandas does it.
"""


def _flag(value: float, limit: float, form: str) -> str:
    return f"{value:{form}}" if value <= limit else f"**{value:{form}}**"


def main() -> None:
    """Measure and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--courses", nargs="+", default=list(COURSES), choices=COURSES)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--ingest", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.ingest:
        ingest(args.ingest)
        return
    costs = []
    for course in args.courses:
        with tempfile.TemporaryDirectory() as folder:
            costs.append(measure(course, args.minutes, Path(folder)))
        print(costs[-1], file=sys.stderr, flush=True)
    text = page(costs, args.minutes)
    if args.out:
        args.out.write_text(text, encoding="utf-8")
    else:
        print(text)


if __name__ == "__main__":
    main()
