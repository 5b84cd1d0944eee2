"""The checks of a log after a run in the field: sensors, standstills, speed, slip, estimate."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from granite_lab import estimation
from granite_lab.chain import read, soil_of
from granite_lab.errors import EstimateError, InputError, LabError
from granite_lab.estimation.motion import Motion
from granite_lab.estimation.straight import OFF
from granite_lab.logs.counters import mean_known
from granite_lab.logs.sensors.standstill import COAST, inside
from granite_lab.logs.trial import Array, Trial
from granite_lab.options import Options
from granite_lab.processes import one_thread
from granite_lab.rounding import percent_of
from granite_lab.shown import Shown, frame

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


@dataclass(frozen=True)
class Check:
    """One thing that was checked, whether it passed, what was found, and what to do where it failed."""

    name: str
    good: bool
    found: str
    advice: str = ""


@dataclass(frozen=True)
class Checked(Shown):
    """What was checked in a log.

    Attributes:
        log: its path.
        virtual: a simulator wrote it.
        checks: in the order in which they were made; what a failure makes impossible is not there.
        grade: of the estimate, as `ingest` has it; empty where there is none.
        unusable: the log cannot be used, or a sensor does not work; otherwise what failed is the run.
    """

    log: Path
    virtual: bool
    checks: tuple[Check, ...]
    grade: str = ""
    unusable: bool = False

    def __repr__(self) -> str:
        return f"Checked({self.log.name}: {'good' if self.good else 'BAD'}, {self.reason})"

    @property
    def good(self) -> bool:
        """All checks passed."""
        return all(check.good for check in self.checks)

    @property
    def reason(self) -> str:
        """What failed, or speed, slip ratio and grade of the estimate of a good run."""
        if not self.good:
            return "; ".join(f"{check.name}: {check.found}" for check in self.checks if not check.good)
        parts = [check.found for check in self.checks if check.name in ("speed", "slip")]
        return "; ".join([*parts, f"estimate {self.grade}"])

    @property
    def error(self) -> LabError | None:
        """None where all checks passed; else what the command ends with."""
        bad = [check for check in self.checks if not check.good]
        if not bad:
            return None
        kind: type[LabError] = InputError if self.unusable else EstimateError
        if len(self.checks) == 1:  # the log cannot be read
            return kind(bad[0].found, bad[0].advice)
        failed = ", ".join(dict.fromkeys(check.name for check in bad))
        return kind(f"{self.log}: failed: {failed}", bad[0].advice)

    def to_frame(self) -> pd.DataFrame:
        """Return one row a check."""
        return frame([asdict(check) for check in self.checks])


def unread(path: Path, error: LabError) -> Checked:
    """Return the only check of a log that cannot be used, which failed."""
    return Checked(path, False, (Check("log", False, error.message, error.hint),), unusable=True)


def check_run(path: Path, options: Options) -> Checked:
    """Check one log; raises nothing that is the log's fault."""
    try:
        trial, robot = read(path, options)
    except InputError as error:
        return unread(path, error)
    checks, grade = [_log(trial), *_sensors(trial)], ""
    unusable = not all(check.good for check in checks)
    try:
        with one_thread():
            motion = estimation.correct(trial, robot, soil=soil_of(trial, options.soil))[1]
        checks += _motion(motion, trial)
        grade = motion.health.grade
    except EstimateError as error:
        checks.append(Check("estimate", False, error.message, error.hint))
    except InputError as error:
        unusable = True
        checks.append(Check("log", False, error.message, error.hint))
    return Checked(path, trial.info.virtual, tuple(checks), grade, unusable)


def _log(trial: Trial) -> Check:
    spans = [s.t for s in (trial.imu, trial.wheels, trial.currents) if s is not None and len(s.t) > 1]
    seconds = max(t[-1] for t in spans) - min(t[0] for t in spans) if spans else 0.0
    dead = [str(doubt) for doubt in trial.doubts if doubt.dead]
    if dead:
        return Check("log", False, "; ".join(dead), "check plug and driver of the sensor")
    doubts = f"; warnings: {len(trial.warnings)}, see granite-lab inspect" if trial.warnings else ""
    finding = f"read, {seconds:.1f} s, layout {trial.layout}{doubts}"
    return Check("log", bool(seconds > 0), finding, "log a whole run")


def _sensors(trial: Trial) -> Iterator[Check]:
    """Say of each sensor whether it was logged, and what it shows; `_log` names dead channels."""
    imu, wheels, currents = trial.imu, trial.wheels, trial.currents
    if imu is None:
        yield Check("IMU", False, "not in the log", "check plug, driver and topic of the IMU")
    else:
        size = float(np.nanmedian(np.linalg.norm(imu.specific_force, axis=1)))
        good = imu.gravity_removed or not math.isfinite(size) or GRAVITY[0] < size < GRAVITY[1]
        finding = _rate(imu.t) if good else f"magnitude at rest {size:.2f} m/s², not 9.81"
        yield Check("IMU", good, finding, "check range and unit of the IMU")
    if wheels is None:
        yield Check("encoders", False, "not in the log", "check plugs and driver of the encoders")
    else:
        turns = any(
            np.ptp(angle[np.isfinite(angle)]) > 0 for angle in wheels.angle.T if np.isfinite(angle).any()
        )
        finding = _rate(wheels.t) if turns else "no wheel turns"
        advice = "check plugs of the encoders, and whether the robot drove"
        yield Check("encoders", turns, finding, advice)
    if currents is not None:
        yield Check("currents", True, _rate(currents.t))


def _rate(t: Array) -> str:
    return f"{1 / float(np.median(np.diff(t))):.0f} Hz" if len(t) > 1 else "one sample"


def _motion(motion: Motion, trial: Trial) -> Iterator[Check]:
    """Say of the motion what a trial needs to be of use."""
    for warning in (line for line in motion.warnings if f": {OFF}; " in line):
        yield Check("course", False, warning.split(f": {OFF}; ")[0], warning.split("; ")[-1])
    step, pace = np.gradient(motion.t), np.abs(mean_known(motion.v_wheel))
    stands = inside(motion.t, motion.health.rests) | (pace < COAST)
    middle = np.nan_to_num(0.5 * sum(motion.steady), nan=0.5 * float(motion.t[0] + motion.t[-1]))
    first, last = (float(step[stands & side].sum()) for side in (motion.t < middle, motion.t >= middle))
    finding = f"{first:.1f} s before the run, {last:.1f} s after it, {REST:g} s are needed"
    advice = "let the robot stand still for 2 s before and after the run"
    yield Check("standstills", min(first, last) >= REST, finding, advice)
    speeds = motion.v_wheel[(motion.t >= motion.steady[0]) & (motion.t <= motion.steady[1])]
    speeds = speeds[np.isfinite(speeds)]
    speed = float(speeds.mean()) if speeds.size else math.nan
    measured = motion.variant_source == "measured"
    wanted = trial.info.v_desired or (None if measured else motion.variant.velocity)
    desired = f", desired {wanted:g} m/s" if wanted else "; the log does not say which is desired"
    finding = f"wheels {speed:.3f} m/s{desired}, for {motion.steady[1] - motion.steady[0]:.1f} s"
    good = math.isfinite(speed) and (wanted is None or abs(speed - wanted) <= SPEED * wanted)
    advice = "check the command, the battery and the current limit"
    yield Check("speed", good, finding if math.isfinite(speed) else "no part at constant speed", advice)
    slip = motion.slip_ratio
    low, high = slip.interval()
    usual = f"usual: {100 * SLIP[0]:.0f} to {100 * SLIP[1]:.0f} %"
    finding = f"λ_R {percent_of(slip)}, {usual}"
    advice = "check wheel radius, unit of the encoders and mounting of the IMU"
    known = math.isfinite(slip.value) and not slip.std >= 1.0
    good = bool(known and low <= SLIP[1] and high >= SLIP[0])
    yield Check("slip", good, finding if known else "not known", advice)
    health = motion.health
    yield Check("estimate", health.grade != "poor", health.verdict, "look at the report of granite-lab study")
