"""How often each candidate would be named on these very trials, and what it would be taken for.

The screen's scores are products of the residuals with the candidates' signatures. With a candidate
of known size in the trials they are normal numbers: their mean follows from that signature, their
covariance is the inner products of the signatures, nuisances projected out. So the whole procedure,
from the scores to a name with its twins, is played many times without any further simulation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from granite_lab.discovery.arrow import project
from granite_lab.discovery.detect import detectability
from granite_lab.discovery.plan_scores import amounts_at, evidence_of, path_drop
from granite_lab.discovery.point import Fit
from granite_lab.discovery.problem import Problem
from granite_lab.discovery.rivals import BETTER, MISMATCH, TWIN, freedom
from granite_lab.discovery.shown import Confusion, Detectable, Played
from granite_lab.discovery.signature import Probe, Signatures, strengths
from granite_lab.logs.trial import Array
from granite_lab.model.effect import Effect


@dataclass(frozen=True, eq=False)
class Law:
    """The joint law of all scores.

    Attributes:
        gram: (n, n) covariance of the products of all columns with the residuals: the shared
            candidates' probes first, then the columns of each trial's own.
        own: candidates with numbers of their own in each trial to the places of those, per trial.
        factors: of the same candidates, the inverse of their block with its prior.
    """

    gram: Array
    own: dict[str, list[list[int]]]
    factors: dict[str, tuple[Array, bool]]


def law(problem: Problem, fit: Fit, signs: Signatures) -> Law:
    """Return the joint law of the scores of a fit's candidates."""
    n = len(signs.probes)
    places: dict[str, list[list[int]]] = {}
    for id_, own in signs.own.items():
        wide = own[0].shape[1]
        places[id_] = [list(range(n + i * wide, n + (i + 1) * wide)) for i in range(len(own))]
        n += len(own) * wide
    if not places:
        return Law(signs.gram, {}, {})
    columns = []
    for i, shared in enumerate(signs.columns):
        whole = np.zeros((shared.shape[0], n))
        whole[:, : shared.shape[1]] = shared
        for id_, own in signs.own.items():
            whole[:, places[id_][i]] = own[i]
        columns.append(whole)
    gram = project(fit.blocks, columns, problem.bounds(fit.point)[0]).gram
    factors = {}
    for id_, per_trial in places.items():
        flat = [k for own in per_trial for k in own]
        precision = np.tile(problem.own_precision([id_]), len(per_trial))
        factors[id_] = cho_factor(gram[np.ix_(flat, flat)] + np.diag(precision))
    return Law(gram, places, factors)


def confusion(
    problem: Problem,
    fit: Fit,
    signs: Signatures,
    candidates: Mapping[str, Effect],
    threshold: float,
    *,
    detectable: Sequence[Detectable] = (),
    fitted: Mapping[str, Sequence[float]] | None = None,
    factor: float = 2.0,
    draws: int = 200,
    seed: int = 0,
) -> Confusion:
    """Put each candidate into the trials in turn and see what is named.

    Args:
        problem: the trials, with the noise.
        fit: without the candidates.
        signs: their signatures around it.
        candidates: effects.
        threshold: evidence that is needed to name one.
        detectable: smallest sizes, if they are known already.
        fitted: parameter values of candidates that are put in at that size, by id.
        factor: all others are put in at this times their smallest detectable size; one with several
            strengths has them by turns.
        draws: sets for each candidate.
        seed: of the noise.
    """
    known = [e for e in candidates if e in signs.own or any(p.effect == e for p in signs.probes)]
    detectable = detectable or detectability(fit, signs, candidates, threshold)[0]
    joint = law(problem, fit, signs)
    rng = np.random.default_rng(seed)
    values, vectors = np.linalg.eigh(joint.gram)
    root = vectors * np.sqrt(np.fmax(values, 0))
    noise = root @ rng.normal(size=(joint.gram.shape[0], draws))
    k = len(known)
    matrix = np.full((k, k), np.nan)
    missed, kept, alone = (np.full(k, np.nan) for _ in range(3))
    played: list[Played] = []
    for i, id_ in enumerate(known):
        put, own = _put(
            candidates[id_], signs, joint, detectable, (fitted or {}).get(id_), factor, draws, rng
        )
        played += own
        if put is None:
            continue
        first, sets = _named(
            problem, candidates, known, signs.probes, joint, joint.gram @ put + noise, threshold
        )
        matrix[i] = [np.mean(first == j) for j in range(k)]
        missed[i] = np.mean(first < 0)
        kept[i] = np.mean(sets[i])
        alone[i] = np.mean(sets[i] & (sets.sum(axis=0) == 1))
    return Confusion(tuple(known), matrix, missed, kept, alone, tuple(played), factor, draws)


def _put(
    effect: Effect,
    signs: Signatures,
    joint: Law,
    detectable: Sequence[Detectable],
    fitted: Sequence[float] | None,
    factor: float,
    draws: int,
    rng: np.random.Generator,
) -> tuple[Array | None, list[Played]]:
    """Return the (n, draws) amounts of all columns, and what they stand for."""
    smallest = {d.parameter: d.size for d in detectable if d.effect == effect.id}
    n = joint.gram.shape[0]
    ways: list[Array] = []
    played: list[Played] = []
    for k in strengths(effect):
        p = effect.parameters[k]
        least = smallest.get(p.name, float("nan"))
        size = factor * least if fitted is None else abs(fitted[k] - p.neutral)
        size = min(size, max(p.high - p.neutral, p.neutral - p.low))
        if np.isfinite(size) and size > 0 and not p.per_trial:
            sides = (1, -1) if fitted is None else (int(np.sign(fitted[k] - p.neutral)),)
            both = [amounts_at(signs.probes, effect, k, side * size, n) for side in sides]
            ways += sorted((a for a in both if a is not None), key=lambda a: -float(a @ joint.gram @ a))[:1]
        played.append(Played(effect.id, p.name, p.unit, least, size))
    if effect.id in joint.own:
        size = next((w.size for w in played if np.isfinite(w.size)), 0.0)
        put = np.zeros((n, draws))
        for own in joint.own[effect.id]:
            direction = rng.normal(size=(len(own), draws))
            put[own] = size * direction / np.linalg.norm(direction, axis=0)
        return (put if size > 0 else None), played
    if not ways:
        return None, played
    if fitted is not None:
        return np.tile(np.sum(ways, axis=0)[:, None], (1, draws)), played
    return np.stack([ways[d % len(ways)] for d in range(draws)], axis=1), played


def _named(
    problem: Problem,
    candidates: Mapping[str, Effect],
    known: Sequence[str],
    probes: Sequence[Probe],
    joint: Law,
    B: Array,
    threshold: float,
) -> tuple[Array, Array]:
    """Return (draws,) who comes first, -1 for nobody, and (k, draws) who stands in the named set."""
    drop, strength = [], []
    for id_ in known:
        if id_ in joint.own:
            flat = [k for own in joint.own[id_] for k in own]
            d = np.sum(B[flat] * cho_solve(joint.factors[id_], B[flat]), axis=0)
            f = np.full(d.size, len(flat))
        else:
            d, f = path_drop(candidates[id_], probes, joint.gram, B)
        drop.append(d)
        strength.append(evidence_of(d, f))
    drops, evidence = np.stack(drop), np.stack(strength)
    numbers = np.array([freedom(problem, candidates[id_]) for id_ in known])[:, None]
    shared = np.array([id_ not in joint.own for id_ in known])[:, None]
    each = np.arange(B.shape[1])
    first = evidence.argmax(axis=0)
    # a rival that is clearly better in the full fit takes the place
    merit = np.where(shared, drops - numbers, -np.inf)
    better = merit.argmax(axis=0)
    gain = merit[better, each] - (drops - numbers)[first, each]
    first = np.where((gain > BETTER) & shared[first, 0], better, first)
    worse = drops[first, each] - drops + numbers - numbers[first, 0]
    sets = (worse < TWIN + MISMATCH * drops[first, each]) & shared & shared[first, 0]
    sets[first, each] = True
    found = evidence.max(axis=0) > threshold
    return np.where(found, first, -1), sets & found
