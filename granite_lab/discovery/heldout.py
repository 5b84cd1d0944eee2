"""How a model predicts trials that had no say in its numbers; linear about its fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from granite_lab.estimate import Estimate
from granite_lab.inference.fit import Fit
from granite_lab.inference.gap import held, tolerated
from granite_lab.inference.normal import Normal, posterior
from granite_lab.inference.problem import Problem
from granite_lab.inference.scales import SHARES
from granite_lab.logs.trial import Array


@dataclass(frozen=True, eq=False)
class Predicted:
    """Misfits of all trials under noise and a discrepancy of the tolerated size.

    Attributes:
        own: (trials,) with all trials in the fit.
        left_out: (trials,) each predicted by the others; NaN where there are none.
        speed_left_out: (trials,) each predicted by the trials of other commands; NaN where there are none.
        expected: (trials,) what noise and the tolerance leave of a model that is right.
    """

    own: Array
    left_out: Array
    speed_left_out: Array
    expected: Array

    @property
    def unseen(self) -> Array:
        """(trials,) left out, or those of the fit itself where nothing can be left out."""
        return self.left_out if np.isfinite(self.left_out).any() else self.own


def predict(problem: Problem, fit: Fit, tolerance: float) -> Predicted:
    """Leave out one trial after the other, then one command after the other.

    Args:
        problem: the trials.
        fit: of all of them.
        tolerance: discrepancy that is taken for granted, as a share of a channel's rms.
    """
    try:
        return _predict(problem, fit, tolerance)
    except np.linalg.LinAlgError:  # a trial that leaves its numbers open
        nothing = np.full(len(problem.trials), np.nan)
        return Predicted(nothing, nothing, nothing, nothing)


def _predict(problem: Problem, fit: Fit, tolerance: float) -> Predicted:
    normal = problem.normal(fit.point, fit.slopes, fit.residuals, apart=True)
    order = [i for own in problem.commands for i in own]
    n = len(order)
    parts = {i: k for k, i in enumerate(order)}
    command = np.array([next(c for c, own in enumerate(problem.commands) if i in own) for i in range(n)])
    own, left, speed, expected = (np.full(n, np.nan) for _ in range(4))
    everyone = _shared(problem, fit, normal, tolerance, list(range(n)))
    flexible = _shared(problem, fit, normal, SHARES[-1], list(range(n)))
    across = [
        _shared(problem, fit, normal, tolerance, [parts[i] for i in range(n) if command[i] != c])
        if len(problem.commands) > 1
        else None
        for c in range(len(problem.commands))
    ]
    for i in range(n):
        k = parts[i]
        own[i] = _misfit(problem, fit, normal, k, i, tolerance, everyone)
        expected[i] = _misfit(problem, fit, normal, k, i, SHARES[-1], flexible)
        for share, sign in ((tolerance, 1), (SHARES[-1], -1)):
            scales = tolerated(fit.scales, share)
            expected[i] += sign * sum(held(c, scales) for c in normal.parts[k].channels)
        if n > 1:
            others = _shared(problem, fit, normal, tolerance, [j for j in range(n) if j != k])
            left[i] = _misfit(problem, fit, normal, k, i, tolerance, others)
        step = across[command[i]]
        if step is not None:
            speed[i] = _misfit(problem, fit, normal, k, i, tolerance, step)
    return Predicted(own, left, speed, expected)


def _shared(problem: Problem, fit: Fit, normal: Normal, share: float, only: Sequence[int]) -> Array:
    """Return the step of the shared numbers that some trials ask for."""
    M, logdet = normal.marginal(tolerated(fit.scales, share), only)
    std, mean = problem.prior(fit.point, fit.scales)
    first = sum(x.size for x in fit.point.trials)
    return posterior(M, logdet, std**-2.0, mean - fit.point.vector).step[first:]


def _misfit(
    problem: Problem, fit: Fit, normal: Normal, part: int, trial: int, share: float, step: Array
) -> float:
    """Return the misfit of one trial once its own numbers are refitted, the shared ones given."""
    M, _ = normal.marginal(tolerated(fit.scales, share), [part])
    sizes = [x.size for x in fit.point.trials]
    begin, total = sum(sizes[:trial]), sum(sizes)
    own = np.arange(begin, begin + sizes[trial])
    shared = np.arange(total, normal.parameters)
    std, mean = problem.prior(fit.point, fit.scales)
    precision, pull = std[own] ** -2.0, (mean - fit.point.vector)[own]
    right = M[own, -1] - M[np.ix_(own, shared)] @ step + precision * pull
    squares = M[-1, -1] - 2 * step @ M[shared, -1] + step @ M[np.ix_(shared, shared)] @ step
    N = M[np.ix_(own, own)] + np.diag(precision)
    scale = 1 / np.sqrt(np.diag(N))
    solved = scale * np.linalg.solve(N * np.outer(scale, scale), scale * right)
    return float(squares + precision @ pull**2 - right @ solved)


FEWEST_SPEEDS = 3
"""Speeds from which on they are left out in place of trials: a law in speed has one number more than a
line."""


def transferred(problem: Problem, predicted: Predicted) -> Array:
    """Return the misfits of the speeds that were left out, of the trials where there are few speeds.

    They are those of the fit itself where nothing could be left out.
    """
    speeds = len({t.observation.variant.velocity for t in problem.trials})
    if speeds >= FEWEST_SPEEDS and np.isfinite(predicted.speed_left_out).any():
        return predicted.speed_left_out
    return predicted.unseen


def predicts_better(problem: Problem, before: Predicted, after: Predicted) -> bool:
    """Tell whether a model predicts what was left out better by more than a standard error."""
    drop = transferred(problem, before) - transferred(problem, after)
    drop = drop[np.isfinite(drop)]
    if drop.size < 2:
        return True
    return bool(drop.sum() > np.sqrt(drop.size) * np.std(drop, ddof=1))


def closed(before: Array, after: Array, gap: Array) -> Estimate:
    """Return the share of a gap that is closed, summed over trials, with its standard error.

    Args:
        before, after: (trials,) misfits without and with what closes it.
        gap: (trials,) the whole gap.
    """
    known = np.isfinite(before) & np.isfinite(after) & np.isfinite(gap)
    closes, whole, n = (before - after)[known], gap[known], int(known.sum())
    if n == 0 or whole.sum() <= 0:
        return Estimate(float("nan"), float("nan"))
    share = float(closes.sum() / whole.sum())
    if n < 2:
        return Estimate(share, float("nan"))
    away = closes - share * whole
    return Estimate(share, float(np.sqrt(n / (n - 1) * np.sum(away**2)) / whole.sum()))
