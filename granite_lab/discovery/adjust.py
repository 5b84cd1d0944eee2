"""Gauss-Newton over all trials: the model with its nuisances, and with effects where some are given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from granite_lab.discovery.arrow import step
from granite_lab.discovery.bench import SAND
from granite_lab.discovery.point import Fit, Point, Slopes
from granite_lab.discovery.problem import Problem
from granite_lab.discovery.slopes import blocks_at, slopes_at
from granite_lab.errors import EstimateError
from granite_lab.logs.trial import Array

TOLERANCE, RELATIVE = 0.3, 0.003
"""Drop of chi2 at which an iteration ends, absolute and as a share of the misfit."""

GIVE_UP = 0.1
"""A step that covers less than this share of the way to the goal ends a fit."""


def fit(
    problem: Problem,
    start: Point,
    *,
    slopes: Slopes | None = None,
    rounds: int = 8,
    renew: int = 1,
    goal: float = np.inf,
) -> Fit:
    """Iterate to convergence.

    The derivatives are computed at the start and `renew` times on the way; in between they are
    kept (chord method), while the residuals come from simulations of every trial.

    Args:
        problem: the trials, with the noise.
        start: where to begin.
        slopes: derivatives at the start, if they are known.
        rounds: most steps.
        renew: how often the derivatives are computed anew.
        goal: chi2 that makes the fit interesting; one that no longer approaches it is given up.

    Raises:
        EstimateError: the simulation fails at the start.
    """
    point = start
    slopes = slopes or slopes_at(problem, point)
    residuals = problem.residuals(point)
    if residuals is None:
        raise EstimateError("the simulation does not converge at the start of a fit", "check the files")
    blocks = blocks_at(problem, point, slopes)
    white = problem.white(residuals)
    chi2 = problem.chi2(white, point)
    prior, low, high = problem.bounds(point)
    centre = problem.centres(point)
    damping, converged = 0.0, False
    count = sum(int(w.known.sum()) for own in problem.whiteners for w in own)
    for _ in range(rounds):
        shared = np.concatenate([point.sand, point.common])
        move = step(blocks, list(white), list(point.trials), shared, (prior, centre), (low, high), damping)
        trial_point = _moved(problem, point, move.shared, move.local, low, high)
        new = problem.residuals(trial_point)
        new_white = problem.white(new) if new is not None else None
        new_chi2 = problem.chi2(new_white, trial_point) if new_white is not None else np.inf
        # far from noise the last digits do not matter
        tolerance = max(TOLERANCE, RELATIVE * (chi2 - count))
        if new_chi2 > chi2 + TOLERANCE:
            damping = max(10 * damping, 0.3)
            if damping > 1e4:
                break
            if renew > 0:
                slopes = slopes_at(problem, point)
                blocks, renew = blocks_at(problem, point, slopes), renew - 1
            continue
        drop = chi2 - new_chi2
        point, white, chi2 = trial_point, new_white or white, min(new_chi2, chi2)
        assert new is not None
        residuals = new
        damping = 0.0 if damping < 0.1 else damping / 10
        if drop < GIVE_UP * (chi2 - goal):
            break
        if abs(drop) < tolerance:
            if renew <= 0:
                converged = True
                break
            slopes = slopes_at(problem, point)
            blocks, renew = blocks_at(problem, point, slopes), renew - 1
    return Fit(point, residuals, chi2, blocks, slopes, converged, white)


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
