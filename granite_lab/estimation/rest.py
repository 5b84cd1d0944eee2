"""Standstills in the estimation: those found, those named by hand, and what lies in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from granite_lab.errors import EstimateError
from granite_lab.estimation.wheels import Rolling
from granite_lab.logs.counters import integral, runs
from granite_lab.logs.sensors.mounting import BodyImu
from granite_lab.logs.sensors.standstill import (
    COAST,
    MOVING,
    WINDOW,
    Interval,
    WheelTravel,
    find_standstills,
    imu_quiet,
    inside,
)
from granite_lab.logs.trial import Array, ImuStream, Trial
from granite_lab.parameters import ImuGrade, Robot

GAINED, TURNED = 0.15, 0.15
"""A robot whose IMU gains this velocity [m/s] or angle [rad] in a second does not stand."""


def travel_of(rolling: Rolling) -> WheelTravel:
    """Return the rolled distances of wheels whose dead encoders are masked."""
    distance = rolling.distance.copy()
    distance[0] = np.where(np.isfinite(distance[1]), 0.0, distance[0])  # where it counts from
    return WheelTravel(rolling.t, distance, rolling.rates, rolling.resolution)


def find_rests(
    imu: ImuStream | None,
    rolling: Rolling | None,
    grade: ImuGrade,
    *,
    offset: float = 0.0,
    by_hand: Sequence[Interval] = (),
) -> tuple[tuple[Interval, ...], Array]:
    """Find the standstills as `find_standstills` does; those given by hand are taken as they are.

    Returns:
        the standstills [s], on the IMU's clock; (N,) std of the velocity that may be left at the first sample
        of each [m/s], else 0.
    """
    wheels = None if rolling is None else travel_of(rolling)
    rests, unseen = find_standstills(imu, wheels, grade, offset=offset)
    if not by_hand:
        return tuple(rests), unseen
    if imu is not None:
        t = imu.t
    else:
        assert rolling is not None
        t = rolling.t + offset
    named = inside(t, by_hand)
    union = [(float(t[a]), float(t[b - 1])) for a, b in runs(inside(t, rests) | named) if b - a > 1]
    return tuple(union), np.where(named, 0.0, unseen)


def coasts(
    imu: ImuStream, rolling: Rolling | None, grade: ImuGrade, offset: float, rests: Sequence[Interval]
) -> bool:
    """Whether the log ends while the wheels coast to rest, slower than `COAST`, and the IMU is quiet."""
    end = imu.t[-1]
    if rolling is None or not rests or rests[-1][1] > end - WINDOW:
        return False
    last = (rolling.t + offset >= end - WINDOW) & np.isfinite(rolling.speed)
    slow = last.any() and float(np.abs(rolling.speed[last]).max()) < COAST
    return bool(slow and imu_quiet(imu, grade, inside(imu.t, rests))[imu.t >= end - WINDOW].all())


def named_rests(trial: Trial, robot: Robot) -> tuple[Interval, ...]:
    """Return the standstills of the body that a trial names [s].

    Raises:
        EstimateError: the wheels turn in one in which robot and wheels are said to stand.
    """
    info, wheels = trial.info, trial.wheels
    for begin, end in info.rests if wheels is not None else ():
        assert wheels is not None
        angle = wheels.angle[(wheels.t >= begin) & (wheels.t <= end)]
        turned = max((float(np.ptp(a[np.isfinite(a)])) for a in angle.T if np.isfinite(a).any()), default=0.0)
        if (rolled := turned * robot.wheels.radius) > MOVING * (end - begin):
            raise EstimateError(
                f"{trial.name}: the wheels roll {rolled:.2f} m in the standstill named from {begin:g} s to "
                f"{end:g} s",
                "name the part in which they stand; where they spin while the body stands, name it in "
                "body_rests (--body-rest)",
            )
    return (*info.rests, *info.body_rests)


def refuse_moved(imu: BodyImu, by_hand: Sequence[Interval]) -> None:
    """Refuse standstills named by hand in which the IMU shows that the robot moved.

    Raises:
        EstimateError: specific force, less its mean, gains a velocity there, or a gyro an angle.
    """
    for begin, end in by_hand:
        at = inside(imu.t, [(begin, end)])
        if np.count_nonzero(at) < 4:
            continue
        t = imu.t[at]
        force, pitch_rate, yaw_rate = np.nan_to_num([imu.forward, imu.pitch_rate, imu.yaw_rate])[:, at]
        turned = integral(t, pitch_rate)
        # it settles, which shows as gravity's share; the mean is bias and slope
        speed = integral(t, force + imu.gravity * turned)
        speed -= np.interp(t, t[[0, -1]], speed[[0, -1]])
        for gained, limit, change in (
            (speed, GAINED, "its velocity along x changes by {:.2f} m/s"),
            (turned, TURNED, "it turns about y by {:.2f} rad"),
            (integral(t, yaw_rate), TURNED, "it turns about z by {:.2f} rad"),
        ):
            if np.ptp(gained) > limit * max(1.0, float(np.sqrt(t[-1] - t[0]))):
                raise EstimateError(
                    f"the robot moved in the standstill named from {begin:g} s to {end:g} s: by the IMU "
                    + change.format(np.ptp(gained)),
                    "name the part in which the body stands; its wheels may spin",
                )


def cumulate(t: Array, rate: Array, rest: np.ndarray) -> Array:
    """(N,) integral by the trapezoidal rule from the first sample on; it stops between two at rest."""
    step = 0.5 * (rate[1:] + rate[:-1]) * np.diff(t)
    return np.append(0.0, np.cumsum(np.where(rest[1:] & rest[:-1], 0.0, step)))
