"""Nominal motion by integrating the IMU; the filter then only estimates how far it drifted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from granite_lab.estimation.faults import Faults
from granite_lab.estimation.mounting import BodyImu
from granite_lab.estimation.rest import Interval, inside
from granite_lab.estimation.roll import cumulate, roll_angle
from granite_lab.logs.trial import Array
from granite_lab.parameters import Robot


@dataclass(frozen=True, eq=False)
class Nominal:
    """The motion that integrating the IMU gives, frozen while the robot rests.

    Attributes:
        t: (N,) stamps [s].
        rest: (N,) True at standstill.
        x, v: (N,) distance [m] and velocity [m/s] of R.
        pitch: (N,) [rad].
        pitch_rate: (N,) bias removed, zero at rest [rad/s].
        heading_rate: (N,) [rad/s].
        accel_bias, gyro_bias: constants that were removed before integration.
        coupling: (N,) forward acceleration per radian of pitch [m/s^2].
        vibration_left: (N,) share of the vibration's rms that is in x and v; None: all of it.
    """

    t: Array
    rest: np.ndarray
    x: Array
    v: Array
    pitch: Array
    pitch_rate: Array
    heading_rate: Array
    accel_bias: float
    gyro_bias: float
    coupling: Array
    vibration_left: Array | None = None


def integrate(
    imu: BodyImu,
    robot: Robot,
    rests: Sequence[Interval],
    faults: Faults,
    *,
    accel_bias: float = 0.0,
    gyro_bias: float | None = None,
    pitch: float = 0.0,
    velocity: float = 0.0,
    aside: Array | None = None,
) -> Nominal:
    """Integrate gyro and accelerometer from the first sample on, standing still during the rests.

    The sensor sits at p = (p_x, p_z) from R, where with pitch rate q and yaw rate r

        f_x = dv/dt - g sin(pitch) + dq/dt p_z - (q^2 + r^2) p_x + bias.

    The velocity of the sensor, v + q p_z, takes in dq/dt without differentiating the gyro; R's
    velocity follows from it.

    Args:
        imu: samples in robot axes.
        robot: where the sensor sits.
        rests: standstills [s].
        faults: samples not to be trusted; interpolated over.
        accel_bias, gyro_bias: constants to remove; the gyro's by default its mean at rest.
        pitch, velocity: of the first sample [rad], [m/s].
        aside: (N,) velocity to the left [m/s], which turning makes a forward one.
    """
    t, rest = imu.t, inside(imu.t, rests)
    forward = _patched(t, imu.forward, faults.doubt)
    gyro = _patched(t, np.nan_to_num(imu.pitch_rate), faults.rate_doubt)
    yaw = np.nan_to_num(imu.yaw_rate)
    if gyro_bias is None:
        gyro_bias = float(np.mean(gyro[rest])) if rest.any() else 0.0
    yaw_rate = yaw - (float(np.mean(yaw[rest])) if rest.any() else 0.0)
    roll, _ = roll_angle(imu, rest, robot)
    pitch_rate = (gyro - gyro_bias) * np.cos(roll) - yaw_rate * np.sin(roll)
    if not imu.has_pitch_rate:
        pitch_rate = np.zeros(t.size)
    angle = pitch + cumulate(t, pitch_rate, rest)
    acceleration = forward + imu.gravity * np.sin(angle) - accel_bias
    acceleration += (pitch_rate**2 + yaw_rate**2) * robot.imu.x
    if aside is not None:
        acceleration += yaw_rate * aside
    v_sensor = velocity + cumulate(t, acceleration, rest)
    pitch_rate, yaw_rate = np.where(rest, 0.0, pitch_rate), np.where(rest, 0.0, yaw_rate)
    v = v_sensor - robot.imu.z * pitch_rate
    x = cumulate(t, v_sensor, rest) - robot.imu.z * (angle - pitch)
    return Nominal(
        t=t, rest=rest, x=x, v=v, pitch=angle, pitch_rate=pitch_rate, heading_rate=yaw_rate,
        accel_bias=accel_bias, gyro_bias=gyro_bias, coupling=imu.gravity * np.cos(angle),
    )  # fmt: skip


def _patched(t: Array, signal: Array, doubt: np.ndarray) -> Array:
    """Interpolate over samples that cannot be trusted."""
    if not doubt.any() or doubt.all():
        return signal
    return np.where(doubt, np.interp(t, t[~doubt], signal[~doubt]), signal)
