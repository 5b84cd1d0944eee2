"""Long drives over uneven ground with their truth: for what short trials on sand do not show.

Everything is by formula on a fine grid; nothing of `granite_lab.estimation` or of the simulators is used.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import iirpeak, lfilter

from granite_lab.logs.trial import ImuStream, Trial, TrialInfo, WheelStream

Array = NDArray[np.float64]

RADIUS = 0.0965
LEVER = (0.10, 0.12)
"""The sample robot's wheel radius, and its IMU's place ahead of and above R [m]."""

SEED = 1
"""Of long logs."""

FINE, IMU_RATE, WHEEL_RATE = 400.0, 200.0, 100.0
"""Rates of the grid, of the IMU and of the encoders [Hz]."""


@dataclass(frozen=True, eq=False)
class Drive:
    """A log and what happened.

    Attributes:
        trial: IMU and encoders.
        t: (K,) grid [s].
        v, wheel: (K,) body and wheel velocity [m/s].
    """

    trial: Trial
    t: Array
    v: Array
    wheel: Array

    def at(self, t: Array, name: str) -> Array:
        """Truth at other instants."""
        return np.asarray(np.interp(t, self.t, getattr(self, name)))


def wander(rng: np.random.Generator, n: int, std: float, time: float) -> Array:
    """(n,) first-order Gauss-Markov process twice smoothed, so that it can be differentiated."""
    a = np.exp(-1.0 / (FINE * time))
    signal = lfilter(
        [1 - a], [1, -a], lfilter([1 - a], [1, -a], rng.standard_normal(n + int(8 * time * FINE)))
    )
    signal = signal[-n:]
    return np.asarray(signal * (std / max(float(np.std(signal)), 1e-12)))


def drive(
    seed: int,
    course: Sequence[tuple[float, float]],
    *,
    slip: float = 0.04,
    scatter: float = 0.03,
    accel: float = 0.02,
    gyro: float = 0.0005,
) -> Drive:
    """Drive a course.

    Args:
        seed: of all that is random.
        course: (instant [s], wheel speed [m/s]), straight lines between; zero speed is a standstill.
        slip, scatter: mean of the slip ratio, and std of what wanders about it within a second.
        accel, gyro: white noise of the IMU in motion [m/s^2 sqrt(s)], [rad/s sqrt(s)]; a tenth at rest.
    """
    rng = np.random.default_rng(seed)
    instants, speeds = np.array(course, dtype=float).T
    t = np.arange(instants[0], instants[-1], 1.0 / FINE)
    wheel = np.interp(t, instants, speeds)
    moving = wheel > 0
    wheel = wheel * (1.0 + wander(rng, t.size, 0.04, 1.5) * np.minimum(wheel / 0.2, 1.0))
    ratio = slip + wander(rng, t.size, scatter, 0.4)
    v = wheel * (1.0 - ratio)
    # pitch by the way: the ground is what it is, and the robot stands on it
    ground = wander(rng, t.size, 0.02, 3.0)  # [rad]
    way = np.cumsum(np.where(moving, 1.0, 0.0)) / FINE
    pitch = np.interp(way, t - t[0], ground)
    rate = np.gradient(pitch, 1.0 / FINE)
    force = np.gradient(v, 1.0 / FINE) - 9.81 * np.sin(pitch)
    force += np.gradient(rate, 1.0 / FINE) * LEVER[1] - rate**2 * LEVER[0]
    up = 9.81 * np.cos(pitch)

    def mean_over(signal: Array, every: int) -> Array:
        return np.asarray(signal[: signal.size // every * every].reshape(-1, every).mean(axis=1))

    every = round(FINE / IMU_RATE)
    stamps = mean_over(t, every)
    n = stamps.size
    shake = np.where(mean_over(moving.astype(float), every) > 0, 1.0, 0.1)
    specific, angular = np.zeros((n, 3)), np.zeros((n, 3))
    specific[:, 0], specific[:, 2], angular[:, 1] = (mean_over(s, every) for s in (force, up, rate))
    specific += accel * np.sqrt(IMU_RATE) * shake[:, None] * rng.standard_normal((n, 3)) + rng.normal(
        0, 0.05, 3
    )
    angular += gyro * np.sqrt(IMU_RATE) * shake[:, None] * rng.standard_normal((n, 3)) + rng.normal(
        0, 2e-3, 3
    )
    skip = round(FINE / WHEEL_RATE)
    step = 2 * np.pi / 106000
    angle = np.floor(np.cumsum(wheel)[::skip] / FINE / RADIUS / step) * step
    trial = Trial(
        name=f"long-{seed}",
        info=TrialInfo(robot="granite", virtual=True),
        imu=ImuStream(stamps, specific, angular),
        wheels=WheelStream(
            t[::skip], np.repeat((angle - angle[0])[:, None], 4, axis=1), resolution=(step,) * 4
        ),
    )
    return Drive(trial, t, v, wheel)


def cycles(number: int, length: float = 30.0) -> list[tuple[float, float]]:
    """Course of repeated drives at 0.5 m/s with a standstill after each."""
    own = ((3.0, 0.0), (4.0, 0.5), (length - 3.0, 0.5), (length - 2.0, 0.0))
    driven = [(i * length + t, v) for i in range(number) for t, v in own]
    return [(0.0, 0.0), *driven, (number * length + 1.0, 0.0)]


def repeated(duration: float) -> Drive:
    """Drive for 30 s again and again on soft ground, with standstills between, under a consumer IMU."""
    return sensed(drive(SEED, cycles(round(duration / 30.0)), slip=0.15, accel=0.0, gyro=0.0))


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
    imu = replace(imu, specific_force=force, angular_rate=turned)
    return replace(calm, trial=replace(calm.trial, imu=imu))
