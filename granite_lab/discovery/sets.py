"""Fits of sets of effects, side by side, from one or several starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from granite_lab.errors import EstimateError
from granite_lab.inference.constants import DRAWS, FEW, LEAST_GAIN
from granite_lab.inference.descent import ROUGH, Goal
from granite_lab.inference.fit import Fit, fit
from granite_lab.inference.normal import Scales
from granite_lab.inference.point import Point
from granite_lab.inference.problem import Problem

EffectSet = tuple[str, ...]
"""Ids of effects, sorted."""

UNLIKELY = 1 / DRAWS
"""Odds below which a set changes no probability: no draw shows it."""

TOGETHER = FEW
"""Number of competing sets that are fitted at a time. All later ones know the best of these, whatever the
number of processes is."""


Starts = Sequence[tuple[Point, Scales]]
"""Where fits begin, with the set of effects switched on, and the scales that they begin with."""


def fit_sets(
    problem: Problem,
    starts: Starts,
    others: Mapping[EffectSet, Fit],
    bar: float | None = None,
    goal: Goal = ROUGH,
) -> dict[EffectSet, Fit]:
    """Return the best fit of each set of effects, those left out whose starts have no solution.

    A fit can be no worse than that of a part of the set: one that is has missed the optimum. It is made again
    from the part, with the other effects at their neutral values.

    Args:
        problem: the trials.
        starts: of the sets, several of one where they differ.
        others: fits of other sets.
        bar, goal: as in `best_fits`.
    """
    fits = best_fits(problem, starts, goal, bar)
    missed = []
    for key, effects in {set_of(start): start.effects for start, _ in starts}.items():
        part = _best_part({**others, **fits}, key)
        if part is not None and not (key in fits and fits[key].evidence > part.evidence):
            missed.append((_with_neutral(problem, part.point, effects), part.scales))
    if bar is not None:
        bar = max(bar, *(log_posterior(key, f) for key, f in fits.items()), -np.inf)
    for key, again in best_fits(problem, missed, goal, bar).items():
        if key not in fits or again.evidence > fits[key].evidence:
            fits[key] = again
    return fits


def _best_part(fits: Mapping[EffectSet, Fit], effects: Sequence[str]) -> Fit | None:
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
    starts: Starts,
    goal: Goal,
    bar: float | None = None,
) -> dict[EffectSet, Fit]:
    """Return the best fit of each set of effects from several starts, those without a solution left out.

    Args:
        problem: the trials.
        starts: of the sets; where sets compete, the most promising ones first.
        goal: how far fits go.
        bar: where sets compete, the logarithm of the posterior of one that is fitted already. A fit ends
            where its odds against this one, or against a set fitted before it, promise to stay below
            `UNLIKELY`. By default all go to the goal.
    """

    def attempt(start: tuple[Point, Scales]) -> Fit | None:
        least = None if bar is None else bar + float(np.log(UNLIKELY)) - log_prior_of(set_of(start[0]))
        try:
            return fit(problem, *start, goal if least is None else replace(goal, evidence=least))
        except EstimateError:
            return None

    best: dict[EffectSet, Fit] = {}
    together = len(starts) if bar is None else TOGETHER
    for first in range(0, len(starts), max(together, 1)):
        several = starts[first : first + together]
        fits = problem.pool.parallel(attempt, several)
        for (start, _), f in zip(several, fits, strict=True):
            key = set_of(start)
            if f is not None and (key not in best or f.evidence > best[key].evidence):
                best[key] = f
                bar = None if bar is None else max(bar, log_posterior(key, f))
    return best


def log_prior_of(effects: Sequence[str]) -> float:
    """Return the logarithm of the prior odds of a set: equal odds for each effect."""
    return -LEAST_GAIN * len(effects)


def log_posterior(effects: Sequence[str], fitted: Fit) -> float:
    """Return the logarithm of evidence and prior of a set."""
    return fitted.evidence + log_prior_of(effects)


def set_of(point: Point) -> EffectSet:
    """Return the effects of a point, sorted."""
    return tuple(sorted(point.effects))


def from_best_part(problem: Problem, point: Point, fits: Mapping[EffectSet, Fit]) -> Point:
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
