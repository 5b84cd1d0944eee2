"""Which candidate could explain the residual, to first order along its sizes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, chdtri  # the law of chi2; scipy.stats takes half a second to import

from granite_lab.discovery.arrow import Block
from granite_lab.discovery.point import Fit
from granite_lab.discovery.problem import Problem
from granite_lab.discovery.signature import Signatures, strengths
from granite_lab.logs.trial import Array
from granite_lab.model.effect import Effect, EffectParameter

LEAST_TAIL = 1e-300
"""Probability that stands for all smaller ones, which have no logarithm."""


@dataclass(frozen=True)
class Score:
    """How well one candidate explains the residual, to first order along its sizes.

    Attributes:
        effect: id.
        drop: by how much chi2 falls.
        freedom: how many numbers it takes.
        values: where a full fit should begin.
    """

    effect: str
    drop: float
    freedom: int
    values: tuple[float, ...]

    @property
    def evidence(self) -> float:
        """The drop that one number alone would need to be as unlikely by chance."""
        return evidence(self.drop, self.freedom)


def evidence(drop: float, freedom: int) -> float:
    """Translate a drop of chi2 by several numbers into that by one number of the same rarity."""
    if freedom <= 1 or drop <= 0:
        return drop
    log_p = float(np.log(max(chdtrc(freedom, drop), LEAST_TAIL)))
    if log_p < -600:  # beyond the range of the inverse: the tails differ by a slowly growing constant
        reference = float(chdtri(freedom, np.exp(-600))), float(chdtri(1, np.exp(-600)))
        return drop - (reference[0] - reference[1])
    return float(chdtri(1, np.exp(log_p)))


def scores(problem: Problem, fit: Fit, signs: Signatures, candidates: Mapping[str, Effect]) -> list[Score]:
    """Score every candidate, the best first."""
    b = signs.products(fit, problem.centres(fit.point), problem.bounds(fit.point)[0])
    result = []
    for id_, effect in candidates.items():
        if id_ in signs.own:
            result.append(_own_score(problem, fit, signs.own[id_], effect))
            continue
        place = [k for k, p in enumerate(signs.probes) if p.effect == id_]
        if place:
            result.append(_path_score(effect, place, signs, b))
    return sorted(result, key=lambda s: -s.evidence)


def _path_score(effect: Effect, place: list[int], signs: Signatures, b: Array) -> Score:
    """Follow each strength from zero through its sizes; with several strengths, all of them at their best."""
    start = [p.neutral for p in effect.parameters]
    best: dict[int, tuple[float, float, int]] = {}
    for parameter in strengths(effect):
        p = effect.parameters[parameter]
        nodes = [k for k in place if signs.probes[k].parameter == parameter]
        for side in (1, -1):
            path = sorted(
                (k for k in nodes if (signs.probes[k].size - p.neutral) * side > 0),
                key=lambda k: abs(signs.probes[k].size - p.neutral),
            )
            for drop, size, node in _along(path, signs, b, p):
                if drop > best.get(parameter, (0.0, 0.0, 0))[0]:
                    best[parameter] = drop, size, node
    if not best:
        return Score(effect.id, 0.0, 1, tuple(start))
    leading = max(best, key=lambda k: best[k][0])
    values, drop, freedom = list(start), best[leading][0], 1
    values[leading] = best[leading][1]
    if len(best) > 1:
        nodes = [node for _, _, node in best.values()]
        G = signs.gram[np.ix_(nodes, nodes)]
        amounts = np.linalg.lstsq(G, b[nodes], rcond=1e-9)[0]
        together = float(amounts @ b[nodes])
        if (amounts > 0).all() and evidence(together, len(nodes)) > drop:
            drop, freedom = together, len(nodes)
            for amount, (k, (_, _, node)) in zip(amounts, best.items(), strict=True):
                p = effect.parameters[k]
                size = p.neutral + amount * (signs.probes[node].size - p.neutral)
                values[k] = float(np.clip(size, p.low, p.high))
    return Score(effect.id, drop, freedom, tuple(values))


def _along(
    path: list[int], signs: Signatures, b: Array, p: EffectParameter
) -> list[tuple[float, float, int]]:
    """Return (drop, size, nearest node) at the best point of each segment between sizes."""
    G, found = signs.gram, []
    previous, s0 = None, p.neutral
    for n, k in enumerate(path):
        s1 = signs.probes[k].size
        last = n == len(path) - 1
        # response (1-u) d0 + u d1
        g00, g01, b0 = (
            (G[previous, previous], G[previous, k], b[previous]) if previous is not None else (0.0, 0.0, 0.0)
        )
        curvature = g00 - 2 * g01 + G[k, k]
        u = ((b[k] - b0) - (g01 - g00)) / curvature if curvature > 0 else 0.0
        u = float(np.clip(u, 0.0, 2.0 if last else 1.0))
        size = float(np.clip(s0 + u * (s1 - s0), p.low, p.high))
        norm = (1 - u) ** 2 * g00 + 2 * u * (1 - u) * g01 + u**2 * G[k, k]
        drop = 2 * ((1 - u) * b0 + u * b[k]) - norm
        found.append((float(drop), size, k))
        previous, s0 = k, s1
    return found


def _own_score(problem: Problem, fit: Fit, columns: list[Array], effect: Effect) -> Score:
    """Score an effect with numbers of its own in each trial."""
    prior = problem.bounds(fit.point)[0]
    precision = problem.own_precision([effect.id])
    blocks = [
        Block(np.hstack([b.local, c]), b.shared, np.concatenate([b.precision, precision]))
        for b, c in zip(fit.blocks, columns, strict=True)
    ]
    centre = problem.centres(fit.point)
    gain = explained(blocks, fit, prior, centre) - explained(fit.blocks, fit, prior, centre)
    return Score(effect.id, gain, len(precision) * len(columns), tuple(p.neutral for p in effect.parameters))


def explained(blocks: Sequence[Block], fit: Fit, prior: Array, centre: Array) -> float:
    """Return by how much chi2 would fall if all numbers took one more step."""
    x = np.concatenate([fit.point.sand, fit.point.common])
    N, g, total = np.diag(prior), -prior * (x - centre), 0.0
    for block, w, own in zip(blocks, fit.white, fit.point.trials, strict=True):
        at = np.concatenate([own, np.zeros(block.local.shape[1] - own.size)])
        pull = block.local.T @ w - block.precision * at
        total += float(pull @ block.solve(pull))
        N = N + block.shared.T @ block.shared - block.coupling.T @ block.solve(block.coupling)
        g = g + block.shared.T @ w - block.coupling.T @ block.solve(pull)
    return total + float(g @ np.linalg.solve(N, g))
