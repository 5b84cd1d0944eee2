"""Velocity far from any standstill: slow changes by the wheels, quick ones by the IMU.

Where nothing anchors it for minutes, an integrated velocity is worth nothing. What is left is the
wheels' speed and what is known of slip: its ratio stays near a mean that is typical of firm ground,
grows with thrust, and scatters in bursts. How much it scatters, and how much the IMU's noise in
motion hides, is found by the likelihood of the wheels' speed in the trial itself.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import welch

from granite_lab.estimate import Estimate
from granite_lab.estimation import lateral, nodes, smoother
from granite_lab.estimation.integration import integrate
from granite_lab.estimation.passes import Problem, cut, first_velocity, lay_out
from granite_lab.estimation.process import SlipModel
from granite_lab.estimation.rest import inside

FIRM = SlipModel(
    steady=0.03, per_acceleration=0.0, thrust=0.02, onset=0.0, walk=0.0, ramp=0.0, scatter=0.05, time=0.3,
    bounded=True, limit=0.15, limit_time=30.0, memory=2.0,
)  # fmt: skip
"""Slip of wheels away from standstills: 3 % in steady motion with a std of 15 points, which takes in
sand; a tyre that needs 2 % of slip for a thrust of a tenth of its weight."""

TAKEN = 6000
"""Nodes on which the figures are tuned."""

APART = 0.15
"""Spacing of the wheels' samples for that [s]: closer ones are smoothed by the logger, and would only
say how smooth they are."""

HIGH = 3.0
"""Above this frequency [Hz] specific force is noise, not the robot's acceleration."""

Figures = dict[str, float]

PRIOR = {"scatter": (0.05, 1.0), "time": (0.3, 0.7), "thrust": (0.02, 0.7), "pitch": (0.005, 1.5)}
"""Median and std of the logarithm of each figure before the trial is seen: scatter [-] and correlation
time [s] of the slip ratio, slip by thrust [s^2/m], random walk of pitch that the gyro does not see
[rad/sqrt(s)]; the latter has a floor, because over minutes it is turns and shaking that the gyro gets
wrong, which the likelihood of single seconds does not show."""

RANGE = {"scatter": (3e-3, 0.6), "time": (0.05, 2.0), "thrust": (1e-3, 0.1), "pitch": (2e-3, 0.1)}

STEPS = (np.log(2.5), np.log(1.5))
"""Steps of the search, first wide, then fine."""


def refer(problem: Problem, offset: Estimate, slip_std: float | None = None) -> Problem:
    """Tune the noise in motion and the slip model on the trial, and find the sideways velocity.

    Args:
        problem: with wheels.
        offset: of the encoders' clock.
        slip_std: std of the steady slip ratio, if known.
    """
    base = FIRM if slip_std is None else dataclasses.replace(FIRM, steady=0.0, limit=slip_std)
    accel, rms = shaking(problem)
    noise = dataclasses.replace(problem.noise, accel_motion=accel, accel_stamps=0.0, vibration=rms)
    problem = dataclasses.replace(problem, slip=base, noise=noise)
    figures: Figures = {name: median for name, (median, _) in PRIOR.items()}
    for _ in range(2):
        parts = windows(problem, offset.value)

        def score(f: Figures, parts: list[Problem] = parts) -> float:
            prior = -0.5 * sum((np.log(f[n] / median) / std) ** 2 for n, (median, std) in PRIOR.items())
            return float(prior + sum(_likelihood(_with(part, f), offset.value) for part in parts))

        figures = climb(score, figures)
        problem = _with(problem, figures)
        problem = dataclasses.replace(problem, aside=_aside(problem, figures, offset.value))
        if problem.aside is None:
            break
    return problem


def shaking(problem: Problem) -> tuple[float, float]:
    """White noise of specific force in motion, and what vibration is left beside it.

    On rough ground, or sampled too slowly, vibration is as white as its spectrum above the motion's
    band is flat, and its integral is not bounded.

    Returns:
        density [m/s^2 sqrt(s)], rms [m/s^2].
    """
    imu, noise = problem.imu, problem.noise
    moving = ~inside(imu.t, problem.rests) & np.isfinite(imu.forward)
    dt = float(np.median(np.diff(imu.t)))
    if moving.sum() < 256 or 0.5 / dt < 2.0 * HIGH:
        return max(noise.accel, 0.1), noise.vibration
    frequency, density = welch(imu.forward[moving], fs=1.0 / dt, nperseg=256)
    high = np.sqrt(uniform_filter1d(density[frequency > HIGH], 5) / 2.0)
    white = float(np.percentile(high, 30))
    return white, float(np.sqrt(max(noise.vibration**2 - white**2 / dt, 0.0)))


def windows(problem: Problem, offset: float) -> list[Problem]:
    """Take up to three parts of the motion, `TAKEN` nodes in all, with the wheels thinned."""
    t = problem.imu.t
    moving = t[~inside(t, problem.rests)]
    assert problem.rolling is not None
    problem = dataclasses.replace(problem, rolling=problem.rolling.thinned(APART))
    if moving.size <= TAKEN:
        return [problem]
    size = TAKEN // 3
    parts = []
    for share in (1 / 6, 1 / 2, 5 / 6):
        first = int(share * moving.size) - size // 2
        begin, end = moving[first], moving[first] + size * float(np.median(np.diff(t)))
        parts.append(cut(problem, float(begin), float(end), offset))
    return [part for part in parts if part.imu.t.size > size // 4]


def climb(score: Callable[[Figures], float], start: Figures) -> Figures:
    """Climb to the highest score, one figure at a time, with wide and then with small steps."""
    best, height = dict(start), score(start)
    for step in STEPS:
        for _ in range(3):
            before = height
            for name, (low, high) in RANGE.items():
                for factor in (np.exp(step), np.exp(-step)):
                    while low <= (value := best[name] * factor) <= high:
                        other = {**best, name: float(value)}
                        reached = score(other)
                        if reached <= height + 0.1:
                            break
                        best, height = other, reached
            if height - before < 2.0:
                break
    return best


def _with(problem: Problem, figures: Figures) -> Problem:
    slip = dataclasses.replace(
        problem.slip, scatter=figures["scatter"], time=figures["time"], thrust=figures["thrust"]
    )
    noise = dataclasses.replace(problem.noise, gyro=figures["pitch"])
    return dataclasses.replace(problem, slip=slip, noise=noise)


def _likelihood(problem: Problem, offset: float) -> float:
    """Log-likelihood of the wheels' speed, the offset being sharp."""
    nominal = integrate(
        problem.imu, problem.robot, problem.rests, problem.faults,
        velocity=first_velocity(problem, offset),
        aside=None if problem.aside is None else problem.aside.velocity,
    )  # fmt: skip
    return smoother.filter_only(lay_out(problem, nominal, offset, 1e-6))


def _aside(problem: Problem, figures: Figures, offset: float) -> lateral.Sideways | None:
    imu, rolling = problem.imu, problem.rolling
    assert rolling is not None
    known = np.isfinite(rolling.speed)
    wheel = np.interp(imu.t, rolling.t[known] + offset, rolling.speed[known])
    slip = np.clip(problem.slip.steady + figures["thrust"] * nodes.push(imu), -0.4, 0.4)
    return lateral.find(
        imu, inside(imu.t, problem.rests), wheel * (1 - slip), accel=problem.noise.accel_motion,
        scatter=figures["scatter"], time=figures["time"],
    )  # fmt: skip
