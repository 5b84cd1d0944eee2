"""Which other candidate could stand in the place of an effect that was found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from granite_lab.discovery.arrow import Block, project
from granite_lab.discovery.baseline import noise_energy
from granite_lab.discovery.bench import SAND
from granite_lab.discovery.constancy import uneven
from granite_lab.discovery.follow import simulated
from granite_lab.discovery.point import Fit, Point
from granite_lab.discovery.problem import Problem
from granite_lab.discovery.refit import at_bound, misfit, refit, with_effect
from granite_lab.discovery.signature import Signatures, is_own, strengths
from granite_lab.logs.trial import Array
from granite_lab.model.effect import Effect

TWIN = 9.0
"""Models whose chi2 is within this of the best stay in the set: were such a model the true one, the best
would beat it by that much with a probability of at most Φ(−3) = 0.13 %."""

MISMATCH = 0.004
"""Share of the drop of chi2 that is not held against a rival: no formula is exact."""

FOREIGN = 0.02
"""The most of that share: so much is not held against a rival where the best leaves as much beyond the noise,
for its own formula is then not nature's either."""

UNLIKE, UNLIKE_SHARE = 60.0, 0.15
"""A candidate that would leave more of an effect's chi2 than this, absolute and as a share, is no twin."""

MOST_TWINS = 4

BETTER = 2.0
"""By how much a rival must be better to take an effect's place."""


def freedom(problem: Problem, effect: Effect) -> int:
    """Return how many numbers an effect adds."""
    shared = sum(not p.per_trial for p in effect.parameters)
    return shared + sum(p.per_trial for p in effect.parameters) * len(problem.trials)


def values_in(problem: Problem, fit: Fit, id_: str) -> tuple[float, ...]:
    """Return the parameters of one effect of a fit; those of each trial as their mean."""
    point = fit.point
    own = np.mean([x[t.size :] for t, x in zip(problem.trials, point.trials, strict=True)], axis=0)
    return dict(problem.setting(point.effects, point.common, own))[id_]


def rivals(
    problem: Problem, fit: Fit, signs: Signatures, left: Mapping[str, Effect], known: Mapping[str, Fit]
) -> tuple[dict[str, tuple[str, ...]], Fit | None]:
    """Test for each effect of a fit which other candidate could stand in its place.

    What the effect contributes is regressed on the signatures of each candidate, all nuisances free;
    where little is left over, the candidate is fitted in full in its place.

    Args:
        problem: the trials.
        fit: with the chosen effects.
        signs: signatures of the other candidates around it.
        left: those candidates.
        known: fits of candidates that were tried before, where a fit in an effect's place may begin.

    Returns:
        per chosen effect the candidates that explain the data as well, and a clearly better fit if
        there is one.
    """
    found: dict[str, tuple[str, ...]] = {}
    better: Fit | None = None
    leaves = misfit(fit.white, noise_energy(problem, fit.white))
    for id_ in fit.point.effects:
        twins = []
        size, remains = unlike(problem, fit, id_, signs, left)
        close = sorted((r, other) for other, r in remains.items() if r < max(UNLIKE, UNLIKE_SHARE * size))
        for _, other in close[:MOST_TWINS]:
            rival = _in_place(problem, fit, id_, other, known.get(other))
            if rival is None or uneven(problem, rival, other):
                continue
            extra = freedom(problem, left[other]) - freedom(problem, problem.effect(id_))
            worse = rival.chi2 - fit.chi2 + extra
            if worse < tolerated(size, leaves):
                twins.append(other)
            if (
                worse < -BETTER
                and not at_bound(problem, rival)
                and (better is None or rival.chi2 < better.chi2)
            ):
                better = rival
        found[id_] = tuple(twins)
    return found, better


def tolerated(size: float, leaves: float) -> float:
    """Return by how much chi2 a rival may be worse than an effect and still stand in its place.

    Args:
        size: chi2 that the effect explains.
        leaves: chi2 beyond the noise that the model with it leaves.
    """
    return TWIN + min(max(leaves, MISMATCH * size), FOREIGN * size)


def unlike(
    problem: Problem, fit: Fit, id_: str, signs: Signatures, left: Mapping[str, Effect]
) -> tuple[float, dict[str, float]]:
    """Return the chi2 that an effect explains in a fit, and what each candidate would leave of it."""
    if is_own(problem.effect(id_)):
        return 0.0, {}
    owner = [e for e, _ in problem.shared_parameters(fit.point.effects)]
    kept = [k for k in range(len(SAND) + len(owner)) if k < len(SAND) or owner[k - len(SAND)] != id_]
    blocks = [Block(b.local, b.shared[:, kept], b.precision) for b in fit.blocks]
    without = replace(fit.point, common=_neutral(problem, fit.point, id_))
    changes = problem.responses([problem.centre(without, v) for v in problem.variants])
    if changes is None:
        return 0.0, {}
    here = problem.centres_at(fit.point)
    columns = []
    for i, (trial, x) in enumerate(zip(problem.trials, fit.point.trials, strict=True)):
        j = problem.variants.index(trial.variant)
        own = trial.effect_columns((here[j] - changes[j])[None], x)
        columns.append(np.column_stack([problem.whiten(i, own), signs.columns[i]]))
    G = project(blocks, columns, problem.bounds(fit.point)[0][kept]).gram
    remains = {}
    for other in left:
        place = [k + 1 for k, p in enumerate(signs.probes) if p.effect == other]
        if place:
            a = np.linalg.lstsq(G[np.ix_(place, place)], G[place, 0], rcond=1e-9)[0]
            remains[other] = float(G[0, 0] - a @ G[place, 0])
    return float(G[0, 0]), remains


def _neutral(problem: Problem, point: Point, id_: str) -> Array:
    """Return the shared parameters of the effects with the strengths of one of them neutral."""
    shared = problem.shared_parameters(point.effects)
    return np.array(
        [p.neutral if e == id_ and not p.shape else v for (e, p), v in zip(shared, point.common, strict=True)]
    )


def _in_place(problem: Problem, fit: Fit, id_: str, other: str, tried: Fit | None) -> Fit | None:
    """Fit a candidate in the place of a chosen effect, from the best of several sizes."""
    point = _without(problem, fit, id_, fit)
    begin = []
    if tried is not None:
        begin.append(
            with_effect(problem, _without(problem, fit, id_, tried), other, values_in(problem, tried, other))
        )
    for share in (0.3, 1.0, -0.3):
        values = [p.neutral for p in problem.effect(other).parameters]
        for k in strengths(problem.effect(other)):
            p = problem.effect(other).parameters[k]
            values[k] = float(np.clip(p.neutral + share * (p.prior_high - p.neutral), p.low, p.high))
        begin.append(with_effect(problem, point, other, values))
    found = [simulated(problem, b) for b in begin]
    sizes = [
        problem.chi2(problem.white(problem.residuals(b, r.trials)), b) if r is not None else np.inf
        for r, b in zip(found, begin, strict=True)
    ]
    return refit(problem, [begin[int(np.argmin(sizes))]], goal=fit.chi2)


def without(problem: Problem, fit: Fit, id_: str, goal: float = np.inf) -> Fit | None:
    """Fit the model without one effect of a fit, beginning at the sand of that fit.

    Args:
        problem: the trials.
        fit: with the effect.
        id_: the effect.
        goal: chi2 that the fit must approach to be worth finishing.
    """
    return refit(problem, [_without(problem, fit, id_, fit)], goal=goal)


def _without(problem: Problem, fit: Fit, id_: str, nuisances: Fit) -> Point:
    """Return the effects of a fit but one, at the sand and the trials' numbers of this or another fit."""
    point = replace(
        problem.neutral(),
        sand=nuisances.point.sand,
        trials=tuple(x[: t.size] for t, x in zip(problem.trials, nuisances.point.trials, strict=True)),
    )
    for e in fit.point.effects:
        if e != id_:
            point = with_effect(problem, point, e, values_in(problem, fit, e))
    return point
