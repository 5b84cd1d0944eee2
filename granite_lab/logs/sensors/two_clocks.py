"""Clocks that are seconds apart, as those of two computers: found before anything compares the sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from granite_lab.estimate import Estimate
from granite_lab.logs.counters import interpolated
from granite_lab.logs.sensors import mounting
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.sensors.imu import despike, mounted
from granite_lab.logs.sensors.mounting import BodyImu
from granite_lab.logs.sensors.ramps import LARGEST, LEAST_RAMP, STEP, changing, correlate
from granite_lab.logs.trial import Array, Trial, WheelStream
from granite_lab.parameters import Robot

FARTHEST = 1.0
"""Offsets up to this are searched for where odometry was smoothed [s]."""

GIVEN = 1.0e-3
"""Std of an offset that was given [s]."""

LONGEST_LAG = 0.25
"""The body follows the wheels on sand by up to a quarter of a second, and never leads them [s]."""

SEEN = 0.5
"""Correlation at which the offset of smoothed odometry, or of two computers, counts as found."""

RIVAL = 0.9
"""Another offset whose correlation is this share of the largest one explains the ramps as well."""

DISTINCT = 0.5
"""Offsets that are closer than this belong to one peak of the correlation: a ramp takes about as long [s]."""


def synchronize_roughly(trial: Trial, robot: Robot) -> tuple[Trial, float]:
    """Synchronize the clocks of IMU and encoders where their offset is given, or where it is of seconds.

    Returns:
        the trial, in which encoders, currents and command are moved; by how much [s], 0 where nothing is.
    """
    given, doubts = trial.info.clock_offset, trial.doubts
    if given is not None:
        by = given
    elif trial.imu is not None and trial.wheels is not None and trial.wheels.t.size > 2:
        imu = mounting.to_body(despike(trial.imu)[0], mounted(robot))
        forward = robot.imu.forward != "find" or trial.imu.robot_axes
        by = gross_offset(imu, trial.wheels, robot.wheels.radius, forward_given=forward).value
    else:
        return trial, 0.0
    if by == 0.0:
        return trial, by
    if given is None:
        apart = f"the clocks of encoders and IMU are {abs(by):.1f} s apart"
        doubts = (*doubts, Doubt(apart, remedy="brought together by the ramps that both show"))
    moved = replace(
        trial,
        info=replace(trial.info, clock_offset=None if given is None else 0.0),
        **trial.on_its_clock(by),
        doubts=doubts,
    )
    return moved, by


def gross_offset(imu: BodyImu, wheels: WheelStream, radius: float, *, forward_given: bool) -> Estimate:
    """Find an offset of seconds, as between two computers, by the ramps that wheels and IMU both show.

    The wheels' common acceleration and the horizontal specific force are correlated over all lags at which
    both sensors cover each other by half. The sign does not count: encoders may count backwards. An axis that
    is not known to point forward is taken with the other one.

    Args:
        imu: samples in robot axes.
        wheels: encoders on their own clock.
        radius: of the wheels [m].
        forward_given: the forward axis is that of the robot.

    Returns:
        how far the encoders' clock lies behind the IMU's [s]; 0 with a std of 0 where an offset within
        `LARGEST` explains the ramps as well, which `find_offset` refines; std NaN where none is found.
    """
    grids = [np.arange(t[0], t[-1], STEP) for t in (imu.t, wheels.t)]  # the clocks may be years apart
    wheel = changing(np.gradient(radius * _common_rate(grids[1], wheels), STEP))
    axes = [imu.forward] if forward_given else [imu.forward, imu.left]
    force = [changing(interpolated(grids[0], imu.t, x)) for x in axes if np.isfinite(x).any()]
    if not force or float(np.max(np.abs(wheel), initial=0.0)) < LEAST_RAMP:
        return Estimate(0.0)
    half = min(len(grid) for grid in grids) // 2
    reach = max(len(grid) for grid in grids) - half
    values = np.sqrt(np.sum([correlate(f, wheel, reach)[0] ** 2 for f in force], axis=0))
    values /= np.sqrt(np.sum(np.square(force)) * np.sum(wheel**2))
    lags = np.arange(-reach, reach + 1)
    covered = (lags <= len(grids[0]) - half) & (-lags <= len(grids[1]) - half)
    values, offsets = values[covered], STEP * lags[covered] + imu.t[0] - wheels.t[0]
    best = int(np.argmax(values))
    if values[np.abs(offsets) <= LARGEST].max(initial=0.0) > RIVAL * values[best]:
        return Estimate(0.0, 0.0)
    apart = np.abs(offsets - offsets[best]) > DISTINCT
    if values[best] < SEEN or values[apart].max(initial=0.0) > RIVAL * values[best]:
        return Estimate(0.0)
    return Estimate(float(offsets[best] - 0.5 * LONGEST_LAG), 0.5 * LONGEST_LAG)


def _common_rate(grid: Array, wheels: WheelStream) -> Array:
    """(K,) rate that the wheels have in common, up to its sign [rad/s]: their first principal component."""
    turned = [interpolated(grid, wheels.t, a) for a in wheels.angle.T if np.isfinite(a).sum() > 2]
    if not turned:
        return np.zeros(grid.size)
    rates = np.gradient(np.stack(turned), STEP, axis=1)
    weights = np.linalg.eigh(rates @ rates.T)[1][:, -1]
    return np.asarray(weights @ rates / np.abs(weights).sum())
