"""Do the inertial samples look like what their columns say they are?

A unit is judged by physics: gravity fixes the accelerometer's, and the turning of the gravity
vector fixes the gyroscope's. Unmistakable evidence corrects the unit, with a warning; the rest is
refused or reported.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from granite_lab.errors import InputError
from granite_lab.logs.trial import Array, ImuStream
from granite_lab.logs.units import STANDARD_GRAVITY
from granite_lab.parameters import Robot

WINDOW = 0.5
"""Length [s] of the windows over which vibration is averaged away."""

_GRAVITY_IN = {"m/s^2": 1.0, "g": STANDARD_GRAVITY, "mg": STANDARD_GRAVITY * 1e-3}
_DEG = math.pi / 180

TURNS = 2.0
"""A gyroscope turns at most so many times as far as gravity; a hundredth of it is read as rad/s in deg/s."""

FASTEST = 60.0
"""No ground robot's gyroscope reads more [rad/s]."""


class Windows(NamedTuple):
    """What K windows of an IMU show.

    Attributes:
        period: of the samples [s].
        mean: (K, 3) specific force [m/s^2].
        spread: (K,) of the specific force [m/s^2].
        turned: (K-1, 3) turning from one window to the next [rad].
        noise: (K,) spread of the rates [rad/s].
    """

    period: float
    mean: Array
    spread: Array
    turned: Array
    noise: Array


def check_imu(
    imu: ImuStream, robot: Robot, where: str, declared: tuple[str, str], doubts: list[str]
) -> ImuStream:
    """Check units, rails and dead axes of an IMU.

    Args:
        imu: as read.
        robot: its IMU's grade is the prior for noise and range.
        where: the file, for messages.
        declared: units that the columns were said to have, from which the stream was converted.
        doubts: warnings are added here.

    Returns:
        the stream with corrected units.

    Raises:
        InputError: an accelerometer in no unit that fits gravity.
    """
    seen = _windows(imu)
    if seen is not None:
        imu = _acceleration(imu, seen, where, declared[0], doubts)
    imu = _rate(imu, seen, robot, declared[1], doubts)
    doubts += _rails(imu, robot)
    return imu


def _windows(imu: ImuStream) -> Windows | None:
    """Average the stream over windows; None where it is too short or an axis is missing."""
    dt = float(np.median(np.diff(imu.t)))
    n = max(int(WINDOW / dt), 3)
    count = len(imu.t) // n
    if count < 4 or np.isnan(imu.specific_force).any():
        return None
    force = imu.specific_force[: count * n].reshape(count, n, 3)
    rate = np.nan_to_num(imu.angular_rate)
    rate = rate - np.median(rate, axis=0)
    angle = np.cumsum(rate, axis=0) * dt
    middle = angle[n // 2 : count * n : n][:count]
    noise = rate[: count * n].reshape(count, n, 3).std(axis=1).mean(axis=1)
    return Windows(dt, force.mean(axis=1), force.std(axis=1).max(axis=1), np.diff(middle, axis=0), noise)


def _acceleration(imu: ImuStream, seen: Windows, where: str, declared: str, doubts: list[str]) -> ImuStream:
    """Compare the mean specific force with gravity."""
    norm = np.linalg.norm(seen.mean, axis=1)
    calm = seen.spread <= np.quantile(seen.spread, 0.3)
    g, spread = float(np.median(norm[calm])), float(np.median(seen.spread[calm]))
    if abs(g / STANDARD_GRAVITY - 1) < 0.12:
        if imu.gravity_removed:
            doubts.append("gravity was said to be removed, but the accelerometer shows it; it is used")
        elif abs(g / STANDARD_GRAVITY - 1) > 0.06:
            doubts.append(f"the accelerometer reads {g:.2f} m/s^2 at rest, expected 9.81: scale error?")
        return dataclasses.replace(imu, gravity_removed=False)
    if imu.gravity_removed:
        return imu
    raw = g / _GRAVITY_IN.get(declared, 1.0)
    for unit, factor in _GRAVITY_IN.items():
        # In the right unit vibration at the calmest stays below gravity.
        change = factor / _GRAVITY_IN.get(declared, 1.0)
        if abs(raw * factor / STANDARD_GRAVITY - 1) < 0.08 and spread * change < 0.5 * STANDARD_GRAVITY:
            doubts.append(
                f"the accelerometer, declared in {declared}, reads {raw:.4g} at rest: "
                f"it is in {unit}; converted"
            )
            return dataclasses.replace(imu, specific_force=imu.specific_force * change)
    if g < 0.8:
        doubts.append(
            f"the accelerometer reads {g:.2g} m/s^2 at rest: the logger has removed gravity, "
            "so that pitch cannot be levelled"
        )
        return dataclasses.replace(imu, gravity_removed=True)
    raise InputError(
        f"{where}: the accelerometer, declared in {declared}, reads {raw:.4g} at rest, expected 9.81 m/s^2, "
        "1 g, 1000 mg or, with gravity removed, 0",
        "correct the unit in the column's name, or give its scale in a column map",
    )


def _rate(imu: ImuStream, seen: Windows | None, robot: Robot, declared: str, doubts: list[str]) -> ImuStream:
    """Compare the gyroscope with the turning of the gravity vector and with the grade's noise."""
    if np.isnan(imu.angular_rate).all():
        return imu
    peak = float(np.nanmax(np.abs(imu.angular_rate)))
    turning = math.nan if imu.gravity_removed or seen is None else _turning_ratio(seen)
    # The turning of the gravity vector, as the accelerometer sees it, contains all of the true turning:
    # a ratio beyond 1 is impossible. Vibration and acceleration lower it to a few hundredths on flat ground
    # (0.06 to 1.1 in logs of a rover on sand, a Husky on sand and snow, and a car).
    too_large = turning > TURNS or (math.isnan(turning) and peak > FASTEST)
    too_small = turning < TURNS / 100 and seen is not None and not _noise_ratio(seen, robot) > 1 / 15
    why = f"it turns {turning:.3g} times as far as gravity does"
    why = f"it reads up to {peak:.0f} rad/s" if math.isnan(turning) else why
    if (too_large and declared == "rad/s") or (too_small and declared == "deg/s"):
        found, factor = ("deg/s", _DEG) if too_large else ("rad/s", 1 / _DEG)
        doubts.append(f"the gyroscope, declared in {declared}, is in {found} ({why}); converted")
        return dataclasses.replace(imu, angular_rate=imu.angular_rate * factor)
    if too_large:
        doubts.append(f"the gyroscope, declared in {declared}, is far too lively ({why}): wrong unit?")
    return imu


def _turning_ratio(seen: Windows) -> float:
    """Return how far the gyroscope turns relative to the gravity vector, NaN if unknown.

    The larger of two comparisons, by root mean square and by median: on smooth ground a few ramps
    would drown the turning in the first, while the noise of rest and steady drive rules the second.
    """
    up = seen.mean / np.linalg.norm(seen.mean, axis=1, keepdims=True)
    moved = np.diff(up, axis=0)
    # Only turning about axes across gravity moves the gravity vector.
    across = np.cross(seen.turned, (up[1:] + up[:-1]) / 2)
    turned, tilted = np.linalg.norm(across, axis=1), np.linalg.norm(moved, axis=1)
    if np.median(tilted) < 1e-6 or np.median(turned) < 1e-12:
        return math.nan  # a dead sensor says nothing about units
    by_square = float(np.sqrt((turned**2).mean() / (tilted**2).mean()))
    return max(by_square, float(np.median(turned) / np.median(tilted)))


def _noise_ratio(seen: Windows, robot: Robot) -> float:
    """Return the gyroscope's noise at rest over that of the robot's grade, NaN without a rest."""
    grade, quietest = robot.imu_grade, float(np.quantile(seen.noise, 0.1))
    # Without a rest the quietest windows are hardly quieter than the others.
    if grade is None or grade.gyro_noise == 0 or not 0 < quietest <= 0.3 * float(np.median(seen.noise)):
        return math.nan
    return quietest / math.hypot(
        grade.gyro_noise * math.sqrt(0.5 / seen.period), grade.gyro_step / math.sqrt(12)
    )


def _rails(imu: ImuStream, robot: Robot) -> list[str]:
    """Report axes that stay at the end of their range, and axes that never change."""
    doubts = []
    grade = robot.imu_grade
    for what, unit, values, limit in (
        ("accelerometer", "m/s^2", imu.specific_force, grade.accel_range if grade else math.inf),
        ("gyroscope", "rad/s", imu.angular_rate, grade.gyro_range if grade else math.inf),
    ):
        for axis, column in zip("xyz", values.T, strict=True):
            if np.isnan(column).all():
                continue
            if np.ptp(column) == 0 and len(column) > 10:
                doubts.append(f"{what} {axis}: constant at {column[0]:g} {unit}: not connected?")
                continue
            at_rail = _rail(column, limit)
            if at_rail.any():
                first = imu.t[int(np.argmax(at_rail))]
                doubts.append(
                    f"{what} {axis}: saturated at {column[at_rail][0]:.4g} {unit} in "
                    f"{int(at_rail.sum())} samples, first at t = {first:.3f} s"
                )
    return doubts


def _rail(column: Array, limit: float) -> np.ndarray:
    """Return which samples sit at a rail: the known one, or an extreme value held for a while."""
    at_rail = np.abs(column) >= 0.999 * limit
    low, middle, high = np.quantile(column, [0.16, 0.5, 0.84])
    for extreme in (column.max(), column.min()):
        held = column == extreme
        runs = held[2:] & held[1:-1] & held[:-2]
        if runs.any() and abs(extreme - middle) > 4 * (high - low) / 2 and high > low:
            at_rail |= held
    return np.asarray(at_rail)
