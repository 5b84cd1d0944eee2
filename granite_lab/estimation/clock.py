"""The offset between the clocks of encoders and IMU: by correlation, then by how a trial begins and ends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.special import softmax

from granite_lab.estimate import Estimate
from granite_lab.estimation.error_model import TAU
from granite_lab.estimation.nodes import build
from granite_lab.estimation.nominal import Nominal
from granite_lab.estimation.problem import Problem
from granite_lab.estimation.rest import travel_of
from granite_lab.estimation.smoother import forward, nominal_of, settle
from granite_lab.estimation.wheels import Rolling
from granite_lab.logs.counters import interpolated
from granite_lab.logs.sensors.mounting import BodyImu
from granite_lab.logs.sensors.ramps import LARGEST, LEAST_RAMP, STEP, changing, correlate
from granite_lab.logs.sensors.standstill import Interval, wheels_still
from granite_lab.logs.sensors.two_clocks import FARTHEST, LONGEST_LAG, RIVAL, SEEN
from granite_lab.logs.trial import Array

WIDE, FINE = 0.02, 0.01
"""Spacing of the offsets whose likelihood is compared, at first and about the best of them [s]."""

TEMPER = 0.5
"""Weight of the likelihood of an offset: the slip model is an idealisation, exact to millimetres only."""

LEFT_OVER, RINGS = 2.5e-3, 2.0 * float(np.pi) * 10.0
"""Std of the offset by how the body really sets off and stops in the sand [s], and by play and tyres: a
robot that rings at 10 Hz [rad/s] follows its wheels so much later, a softer one by its period."""

STILL, MOVED = 0.25, 0.5
"""How much of the log judges a clock offset on the standing and the moving side of a change [s]."""

MOST = 2
"""So many onsets, and so many stops, judge a clock offset at most."""

HIDDEN = 0.015
"""Std of an offset that rests on changes during which samples are missing or at the rail [s]."""

LATEST = 0.01
"""Filters, buses and logging delay one sensor against the other by up to this [s]."""

LATENCY = LATEST / float(np.sqrt(3.0))
"""Std of an offset that is uniformly distributed up to `LATEST` [s]. It is left to the filter."""

LOG_ODDS = 8.0
"""Log prior odds against a larger offset: one logger in a hundred has one, anywhere in 0.4 s. It is applied
where the trial is more likely with it by more than this logarithm. The odds are the same against a change of
motion that tells nothing of the clock: a body that slides on when its wheels stand, stands while they turn,
or sets off late on soft tyres."""

OUTLYING = float(np.sqrt(2.0 * LOG_ODDS))
"""An offset of fewer std never reaches these odds."""


def ramps(rolling: Rolling) -> bool:
    """Whether the wheels' speed changes as fast as the clock offset needs it."""
    speed = rolling.speed_at(np.arange(rolling.t[0], rolling.t[-1], STEP))
    return speed.size > 1 and float(np.max(np.abs(changing(np.gradient(speed, STEP))))) >= LEAST_RAMP


def coarse_offset(imu: BodyImu, rolling: Rolling) -> Estimate:
    """Correlate the wheels' acceleration with the specific force along x over the ramps.

    Returns:
        how far the encoders' clock lies behind the IMU's [s] (to be added to their stamps), with a
        std that covers the body's lag behind the wheels; std NaN where nothing accelerates.
    """
    begin = max(imu.t[0], rolling.t[0]) - LARGEST
    end = min(imu.t[-1], rolling.t[-1]) + LARGEST
    if end - begin < 4 * LARGEST or rolling.t.size < 8:
        return Estimate(0.0)
    grid = np.arange(begin, end, STEP)
    wheel = changing(np.gradient(rolling.speed_at(grid), STEP))
    force = changing(interpolated(grid, imu.t, imu.forward))
    if float(np.max(np.abs(wheel))) < LEAST_RAMP:
        return Estimate(0.0)
    reach = round(LARGEST / STEP)
    values, best, clearness = correlate(force, wheel, reach)
    if clearness < 0.2:
        return Estimate(0.0)
    a, b, c = values[best - 1 : best + 2]
    lag = (best - reach + 0.5 * (a - c) / (a - 2 * b + c)) * STEP
    return Estimate(float(lag - 0.5 * LONGEST_LAG), float(np.hypot(0.02, 0.3 * LONGEST_LAG)))


def slow_offset(imu: BodyImu, rolling: Rolling) -> Estimate:
    """Correlate wheels and IMU over seconds, where odometry was smoothed and terrain shakes the robot.

    Pitch is taken out by its gyro. The smoothing is as long as it must be for a clear correlation.

    Returns:
        how far the encoders' clock lies behind the IMU's [s]; std NaN where it does not show, or where
        the body's usual lag behind the wheels explains the correlation as well.
    """
    begin, end = max(imu.t[0], rolling.t[0]), min(imu.t[-1], rolling.t[-1])
    if end - begin < 8.0 * FARTHEST or min(np.isfinite(x).sum() for x in (rolling.speed, imu.forward)) < 32:
        return Estimate(0.0)
    step = 2.0 * STEP
    grid = np.arange(begin, end, step)
    speed = rolling.speed_at(grid)
    force = interpolated(grid, imu.t, imu.forward)
    if imu.has_pitch_rate:
        turned = np.cumsum(np.nan_to_num(imu.pitch_rate) * np.diff(imu.t, prepend=imu.t[0]))
        force = force + imu.gravity * np.interp(grid, imu.t, turned)
    reach = round(FARTHEST / step)
    lags = np.arange(-reach, reach + 1)
    for width in (0.1, 0.25, 0.6):
        slow = [gaussian_filter1d(s, width / step) - gaussian_filter1d(s, 3.0 / step) for s in (force, speed)]
        values, best, clearness = correlate(slow[0], np.gradient(slow[1], step), reach)
        if clearness < SEEN:
            continue
        lag = float(lags[best] * step)
        usual = (lags * step >= 0.0) & (lags * step <= LONGEST_LAG)
        if values[usual].max() > RIVAL * values[best]:
            return Estimate(0.0)
        return Estimate(min(lag, max(lag - LONGEST_LAG, 0.0)), 0.25 * width)
    return Estimate(0.0)


class Clock(NamedTuple):
    """How far the encoders' clock lies behind the IMU's [s].

    Attributes:
        expected: what the filter is to expect, 0 for an ordinary latency.
        shown: by onsets and stops; std NaN where nothing shows it.
        near: about which the filter is linear.
    """

    expected: Estimate
    shown: Estimate
    near: float


def find_offset(problem: Problem, *, moved: bool = False) -> Clock:
    """Find the clock offset by correlation, then by the likelihood of onsets and stops.

    A body that follows its wheels by tyres, play or a soft mount looks like an offset when it sets off. So
    the whole trial must prefer a large offset to an ordinary latency; and where the wheels seem to be ahead,
    the body, which never leads them, must be stiff, too. Clocks of two computers, which were seconds apart
    and were `moved`, have no ordinary latency.
    """
    coarse = coarse_offset(problem.imu, problem.rolling) if problem.rolling is not None else Estimate(0.0)
    shown = by_changes(problem, coarse) if np.isfinite(coarse.std) else None
    if shown is None:
        return Clock(coarse, coarse, coarse.value)
    latency = latency_of(problem)
    usual, unusual = Estimate(0.0, latency), Estimate(shown.value, latency)
    if moved:
        return Clock(shown, shown, shown.value)
    likely = shown.value * latency**2 / (latency**2 + shown.std**2)
    if abs(shown.value) < LATEST / LATENCY * latency:
        return Clock(usual, shown, likely)
    applied = settle(problem, unusual, robust=False)
    # a body on a spring follows by a quarter of its period at most, whose square the compliance is
    follows = 0.5 * np.pi * float(np.sqrt(applied.problem.compliance)) + 2.0 * shown.std
    lags = 0.0 < shown.value < follows and applied.problem.compliance > problem.compliance
    if abs(shown.value) < OUTLYING * latency:
        return Clock(usual, shown, 0.0 if lags else likely)
    ordinary = settle(problem, usual, robust=False).by_filter.innovations
    if applied.by_filter.innovations.log_likelihood - ordinary.log_likelihood < LOG_ODDS:
        return Clock(usual, shown, 0.0)
    if lags:
        return Clock(usual, usual, 0.0)
    # a loud IMU shows its onsets vaguely: what they show must exclude an ordinary latency by themselves
    vague = abs(shown.value) < OUTLYING * float(np.hypot(latency, shown.std))
    return Clock(usual, shown, 0.0) if vague else Clock(unusual, shown, shown.value)


def latency_of(problem: Problem) -> float:
    """Return the std of an ordinary offset of the clocks [s].

    Where each row holds both sensors, its stamp is that of the row: a reading may be up to a period old.
    """
    latest = LATEST
    if problem.rolling is not None and np.array_equal(problem.rolling.t, problem.imu.t):
        latest = max(LATEST, problem.imu.period)
    return math.hypot(latest / LATEST * LATENCY, problem.stamp_std)


def agreed(by_onsets: Estimate, by_filter: Estimate, compliance: float) -> Estimate:
    """Weighted mean of two estimates of one offset [s]: by onsets and stops, and by the filter.

    Onsets and stops, and the ramps between them, each take a lag of the body for an offset in a way of
    their own: the std covers what the two differ by, and their errors need not cancel. The square root of the
    compliance [s^2] is the time in which the robot rings by one radian.
    """
    lag = LEFT_OVER * max(1.0, RINGS * float(np.sqrt(compliance)))
    std = float(np.hypot(by_filter.std, lag))
    share = std**2 / (by_onsets.std**2 + std**2)
    common = share * by_onsets.std + (1.0 - share) * std
    apart = float(np.sqrt(share * (1.0 - share))) * (by_onsets.value - by_filter.value)
    return Estimate(share * by_onsets.value + (1.0 - share) * by_filter.value, float(np.hypot(common, apart)))


def changes(problem: Problem, offset: float) -> list[Interval]:
    """Windows around the first onsets of motion and the first stops, given a rough clock offset [s]."""
    assert problem.rolling is not None
    begin, end = problem.imu.t[0], problem.imu.t[-1]
    turning = problem.rolling.t[wheels_still(travel_of(problem.rolling)).turns] + offset
    starts, stops = [], []
    for a, b in bridged_rests(problem.rests, turning):
        if b - a < STILL:
            continue
        # the IMU may go on shaking for a while after the wheels have stopped, and never before
        ahead, behind = turning[turning > b - 2 * STILL], turning[turning < a + STILL]
        if b < end - MOVED and ahead.size:
            starts.append((b - STILL, max(b, float(ahead[0])) + MOVED))
        if a > begin + MOVED and behind.size:
            stops.append((min(a, float(behind[-1])) - MOVED, a + STILL))
    return starts[:MOST] + stops[:MOST]


def bridged_rests(rests: Sequence[Interval], turning: Array) -> list[Interval]:
    """Join standstills between which no wheel turned (at `turning` [s]): their ends are no change."""
    between = [(a, b) for (_, a), (b, _) in pairwise(rests) if np.any((turning > a) & (turning < b))]
    begins, ends = [a for a, _ in rests[:1]], [b for _, b in rests[-1:]]
    return list(zip(begins + [b for _, b in between], [a for a, _ in between] + ends, strict=True))


def by_changes(problem: Problem, coarse: Estimate) -> Estimate | None:
    """Refine an offset by the likelihood of the moments when the robot sets off and stops; None without any.

    The body lags the wheels while both move, so correlation is biased. But the body neither sets off
    before the wheels do, nor usually goes on when they have stopped: the first bounds the offset from above,
    the second from below. The filter's model of slip (any share of the wheel's speed, so none when
    the wheels stand) holds both. Each change has its own likelihood, which an unusual change bounds from
    below: one that contradicts the others is outvoted, and where none is, the std covers them all.

    Returns:
        mean and std of the posterior, its likelihood tempered for what the slip model leaves out [s].
    """
    windows = changes(problem, coarse.value)
    if not windows:
        return None
    # where samples are missing the moment itself is not seen
    clear = [window for window in windows if not problem.faults.hide(*window)]
    windows, doubt = (clear, 0.0) if clear else (windows, HIDDEN)
    # these moments alone would take a part of any offset for compliance, or for wheels that spin
    problem = replace(problem, soft=problem.compliance, spins=False)
    cuts = [problem.cut(begin, end, coarse.value) for begin, end in windows]
    parts = [(cut, nominal_of(cut, coarse.value)) for cut in cuts]

    mean, std = posterior(
        parts, coarse, np.arange(-2.0 * coarse.std, 2.0 * coarse.std + 0.5 * WIDE, WIDE) + coarse.value
    )
    reach = max(1.5 * WIDE, 2.5 * std)
    mean, std = posterior(parts, coarse, np.arange(-reach, reach + 0.5 * FINE, FINE) + mean)
    return Estimate(mean, float(np.sqrt(std**2 + LEFT_OVER**2 + doubt**2)))


def posterior(parts: list[tuple[Problem, Nominal]], prior: Estimate, offsets: Array) -> tuple[float, float]:
    """Return mean and std of an offset [s] by equally spaced ones (J,); TAU covers what lies between them.

    The parts of a trial are cut at its changes of motion; those by which all offsets are alike are removed.
    """
    spacing = float(offsets[1] - offsets[0])
    score = -0.5 * ((offsets - prior.value) / prior.std) ** 2
    cell = (0.5 * spacing) ** -2.0
    precision, pull = np.full(offsets.size, cell), np.zeros(offsets.size)
    for part in tuple(parts):
        left = Estimate(0.0, 0.5 * spacing)
        solved = [forward(build(*part, float(c), left)) for c in offsets]
        likely = np.array([filtered.innovations.log_likelihood for filtered in solved])
        telling = TEMPER * (likely - likely.max())
        score += np.logaddexp(telling, -LOG_ODDS)
        if telling.min() > -1.0:
            parts.remove(part)
        after = 1.0 / np.array([filtered.P[-1, TAU, TAU] for filtered in solved])
        precision += TEMPER * (after - cell)
        pull += TEMPER * after * np.array([filtered.x[-1, TAU] for filtered in solved])
    weight, offsets = softmax(score), offsets + pull / precision
    mean = float(weight @ offsets)
    return mean, float(np.sqrt(weight @ ((offsets - mean) ** 2 + 1.0 / precision)))
