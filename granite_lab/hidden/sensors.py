"""Sensors on a true motion: what the logger of a robot would have written, errors and all.

The figures come from the robot's file and the IMU grade as the *distribution* of the errors; the
code is independent of the package's own virtual sensors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from granite_lab.hidden.contact import Array
from granite_lab.hidden.parts import CompleteRobot, Misreading
from granite_lab.hidden.random_numbers import T, scaled
from granite_lab.hidden.simulator import DT, Body
from granite_lab.logs.trial import CurrentStream, ImuStream, WheelStream
from granite_lab.parameters import GRAVITY


@dataclass(frozen=True)
class Logger:
    """Errors of a logger that no file of a robot states.

    Attributes:
        late: latency [s] of the IMU's stamps, which are given at the end of the interval over which a sample
            is the mean; None for stamps in its middle.
        jitter: std of the IMU's stamps [s].
        gain: std of the scale of each axis of the IMU in each trial.
        ripple: relative std of the slow fluctuation of the currents while the wheels turn.
    """

    late: float | None = None
    jitter: float = 1e-4
    gain: float = 5e-4
    ripple: float = 0.01

    def behind(self, rate: float) -> float:
        """Return by how much the stamps come after the middle of what they stand for [s]."""
        return 0.0 if self.late is None else self.late + 0.5 / rate


def wander(rng: np.random.Generator, size: int, step: float, length: float) -> Array:
    """Return a Gaussian random function of unit variance with correlation `length`, sampled every `step`."""
    reach = max(1, int(np.ceil(4 * length / step)))
    kernel = np.exp(-((np.arange(-reach, reach + 1) * step / length) ** 2))
    kernel /= np.sqrt((kernel**2).sum())
    return np.asarray(scipy.signal.fftconvolve(rng.standard_normal(size + 2 * reach), kernel, mode="valid"))


def rotation(roll: float, pitch: float, yaw: float) -> Array:
    """Return the matrix that takes a vector from the old axes to axes turned by yaw, pitch, roll [rad]."""
    turn = scipy.spatial.transform.Rotation.from_euler("ZYX", [yaw, pitch, roll])
    return np.asarray(turn.as_matrix().T)


def felt_at(body: Body, arm_x: float, arm_z: float) -> tuple[Array, Array]:
    """Return specific force (N, 3) and angular rate (N, 3) in robot axes at a point of the robot."""
    dpitch, droll = np.gradient(body.pitch, DT), np.gradient(body.roll, DT)
    sin_p, cos_p, sin_r, cos_r = np.sin(body.pitch), np.cos(body.pitch), np.sin(body.roll), np.cos(body.roll)
    omega = np.stack([
        droll - body.yaw_rate * sin_p,
        dpitch * cos_r + body.yaw_rate * sin_r * cos_p,
        -dpitch * sin_r + body.yaw_rate * cos_r * cos_p,
    ], axis=1)  # fmt: skip
    alpha = np.gradient(omega, DT, axis=0)
    zero = np.zeros(body.t.size)
    velocity = np.stack([body.v, zero, body.w], axis=1)
    arm = np.broadcast_to([arm_x, 0.0, arm_z], omega.shape)
    force = np.stack([body.a, zero, body.dw], axis=1) + np.cross(omega, velocity)
    force += np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm))
    force += GRAVITY * np.stack([-sin_p, cos_p * sin_r, cos_p * cos_r], axis=1)
    return force, omega


def resonance(rng: np.random.Generator, size: int, frequency: float, quality: float) -> Array:
    """Return a narrow-band Gaussian process of unit variance around a frequency [Hz]."""
    w = 2 * np.pi * frequency * DT
    rho = np.exp(-0.5 * w / quality)
    warm_up = int(10 * quality / (frequency * DT))
    shocks = rng.standard_normal(size + warm_up)
    ringing = scipy.signal.lfilter([1.0], [1.0, -2 * rho * np.cos(w), rho**2], shocks)[warm_up:]
    return np.asarray(ringing / ringing.std())


def vibration(rng: np.random.Generator, body: Body, robot: CompleteRobot) -> tuple[Array, Array]:
    """Return the shaking of the frame as acceleration (N, 3) [m/s^2] and angular rate (N, 3) [rad/s].

    It is the derivative of a bounded velocity, and of a bounded angle, that is zero at rest: it
    carries the sensor nowhere. Loud around the frame's frequency, at harmonics that grow with
    speed, and where the lugs strike.
    """
    n, speed = body.t.size, np.abs(body.v_wheel.mean(axis=1))
    base = robot.imu.vibration_frequency * rng.uniform(0.9, 1.1)
    lug = max(2.0, robot.wheels.lugs * speed.max() / (2 * np.pi * robot.wheels.radius))
    tones = [(base, 1.0, 6.0), (2 * base, 0.5, 10.0), (3 * base, 0.25, 10.0), (lug, 0.3, 25.0)]
    grow = speed / 0.5
    gains = [grow, grow**1.5, grow**2, grow]
    acceleration, angle = np.zeros((n, 3)), np.zeros((n, 3))
    loudness = robot.imu.vibration / np.sqrt(sum(size**2 for _, size, _ in tones))
    for axis, factor in enumerate((1.0, 0.7, 1.6)):
        for (frequency, size, quality), gain in zip(tones, gains, strict=True):
            per = 2 * np.pi * frequency
            shake = gain * resonance(rng, n, frequency, quality) * size * loudness * factor / per
            acceleration[:, axis] += np.gradient(shake, DT)
            angle[:, axis] += gain * resonance(rng, n, frequency, quality) * size * loudness * 0.5 / per**2
    return acceleration, np.asarray(np.gradient(angle, DT, axis=0))


def averaged(signal: Array, t: Array, instants: Array, window: float) -> Array:
    """Return the mean of a signal (N, 3) over a window around each instant, as integrating sensors do."""
    whole = scipy.integrate.cumulative_trapezoid(signal, t, axis=0, initial=0)
    ends = [
        np.stack([np.interp(instants + shift, t, column) for column in whole.T], axis=1)
        for shift in (-0.5 * window, 0.5 * window)
    ]
    return np.asarray((ends[1] - ends[0]) / window)


def drifting(rng: np.random.Generator, size: int, dt: float, std: float, time: float) -> Array:
    """Return a first-order Gauss-Markov process (size, 3)."""
    keep = np.exp(-dt / time)
    first = std * rng.standard_normal(3)
    shocks = std * np.sqrt(1 - keep**2) * rng.standard_normal((size, 3))
    shocks[0] = first
    return np.asarray(scipy.signal.lfilter([1.0], [1.0, -keep], shocks, axis=0))


def stamped(rng: np.random.Generator, instants: Array, jitter: float) -> Array:
    """Return stamps around the instants, jittered but in order."""
    gap = float(np.diff(instants).min())
    return np.asarray(
        instants + np.clip(jitter * rng.standard_normal(instants.size), -0.45 * gap, 0.45 * gap)
    )


def read_imu(
    rng: np.random.Generator,
    body: Body,
    robot: CompleteRobot,
    logger: Logger,
    misreading: Misreading | None = None,
) -> tuple[ImuStream, Array, Array, Array]:
    """Return the IMU's samples, its turn-on biases (accelerometer, gyroscope) and its mounting.

    Args:
        rng: source of all errors.
        body: what really happened.
        robot: with its sensors.
        logger: its further errors.
        misreading: lasting errors on top.
    """
    grade = robot.imu_grade
    dt = 1 / grade.rate
    instants = np.arange(rng.uniform(0.5, 1.5) * dt, body.t[-1] - dt, dt)
    n = instants.size
    tilt = np.radians(robot.imu.tilt) * rng.standard_normal(3)
    mounting = rotation(*tilt) @ rotation(*np.radians(robot.imu.rotation))
    force, rate = felt_at(body, robot.imu.x, robot.imu.z)
    shaken, rocked = vibration(rng, body, robot)
    biases, read = [], []
    wrong = misreading or Misreading()
    for signal, distortion, turn_on, instability, density, limit, step in (
        (force + shaken, wrong.accel, grade.accel_bias, grade.accel_instability, grade.accel_noise,
         grade.accel_range, grade.accel_step),
        (rate + rocked, wrong.gyro, grade.gyro_bias, grade.gyro_instability, grade.gyro_noise,
         grade.gyro_range, grade.gyro_step),
    ):  # fmt: skip
        bias = turn_on * rng.standard_normal(3)
        values = averaged(signal, body.t, instants, dt) @ (distortion @ mounting).T
        values = values * (1 + logger.gain * rng.standard_normal(3))
        values = values + bias + drifting(rng, n, dt, instability, grade.instability_time)
        values += density * np.sqrt(0.5 * grade.rate) * rng.standard_normal((n, 3))  # one-sided density
        values = np.clip(values, -limit, limit)
        biases.append(bias)
        read.append(np.round(values / step) * step if step else values)
    stamps = stamped(rng, instants + logger.behind(grade.rate), logger.jitter)
    return ImuStream(stamps, read[0], read[1]), biases[0], biases[1], mounting


def read_wheels(
    rng: np.random.Generator, body: Body, robot: CompleteRobot, clock_offset: float, gain: float | Array = 1.0
) -> WheelStream:
    """Return the encoders' samples, stamped by their own clock, angles times `gain`."""
    enc = robot.encoders
    instants = np.arange(rng.uniform(0, 1) / enc.rate, body.t[-1], 1 / enc.rate)
    angle = scipy.integrate.cumulative_trapezoid(body.v_wheel, dx=DT, axis=0, initial=0) / robot.wheels.radius
    sampled = gain * np.stack([np.interp(instants, body.t, column) for column in angle.T], axis=1)
    step = 2 * np.pi / enc.counts if enc.counts else 0.0
    if step:
        sampled = np.floor(sampled / step + rng.uniform(0, 1, 4)) * step
    stamps = stamped(rng, instants, enc.jitter) - clock_offset
    return WheelStream(stamps, sampled - sampled[0], resolution=(step,) * 4)


def read_currents(
    rng: np.random.Generator, body: Body, robot: CompleteRobot, clock_offset: float, logger: Logger
) -> CurrentStream:
    """Return the motor currents, which share the encoders' clock."""
    cur = robot.currents
    instants = np.arange(rng.uniform(0, 1) / cur.rate, body.t[-1], 1 / cur.rate)
    busy = np.clip(body.v_wheel / 0.1, 0, 1)
    true = body.current * (1 + logger.ripple * busy * wander(rng, body.t.size, DT, 0.1)[:, None])
    sampled = np.stack([np.interp(instants, body.t, column) for column in true.T], axis=1)
    sampled = sampled * (1 + cur.gain * rng.standard_normal(4)) + cur.offset * rng.standard_normal(4)
    sampled += cur.noise * rng.standard_normal(sampled.shape)
    if cur.step:
        sampled = np.round(sampled / cur.step) * cur.step
    return CurrentStream(stamped(rng, instants, robot.encoders.jitter) - clock_offset, sampled)


def with_noise(robot: CompleteRobot, factor: float) -> CompleteRobot:
    """Return the robot with noise, drift, vibration and jitter of its sensors times a factor."""

    def louder_of(record: T, *names: str) -> T:
        return scaled(record, dict.fromkeys(names, factor))

    densities = ("accel_noise", "gyro_noise", "accel_instability", "gyro_instability")
    return replace(
        robot,
        imu_grade=louder_of(robot.imu_grade, *densities),
        imu=louder_of(robot.imu, "vibration", "vibration_rate"),
        encoders=louder_of(robot.encoders, "jitter"),
        currents=louder_of(robot.currents, "noise"),
    )
