"""Least squares over all trials: the model with its nuisances, and with effects where some are given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from granite_lab.discovery.arrow import Block, step
from granite_lab.discovery.bench import SAND
from granite_lab.discovery.follow import Responses, followed, simulated
from granite_lab.discovery.point import Fit, Point, Slopes
from granite_lab.discovery.problem import Problem
from granite_lab.discovery.slopes import blocks_at, slopes_at
from granite_lab.errors import EstimateError
from granite_lab.logs.trial import Array


@dataclass(frozen=True)
class Tolerance:
    """Drop of chi2 at which an iteration ends.

    Attributes:
        absolute: the least drop that counts.
        relative: the same as a share of the misfit; far from noise the last digits do not matter.
    """

    absolute: float
    relative: float


ROUGH, SEARCH, FINAL = Tolerance(5.0, 0.02), Tolerance(1.0, 0.01), Tolerance(0.1, 0.001)
"""For fits under noise that is not yet learnt, for comparing candidates, and for stating numbers."""

GIVE_UP = 0.2
"""A step that covers less than this share of the way to the goal ends a fit."""

STUCK = 1.0
"""Damping at which a fit ends that is still at more than twice its goal."""

TRUSTED, GOOD = 0.6, 0.85
"""Shares of the promised drop above which the derivatives are kept, and the damping falls."""

UNDAMPED, MOST_DAMPED = 1e-3, 1e4


def fit(
    problem: Problem,
    start: Point,
    *,
    slopes: Slopes | None = None,
    rounds: int = 12,
    renew: int = 2,
    goal: float = np.inf,
    fine: bool = True,
    tolerance: Tolerance = SEARCH,
) -> Fit:
    """Iterate to convergence, by Levenberg and Marquardt.

    The derivatives cost much more than a step, so they are kept while steps bring what they promise. On
    the way one simulation per command carries its trials along; a fit begins and ends with simulations of
    every trial. Sand has corners, where the smaller of two laws limits
    the shear stress, and beyond a corner old derivatives mislead.

    Args:
        problem: the trials, with the noise.
        start: where to begin.
        slopes: derivatives at the start, if they are known.
        rounds: most steps.
        renew: how often the derivatives may be computed anew.
        fine: near the solution; new derivatives are taken over small steps.
        goal: chi2 that makes the fit interesting; one that no longer approaches it is given up.
        tolerance: when to end.

    Raises:
        EstimateError: the simulation fails at the start or at the end.
    """
    point = start
    slopes = slopes or slopes_at(problem, point, fine=fine)
    responses, white, chi2 = _exactly(problem, point)
    blocks = blocks_at(problem, point, slopes)
    prior, low, high = problem.bounds(point)
    centre = problem.centres(point)
    damping, converged, fresh = 0.0, False, True
    count = problem.count
    for _ in range(rounds):
        least = max(tolerance.absolute, tolerance.relative * (chi2 - count))
        shared = np.concatenate([point.sand, point.common])
        move = step(blocks, list(white), list(point.trials), shared, (prior, centre), (low, high), damping)
        aim = _moved(problem, point, move.shared, move.local, low, high)
        promised = chi2 - problem.chi2(_promised(blocks, white, point, aim), aim)
        if promised < least and damping < 1:
            converged = responses.exact and (fresh or renew <= 0)
            if converged:
                break
            responses, white, chi2 = _exactly(problem, point)
            if not fresh and renew > 0:
                slopes, fresh, renew = slopes_at(problem, point, fine=fine, near=blocks), True, renew - 1
                blocks = blocks_at(problem, point, slopes)
            continue
        new = followed(problem, responses, point, aim, slopes)
        new_white = problem.white(problem.residuals(aim, new.trials)) if new is not None else None
        drop = chi2 - problem.chi2(new_white, aim) if new_white is not None else -np.inf
        kept = drop / promised if promised > 0 else -1.0
        if new is not None and new_white is not None and drop > 0:
            point, responses, white, chi2, fresh = aim, new, new_white, chi2 - drop, False
            damping = damping / 10 if kept > GOOD else damping
            damping = 0.0 if damping < UNDAMPED else damping
            if drop < GIVE_UP * (chi2 - goal):
                break
        elif fresh or renew <= 0:
            damping = max(10 * damping, 0.1)
            if damping > (STUCK if chi2 > 2 * goal else MOST_DAMPED):
                break
        if kept < TRUSTED and not fresh and renew > 0:
            responses, white, chi2 = _exactly(problem, point)
            slopes, fresh, renew = slopes_at(problem, point, fine=fine, near=blocks), True, renew - 1
            blocks = blocks_at(problem, point, slopes)
    if not responses.exact:
        responses, white, chi2 = _exactly(problem, point)
    residuals = problem.residuals(point, responses.trials)
    return Fit(point, residuals, chi2, blocks, slopes, converged, white)


def _exactly(problem: Problem, point: Point) -> tuple[Responses, tuple[Array, ...], float]:
    """Simulate every trial; return the responses, the whitened residuals and chi2."""
    responses = simulated(problem, point)
    if responses is None:
        raise EstimateError("a simulation of the fit does not converge", "check robot and soil files")
    white = problem.white(problem.residuals(point, responses.trials))
    return responses, white, problem.chi2(white, point)


def _promised(blocks: list[Block], white: Sequence[Array], point: Point, aim: Point) -> list[Array]:
    """Return the whitened residuals that the derivatives promise at another point."""
    shared = np.concatenate([aim.sand - point.sand, aim.common - point.common])
    return [
        w - b.local @ (new - old) - b.shared @ shared
        for b, w, old, new in zip(blocks, white, point.trials, aim.trials, strict=True)
    ]


def _moved(
    problem: Problem, point: Point, shared: Array, local: list[Array], low: Array, high: Array
) -> Point:
    whole = np.clip(np.concatenate([point.sand, point.common]) + shared, low, high)
    _, private = problem.effect_parameters(point.effects)
    trials = []
    for x, dx in zip(point.trials, local, strict=True):
        new = x + dx
        if private:
            n = x.size - len(private)
            new[n:] = np.clip(new[n:], [p.low for p in private], [p.high for p in private])
        trials.append(new)
    n = len(SAND)
    return replace(point, sand=whole[:n], common=whole[n:], trials=tuple(trials))
