"""True motion over sand for judging the estimation: smooth, random, exactly at rest at both ends.

Not the simulator: slip here is a random process around the published slip ratios, with the slow
oscillations of velocity and the squat that the paper saw in its experiments but not in its model.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline
from scipy.signal import bilinear, lfilter

from granite_lab.hidden.contact import Array
from granite_lab.hidden.parts import Trapezoid
from granite_lab.hidden.sensors import wander
from granite_lab.hidden.simulator import DT, Body

SLIP_SPEED = np.array([0.0, 0.2, 0.3, 0.5, 0.7, 1.0])
SLIP_LEVEL = np.array([0.03, 0.0531, 0.0835, 0.165, 0.229, 0.3])
"""Measured slip ratio of the robot over desired velocity [m/s] (Table 3), extended at both ends."""

TERRAIN = 0.5
"""Std of the pitch over the ground [deg]."""


def smooth(signal: Array, width: float, *, delayed: bool = True) -> Array:
    """Return the signal averaged three times over `width` [s]: twice differentiable, of finite memory.

    As a filter in time it is delayed by 1.5 widths; otherwise each average is centred.
    """
    n = 2 * round(width / DT / 2) + 1
    box = np.ones(n) / n
    kernel = np.convolve(np.convolve(box, box), box)
    reach = kernel.size - 1
    ahead = 0 if delayed else reach // 2
    padded = np.concatenate([np.full(reach - ahead, signal[0]), signal, np.full(ahead, signal[-1])])
    return np.convolve(padded, kernel, mode="valid")


def field_over(rng: np.random.Generator, x: Array, length: float, std: float) -> Array:
    """Return a random function of the place, which is constant while the robot stands; zero at the start."""
    step = length / 8
    size = int((x.max() - x.min()) / step) + 12
    grid = x.min() + step * (np.arange(size) - 4)
    values = std * wander(rng, size, step, length)
    # a cubic keeps the second derivative, and so the angular acceleration, free of jumps
    found = CubicSpline(grid, values)(x)
    return np.asarray(found - found[0])


def oscillator(drive: Array, frequency: float, damping: float) -> Array:
    """Return the response of a unit-gain second-order system [Hz, -] to `drive`, starting at rest."""
    w = 2 * np.pi * frequency
    b, a = bilinear([w**2], [1.0, 2 * damping * w, w**2], fs=1 / DT)
    return np.asarray(lfilter(b, a, drive - drive[0]) + drive[0])


def body_velocity(rolling: Array, balance: Array, grip: float, slope: float, build_up: float) -> Array:
    """Return the velocity of a body that its wheels push through a saturating force of the slip.

    The force a unit of mass is grip (1 - exp(-slip/slope)), odd in the slip, against a resistance
    that it balances at the slip ratio `balance`. A standing body stays until the force exceeds it.

    Args:
        rolling: circumferential velocity of the wheels [m/s].
        balance: slip ratio of steady motion at each instant.
        grip: largest force a unit of mass [m/s^2].
        slope: slip ratio that gives 63 % of it.
        build_up: time constant with which the force builds up [s].
    """
    v = np.zeros_like(rolling)
    resistance = grip * -np.expm1(-balance / slope)
    now, force = 0.0, 0.0
    for k in range(1, rolling.size):
        slip = (rolling[k] - now) / max(rolling[k], now, 0.02)
        wanted = math.copysign(grip * -math.expm1(-abs(slip) / slope), slip)
        force += DT * (wanted - force) / (build_up + DT)
        now = max(0.0, now + DT * (force - resistance[k]))
        v[k] = now
    return v


def random_body(
    rng: np.random.Generator,
    *,
    velocity: float,
    acceleration: float,
    duration: float,
    still: tuple[float, float],
    slip: float | None,
    wobble: float,
    radius: float,
    mass: float,
) -> Body:
    """Draw a motion.

    Args:
        rng: source of all randomness.
        velocity, acceleration: of the desired trapezoid [m/s], [m/s^2].
        duration: from the command's start to its end [s].
        still: rest before the command and after it [s].
        slip: mean slip ratio; drawn around the published one when None.
        wobble: factor on roll and yaw.
        radius, mass: of wheel [m] and robot [kg].
    """
    command = Trapezoid(velocity, acceleration, velocity * (duration - velocity / acceleration))
    n = round((still[0] + duration + still[1]) / DT) + 1
    t = DT * np.arange(n)
    desired = np.array([command.velocity(ti - still[0]) for ti in t])
    rolling = smooth(desired, 0.015)  # the drive follows the command within some hundredths of a second
    moving = rolling / velocity

    level = float(np.interp(velocity, SLIP_SPEED, SLIP_LEVEL)) * (1 + 0.08 * rng.standard_normal())
    if slip is not None:
        level = slip
    ripple = rng.uniform(0.005, 0.02) * np.sin(
        2 * np.pi * rng.uniform(0.4, 1.4) * t + rng.uniform(0, 2 * np.pi)
    )
    ratio = level * (1 + 0.08 * wander(rng, n, DT, rng.uniform(0.5, 1.5))) + ripple * velocity / 0.7
    v = body_velocity(
        rolling,
        np.maximum(ratio, 0.005),
        grip=rng.uniform(3.0, 4.2),
        slope=rng.uniform(0.3, 0.45),
        build_up=rng.uniform(0.0, 0.01),
    )
    v = smooth(v, 0.009, delayed=False)
    a = np.gradient(v, DT)
    x = cumulative_trapezoid(v, dx=DT, initial=0)

    # squat by acceleration, and the change of sinkage between rest and driving
    squat = np.radians(-rng.uniform(0.1, 0.3)) * a + np.radians(rng.normal(-0.05, 0.1)) * moving
    squat = oscillator(squat, rng.uniform(3.0, 6.0), rng.uniform(0.3, 0.6))
    start_pitch, start_roll = np.radians(0.3) * rng.standard_normal(2) * (1.0, wobble)
    ground = field_over(rng, x, rng.uniform(0.15, 0.35), np.radians(TERRAIN))
    w = v * np.sin(squat)
    each = rng.normal(0, 0.002, 4)
    unlike = 1 + each + 0.004 * np.stack([wander(rng, n, DT, 0.4) for _ in range(4)], axis=1)
    resistance = mass * 9.81 * (0.12 + 0.2 * level) * moving
    share = np.array([0.46, 0.46, 0.54, 0.54]) / 2
    steady = still[0] + command.ramp + 0.5 * command.hold, still[0] + command.ramp + command.hold
    return Body(
        t=np.asarray(t, dtype=np.float64),
        x=x,
        v=v,
        a=a,
        w=w,
        dw=np.gradient(w, DT),
        pitch=start_pitch + ground + squat,
        roll=start_roll + field_over(rng, x, 0.3, np.radians(0.5 * wobble * TERRAIN)),
        yaw_rate=np.radians(0.5) * wobble * wander(rng, n, DT, 0.7) * moving,
        v_wheel=rolling[:, None] * unlike,
        force=(mass * a + resistance)[:, None] * share,
        start=still[0],
        stop=still[0] + duration,
        steady=steady,
    )
