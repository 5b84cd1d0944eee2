"""`check`: whether a run in the field was good, before the robot is moved on."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import numpy as np

from granite_lab import estimation
from granite_lab.api.calls import checked
from granite_lab.api.project import About, choose
from granite_lab.errors import EstimateError, InputError, LabError, UsageError
from granite_lab.estimation.motion import Motion
from granite_lab.logs.named import is_bag
from granite_lab.logs.trial import Array, Trial
from granite_lab.parameters import WHEELS
from granite_lab.processes import one_thread
from granite_lab.running.options import read

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
        import pandas as pd  # noqa: PLC0415

        return pd.DataFrame([asdict(check) for check in self.checks])


@checked
def check(log: str | Path, **said: Unpack[About]) -> Checked:
    """Check a log after a run in the field: readable, sensors, standstills, speed, slip, estimate.

    A log that cannot be used is reported as a failed check.

    Args:
        log: path of the log.

    Returns:
        the checks; the table has a row for each.

    Raises:
        UsageError: unknown robot or column map, or a folder of several logs.
    """
    choice = choose(log, said, everything=True)
    if len(choice.files) > 1:
        raise UsageError(f"{log}: {len(choice.files)} logs", "check one after the other")
    path, options = choice.files[0], choice.options
    try:
        trial, robot = read(path, options)
    except InputError as error:
        return Checked(path, False, (Check("log", False, error.message, error.hint),), error)
    checks = [_log(trial, path), *_sensors(trial)]
    failed = InputError if not all(c.good for c in checks) else EstimateError
    try:
        with one_thread():
            checks += _motion(estimation.correct(trial, robot)[1], trial)
    except (InputError, EstimateError) as error:
        if isinstance(error, InputError):
            failed = InputError
        what = "log" if isinstance(error, InputError) else "estimate"
        checks.append(Check(what, False, error.message, error.hint))
    bad = [c for c in checks if not c.good]
    if not bad:
        return Checked(path, trial.info.virtual, tuple(checks))
    told = f"{path}: failed: {', '.join(dict.fromkeys(c.name for c in bad))}"
    return Checked(path, trial.info.virtual, tuple(checks), failed(told, bad[0].advice))


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
    if imu is None:
        yield Check("IMU", False, "not in the log", "check plug, driver and topic of the IMU")
    else:
        dead = [
            f"{kind} {axis}"
            for kind, values in (("acceleration", imu.specific_force), ("rate", imu.angular_rate))
            for axis, value in zip("xyz", values.T, strict=True)
            if np.isfinite(value).any() and not _changes(value)
        ]
        size = float(np.nanmedian(np.linalg.norm(imu.specific_force, axis=1)))
        heavy = imu.gravity_removed or not math.isfinite(size) or GRAVITY[0] < size < GRAVITY[1]
        found = f"constant: {', '.join(dead)}" if dead else f"{_rate(imu.t)}, all channels change"
        if not heavy:
            found += f"; magnitude at rest {size:.2f} m/s², not 9.81"
        yield Check("IMU", not dead and heavy, found, "check plug, range and unit of the IMU")
    if wheels is None:
        yield Check("encoders", False, "not in the log", "check plugs and driver of the encoders")
    else:
        travel = [float(np.ptp(a[np.isfinite(a)])) if np.isfinite(a).any() else 0.0 for a in wheels.angle.T]
        still = [n for n, x in zip(WHEELS, travel, strict=True) if not x > SHARE * max(travel)]
        yield Check(
            "encoders",
            not still,
            f"no motion: {', '.join(still)}" if still else f"{_rate(wheels.t)}, all four wheels turn",
            "check plugs of the encoders, and whether the robot drove",
        )
    if currents is not None:
        flat = [n for n, c in zip(WHEELS, currents.current.T, strict=True) if not _changes(c)]
        yield Check(
            "currents",
            not flat,
            f"constant: {', '.join(flat)}" if flat else f"{_rate(currents.t)}, all four motors draw",
            "check the current sensors",
        )


def _changes(value: Array) -> bool:
    known = value[np.isfinite(value)]
    return known.size > 1 and float(np.ptp(known)) > 0


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
    steady = (motion.t >= motion.steady[0]) & (motion.t <= motion.steady[1])
    speeds = motion.v_wheel[steady]
    known = np.isfinite(speeds)
    speed = float(speeds[known].mean()) if known.any() else math.nan
    wanted = trial.info.v_desired or (
        motion.variant.velocity if motion.variant_source != "measured" else None
    )
    yield Check(
        "speed",
        math.isfinite(speed) and (wanted is None or abs(speed - wanted) <= SPEED * wanted),
        "no part at constant speed"
        if not math.isfinite(speed)
        else f"wheels {speed:.3f} m/s"
        + (f", desired {wanted:g} m/s" if wanted else "; the log does not say which is desired")
        + f", for {motion.steady[1] - motion.steady[0]:.1f} s",
        "check the command, the battery and the current limit",
    )
    slip = motion.slip_ratio
    low, high = slip.interval()
    yield Check(
        "slip",
        bool(low <= SLIP[1] and high >= SLIP[0]),
        f"λ_R {100 * slip.value:.1f} ± {100 * slip.std:.1f} %, "
        f"usual: {100 * SLIP[0]:.0f} to {100 * SLIP[1]:.0f} %"
        if math.isfinite(slip.value)
        else "not known",
        "check wheel radius, unit of the encoders and mounting of the IMU",
    )
    health = motion.health
    yield Check("estimate", health.grade != "poor", health.verdict, "look at the report of granite-lab study")
