"""How much the slip ratio scatters in steady motion, from the likelihood of the trial itself."""

from __future__ import annotations

import dataclasses

import numpy as np

from granite_lab.estimation import smoother
from granite_lab.estimation.integration import integrate
from granite_lab.estimation.passes import STILL, Problem, cut, first_velocity, lay_out
from granite_lab.estimation.process import SlipModel
from granite_lab.estimation.rest import Interval

LISTEN = 6.0
"""Length of a window of motion that is listened to [s]; the IMU is precise over these few seconds."""

WINDOWS = 3
"""So many windows are spread over the longest motion: sand differs along the way."""

FACTOR = 2.0
"""Ratio of neighbouring candidates."""

REFERENCE = 0.01
"""Scatter to start from [-]."""

LEAST, MOST = 0.002, 0.5
"""Bounds of the scatter [-]."""

WANDER_TIME = 300.0
"""Time in which the level of the slip ratio may wander by as much as it scatters [s]."""


def with_scatter(slip: SlipModel, scatter: float) -> SlipModel:
    """Return the model with this scatter about the level, and a level that wanders accordingly."""
    return dataclasses.replace(slip, scatter=scatter, walk=scatter / float(np.sqrt(WANDER_TIME)))


def listen_to(problem: Problem) -> list[Interval]:
    """Windows [s] at the start, in the middle and at the end of the longest motion after a standstill."""
    t = problem.imu.t
    ends = [end for _, end in problem.rests]
    begins = [begin for begin, _ in problem.rests[1:]] + [float(t[-1])]
    begin, end = max(zip(ends, begins, strict=True), key=lambda m: m[1] - m[0], default=(0.0, 0.0))
    if end - begin < 1.0:
        return []
    count = min(WINDOWS, max(1, int((end - begin) / LISTEN)))
    length = min(LISTEN, end - begin)
    places = np.linspace(begin, end - length, count) if count > 1 else [begin]
    return [(float(a) - (STILL if i == 0 else 0.0), float(a) + length) for i, a in enumerate(places)]


def identify_scatter(problem: Problem, offset: float) -> SlipModel:
    """Find the scatter of the slip ratio that makes the measurements most likely.

    Over seconds the IMU knows the body's velocity to a millimetre a second, so what the wheels do
    besides shows. A level of slip, on the contrary, stays free. Windows with faults tell nothing.

    Args:
        problem: the trial, with wheels.
        offset: of the encoders' clock [s].

    Returns:
        its slip model with scatter and walk replaced; unchanged where nothing can be told.
    """
    imu, faults = problem.imu, problem.faults
    if problem.rolling is None or problem.slip.bounded or not imu.has_pitch_rate or not imu.gravity:
        return problem.slip
    broken = [*faults.gaps, *faults.plateaus, *((r.begin, r.end) for r in faults.restarts)]
    windows = [
        (a, b) for a, b in listen_to(problem) if not any(begin < b and end > a for begin, end in broken)
    ]
    if not windows:
        return problem.slip
    parts = [cut(problem, begin, end, offset) for begin, end in windows]
    nominal = [
        integrate(p.imu, p.robot, p.rests, p.faults, velocity=first_velocity(p, offset)) for p in parts
    ]
    known: dict[int, float] = {}

    def score(place: int) -> float:
        if place not in known:
            slip = with_scatter(problem.slip, REFERENCE * FACTOR**place)
            known[place] = sum(
                smoother.filter_only(lay_out(dataclasses.replace(p, slip=slip), n, offset, 1e-3))
                for p, n in zip(parts, nominal, strict=True)
            )
        return known[place]

    best = 0
    while LEAST < REFERENCE * FACTOR**best < MOST:
        better = max((best - 1, best, best + 1), key=score)
        if better == best:
            break
        best = better
    return with_scatter(problem.slip, expected(best, score(best - 1), score(best), score(best + 1)))


def expected(best: int, below: float, here: float, above: float) -> float:
    """Root of the posterior mean of the scatter's variance, which the std of the estimate goes by.

    The posterior of the scatter's logarithm is taken for normal, by the parabola through three values.

    Args:
        best: the most likely candidate.
        below, here, above: log-likelihood of it and its neighbours.
    """
    bend = below - 2.0 * here + above
    if bend >= 0.0:
        return float(np.clip(REFERENCE * FACTOR**best, LEAST, MOST))
    peak = best + float(np.clip(0.5 * (above - below) / -bend, -0.5, 0.5))
    spread = min(float(np.log(FACTOR) / np.sqrt(-bend)), 0.7)
    return float(np.clip(REFERENCE * FACTOR**peak * np.exp(spread**2), LEAST, MOST))
