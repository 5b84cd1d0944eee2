"""Fits of sets of effects, side by side, from one or several starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from granite_lab.errors import EstimateError
from granite_lab.inference.descent import LEAST_OF_ROUGH
from granite_lab.inference.fit import ROUNDS, Fit, fit
from granite_lab.inference.normal import Scales
from granite_lab.inference.point import Point
from granite_lab.inference.problem import Problem


def fit_sets(
    problem: Problem,
    starts: Sequence[tuple[Point, Scales]],
    others: Mapping[tuple[str, ...], Fit],
) -> dict[tuple[str, ...], Fit]:
    """Return the best fit of each set of effects, those left out whose starts have no solution.

    A fit can be no worse than that of a part of the set: one that is has missed the optimum. It is made again
    from the part, with the other effects at their neutral values.

    Args:
        problem: the trials.
        starts: where to begin, with the set switched on, and the scales to begin with; several of a set.
        others: fits of other sets.
    """
    fits = best_fits(problem, starts)
    missed = []
    for key, effects in {set_of(start): start.effects for start, _ in starts}.items():
        part = _best_part({**others, **fits}, key)
        if part is not None and not (key in fits and fits[key].evidence > part.evidence):
            missed.append((_with_neutral(problem, part.point, effects), part.scales))
    for key, again in best_fits(problem, missed).items():
        if key not in fits or again.evidence > fits[key].evidence:
            fits[key] = again
    return fits


def _best_part(fits: Mapping[tuple[str, ...], Fit], effects: Sequence[str]) -> Fit | None:
    """Return the likeliest fit of a set that lacks some of the effects and holds no others."""
    parts = (fit for key, fit in fits.items() if set(key) < set(effects))
    return max(parts, key=lambda fit: fit.evidence, default=None)


def _with_neutral(problem: Problem, point: Point, effects: Sequence[str]) -> Point:
    """Return a point with further effects switched on at their neutral values."""
    for id_ in (e for e in effects if e not in point.effects):
        point = problem.with_effect(point, id_, [p.neutral for p in problem.parameters_of(id_)])
    return point


def best_fits(
    problem: Problem,
    starts: Sequence[tuple[Point, Scales]],
    least: float = LEAST_OF_ROUGH,
    rounds: int = ROUNDS,
    each_trial: tuple[str, ...] | None = None,
) -> dict[tuple[str, ...], Fit]:
    """Return the best fit of each set of effects from several starts, those without a solution left out.

    Fine fits of one set alone, `each_trial`, go on with derivatives at each trial's own numbers.
    """

    def attempt(k: int) -> Fit | None:
        try:
            apart = set_of(starts[k][0]) == each_trial
            return fit(problem, *starts[k], rounds=rounds, least=least, each_trial=apart)
        except EstimateError:
            return None

    best: dict[tuple[str, ...], Fit] = {}
    for (start, _), f in zip(starts, problem.pool.parallel(attempt, len(starts)), strict=True):
        key = set_of(start)
        if f is not None and (key not in best or f.evidence > best[key].evidence):
            best[key] = f
    return best


def set_of(point: Point) -> tuple[str, ...]:
    """Return the effects of a point, sorted."""
    return tuple(sorted(point.effects))


def from_best_part(problem: Problem, point: Point, fits: Mapping[tuple[str, ...], Fit]) -> Point:
    """Return a point with the sand, offsets and gains of the best fit of a part of its effects.

    There these numbers already compensate for the effects that the point lacks.

    Args:
        problem: the trials.
        point: with the effects.
        fits: sets to their fits.
    """
    part = _best_part(fits, point.effects)
    assert part is not None  # the model without effects is always fitted
    rows = zip(problem.trials, point.trials, part.point.trials, strict=True)
    trials = tuple(np.concatenate([of_part[: t.size], x[t.size :]]) for t, x, of_part in rows)
    return replace(point, shared=part.point.shared, trials=trials)
