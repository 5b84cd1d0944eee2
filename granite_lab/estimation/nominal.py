"""Nominal motion by integrating the IMU; the filter then only estimates how far it drifted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d, minimum_filter1d

from granite_lab.estimation.rest import cumulate
from granite_lab.logs.counters import runs
from granite_lab.logs.sensors.faults import Faults
from granite_lab.logs.sensors.mounting import BodyImu
from granite_lab.logs.sensors.standstill import Interval, inside
from granite_lab.logs.trial import Array
from granite_lab.parameters import GRAVITY, Robot

ANY_ROLL = float(np.radians(1.0))
"""Std of the ground's roll where nothing is known of it [rad]."""

ACROSS = 1.5
"""Ground lies across by this many times what its roll varies along the path."""

LEAST = float(np.radians(0.5))
"""Std of the roll of ground that does not vary at all [rad]."""

EVIDENT = 2.5
"""A mean roll this many std from what ground and bias explain is the ground's."""

HALF = 0.25
"""Corner of the low-pass [Hz], where it halves an amplitude, times the width of its Gaussian [s]."""

CORNER = 0.31
"""Corner of the low-pass over the frequency of the vibration. At half of that frequency it passes 8 %."""

FADE = 0.1
"""The smoothing comes in within this time [s]."""

LOWEST = 5.0
"""Lowest corner of the low-pass [Hz]: what changes more slowly may be motion."""

APART = 1.5
"""A vibration can be told from motion if its frequency is this many times the lowest corner."""


@dataclass(frozen=True, eq=False)
class Nominal:
    """The motion that integrating the IMU gives, frozen while the robot rests.

    Attributes:
        t: (N,) stamps [s].
        rest: (N,) True at standstill.
        x, v: (N,) distance [m] and velocity [m/s] of R.
        pitch: (N,) [rad].
        heading_rate: (N,) [rad/s].
        accel_bias, gyro_bias: constants that were removed before integration.
        coupling: (N,) forward acceleration per radian of pitch [m/s^2].
        roll_std: std of the constant error of the roll [rad].
        vibration_left: (N,) share of the vibration's rms that is in x and v; None: all of it.
    """

    t: Array
    rest: np.ndarray
    x: Array
    v: Array
    pitch: Array
    heading_rate: Array
    accel_bias: float
    gyro_bias: float
    coupling: Array
    roll_std: float
    vibration_left: Array | None = None


class Start(NamedTuple):
    """Constants from which integration starts.

    Attributes:
        accel_bias, gyro_bias: that are removed [m/s^2], [rad/s]; the gyro's is its mean at rest by default.
        pitch, velocity: at the first sample [rad], [m/s].
    """

    accel_bias: float = 0.0
    gyro_bias: float | None = None
    pitch: float = 0.0
    velocity: float = 0.0


AT_REST = Start()
"""A level robot that stands, whose biases are not known."""


def integrate(imu: BodyImu, robot: Robot, rests: Sequence[Interval], faults: Faults, start: Start) -> Nominal:
    """Integrate gyro and accelerometer from the first sample on, standing still during the rests.

    The sensor sits at p = (p_x, p_z) from R, where with pitch rate q and yaw rate r

        f_x = dv/dt - g sin(pitch) + dq/dt p_z - (q^2 + r^2) p_x + bias.

    The velocity of the sensor, v + q p_z, takes in dq/dt without differentiating the gyro; R's
    velocity follows from it.
    """
    t, rest = imu.t, inside(imu.t, rests)
    forward = _patched(t, imu.forward, faults.doubt)
    gyro = _patched(t, np.nan_to_num(imu.pitch_rate), faults.rate_doubt)
    yaw = np.nan_to_num(imu.yaw_rate)
    levels = [float(np.mean(rate[rest])) if rest.any() else 0.0 for rate in (gyro, yaw)]
    gyro_bias = levels[0] if start.gyro_bias is None else start.gyro_bias
    yaw_rate = yaw - levels[1]
    roll, roll_std = roll_angle(imu, rest, robot)
    pitch_rate = ((gyro - gyro_bias) * np.cos(roll) - yaw_rate * np.sin(roll)) * imu.has_pitch_rate
    angle = start.pitch + cumulate(t, pitch_rate, rest)
    acceleration = forward + imu.gravity * np.sin(angle) - start.accel_bias
    acceleration += (pitch_rate**2 + yaw_rate**2) * robot.imu.x
    v_sensor = start.velocity + cumulate(t, acceleration, rest)
    pitch_rate, yaw_rate = np.where(rest, 0.0, pitch_rate), np.where(rest, 0.0, yaw_rate)
    v = v_sensor - robot.imu.z * pitch_rate
    x = cumulate(t, v_sensor, rest) - robot.imu.z * (angle - start.pitch)
    return Nominal(
        t=t, rest=rest, x=x, v=v, pitch=angle, heading_rate=yaw_rate, accel_bias=start.accel_bias,
        gyro_bias=gyro_bias, coupling=imu.gravity * np.cos(angle), roll_std=roll_std,
    )  # fmt: skip


def _patched(t: Array, signal: Array, doubt: np.ndarray) -> Array:
    """Interpolate over samples that cannot be trusted."""
    if not doubt.any() or doubt.all():
        return signal
    return np.where(doubt, np.interp(t, t[~doubt], signal[~doubt]), signal)


def roll_angle(imu: BodyImu, rest: np.ndarray, robot: Robot) -> tuple[Array, float]:
    """(N,) roll of the sensor about x against the vertical [rad], and the std of its constant error.

    At each standstill it is the lateral specific force over g; between them the gyro carries it on,
    and what its bias adds up to is taken out along a straight line. The ground at the end tilts
    differently than at the start, so no mean over the standstills would do. The accelerometer's bias
    is common to all of them: their mean is shrunk by what it may be, their differences are not.
    """
    tilted = float(np.radians(0.0 if imu.levelled else robot.imu.tilt))
    doubt = robot.imu_grade.accel_bias / GRAVITY
    seen = rest & np.isfinite(imu.left)
    if not imu.gravity or not seen.any():
        return np.zeros(imu.t.size), float(np.hypot(tilted, ANY_ROLL))
    rate = np.nan_to_num(imu.roll_rate)
    turned = cumulate(imu.t, rate - float(np.mean(rate[rest])), rest)
    stands = [(a, b) for a, b in runs(rest) if seen[a:b].any()]
    levels = np.array([np.mean(imu.left[a:b][seen[a:b]]) for a, b in stands])
    levels = np.clip(levels / GRAVITY, -1.0, 1.0)
    drifts = levels - [np.mean(turned[a:b]) for a, b in stands]
    edges = [imu.t[place] for a, b in stands for place in (a, b - 1)]
    level, angle = float(np.mean(levels)), turned + np.interp(imu.t, edges, np.repeat(drifts, 2))
    varied = float(np.std(angle[~rest])) if (~rest).any() else ANY_ROLL
    prior = float(np.hypot(tilted, np.clip(ACROSS * varied, LEAST, ANY_ROLL)))
    if abs(level) > EVIDENT * np.hypot(prior, doubt):
        prior = abs(level)
    weight = prior**2 / (prior**2 + doubt**2)
    common = (1.0 - weight) * level
    return angle - common, float(np.sqrt(weight) * doubt)


def smoothed(signal: Array, width: float) -> Array:
    """(N,) signal smoothed by 2 G - G G, G a Gaussian of `width` samples: true to cubics, without delay."""
    once = gaussian_filter1d(signal, width, mode="nearest")
    return np.asarray(2.0 * once - gaussian_filter1d(once, width, mode="nearest"))


def quieten(nominal: Nominal, steady: np.ndarray, frequency: float) -> Nominal:
    """Take the frame's vibration out of velocity and distance where the wheels turn steadily.

    Sand lets a body change its velocity no faster than its wheels do: what an IMU shows near the frame's
    own frequency while they turn steadily is the frame. Around the ramps nothing is touched, and the
    filter's oscillator carries the doubt.

    `vibration_left` counts as vibration what is up to an octave slower than the smoothing removes. The motion
    is unchanged where the vibration is too slow to be told from motion, or the wheels never turn steadily.
    """
    period = float(np.median(np.diff(nominal.t)))
    width = HALF / (max(CORNER * frequency, LOWEST) * period)
    on = steady & ~nominal.rest
    if frequency < APART * LOWEST or width < 1.0 or on.sum() * period < 1.0:
        return nominal
    fade = max(round(FADE / period), 1)
    core = minimum_filter1d(on.astype(float), 2 * fade + 1, mode="constant") > 0
    if not core.any():
        return nominal
    weight = np.where(on, gaussian_filter1d(core.astype(float), fade / 3.0, mode="constant"), 0.0)
    slow, motion = smoothed(nominal.v, width), smoothed(nominal.v, 2.0 * width)
    whole = float(np.mean((nominal.v - motion)[core] ** 2))
    left = min(float(np.sqrt(np.mean((slow - motion)[core] ** 2) / max(whole, 1e-20))), 1.0)
    fast = weight * (nominal.v - slow)
    return replace(
        nominal, v=nominal.v - fast, x=nominal.x - cumulate(nominal.t, fast, nominal.rest),
        vibration_left=1.0 - weight * (1.0 - left),
    )  # fmt: skip
