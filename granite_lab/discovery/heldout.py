"""How a model predicts trials that had no say in its numbers; linear about its fit."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np

from granite_lab.estimate import Estimate
from granite_lab.inference.constants import FEWEST_SPEEDS, UNOBSERVABLE
from granite_lab.inference.fit import Fit
from granite_lab.inference.gap import determined_by_prior, tolerated
from granite_lab.inference.normal import JITTER, least_within, posterior
from granite_lab.inference.problem import Problem
from granite_lab.inference.scales import DISCREPANCIES
from granite_lab.logs.trial import Array
from granite_lab.parameters import by_speed


@dataclass(frozen=True, eq=False)
class Predicted:
    """Misfits of all trials under noise and a discrepancy of the tolerated size.

    Attributes:
        in_fit: (trials,) with all trials in the fit.
        left_out: (trials,) each predicted by the others, see `by_others`; NaN where there are none.
        speed_left_out: (trials,) each predicted by the trials of other commands; NaN where there are none.
        expected: (trials,) what noise and the tolerance leave of a model that is right.
        loss: per part that is left out, see `units`, minus twice the logarithm of its probability density
            given the other parts: what they leave open of the numbers counts as uncertainty.
        squares: the sum of squares in that density, over the covariance of noise, tolerance and uncertainty.
    """

    in_fit: Array
    left_out: Array
    speed_left_out: Array
    expected: Array
    loss: Array
    squares: Array

    @classmethod
    def unknown(cls, problem: Problem) -> Predicted:
        """Return what is known of trials that cannot be predicted: nothing."""
        trials, parts = (np.full(len(x), np.nan) for x in (problem.trials, units(problem)))
        return cls(trials, trials, trials, trials, parts, parts)

    @property
    def unseen(self) -> Array:
        """(trials,) left out, or those of the fit itself where nothing can be left out."""
        return self.left_out if np.isfinite(self.left_out).any() else self.in_fit


class Equations:
    """The normal equations of a fit, trial by trial, each with a discrepancy of its own.

    Args:
        problem: the trials.
        fit: of all of them.
        keep: keep what only other residuals need, see `if_right`.
    """

    def __init__(self, problem: Problem, fit: Fit, *, keep: bool = False) -> None:
        self.problem, self.fit = problem, fit
        self.normal = problem.normal(fit.point, fit.derivatives, fit.residuals, apart=True, keep=keep)
        std, mean = problem.prior(fit.point, fit.scales)
        self.precision, self.pull = std**-2.0, mean - fit.point.vector
        self.low, self.high = (side - fit.point.vector for side in problem.bounds(fit.point))

    def without(self, ids: Sequence[str]) -> Equations:
        """Return the equations with the shared numbers of some effects held at their neutral values."""
        point, other = self.fit.point, copy(self)
        other.precision, other.pull = self.precision.copy(), self.pull.copy()
        first = self.precision.size - point.common.size
        for k, (id_, p) in enumerate(self.problem.parameters(point.effects, per_trial=False), first):
            if id_ in ids:
                other.precision[k] /= UNOBSERVABLE**2
                other.pull[k] = p.neutral - point.vector[k]
        return other

    def if_right(self, right: Fit) -> Equations:
        """Return the equations for data that another fit explains without any error."""
        between = tuple(own - other for own, other in zip(self.fit.residuals, right.residuals, strict=True))
        other = copy(self)
        other.normal = self.normal.at(self.problem.white(between))
        return other

    def marginal(self, share: float, only: Sequence[int]) -> tuple[Array, float]:
        """Return the matrix of some trials under a discrepancy of some share, and its log determinant."""
        return self.normal.marginal(tolerated(self.fit.scales, share), only)

    def determined_by_prior(self, part: int, share: float) -> float:
        """Return the number of directions along which the discrepancy of a trial is held by its prior."""
        scales = tolerated(self.fit.scales, share)
        return sum(determined_by_prior(c, scales) for c in self.normal.parts[part].channels)


def predict(problem: Problem, fit: Fit, tolerance: float, equations: Equations | None = None) -> Predicted:
    """Leave out one trial after the other, then one command after the other.

    Args:
        problem: the trials.
        fit: of all of them.
        tolerance: discrepancy that is taken for granted, as a share of a channel's rms.
        equations: of the fit, where they are not the usual ones.
    """
    try:
        return _predict(problem, equations or Equations(problem, fit), tolerance)
    except np.linalg.LinAlgError:  # a trial that leaves its numbers open
        return Predicted.unknown(problem)


def _predict(problem: Problem, equations: Equations, tolerance: float) -> Predicted:
    order = [i for repetitions in problem.commands for i in repetitions]
    n = len(order)
    parts = {i: k for k, i in enumerate(order)}
    in_fit, left, speed, expected = (np.full(n, np.nan) for _ in range(4))
    held = shared_step(equations, tolerance, list(range(n)))
    flexible = shared_step(equations, DISCREPANCIES[-1], list(range(n)))
    for i in range(n):
        k = parts[i]
        in_fit[i] = _misfit(equations, k, i, tolerance, held)
        expected[i] = _misfit(equations, k, i, DISCREPANCIES[-1], flexible)
        expected[i] += equations.determined_by_prior(k, tolerance) - equations.determined_by_prior(
            k, DISCREPANCIES[-1]
        )
    for i in range(n) if n > 1 else ():
        left[[i]] = by_others(problem, equations, tolerance, [i])
    for out in problem.commands if len(problem.commands) > 1 else ():
        speed[list(out)] = by_others(problem, equations, tolerance, out)
    loss, squares = _densities(problem, equations, tolerance)
    return Predicted(in_fit, left, speed, expected, loss, squares)


def losses(problem: Problem, equations: Equations, tolerance: float) -> Array:
    """Return `Predicted.loss` alone; NaN where trials cannot be predicted."""
    return left_out(problem, equations, tolerance)[0]


def left_out(problem: Problem, equations: Equations, tolerance: float) -> tuple[Array, Array]:
    """Return `Predicted.loss` and `Predicted.squares`; NaN where trials cannot be predicted."""
    try:
        return _densities(problem, equations, tolerance)
    except np.linalg.LinAlgError:  # a trial that leaves its numbers open
        unknown = np.full(len(units(problem)), np.nan)
        return unknown, unknown


def _densities(problem: Problem, equations: Equations, tolerance: float) -> tuple[Array, Array]:
    """Return `Predicted.loss` and `Predicted.squares`.

    Raises:
        np.linalg.LinAlgError: a trial leaves its numbers open.
    """
    order = [i for repetitions in problem.commands for i in repetitions]
    whole = _density(equations, tolerance, range(len(order)))
    others = [[k for k, i in enumerate(order) if i not in out] for out in units(problem)]
    parts = [whole - _density(equations, tolerance, rest) if rest else (np.nan, np.nan) for rest in others]
    loss, squares = np.array(parts, dtype=np.float64).T
    return loss, squares


def _density(equations: Equations, share: float, only: Sequence[int]) -> Array:
    """Return minus twice the log marginal likelihood of some trials, and the sum of squares in it."""
    fitted = posterior(*equations.marginal(share, only), equations.precision, equations.pull)
    return np.array([-2 * fitted.evidence, fitted.misfit])


def by_others(problem: Problem, equations: Equations, tolerance: float, out: Sequence[int]) -> Array:
    """Return the misfits of some trials that all others predict, over the covariance of the prediction.

    What the others leave open of the numbers is part of it: few speeds tell how a strength goes on.

    Args:
        problem, equations, tolerance: as in `predict`.
        out: numbers of the trials that are left out, each predicted by itself.
    """
    order = [i for repetitions in problem.commands for i in repetitions]
    rest = [k for k, i in enumerate(order) if i not in out]
    of_rest = _density(equations, tolerance, rest)
    parts = [order.index(i) for i in out]
    return np.array([(_density(equations, tolerance, [*rest, k]) - of_rest)[1] for k in parts])


def shared_step(equations: Equations, share: float, only: Sequence[int]) -> Array:
    """Return the step of the shared numbers that some trials ask for, within the bounds.

    Few speeds may ask for numbers far beyond them, where the model is not linear.
    """
    M, _ = equations.marginal(share, only)
    p, first = equations.precision.size, sum(x.size for x in equations.fit.point.trials)
    N, right = M[:p, :p] + np.diag(equations.precision), M[:p, -1] + equations.precision * equations.pull
    return least_within(N, right, equations.low, equations.high, JITTER)[first:]


def _misfit(equations: Equations, part: int, trial: int, share: float, step: Array) -> float:
    """Return the misfit of one trial once its own numbers are refitted, the shared ones given."""
    M, _ = equations.marginal(share, [part])
    sizes = [x.size for x in equations.fit.point.trials]
    begin, total = sum(sizes[:trial]), sum(sizes)
    local = np.arange(begin, begin + sizes[trial])
    shared = np.arange(total, equations.precision.size)
    precision, pull = equations.precision[local], equations.pull[local]
    right = M[local, -1] - M[np.ix_(local, shared)] @ step + precision * pull
    squares = M[-1, -1] - 2 * step @ M[shared, -1] + step @ M[np.ix_(shared, shared)] @ step
    N = M[np.ix_(local, local)] + np.diag(precision)
    scale = 1 / np.sqrt(np.diag(N))
    solved = scale * np.linalg.solve(N * np.outer(scale, scale), scale * right)
    return float(squares + precision @ pull**2 - right @ solved)


def predicts_better(before: Array, after: Array) -> bool:
    """Tell whether a model predicts what was left out better by more than a standard error.

    Args:
        before, after: (units,) losses of the other model and of this one.
    """
    drop = before - after
    drop = drop[np.isfinite(drop)]
    if drop.size < 2:
        return True
    return bool(drop.sum() > np.sqrt(drop.size) * np.std(drop, ddof=1))


def units(problem: Problem) -> tuple[Sequence[int], ...]:
    """Return the trials that are left out together: those of a command, each by itself with few speeds."""
    if len(speeds(problem)) >= FEWEST_SPEEDS:
        return problem.commands
    return tuple((i,) for i in range(len(problem.trials)))


def speeds(problem: Problem) -> set[float]:
    """Return the desired velocities of the commands [m/s], as `by_speed` groups them."""
    firsts = (problem.trials[repetitions[0]] for repetitions in problem.commands)
    return set(by_speed(trial.observation.variant.velocity for trial in firsts))


def closed(before: Array, after: Array, gap: Array) -> Estimate:
    """Return the share of a gap that is closed, summed over trials, with its standard error.

    Args:
        before, after: (trials,) misfits without and with what closes it.
        gap: (trials,) the whole gap.
    """
    finite = np.isfinite(before) & np.isfinite(after) & np.isfinite(gap)
    closes, whole, n = (before - after)[finite], gap[finite], int(finite.sum())
    if n == 0 or whole.sum() <= 0:
        return Estimate(float("nan"), float("nan"))
    share = float(closes.sum() / whole.sum())
    if n < 2:
        return Estimate(share, float("nan"))
    away = closes - share * whole
    return Estimate(share, float(np.sqrt(n / (n - 1) * np.sum(away**2)) / whole.sum()))


def gaps(before: Predicted, after: Predicted) -> tuple[Array, Array]:
    """Return (trials,) what a model misses beyond noise and tolerance, on trials and on speeds left out.

    Args:
        before, after: predictions without and with what closes it; a model that is better than expected
            shows what can be reached.
    """
    floor = np.fmin(after.expected, before.expected)
    pairs = ((before.unseen, after.unseen), (before.speed_left_out, after.speed_left_out))
    trials, speeds = (b - (floor if floor.sum() < np.nansum(a) else a) for b, a in pairs)
    return trials, speeds
