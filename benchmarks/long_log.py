"""What an hour of log costs: processor time and memory of `granite-lab ingest`, by a process of its own.

``python -m benchmarks.long_log [--minutes 60] [--out FILE]``
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.against_truth import table
from benchmarks.blind_code import commit
from benchmarks.command_line import parser_of
from granite_lab.files import write_text
from granite_lab.logs import write_canonical
from tests.truth.long_logs import LEVER, SEED, Drive, drive, repeated, wander

TIME_LIMIT, MEMORY_LIMIT = 60.0, 1.5
"""For an hour: processor time [s], and the most memory held at a time [GB]."""

COURSES = {
    "trials": "drives of 30 s on soft ground, a standstill after each, consumer IMU and vibration",
    "straight": "one drive straight ahead on firm, rough ground, standstill only at both ends",
    "winding": "the same, winding at a yaw rate of 0.2 rad/s (std)",
}


@dataclass(frozen=True)
class Cost:
    """What ingesting one log took, and how good the motion is.

    Attributes:
        course: which log.
        size: of the file [MB].
        time: processor time, with the start of Python [s].
        memory: the most that was held [GB].
        rmse: of the velocity [m/s], at the IMU's stamps.
        coverage: share of velocities within two std.
        way: relative error of the distance.
    """

    course: str
    size: float
    time: float
    memory: float
    rmse: float
    coverage: float
    way: float


def driven(course: str, duration: float) -> Drive:
    """Drive one of the courses for some time [s]."""
    if course == "trials":
        return repeated(duration)
    # the driver does not keep one speed for an hour
    instants = np.arange(20.0, duration - 20.0, 20.0)
    speeds = np.random.default_rng(SEED).uniform(0.3, 0.7, instants.size)
    points = [(0.0, 0.0), (3.0, 0.0), (4.0, 0.5), *zip(instants.tolist(), speeds.tolist(), strict=True)]
    straight = drive(SEED, [*points, (duration - 3.0, 0.5), (duration - 2.0, 0.0), (duration, 0.0)])
    return turning(straight) if course == "winding" else straight


def turning(straight: Drive) -> Drive:
    """Let a drive wind: yaw rate of 0.2 rad/s (std) while it moves, R without sideways velocity."""
    imu = straight.trial.imu
    assert imu is not None
    rng = np.random.default_rng(SEED + 1)
    yaw = wander(rng, straight.t.size, 0.2, 2.0) * np.minimum(np.abs(straight.v) / 0.2, 1.0)
    growth = np.gradient(yaw, straight.t)
    r, dr, v = (np.interp(imu.t, straight.t, signal) for signal in (yaw, growth, straight.v))
    rate, force = imu.angular_rate.copy(), imu.specific_force.copy()
    rate[:, 2] += r
    force[:, 0] -= r**2 * LEVER[0]
    force[:, 1] += r * v + dr * LEVER[0]
    imu = replace(imu, angular_rate=rate, specific_force=force)
    return replace(straight, trial=replace(straight.trial, imu=imu))


def measure(course: str, minutes: float, folder: Path) -> Cost:
    """Write a log, ingest it as a user would, and compare with the truth."""
    log = driven(course, 60.0 * minutes)
    path, out = folder / f"{course}.csv", folder / "out"
    write_canonical(path, log.trial)
    start = "from granite_lab.cli import main; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", start, "ingest", str(path), "--out", str(out), "--quiet", "--json"],
        stdout=subprocess.DEVNULL,
    )
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(process.returncode)
    memory = used.ru_maxrss * 1024 / 1e9  # counted in KiB by Linux
    time = used.ru_utime + used.ru_stime
    return Cost(course, path.stat().st_size / 1e6, time, memory, *quality(out / f"{course}.csv", log))


def quality(motion_table: Path, log: Drive) -> tuple[float, float, float]:
    """RMSE of v [m/s], share within two std in motion, relative error of the distance."""
    motion = pd.read_csv(motion_table, usecols=["t_s", "x_m", "v_mps", "v_std_mps"])
    t = motion.t_s.to_numpy()
    error = motion.v_mps.to_numpy() - log.at(t, "v")
    within = np.abs(error) <= 2 * motion.v_std_mps.to_numpy()
    moving = log.at(t, "wheel") > 0
    travelled = float(np.trapezoid(log.v, log.t))
    way = float(motion.x_m.iloc[-1] - motion.x_m.iloc[0]) / travelled - 1.0
    return float(np.sqrt(np.mean(error**2))), float(np.mean(within[moving])), way


def page(costs: list[Cost], minutes: float) -> str:
    """Return the page."""
    share = minutes / 60.0
    rows = [
        [
            COURSES[c.course], f"{c.size:.0f}", _flag(c.time, TIME_LIMIT * share, ".1f"),
            _flag(c.memory, MEMORY_LIMIT, ".2f"),
            *(
                (f"{1e3 * c.rmse:.1f}", f"{100 * c.coverage:.0f}", f"{100 * c.way:+.2f}")
                if np.isfinite(c.rmse)
                else ["**NaN**"] * 3
            ),
        ]
        for c in costs
    ]  # fmt: skip
    head = (
        "log", "size [MB]", "processor time [s]", "memory [GB]", "RMSE of v [mm/s]", "in 2σ [%]",
        "error of the distance [%]",
    )  # fmt: skip
    unknown = (
        " NaN: the estimate is no number; rounding has made its covariance indefinite."
        if any(np.isnan(c.rmse) for c in costs)
        else ""
    )
    times, memory = [c.time for c in costs], max(c.memory for c in costs)
    machine = f"{platform.machine()}, Python {platform.python_version()}"
    return f"""# Long logs

{minutes:g} minutes of log take {min(times):.0f} to {max(times):.0f} s of processor time and at most
{memory:.2f} GB of memory (aims for an hour: {TIME_LIMIT:g} s, {MEMORY_LIMIT:g} GB; bold: missed).{unknown}

{table(head, rows)}
Method: virtual logs (`tests/truth/long_logs.py`), IMU 200 Hz and encoders 100 Hz in one CSV file, by
`granite-lab ingest` in a process of its own with the start of Python ({machine}). Far
from standstills (second and third log) the velocity follows the wheels minus an assumed slip.

Written by `python -m benchmarks.long_log --minutes {minutes:g} --out FILE`, code {commit()}.
"""


def _flag(value: float, limit: float, form: str) -> str:
    return f"{value:{form}}" if value <= limit else f"**{value:{form}}**"


def main() -> None:
    """Measure and write the page."""
    parser = parser_of(__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--courses", nargs="+", default=list(COURSES), choices=COURSES)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    costs = []
    for course in args.courses:
        with tempfile.TemporaryDirectory() as folder:
            costs.append(measure(course, args.minutes, Path(folder)))
        print(costs[-1], file=sys.stderr, flush=True)
    text = page(costs, args.minutes)
    if args.out:
        write_text(args.out, text)
    else:
        print(text)


if __name__ == "__main__":
    main()
