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
    rounds: int = ROUNDS,
) -> dict[tuple[str, ...], Fit]:
    """Return the best fit of each set of effects, those left out whose starts have no solution.

    A fit can be no worse than that of a part of the set: one that is has missed the optimum. It is made again
    from the part, with the other effects at their neutral values.

    Args:
        problem: the trials.
        starts: where to begin, with the set switched on, and the scales to begin with; several of a set.
        others: fits of other sets.
        rounds: most steps of a fit.
    """
    fits = attempts(problem, starts, rounds=rounds)
    again: dict[tuple[str, ...], tuple[Point, Scales]] = {}
    for key, effects in {set_of(start): start.effects for start, _ in starts}.items():
        parts = [f for k, f in {**others, **fits}.items() if set(k) < set(key)]
        part = max(parts, key=lambda f: f.evidence, default=None)
        if part is not None and not (key in fits and fits[key].evidence > part.evidence):
            point = part.point
            for id_ in (e for e in effects if e not in point.effects):
                point = problem.with_effect(point, id_, [p.neutral for p in problem.parameters_of(id_)])
            again[key] = point, part.scales
    for key, other in attempts(problem, list(again.values()), rounds=rounds).items():
        if key not in fits or other.evidence > fits[key].evidence:
            fits[key] = other
    return fits


def attempts(
    problem: Problem,
    starts: Sequence[tuple[Point, Scales]],
    least: float = LEAST_OF_ROUGH,
    rounds: int = ROUNDS,
) -> dict[tuple[str, ...], Fit]:
    """Return the best fit of each set of effects from several starts, those without a solution left out."""

    def attempt(k: int) -> Fit | None:
        try:
            return fit(problem, *starts[k], rounds=rounds, least=least)
        except EstimateError:
            return None

    best: dict[tuple[str, ...], Fit] = {}
    for (start, _), f in zip(starts, problem.bench.side_by_side(attempt, len(starts)), strict=True):
        key = set_of(start)
        if f is not None and (key not in best or f.evidence > best[key].evidence):
            best[key] = f
    return best


def set_of(point: Point) -> tuple[str, ...]:
    """Return the effects of a point, sorted."""
    return tuple(sorted(point.effects))


def where_alone(problem: Problem, point: Point, fits: Mapping[tuple[str, ...], Fit]) -> Point:
    """Return a point with the sand, offsets and gains of the best fit of a part of its effects.

    There these numbers already compensate for the effects that the point lacks.

    Args:
        problem: the trials.
        point: with the effects.
        fits: sets to their fits.
    """
    parts = [f for k, f in fits.items() if set(k) < set(point.effects)]
    part = max(parts, key=lambda f: f.evidence).point
    pairs = zip(problem.trials, point.trials, part.trials, strict=True)
    trials = tuple(np.concatenate([theirs[: t.size], x[t.size :]]) for t, x, theirs in pairs)
    return replace(point, shared=part.shared, trials=trials)
