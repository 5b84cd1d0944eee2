"""Velocity far from any standstill: slow changes by the wheels, quick ones by the IMU.

Where nothing anchors it for minutes, an integrated velocity is worth nothing. What is left is the
wheels' speed and what is known of slip: its ratio stays near a mean that is typical of firm ground,
grows with thrust, and scatters in bursts. How much it scatters, and how much the IMU's noise in
motion hides, is found by the likelihood of the wheels' speed in the trial itself.

A turning robot also feeds its velocity to the left into the forward acceleration. In robot axes, with yaw
rate r and specific force f,

    dv_x/dt = f_x + g sin(pitch) + r v_y        dv_y/dt = f_y - g sin(roll) - r v_x

A car that drifts has v_y of a metre a second; r v_y is then as large as the thrust. Turning also makes
v_y observable: what was sideways a moment ago is forwards now, where the wheels measure it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from granite_lab.estimate import Estimate
from granite_lab.estimation.error_model import SIZE, D, S, SlipModel
from granite_lab.estimation.mounting import BodyImu
from granite_lab.estimation.nodes import Nodes, Problem, build, push
from granite_lab.estimation.nominal import Sideways
from granite_lab.estimation.rest import inside
from granite_lab.estimation.smoother import forward, merged, nominal_of
from granite_lab.estimation.spectrum import hann, spectral_density
from granite_lab.logs.trial import Array, part

VX, VY, BX, BY, SLIP = range(5)

STEP = 0.02
"""Spacing of the grid [s]; turning is slower."""

MOST = 60_000
"""A grid of more points than this is made sparser: 60 ms in an hour, which a robot's turns still outlast."""

ASIDE = 0.15
"""Mean sideways velocity over one second, as a share of the forward velocity (std)."""

BIAS_WALK = 0.05
"""Random walk of biases, with the part of pitch and roll that the gyros lose [m/s^2/sqrt(s)]."""

NO_TURN = 0.02
"""With a yaw rate of less rms than this [rad/s] the robot drives straight."""

FIRM = SlipModel(
    steady=0.03, per_acceleration=0.0, thrust=0.02, onset=0.0, walk=0.0, ramp=0.0, scatter=0.05, time=0.3,
    bounded=True, limit=0.05, limit_time=30.0, memory=2.0,
)  # fmt: skip
"""Slip of wheels away from standstills, by firm ground: 3 % in steady motion, which wanders by 5 points; a
tyre that needs 2 % of slip for a thrust of a tenth of its weight. Sand is taken in by `UNKNOWN`."""

UNKNOWN = float(np.sqrt(1 / 3 - FIRM.steady + FIRM.steady**2))
"""Root mean square distance of a slip ratio that is anywhere from 0 to 100 %, on ground of which nothing is
known, from the steady one of `FIRM`, by which the estimate goes. It is in the std only: in the estimate it
would give way to every drift of the pitch."""

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
    base = FIRM if slip_std is None else replace(FIRM, steady=0.0, limit=slip_std)
    accel, rms = shaking(problem)
    noise = replace(problem.noise, accel_motion=accel, accel_stamps=0.0, vibration=rms)
    problem = replace(problem, slip=base, noise=noise)
    figures: Figures = {name: median for name, (median, _) in PRIOR.items()}
    for _ in range(2):
        parts = windows(problem, offset.value)

        def score(f: Figures, parts: list[Problem] = parts) -> float:
            prior = -0.5 * sum((np.log(f[n] / median) / std) ** 2 for n, (median, std) in PRIOR.items())
            tuned = (_with(part, f) for part in parts)
            nodes = (build(p, nominal_of(p, offset.value), offset.value, Estimate(0.0, 1e-6)) for p in tuned)
            return float(prior + sum(forward(merged(n))[2].log_likelihood for n in nodes))

        figures = climb(score, figures)
        problem = _with(problem, figures)
        problem = replace(problem, aside=_aside(problem, figures, offset.value))
        if problem.aside is None:
            break
    return problem


def steady_slip(nodes: Nodes, std: float) -> Array:
    """(K, 14) states that a steady slip ratio of one std makes, beside those that the filter models."""
    error = np.zeros((nodes.t.size, SIZE))
    error[:, S] = std
    error[:, D] = std * np.cumsum(np.where(nodes.moving, nodes.w, 0.0) * np.diff(nodes.t, prepend=nodes.t[0]))
    return error


def shaking(problem: Problem) -> tuple[float, float]:
    """White noise of specific force in motion, and what vibration is left beside it.

    On rough ground, or sampled too slowly, vibration is as white as its spectrum above the motion's
    band is flat, and its integral is not bounded.

    Returns:
        density [m/s^2 sqrt(s)], rms [m/s^2].
    """
    imu, noise = problem.imu, problem.noise
    moving = ~inside(imu.t, problem.rests) & np.isfinite(imu.forward)
    dt = imu.period
    if moving.sum() < 256 or 0.5 / dt < 2.0 * HIGH:
        return max(noise.accel, 0.1), noise.vibration
    frequency, density = spectral_density(imu.forward[moving], 1.0 / dt, hann(256))
    high = np.sqrt(uniform_filter1d(density[frequency > HIGH], 5) / 2.0)
    white = float(np.percentile(high, 30))
    return white, float(np.sqrt(max(noise.vibration**2 - white**2 / dt, 0.0)))


def windows(problem: Problem, offset: float) -> list[Problem]:
    """Take up to three parts of the motion, `TAKEN` nodes in all, with the wheels thinned."""
    t, rolling = problem.imu.t, problem.rolling
    moving = t[~inside(t, problem.rests)]
    assert rolling is not None
    every = max(round(APART / float(np.median(np.diff(rolling.t)))), 1)
    problem = replace(problem, rolling=part(rolling, slice(None, None, every)))
    if moving.size <= TAKEN:
        return [problem]
    size = TAKEN // 3
    parts = []
    for share in (1 / 6, 1 / 2, 5 / 6):
        first = int(share * moving.size) - size // 2
        begin, end = moving[first], moving[first] + size * problem.imu.period
        parts.append(problem.cut(float(begin), float(end), offset))
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
    slip = replace(problem.slip, scatter=figures["scatter"], time=figures["time"], thrust=figures["thrust"])
    return replace(problem, slip=slip, noise=replace(problem.noise, gyro=figures["pitch"]))


def _aside(problem: Problem, figures: Figures, offset: float) -> Sideways | None:
    imu, rolling = problem.imu, problem.rolling
    assert rolling is not None
    known = np.isfinite(rolling.speed)
    wheel = np.interp(imu.t, rolling.t[known] + offset, rolling.speed[known])
    slip = np.clip(problem.slip.steady + figures["thrust"] * push(imu), -0.4, 0.4)
    return find_sideways(
        imu, inside(imu.t, problem.rests), wheel * (1 - slip), accel=problem.noise.accel_motion,
        scatter=figures["scatter"], time=figures["time"],
    )  # fmt: skip


def find_sideways(
    imu: BodyImu, still: np.ndarray, wheel: Array, *, accel: float, scatter: float, time: float
) -> Sideways | None:
    """Smooth forward and sideways velocity together over the plane.

    Args:
        imu: samples in robot axes.
        still: (N,) True at standstill.
        wheel: (N,) wheel speed less the slip that is expected [m/s].
        accel: white noise of the accelerations [m/s^2 sqrt(s)].
        scatter, time: std [-] and correlation time [s] of the slip ratio.

    Returns:
        None for a robot that drives straight, or whose lateral acceleration or yaw rate was not logged.
    """
    if not (np.isfinite(imu.left).any() and np.isfinite(imu.yaw_rate).any()) or not imu.t.size > 8:
        return None
    rates = [np.nan_to_num(rate) for rate in (imu.roll_rate, imu.pitch_rate, imu.yaw_rate)]
    middle = np.mean if not still.any() else (lambda rate: np.mean(rate[still]))
    roll_rate, pitch_rate = (rate - middle(rate) for rate in rates[:2])
    yaw = rates[2] - (float(np.mean(rates[2][still])) if still.any() else 0.0)
    if float(np.sqrt(np.mean(yaw**2))) < NO_TURN:
        return None
    t, step = imu.t, np.diff(imu.t, prepend=imu.t[0])
    good = [np.isfinite(force) for force in (imu.forward, imu.left)]
    force = [np.interp(t, t[g], f[g]) for g, f in zip(good, (imu.forward, imu.left), strict=True)]
    force[0] = force[0] + imu.gravity * np.sin(np.cumsum(pitch_rate * step))
    force[1] = force[1] - imu.gravity * np.sin(np.cumsum(roll_rate * step))
    # means over the grid's steps, from integrals
    spacing = max(STEP, imu.period, float(t[-1] - t[0]) / MOST)
    grid = np.arange(t[0], t[-1] + STEP, spacing)
    gained = np.zeros((grid.size, 5))
    for place, rate in zip((VX, VY), force, strict=True):
        gained[:, place] = np.diff(np.interp(grid, t, np.cumsum(rate * step)), prepend=0.0)
    turned = np.diff(np.interp(grid, t, np.cumsum(yaw * step)), prepend=0.0)
    velocity, std = _smooth(
        grid, gained, turned, np.interp(grid, t, wheel), np.interp(grid, t, still) > 0.99, accel, scatter,
        time,
    )  # fmt: skip
    return Sideways(np.interp(t, grid, velocity), np.interp(t, grid, std))


def _smooth(
    t: Array, gained: Array, turned: Array, wheel: Array, still: np.ndarray, accel: float, scatter: float,
    time: float,
) -> tuple[Array, Array]:  # fmt: skip
    """Return sideways velocity and std on the grid, by the gains of the states and of heading per step."""
    n, dt = t.size, float(t[1] - t[0])
    fast = max(float(np.sqrt(np.mean(wheel[~still] ** 2))) if (~still).any() else 0.0, 0.05)
    keep = np.exp(-dt / time)
    F = np.zeros((n, 5, 5))
    F[:] = np.diag([0.0, 0.0, 1.0, 1.0, keep])
    F[:, VX, VX] = F[:, VY, VY] = np.cos(turned)
    F[:, VX, VY], F[:, VY, VX] = np.sin(turned), -np.sin(turned)
    F[:, VX, BX] = F[:, VY, BY] = -dt
    walk = BIAS_WALK**2 * dt
    Q = np.diag([accel**2 * dt, accel**2 * dt, walk, walk, (1 - keep**2) * scatter**2]) + 1e-12 * np.eye(5)
    from filterpy.kalman import KalmanFilter  # noqa: PLC0415, takes half a second

    kf = KalmanFilter(dim_x=5, dim_z=1)
    kf.x = np.array([[wheel[0]], [0.0], [0.0], [0.0], [0.0]])
    kf.P = np.diag([0.3 * fast, 0.2 * fast, 0.3, 0.3, max(scatter, 1e-3)]) ** 2
    kf.B = np.eye(5)
    xs, Ps = np.empty((n, 5)), np.empty((n, 5, 5))
    sideways = np.array([[0.0, 1.0, 0.0, 0.0, 0.0]])
    for k in range(n):
        if k:
            kf.predict(F=F[k], Q=Q, u=gained[k, :, None])
        forwards = np.array([[1.0, 0.0, 0.0, 0.0, wheel[k]]])
        kf.update(np.array([[wheel[k]]]), R=np.array([[(0.02 * fast) ** 2]]), H=forwards)
        none = 1e-6 if still[k] else (ASIDE * fast) ** 2 / dt
        kf.update(np.zeros((1, 1)), R=np.array([[none]]), H=sideways)
        xs[k], Ps[k] = kf.x[:, 0], kf.P
    value, variance = xs[:, VY].copy(), Ps[:, VY, VY].copy()
    x, P = xs[-1], Ps[-1]
    for k in range(n - 2, -1, -1):  # with the known input, which FilterPy's smoother leaves out
        spread = F[k + 1] @ Ps[k] @ F[k + 1].T + Q
        gain = Ps[k] @ F[k + 1].T @ np.linalg.inv(spread)
        x = xs[k] + gain @ (x - F[k + 1] @ xs[k] - gained[k + 1])
        P = Ps[k] + gain @ (P - spread) @ gain.T
        value[k], variance[k] = x[VY], P[VY, VY]
    return value, np.sqrt(np.maximum(variance, 0.0))
