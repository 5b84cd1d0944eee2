"""Noise identified from the trial itself, with the robot's file as prior.

Densities and smoothed derivatives are as `scipy.signal` has them, whose import takes half a second.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.ndimage import correlate1d

from granite_lab.estimation.mounting import BodyImu
from granite_lab.estimation.rest import Interval, inside
from granite_lab.estimation.wheels import Rolling
from granite_lab.logs.trial import Array
from granite_lab.parameters import GRAVITY, Robot

PRIOR_SAMPLES = 20.0
"""The grade of the robot's file weighs as much as this many samples."""

UNSEEN_PITCH = float(np.radians(2.0))
"""Random walk of the pitch over uneven ground, where no gyro sees it [rad/sqrt(m)]."""

UNSEEN_ATTITUDE = GRAVITY * float(np.radians(0.3))
"""Random walk of the gravity that a logger leaves in its "linear acceleration" [m/s^2/sqrt(s)]."""


@dataclass(frozen=True)
class Noise:
    """Noise that the filter works with; densities are of both-sided spectra (std times sqrt(dt)).

    Attributes:
        accel, gyro: white noise [m/s^2 sqrt(s)], [rad/s sqrt(s)].
        accel_stamps: what the stamps' scatter makes of vibration; the larger of it and `accel_motion` counts.
        accel_bias, gyro_bias: std before the first standstill [m/s^2], [rad/s]; the former with tilt.
        accel_walk, gyro_walk: random walk of the biases [m/s^2/sqrt(s)], [rad/s/sqrt(s)].
        accel_scale: std of the accelerometer's scale error [-].
        pitch: std of the pitch at the start [rad].
        motion_bias: std of a bias that is there only in motion [m/s^2].
        vibration: rms of the frame's vibration along x in motion [m/s^2] at `vibration_speed` [m/s].
        vibration_frequency: its dominant frequency [Hz].
        vibration_damping: its damping ratio (relative bandwidth over two).
        accel_motion, gyro_motion: white noise that is there only in motion, the former below the vibration.
    """

    accel: float
    gyro: float
    accel_stamps: float
    accel_bias: float
    gyro_bias: float
    accel_walk: float
    gyro_walk: float
    accel_scale: float
    pitch: float
    motion_bias: float
    vibration: float
    vibration_speed: float
    vibration_frequency: float
    vibration_damping: float
    accel_motion: float = 0.0
    gyro_motion: float = 0.0

    @property
    def vibration_omega(self) -> float:
        """Angular frequency of the vibration [rad/s]."""
        return 2 * np.pi * self.vibration_frequency

    def as_dict(self) -> dict[str, float]:
        """Return the figures by name, unit in the name, as the motion record keeps them."""
        return {
            "accel_noise_mps2_sqrts": self.accel,
            "gyro_noise_radps_sqrts": self.gyro,
            "accel_noise_in_motion_mps2_sqrts": self.accel_motion,
            "accel_noise_by_stamps_mps2_sqrts": self.accel_stamps,
            "accel_bias_prior_mps2": self.accel_bias,
            "gyro_bias_prior_radps": self.gyro_bias,
            "accel_bias_walk_mps2_per_sqrts": self.accel_walk,
            "gyro_bias_walk_radps_per_sqrts": self.gyro_walk,
            "accel_scale_error_prior": self.accel_scale,
            "motion_bias_prior_mps2": self.motion_bias,
            "vibration_mps2": self.vibration,
            "vibration_frequency_hz": self.vibration_frequency,
            "vibration_damping": self.vibration_damping,
        }


def white(t: Array, signal: Array, rests: Sequence[Interval], prior: float) -> float:
    """Find the white noise density (std times sqrt(dt)) of a signal at standstill by its Allan variance.

    The Allan variance at one sample is precise, that over eight samples is blind to noise beyond the
    filter's interest; they agree for white noise. Where they differ by more than their own scatter
    (coloured noise, a sensor's low-pass), the longer one is used.
    """
    sums = np.zeros((2, 2))  # of squares, and of degrees of freedom: differences overlap, so each has 2/3
    for rest in rests:
        at = inside(t, [rest]) & np.isfinite(signal)
        if at.sum() < 16:
            continue
        part, dt = signal[at], float(np.median(np.diff(t[at])))
        for i, m in enumerate((1, 8)):
            step = np.diff(part[: part.size // m * m].reshape(-1, m).mean(axis=1))
            sums[i] += (step @ step) * m * dt / 3.0, step.size * 2.0 / 3.0
    (fine, n_fine), (long, n_long) = sums
    if n_fine == 0:
        return prior
    variance = (PRIOR_SAMPLES * prior**2 + fine) / (PRIOR_SAMPLES + n_fine)
    if n_long >= 8 and abs(np.log(max(long / n_long, 1e-30) / variance)) > 3.0 * np.sqrt(2.0 / n_long):
        variance = long / n_long
    return float(np.sqrt(variance))


def stamp_noise(imu: BodyImu, moving: np.ndarray) -> float:
    """White noise density [m/s^2 sqrt(s)] that the stamps' scatter makes of vibration in motion.

    Integrated by the trapezoidal rule, a stamp that is off by d changes the velocity by d times half the
    difference of the samples before and after it. The scatter is that of stamps about an even spacing,
    by their second differences, whose variance is six times that of one stamp.
    """
    period = imu.period
    step = imu.forward[2:] - imu.forward[:-2]
    shaken = step[moving[1:-1] & np.isfinite(step)]
    if shaken.size < 8:
        return 0.0
    uneven = 1.4826 * float(np.median(np.abs(np.diff(imu.t, n=2)))) / np.sqrt(6.0)
    return float(uneven * 0.5 * np.sqrt(np.mean(shaken**2) / period))


def vibration(
    imu: BodyImu, moving: np.ndarray, accel: float, prior_frequency: float
) -> tuple[float, float, float]:
    """Identify the frame's vibration along x in motion from the spectrum above 5 Hz.

    Returns:
        rms beyond the white noise [m/s^2], dominant frequency [Hz], damping ratio.
    """
    dt = imu.period
    part = imu.forward[moving & np.isfinite(imu.forward)]
    if part.size < 64 or dt > 0.05:
        return 0.0, prior_frequency, 0.3
    size = int(min(part.size, 2 ** np.ceil(np.log2(1.28 / dt))))
    frequency, densities = periodograms(part, 1.0 / dt, hann(size))
    band = frequency >= min(5.0, 0.2 / dt)
    # a jerk of the body at a change of speed is in few segments: it is no vibration
    mean, usual = (
        np.maximum(average(densities, axis=0) - 2.0 * accel**2, 0.0)[band] for average in (np.mean, np.median)
    )
    frequency, power = frequency[band], float(mean.sum() * (frequency[1] - frequency[0]))
    if power <= (0.5 * accel) ** 2 / dt or not usual.any():
        return float(np.sqrt(power)), prior_frequency, 0.3
    peak = float(frequency[np.argmax(usual)])
    low, high = np.interp([0.16, 0.84], np.cumsum(usual) / usual.sum(), frequency)
    return float(np.sqrt(power)), peak, float(np.clip(0.5 * (high - low) / peak, 0.05, 0.7))


def identify(imu: BodyImu, rolling: Rolling | None, robot: Robot, rests: Sequence[Interval]) -> Noise:
    """Identify all noise figures of a trial; the grade in the robot's file is the prior."""
    grade, moving = robot.imu_grade, ~inside(imu.t, rests)
    assert grade is not None
    speed = float(np.nanmax(np.abs(rolling.speed))) if rolling is not None else 0.5
    accel = white(imu.t, imu.forward, rests, grade.accel_noise)
    accel = max(accel, grade.accel_step * float(np.sqrt(imu.period / 12.0)), 1e-5)
    gyro = UNSEEN_PITCH * float(np.sqrt(max(speed, 0.1)))
    if imu.has_pitch_rate:
        gyro = white(imu.t, imu.pitch_rate, rests, grade.gyro_noise)
    rms, frequency, damping = vibration(imu, moving, accel, robot.imu.vibration_frequency)
    tilt = np.radians(2.0 if imu.levelled else robot.imu.tilt)
    # unseen pitch on setting off (squat), or an unknown error of the attitude the logger worked with
    blind = GRAVITY * np.radians(1.0) if not imu.has_pitch_rate or not imu.gravity else 0.0
    attitude, walk = 0.0 if imu.gravity else UNSEEN_ATTITUDE, float(np.sqrt(2.0 / grade.instability_time))
    return Noise(
        accel=accel,
        gyro=gyro,
        accel_stamps=stamp_noise(imu, moving),
        accel_bias=float(np.hypot(grade.accel_bias, GRAVITY * tilt)),
        gyro_bias=grade.gyro_bias,
        accel_walk=float(np.hypot(grade.accel_instability * walk, attitude)),
        gyro_walk=grade.gyro_instability * walk,
        accel_scale=grade.accel_scale,
        pitch=float(np.radians(2.0)),
        motion_bias=float(np.hypot(2.0 * grade.accel_instability, blind)),
        vibration=rms,
        vibration_speed=max(speed, 0.05),
        vibration_frequency=frequency,
        vibration_damping=damping,
    )


def periodograms(values: Array, rate: float, window: Array) -> tuple[Array, Array]:
    """(F,) frequencies [Hz] and (S, F) one-sided densities [unit^2/Hz] of segments that overlap by half.

    The mean of each segment, as long as the window, is removed.
    """
    size = window.size
    parts = np.lib.stride_tricks.sliding_window_view(values, size)[:: max(1, size - size // 2)]
    parts = parts - parts.mean(axis=1, keepdims=True)
    power = np.abs(np.fft.rfft(parts * window, axis=1)) ** 2 / (rate * np.sum(window**2))
    power[:, 1 : None if size % 2 else -1] *= 2.0
    return np.asarray(np.fft.rfftfreq(size, 1.0 / rate)), np.asarray(power)


def spectral_density(values: Array, rate: float, window: Array) -> tuple[Array, Array]:
    """Return the mean of the `periodograms` (Welch)."""
    frequency, density = periodograms(values, rate, window)
    return frequency, np.asarray(density.mean(axis=0))


def hann(size: int) -> Array:
    """Return a periodic Hann window."""
    return np.asarray(0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(size) / size))


def blackman_harris(size: int) -> Array:
    """Return the symmetric window of four cosines with the least side lobes (Harris, 1978)."""
    phase = np.linspace(0.0, 2.0 * np.pi, size)
    return np.asarray(np.array([0.35875, -0.48829, 0.14128, -0.01168]) @ np.cos(np.outer(range(4), phase)))


def slope(values: Array, window: int, order: int, step: float, derivative: int = 1) -> Array:
    """Return a derivative of polynomials through the neighbours of each sample (Savitzky and Golay).

    The first and the last value continue beyond the ends; `step` is from sample to sample.
    """
    weights = _weights(window, order, derivative) / step**derivative
    return np.asarray(correlate1d(values, weights, mode="nearest"))


@cache
def _weights(window: int, order: int, derivative: int) -> Array:
    """(window,) weights of the neighbours, a step of 1 apart."""
    t = np.arange(window) - window // 2
    fit = np.linalg.pinv(np.vander(t, order + 1, increasing=True))[derivative]
    return np.asarray(fit * math.factorial(derivative))
