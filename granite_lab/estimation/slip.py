"""How the slip ratio changes in a trial: where it jumps, and how much it scatters elsewhere.

Over a quarter of a second an IMU knows a change of velocity to some millimetres a second, whatever it drifts
by over seconds. So the rolled distance less the one by the IMU alone shows each change of slip: wheels that
slip through, that spin on while the body stands, or that stand while the body slides on. A change far
beyond the usual ones is a jump: there the slip ratio may take any value, and elsewhere it scatters no more
for it. Such breaks are looked for in the same way in economic time series [1].

[1] A. Harvey, S. J. Koopman, Diagnostic checking of unobserved-components time series models, J. Business &
Economic Statistics 10 (1992).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.special import ndtri

from granite_lab.estimate import Estimate
from granite_lab.estimation.clock import STILL
from granite_lab.estimation.error_model import BA, BM, TH, SlipModel, V, std_of
from granite_lab.estimation.nodes import Nodes, build
from granite_lab.estimation.nominal import Nominal
from granite_lab.estimation.problem import Problem
from granite_lab.estimation.smoother import Solution, forward, nominal_of, settle, smooth
from granite_lab.estimation.wheels import Rolling
from granite_lab.logs.counters import interpolated, mad_std, runs
from granite_lab.logs.sensors.standstill import COAST, MOVING, Interval, inside
from granite_lab.logs.trial import Array
from granite_lab.parameters import GRAVITY

BIN = 0.25
"""Time over which slip is averaged [s]: the body follows the wheels on sand within it."""

STEPS = 5
"""Steps of the filter in it."""

FALSE_ALARM = 0.01
"""False-alarm probability of a log: that one of all its usual changes of slip is taken for a jump."""

SURE, LASTING = 0.02, 1.0
"""Largest speed of a body that stands on turning wheels, as a share of theirs [-], and shortest time [s]."""

WINDOW = 6.0
"""Length of a window of motion by which scatter is identified [s]; the IMU is precise over few seconds."""

WINDOWS = 3
"""So many windows are spread over the longest motion: sand differs along the way."""

FACTOR = 2.0
"""Ratio of neighbouring candidates."""

REFERENCE = 0.01
"""Scatter to start from [-]."""

LEAST_SCATTER, MOST_SCATTER = 0.002, 0.5
"""Bounds of the scatter [-]."""

WANDER_TIME = 300.0
"""Time in which the level of the slip ratio may wander by as much as it scatters [s]."""


@dataclass(frozen=True, eq=False)
class Changes:
    """Changes of slip from one bin of time to the next (J in all)."""

    begin: Array  # (J,) of the two bins together [s]
    end: Array
    slip: Array  # (J, 2) mean slip velocity in each [m/s]
    wheel: Array  # (J, 2) mean wheel velocity in each [m/s], signed, at least `COAST`
    unsure: Array  # (J,) std of the body's velocity by the IMU alone, which both have in common [m/s]
    drift: Array  # (J,) std of its change from one to the other by pitch and biases [m/s]

    @property
    def size(self) -> Array:
        """(J,) change of the slip ratio, times the slower of the two wheel velocities [m/s]."""
        ratio = self.slip / self.wheel
        return np.asarray(np.abs(ratio[:, 1] - ratio[:, 0]) * self.slower)

    @property
    def slower(self) -> Array:
        """(J,) magnitude of the slower of the two wheel velocities [m/s]."""
        return np.asarray(np.abs(self.wheel).min(axis=1))


def with_jumps(problem: Problem, offset: float) -> Problem:
    """Return the problem with its slip velocity's `jumps`, and with standstills on turning wheels."""
    rolling = problem.rolling
    assert rolling is not None
    while True:
        without = replace(problem, rolling=None, spacing=BIN / STEPS)
        by_imu = smooth(settle(without, Estimate(offset), robust=False))
        changes = slip_changes(by_imu, rolling, offset)
        stands = body_standstills(changes, problem.rests)
        if not stands:
            break
        # what the IMU alone knows next to a standstill may show more of it
        stands = [at_calm_instants(by_imu.nominal, interval, problem.rests) for interval in stands]
        still = runs(inside(problem.imu.t, [*problem.rests, *stands]))
        rests = tuple((float(problem.imu.t[a]), float(problem.imu.t[b - 1])) for a, b in still)
        problem = replace(problem, rests=rests)
    size = changes.size
    rare = -ndtri(0.5 * FALSE_ALARM / max(size.size, 1))
    jump = size > rare * usual_size(problem, changes)
    if not jump.any():
        return problem
    # the ratio to wheels that nearly stand says little of how far the slip velocity itself changed
    far = np.maximum(size, np.abs(changes.slip[:, 1] - changes.slip[:, 0]))
    t, rate = problem.imu.t, np.zeros(problem.imu.t.size)
    for k in np.flatnonzero(jump):
        # it may begin in the bin before and end in the one after, where it is too small to show
        at = (t >= changes.begin[k] - BIN) & (t <= changes.end[k] + BIN)
        rate[at] = np.maximum(rate[at], far[k] ** 2 / BIN)
    return replace(problem, jumps=rate)


def body_standstills(changes: Changes, rests: Sequence[Interval]) -> list[Interval]:
    """Return intervals [s] in which the wheels turn and the body, by the IMU alone, stands still.

    The slip ratio is then known to be 100 % within `SURE`. Wheels that dig themselves in hold the body for
    seconds; one that only turns round stands for less than a second, unless it goes on to stand.
    """
    body, far = changes.wheel - changes.slip, SURE * changes.slower
    stands = (np.abs(body) < 2.0 * changes.unsure[:, None]).all(axis=1) & (changes.unsure < far)
    stands &= changes.slower > MOVING
    standing = []
    for a, b in runs(stands):
        # it may come to rest late in the first bin and set off early in the last
        begin, end = float(changes.begin[a]) + BIN, float(changes.end[b - 1]) - BIN
        after = [start for start, _ in rests if abs(start - changes.end[b - 1]) < BIN]
        if after:
            standing.append((begin, after[0]))
        elif end - begin > LASTING:
            standing.append((begin, end))
    return standing


def at_calm_instants(nominal: Nominal, interval: Interval, rests: Sequence[Interval]) -> Interval:
    """Move both ends of a standstill [s] to instants at which vibration does not move the body.

    Wheels that turn shake a body that stands. What it does at the first instant is taken for its velocity.
    """
    t, edges = nominal.t, [edge for rest in rests for edge in rest]
    shaken = np.abs(nominal.v - uniform_filter1d(nominal.v, round(BIN / float(np.median(np.diff(t))))))

    def at_calmest(edge: float) -> float:
        near = np.abs(t - edge) < 0.5 * BIN
        return edge if edge in edges else float(t[near][np.argmin(shaken[near])])

    return at_calmest(interval[0]), at_calmest(interval[1])


def slip_changes(by_imu: Solution, rolling: Rolling, offset: float) -> Changes:
    """Compare the rolled distance with that of the solution `by_imu` alone, bin by bin of each motion."""
    nodes, smoothed = by_imu.nodes, by_imu.smoothed
    v_std = std_of(smoothed.P, {V: 1.0})
    pull = std_of(smoothed.P, {TH: GRAVITY, BA: -1.0, BM: -1.0})
    parts = [np.empty((8, 0))]
    for a, b in runs(nodes.moving):
        begin, end = nodes.t[max(a - 1, 0)], nodes.t[b - 1]
        edges = np.linspace(begin, end, max(round((end - begin) / BIN), 1) + 1)
        width = edges[1] - edges[0]
        pace = np.diff(interpolated(edges, rolling.t + offset, rolling.mean)) / width
        slip = pace - np.diff(np.interp(edges, nodes.t, by_imu.travelled)) / width
        wheel = np.where(pace < 0.0, -1.0, 1.0) * np.maximum(np.abs(pace), COAST)
        unsure, drift = (np.interp(edges[1:-1], nodes.t, std) for std in (v_std, pull))
        pairs = (edges[:-2], edges[2:], slip[:-1], slip[1:], wheel[:-1], wheel[1:], unsure, width * drift)
        parts.append(np.array(pairs))
    begin, end, slip_1, slip_2, wheel_1, wheel_2, unsure, drift = np.concatenate(parts, axis=1)
    slip, wheel = np.stack([slip_1, slip_2], axis=1), np.stack([wheel_1, wheel_2], axis=1)
    return Changes(begin, end, slip, wheel, unsure, drift)


def usual_size(problem: Problem, changes: Changes) -> Array:
    """(J,) std of the sizes of usual changes [m/s].

    It is made of the scatter of the ratio, by the median of all changes; of what the slip model allows while
    the wheels' speed changes; of the error of the body's velocity, which looks like a change of the ratio
    where the wheels' speed changes; and of what the IMU's pitch, biases and white noise change by meanwhile.
    """
    noise, wheel = problem.noise, np.abs(changes.wheel)
    scatter = mad_std(changes.size / changes.slower, 0.0) if changes.unsure.size else 0.0
    ramp = problem.slip.ramp * np.sqrt(np.abs(np.log(wheel[:, 1] / wheel[:, 0])))
    level = changes.unsure * np.abs(1.0 / changes.wheel[:, 1] - 1.0 / changes.wheel[:, 0])
    # means of a random walk over neighbouring bins differ by two thirds of its variance in a bin
    white = np.hypot(noise.accel, noise.accel_motion) * np.sqrt(2.0 / 3.0 * BIN)
    by_imu = np.hypot(white, changes.drift)
    return np.asarray(np.hypot(np.sqrt(scatter**2 + ramp**2 + level**2) * changes.slower, by_imu))


def with_scatter(slip: SlipModel, scatter: float) -> SlipModel:
    """Return the model with this scatter about the level, and a level that wanders accordingly."""
    return replace(slip, scatter=scatter, walk=scatter / float(np.sqrt(WANDER_TIME)))


def scatter_windows(problem: Problem) -> list[Interval]:
    """Windows [s] at the start, in the middle and at the end of the longest motion after a standstill."""
    t = problem.imu.t
    ends = [end for _, end in problem.rests]
    begins = [begin for begin, _ in problem.rests[1:]] + [float(t[-1])]
    begin, end = max(zip(ends, begins, strict=True), key=lambda m: m[1] - m[0], default=(0.0, 0.0))
    if end - begin < 1.0:
        return []
    count = min(WINDOWS, max(1, int((end - begin) / WINDOW)))
    length = min(WINDOW, end - begin)
    places = np.linspace(begin, end - length, count) if count > 1 else [begin]
    return [(float(a) - (STILL if i == 0 else 0.0), float(a) + length) for i, a in enumerate(places)]


def identify_scatter(problem: Problem, offset: float) -> SlipModel:
    """Find the scatter of the slip ratio that makes the measurements most likely.

    Over seconds the IMU knows the body's velocity to a millimetre a second, so what the wheels do besides
    shows. A level of slip, on the contrary, stays free. Windows with faults tell nothing; the slip model is
    unchanged where nothing can be told.
    """
    windows = [window for window in scatter_windows(problem) if not problem.faults.touch(*window)]
    if not windows:
        return problem.slip
    parts = [_without_scatter(problem.cut(begin, end, offset), offset) for begin, end in windows]

    @cache
    def score(place: int) -> float:
        variance = (REFERENCE * FACTOR**place) ** 2  # in which all noise is linear
        total = 0.0
        for none, Q, P0 in parts:
            scattering = replace(none, Q=none.Q + variance * Q, P0=none.P0 + variance * P0)
            total += forward(scattering).innovations.log_likelihood
        return total

    best = 0
    while LEAST_SCATTER < REFERENCE * FACTOR**best < MOST_SCATTER:
        better = max((best - 1, best, best + 1), key=score)
        if better == best:
            break
        best = better
    return with_scatter(problem.slip, expected(best, score(best - 1), score(best), score(best + 1)))


def _without_scatter(part: Problem, offset: float) -> tuple[Nodes, Array, Array]:
    """Return the nodes of a window without scatter of slip, and what a scatter of 1 adds to Q and P0."""
    nominal = nominal_of(part, offset)
    slips = (with_scatter(part.slip, 0.0), with_scatter(part.slip, 1.0))
    left = Estimate(0.0, 1e-3)
    none, unit = (build(replace(part, slip=slip), nominal, offset, left) for slip in slips)
    return none, unit.Q - none.Q, unit.P0 - none.P0


def expected(best: int, below: float, at_best: float, above: float) -> float:
    """Root of the posterior mean of the scatter's variance, which the std of the estimate goes by.

    The posterior of the scatter's logarithm is taken for normal, by the parabola through three log-
    likelihoods: of the best candidate, and of its neighbours.
    """
    bend = below - 2.0 * at_best + above
    if bend >= 0.0:
        return float(np.clip(REFERENCE * FACTOR**best, LEAST_SCATTER, MOST_SCATTER))
    peak = best + float(np.clip(0.5 * (above - below) / -bend, -0.5, 0.5))
    log_std = min(float(np.log(FACTOR) / np.sqrt(-bend)), 0.7)
    return float(np.clip(REFERENCE * FACTOR**peak * np.exp(log_std**2), LEAST_SCATTER, MOST_SCATTER))
