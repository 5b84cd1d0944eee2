"""Full fits with an effect switched on, and how they fare on trials that were not used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from granite_lab.discovery import arrow
from granite_lab.discovery.adjust import fit as adjust
from granite_lab.discovery.arrow import Block
from granite_lab.discovery.baseline import noise_energy
from granite_lab.discovery.bench import SAND
from granite_lab.discovery.point import Fit, Point, Slopes
from granite_lab.discovery.problem import Problem
from granite_lab.discovery.slopes import slopes_at
from granite_lab.errors import EstimateError
from granite_lab.logs.trial import Array

NOISE = 1.02
"""chi2 over that of the noise that counts as noise when further starts and candidates are weighed."""

SETTLED = 0.95
"""Share of the misfit that a fit explains when no other start is tried."""

OPEN = 2.0
"""Standard deviations within which a shape that ended at a bound may as well be neutral."""

AT_BOUND = 1e-3
"""Share of a parameter's range within which it counts as being at its bound."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Residuals of trials whose group had no say in the shared numbers.

    Attributes:
        white: per trial (m,) whitened residual after its own numbers were refitted.
        loss: (trials,) its sum of squares, with the priors of the trial's own numbers.
    """

    white: tuple[Array, ...]
    loss: Array


def with_effect(problem: Problem, point: Point, id_: str, values: Sequence[float]) -> Point:
    """Return the point with one more effect switched on."""
    parameters = problem.effect(id_).parameters
    places = problem.places(id_)
    common = [values[k] for k in places if not parameters[k].per_trial]
    own = [values[k] for k in places if parameters[k].per_trial]
    return replace(
        point,
        effects=(*point.effects, id_),
        common=np.concatenate([point.common, common]),
        trials=tuple(np.concatenate([x, own]) for x in point.trials),
    )


def refit(
    problem: Problem,
    starts: Sequence[Point],
    *,
    near: Slopes | None = None,
    goal: float = np.inf,
    before: Fit | None = None,
    expected: float = np.inf,
) -> Fit | None:
    """Fit from several starts and keep the best; None where every start fails.

    Args:
        problem: the trials.
        starts: points with the effects switched on.
        near: derivatives by the sand that are good enough to begin with.
        goal: chi2 that a fit must approach to be worth finishing.
        before: the fit without the effect; a start that explains nearly all that it left ends the search.
        expected: drop of chi2 against that fit which ends the search, too, once a fit has converged.
    """
    best: Fit | None = None
    for start in starts:
        try:
            slopes = slopes_at(problem, start, sand_from=near)
            fit = adjust(problem, start, slopes=slopes, goal=goal)
        except EstimateError:
            continue
        if best is None or fit.chi2 < best.chi2:
            best = fit
        if enough(problem, best) or (before is not None and _done(problem, before, best, expected)):
            break
    return best


def plainly_needed(problem: Problem, fit: Fit, id_: str, least: float) -> bool:
    """Tell without another fit that a shared strength of an effect is far from neutral.

    Args:
        problem: the trials.
        fit: with the effect.
        id_: of the effect.
        least: square of the distance from the neutral value in standard deviations that is far.
    """
    shared = problem.shared_parameters(fit.point.effects)
    variance = np.diag(covariance(problem, fit))[len(SAND) :]
    return any(
        e == id_ and not p.shape and (x - p.neutral) ** 2 > least * s
        for (e, p), x, s in zip(shared, fit.point.common, variance, strict=True)
    )


def _done(problem: Problem, before: Fit, after: Fit, expected: float) -> bool:
    """Tell whether a converged fit explains nearly all that another one left, or what was expected."""
    return after.converged and (before.chi2 - after.chi2 > expected or nearly_all(problem, before, after))


def nearly_all(problem: Problem, before: Fit, after: Fit) -> bool:
    """Tell whether a fit explains nearly all that another one left."""
    noise = noise_energy(problem, after.white)
    return misfit(after.white, noise) < (1 - SETTLED) * misfit(before.white, noise)


def enough(problem: Problem, fit: Fit) -> bool:
    """Tell whether a fit leaves hardly more than noise, so that another start cannot find much."""
    noise = noise_energy(problem, fit.white)
    return misfit(fit.white, noise) < (NOISE - 1) * noise


def misfit(white: Sequence[Array], noise: float) -> float:
    """Return by how much whitened residuals exceed the noise, as a sum of squares."""
    return max(0.0, sum(float(w @ w) for w in white) - noise)


def reduced(block: Block, white: Array, own: Array) -> tuple[Array, Array]:
    """Return one trial's part of the normal matrix and gradient of the shared numbers."""
    pull = block.local.T @ white - block.precision * own
    return (
        block.eliminated(block.shared),
        block.shared.T @ white - block.coupling.T @ block.solve(pull),
    )


def covariance(problem: Problem, fit: Fit) -> Array:
    """Return the covariance of the shared numbers, sand first, then the effects' parameters."""
    return arrow.covariance(fit.blocks, problem.bounds(fit.point)[0])


def held_out(problem: Problem, fit: Fit, groups: Sequence[int]) -> HeldOut:
    """Leave out one group of trials after the other; linear around the fit.

    Args:
        problem: the trials.
        fit: of all of them.
        groups: of each trial.
    """
    prior, low, high = problem.bounds(fit.point)
    centre = problem.centres(fit.point)
    shared = np.concatenate([fit.point.sand, fit.point.common])
    parts = [reduced(b, w, x) for b, w, x in zip(fit.blocks, fit.white, fit.point.trials, strict=True)]
    white: list[Array] = [np.zeros(0)] * len(groups)
    loss = np.zeros(len(groups))
    for group in dict.fromkeys(groups):
        N, g = np.diag(prior + 1e-12), -prior * (shared - centre)
        for own, (part, pull) in zip(groups, parts, strict=True):
            if own != group:
                N, g = N + part, g + pull
        scale = 1 / np.sqrt(np.diag(N))
        change = scale * np.linalg.lstsq(N * np.outer(scale, scale), scale * g, rcond=1e-12)[0]
        change = np.clip(shared + change, low, high) - shared
        for i, own in enumerate(groups):
            if own != group:
                continue
            block, x = fit.blocks[i], fit.point.trials[i]
            left = fit.white[i] - block.shared @ change
            dx = block.solve(block.local.T @ left - block.precision * x)
            white[i] = left - block.local @ dx
            loss[i] = white[i] @ white[i] + np.sum(block.precision * (x + dx) ** 2)
    return HeldOut(tuple(white), loss)


def at_bound(problem: Problem, fit: Fit) -> tuple[str, ...]:
    """Name the effects' parameters that ended at a bound other than their neutral value.

    A shape that the trials leave open may end anywhere; it says nothing against its effect.
    """
    shared, _ = problem.effect_parameters(fit.point.effects)
    found = []
    for k, (p, value) in enumerate(zip(shared, fit.point.common, strict=True)):
        margin = AT_BOUND * (p.high - p.low)
        ends = [b for b in (p.low, p.high) if p.shape or abs(b - p.neutral) > margin]
        if any(abs(value - b) < margin for b in ends) and not (p.shape and _open(problem, fit, k, p.neutral)):
            found.append(p.name)
    return tuple(found)


def _open(problem: Problem, fit: Fit, k: int, value: float) -> bool:
    """Tell whether the trials leave it open that a shared number of the effects has another value."""
    variance = float(np.diag(covariance(problem, fit))[len(SAND) + k])
    return bool((fit.point.common[k] - value) ** 2 < OPEN**2 * variance)
