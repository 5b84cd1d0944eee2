"""What each candidate would do to these trials: simulated at several sizes, nuisances projected out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from granite_lab.discovery.arrow import Projection, project
from granite_lab.discovery.bench import Task
from granite_lab.discovery.point import Fit
from granite_lab.discovery.problem import Problem
from granite_lab.logs.trial import Array
from granite_lab.model.effect import Effect, EffectParameter

CLOSELY = 12
"""Sizes at which a strength is probed whose trace moves in time with it."""


@dataclass(frozen=True)
class Probe:
    """A size at which the response to an effect was simulated.

    Attributes:
        effect: id.
        parameter: place of the strength that is not neutral.
        values: all parameters of the effect.
    """

    effect: str
    parameter: int
    values: tuple[float, ...]

    @property
    def size(self) -> float:
        """The strength."""
        return self.values[self.parameter]


@dataclass(frozen=True, eq=False)
class Signatures:
    """The signatures of the candidates at one fit.

    Attributes:
        probes: what was simulated, one column each.
        projection: what survives of them when all nuisances are refitted.
        own: per-trial candidates to their (m, l) whitened columns in each trial.
        columns: per trial the (m, k) whitened signatures before the projection.
    """

    probes: tuple[Probe, ...]
    projection: Projection
    own: dict[str, list[Array]]
    columns: list[Array]

    @property
    def gram(self) -> Array:
        """(k, k) inner products of the surviving signatures."""
        return self.projection.gram

    def products(self, fit: Fit, centre: Array, prior: Array) -> Array:
        """Return (k,) products of the surviving signatures with the residuals of a fit and its priors."""
        b = np.zeros(len(self.probes))
        shared = np.concatenate([fit.point.sand, fit.point.common])
        rows = zip(
            self.projection.left, self.projection.pull, fit.blocks, fit.white, fit.point.trials, strict=True
        )
        for left, pull, block, white, x in rows:
            b += left.T @ white + pull.T @ (block.precision * x)
        return np.asarray(b + self.projection.through.T @ (prior * (shared - centre)))


def strengths(effect: Effect) -> list[int]:
    """Return the places of the parameters that say how much."""
    return [k for k, p in enumerate(effect.parameters) if not p.shape]


def is_own(effect: Effect) -> bool:
    """Tell whether the effect has numbers of its own in each trial."""
    return any(p.per_trial for p in effect.parameters)


def sizes(p: EffectParameter, *, small: bool = False) -> tuple[float, ...]:
    """Return the sizes at which a strength is probed, outward from the neutral value.

    Args:
        p: the parameter.
        small: only the least, for residuals that are small already.
    """
    high, low = p.prior_high - p.neutral, p.prior_low - p.neutral
    if p.per_trial:
        return (p.neutral + high / 2,)
    if low < 0 < high:
        both = (p.neutral + 0.2 * high, p.neutral + 0.2 * low)
        return both if small else (*both, p.neutral + high, p.neutral + low)
    if high <= 0:
        high, low = low, high
    least = float(max(abs(low), abs(high) / 30) * np.sign(high))
    if small:
        return (p.neutral + least / 2,)
    if p.moving:
        return tuple(p.neutral + np.sign(high) * np.geomspace(abs(least) / 2, abs(high), CLOSELY))
    return (p.neutral + least / 2, p.neutral + float(np.sign(high) * np.sqrt(least * high)), p.neutral + high)


def probes_of(effect: Effect, *, small: bool = False) -> list[Probe]:
    """List the sizes, one strength at a time, the shapes where a search would start."""
    found = []
    for k in strengths(effect):
        for size in sizes(effect.parameters[k], small=small):
            values = [p.neutral for p in effect.parameters]
            values[k] = size
            found.append(Probe(effect.id, k, tuple(values)))
    return found


def signatures(
    problem: Problem, fit: Fit, candidates: Mapping[str, Effect], *, small: bool = False
) -> Signatures:
    """Simulate every candidate at its sizes around a fit, and project the nuisances out."""
    probes = [probe for effect in candidates.values() for probe in probes_of(effect, small=small)]
    tasks = []
    for v in problem.variants:
        base = problem.centre(fit.point, v)
        tasks += [Task(v, base.sand, (*base.setting, (p.effect, p.values))) for p in probes]
    here = problem.centres_at(fit.point)
    found = problem.bench.run(tasks, keep=False)
    changes = [found[j * len(probes) : (j + 1) * len(probes)] for j in range(len(problem.variants))]
    sound = [k for k in range(len(probes)) if all(of[k] is not None for of in changes)]
    moved = [
        np.stack([of[k] - base for k in sound]) if sound else np.zeros((0, *base.shape))  # type: ignore[operator]
        for of, base in zip(changes, here, strict=True)
    ]
    columns = [
        problem.whiten(i, trial.effect_columns(moved[problem.variants.index(trial.variant)], x))
        for i, (trial, x) in enumerate(zip(problem.trials, fit.point.trials, strict=True))
    ]
    shared = [n for n, k in enumerate(sound) if not is_own(candidates[probes[k].effect])]
    prior = problem.bounds(fit.point)[0]
    common = [c[:, shared] for c in columns]
    projection = project(fit.blocks, common, prior)
    own = {}
    for id_, effect in candidates.items():
        place = [n for n, k in enumerate(sound) if probes[k].effect == id_]
        if is_own(effect) and len(place) == len(strengths(effect)):  # all of them, or it cannot be tried
            scale = np.array([probes[sound[n]].size for n in place])
            own[id_] = [c[:, place] / scale for c in columns]
    return Signatures(tuple(probes[sound[n]] for n in shared), projection, own, common)
