"""The check of a log after a run in the field: is it good, and if not, what is to be done?"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from granite_lab import estimation
from granite_lab.errors import EstimateError, InputError, LabError
from granite_lab.estimation.motion import Motion
from granite_lab.logs.named import is_bag
from granite_lab.logs.trial import Array, Trial
from granite_lab.parameters import WHEELS
from granite_lab.processes import one_thread
from granite_lab.running import Options
from granite_lab.running.options import read
from granite_lab.shown import frame

if TYPE_CHECKING:
    import pandas as pd

REST = 0.5
"""Shortest standstill at either end that anchors the velocity [s]."""
SPEED = 0.05
"""Largest difference of the wheels' mean speed from the desired one, as a share."""
SLIP = (0.0, 0.5)
"""Slip ratios that a light robot has on level sand."""
GRAVITY = (9.3, 10.3)
"""Mean magnitude of the specific force at rest, whatever the axes [m/s^2]."""
SHARE = 0.2
"""Least travel of a wheel, as a share of the wheel that travels farthest."""


@dataclass(frozen=True)
class Check:
    """One thing that was checked.

    Attributes:
        name: of the check.
        good: it passed.
        found: what was found, in one line.
        advice: what to do where it failed.
    """

    name: str
    good: bool
    found: str
    advice: str = ""


@dataclass(frozen=True)
class Checked:
    """What was checked in a log.

    Attributes:
        log: its path.
        virtual: a simulator wrote it.
        checks: in the order in which they were made; what a failure makes impossible is not there.
        error: None where all checks passed; else what the command ends with.
    """

    log: Path
    virtual: bool
    checks: tuple[Check, ...]
    error: LabError | None = None

    @property
    def good(self) -> bool:
        """All checks passed."""
        return self.error is None

    def to_frame(self) -> pd.DataFrame:
        """Return one row a check."""
        return frame([asdict(check) for check in self.checks])


def check_log(path: Path, options: Options) -> Checked:
    """Check one log.

    Args:
        path: of the log.
        options: how it is read.
    """
    try:
        trial, robot = read(path, options)
    except InputError as error:
        return Checked(path, False, (Check("log", False, error.message, error.hint),), error)
    checks = [_log(trial, path), *_sensors(trial)]
    failed: type[LabError] = InputError if not all(c.good for c in checks) else EstimateError
    try:
        with one_thread():
            checks += _motion(estimation.correct(trial, robot)[1], trial)
    except EstimateError as error:
        checks.append(Check("estimate", False, error.message, error.hint))
    except InputError as error:
        failed = InputError
        checks.append(Check("log", False, error.message, error.hint))
    bad = [c for c in checks if not c.good]
    told = f"{path}: failed: {', '.join(dict.fromkeys(c.name for c in bad))}"
    end = failed(told, bad[0].advice) if bad else None
    return Checked(path, trial.info.virtual, tuple(checks), end)


def _log(trial: Trial, path: Path) -> Check:
    from granite_lab.logs.streams import ZERO  # noqa: PLC0415, heavy

    spans = [s.t for s in (trial.imu, trial.wheels, trial.currents) if s is not None and len(s.t) > 1]
    seconds = max(t[-1] for t in spans) - min(t[0] for t in spans) if spans else 0.0
    dead = [line for line in trial.warnings if line.endswith(ZERO)]
    if dead and not is_bag(path):  # messages of ROS hold zeros where nothing is measured
        return Check("log", False, "; ".join(dead), "check plug and driver of the sensor")
    doubts = f"; warnings: {len(trial.warnings)}, see granite-lab inspect" if trial.warnings else ""
    found = f"read, {seconds:.1f} s, layout {trial.layout}{doubts}"
    return Check("log", bool(seconds > 0), found, "log a whole run")


def _sensors(trial: Trial) -> Iterator[Check]:
    """Say of each sensor whether its channels hold numbers that change."""
    imu, wheels, currents = trial.imu, trial.wheels, trial.currents
    if imu is not None:
        names = [f"{kind} {axis}" for kind in ("acceleration", "rate") for axis in "xyz"]
        values = np.hstack([imu.specific_force, imu.angular_rate]).T
        dead = [n for n, x in zip(names, values, strict=True) if np.isfinite(x).any() and not _travel(x)]
        size = float(np.nanmedian(np.linalg.norm(imu.specific_force, axis=1)))
        heavy = imu.gravity_removed or not math.isfinite(size) or GRAVITY[0] < size < GRAVITY[1]
        found = f"constant: {', '.join(dead)}" if dead else f"{_rate(imu.t)}, all channels change"
        found += "" if heavy else f"; magnitude at rest {size:.2f} m/s², not 9.81"
        yield Check("IMU", not dead and heavy, found, "check plug, range and unit of the IMU")
    else:
        yield Check("IMU", False, "not in the log", "check plug, driver and topic of the IMU")
    if wheels is not None:
        travel = {n: _travel(angle) for n, angle in zip(WHEELS, wheels.angle.T, strict=True)}
        still = [n for n, x in travel.items() if not x > SHARE * max(travel.values())]
        found = f"no motion: {', '.join(still)}" if still else f"{_rate(wheels.t)}, all four wheels turn"
        advice = "check plugs of the encoders, and whether the robot drove"
        yield Check("encoders", not still, found, advice)
    else:
        yield Check("encoders", False, "not in the log", "check plugs and driver of the encoders")
    if currents is not None:
        flat = [n for n, c in zip(WHEELS, currents.current.T, strict=True) if not _travel(c)]
        found = f"constant: {', '.join(flat)}" if flat else f"{_rate(currents.t)}, all four motors draw"
        yield Check("currents", not flat, found, "check the current sensors")


def _travel(value: Array) -> float:
    """Return how far the known values of a channel reach, 0 where fewer than two are known."""
    known = value[np.isfinite(value)]
    return float(np.ptp(known)) if known.size else 0.0


def _rate(t: Array) -> str:
    return f"{1 / float(np.median(np.diff(t))):.0f} Hz" if len(t) > 1 else "one sample"


def _motion(motion: Motion, trial: Trial) -> Iterator[Check]:
    """Say of the motion what a trial needs to be of use."""
    ends = (motion.t[0], motion.t[-1])
    first = sum(b - a for a, b in motion.health.rests if b <= motion.steady[0] or a <= ends[0] + REST)
    last = sum(b - a for a, b in motion.health.rests if a >= motion.steady[1] or b >= ends[1] - REST)
    yield Check(
        "standstills",
        min(first, last) >= REST,
        f"{first:.1f} s before the run, {last:.1f} s after it, {REST:g} s are needed",
        "let the robot stand still for 2 s before and after the run",
    )
    speeds = motion.v_wheel[(motion.t >= motion.steady[0]) & (motion.t <= motion.steady[1])]
    speeds = speeds[np.isfinite(speeds)]
    speed = float(speeds.mean()) if speeds.size else math.nan
    wanted = trial.info.v_desired or (
        motion.variant.velocity if motion.variant_source != "measured" else None
    )
    said = f", desired {wanted:g} m/s" if wanted else "; the log does not say which is desired"
    yield Check(
        "speed",
        math.isfinite(speed) and (wanted is None or abs(speed - wanted) <= SPEED * wanted),
        f"wheels {speed:.3f} m/s{said}, for {motion.steady[1] - motion.steady[0]:.1f} s"
        if math.isfinite(speed)
        else "no part at constant speed",
        "check the command, the battery and the current limit",
    )
    slip = motion.slip_ratio
    low, high = slip.interval()
    usual = f"usual: {100 * SLIP[0]:.0f} to {100 * SLIP[1]:.0f} %"
    known = f"λ_R {100 * slip.value:.1f} ± {100 * slip.std:.1f} %, {usual}"
    yield Check(
        "slip",
        bool(low <= SLIP[1] and high >= SLIP[0]),
        known if math.isfinite(slip.value) else "not known",
        "check wheel radius, unit of the encoders and mounting of the IMU",
    )
    health = motion.health
    yield Check("estimate", health.grade != "poor", health.verdict, "look at the report of granite-lab study")
