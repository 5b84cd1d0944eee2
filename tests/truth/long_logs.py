"""Long logs as files: what a logger writes in an hour, with the truth beside it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.signal import iirpeak, lfilter

from granite_lab.parameters import WHEELS
from tests.truth.long_drives import LEVER, Array, Drive, cycles, drive, wander

SEED = 1


def long_drive(course: str, duration: float) -> Drive:
    """Drive for some time at 200 Hz of IMU and 100 Hz of encoders.

    Args:
        course: "trials" of 30 s each with standstills between, on soft ground under a consumer IMU;
            "straight" or "winding" on firm, rough ground without a stop but at both ends.
        duration: [s].
    """
    if course == "trials":
        calm = drive(SEED, cycles(round(duration / 30.0)), slip=0.15, accel=0.0, gyro=0.0)
        return sensed(calm)
    course_points = [(0.0, 0.0), (3.0, 0.0), (4.0, 0.5)]
    # the driver does not keep one speed for an hour
    rng = np.random.default_rng(SEED)
    instants = np.arange(20.0, duration - 20.0, 20.0)
    speeds = rng.uniform(0.3, 0.7, instants.size)
    course_points += [(float(t), float(v)) for t, v in zip(instants, speeds, strict=True)]
    course_points += [(duration - 3.0, 0.5), (duration - 2.0, 0.0), (duration, 0.0)]
    straight = drive(SEED, course_points)
    return turning(straight) if course == "winding" else straight


def sensed(calm: Drive) -> Drive:
    """Add white noise of 0.002 m/s^2 sqrt(s) and 1e-4 rad/s sqrt(s), and a vibration of 0.3 m/s^2 rms.

    Vibration is noise through a resonance at 12 Hz that lets nothing constant pass, so its integral is
    bounded; it is there while the robot moves.
    """
    imu = calm.trial.imu
    rng = np.random.default_rng(SEED + 2)
    shape, rate = imu.specific_force.shape, 1.0 / float(np.median(np.diff(imu.t)))
    vibration = lfilter(*iirpeak(12.0, 5.0, fs=rate), rng.standard_normal(shape), axis=0)
    vibration *= 0.3 / vibration.std() * np.minimum(calm.at(imu.t, "wheel") / 0.5, 1.0)[:, None]
    force = imu.specific_force + 0.002 * np.sqrt(rate) * rng.standard_normal(shape) + vibration
    turned = imu.angular_rate + 1e-4 * np.sqrt(rate) * rng.standard_normal(shape)
    imu = dataclasses.replace(imu, specific_force=force, angular_rate=turned)
    return dataclasses.replace(calm, trial=dataclasses.replace(calm.trial, imu=imu))


def turning(straight: Drive) -> Drive:
    """Let a drive wind: yaw rate of 0.2 rad/s (std) while it moves, R without sideways velocity."""
    imu = straight.trial.imu
    rng = np.random.default_rng(SEED + 1)
    yaw = wander(rng, straight.t.size, 0.2, 2.0) * np.minimum(np.abs(straight.v) / 0.2, 1.0)
    growth = np.gradient(yaw, straight.t)
    r, dr, v = (np.interp(imu.t, straight.t, signal) for signal in (yaw, growth, straight.v))
    rate, force = imu.angular_rate.copy(), imu.specific_force.copy()
    rate[:, 2] += r
    force[:, 0] -= r**2 * LEVER[0]
    force[:, 1] += r * v + dr * LEVER[0]
    imu = dataclasses.replace(imu, angular_rate=rate, specific_force=force)
    return dataclasses.replace(straight, trial=dataclasses.replace(straight.trial, imu=imu))


def write_log(path: Path, log: Drive) -> None:
    """Write the log as a canonical CSV, one row a stamp of either sensor."""
    imu, wheels = log.trial.imu, log.trial.wheels
    names = [*(f"imu_a{a}_mps2" for a in "xyz"), *(f"imu_g{a}_radps" for a in "xyz")]
    inertial = _table(imu.t, np.hstack([imu.specific_force, imu.angular_rate]), names)
    rolled = _table(wheels.t, wheels.angle, [f"enc_{wheel}_rad" for wheel in WHEELS])
    rows = pd.concat([inertial, rolled]).sort_values("t_s", kind="stable")
    with path.open("w", encoding="utf-8") as file:
        file.write('# robot = "granite"\n')
        rows.to_csv(file, index=False, float_format="%.9g")


def _table(t: Array, values: Array, names: list[str]) -> pd.DataFrame:
    return pd.DataFrame(np.column_stack([t, values]), columns=["t_s", *names])
