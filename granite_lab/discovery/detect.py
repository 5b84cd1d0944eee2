"""What a design could show: smallest detectable sizes, and which candidates it cannot tell apart."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.special import chdtrc, chdtri

from granite_lab.discovery.arrow import Block
from granite_lab.discovery.point import Fit
from granite_lab.discovery.shown import Detectable
from granite_lab.discovery.signature import Signatures, is_own, strengths
from granite_lab.logs.trial import Array
from granite_lab.model.effect import Effect

POWER = 0.8416
"""Standard normal number for a power of 80 %."""

CONFUSED = 0.95


def detectability(
    fit: Fit, signs: Signatures, candidates: Mapping[str, Effect], threshold: float
) -> tuple[tuple[Detectable, ...], tuple[str, ...], Array]:
    """Return the smallest detectable sizes, the candidates compared, and their cosines (k, k)."""
    ids, matrix = confusion(signs, candidates)
    found = []
    for id_, effect in candidates.items():
        close = (
            tuple(
                other for other, c in zip(ids, matrix[ids.index(id_)], strict=True)
                if other != id_ and abs(c) > CONFUSED
            )
            if id_ in ids
            else ()
        )  # fmt: skip
        for k in strengths(effect):
            p = effect.parameters[k]
            size = (
                _own_size(fit, signs, id_, threshold)
                if is_own(effect)
                else _size(signs, id_, k, p.neutral, threshold)
            )
            reachable = size <= max(p.high - p.neutral, p.neutral - p.low)
            found.append(Detectable(id_, p.name, p.unit, size if reachable else float("nan"), close))
    return tuple(found), ids, matrix


def _size(signs: Signatures, id_: str, parameter: int, neutral: float, threshold: float) -> float:
    """Follow the sizes outward until the signature's chi2 reaches what is needed."""
    needed = (np.sqrt(threshold) + POWER) ** 2
    nodes = [k for k, p in enumerate(signs.probes) if p.effect == id_ and p.parameter == parameter]
    best = np.inf
    for side in (1, -1):
        path = sorted(
            (abs(signs.probes[k].size - neutral), float(signs.gram[k, k]))
            for k in nodes
            if (signs.probes[k].size - neutral) * side > 0
        )
        s0, g0 = 0.0, 0.0
        for n, (s1, g1) in enumerate(path):
            slope = (np.sqrt(max(g1, 0.0)) - np.sqrt(max(g0, 0.0))) / (s1 - s0)
            if slope > 0 and (g1 >= needed or n == len(path) - 1):
                best = min(best, s0 + (np.sqrt(needed) - np.sqrt(max(g0, 0.0))) / slope)
                break
            s0, g0 = s1, g1
    return float(best)


def _own_size(fit: Fit, signs: Signatures, id_: str, threshold: float) -> float:
    """Return the amplitude, the same in each trial at any phase, that is found with 80 % probability."""
    if id_ not in signs.own:
        return float("inf")
    columns = signs.own[id_]
    freedom = columns[0].shape[1] * len(columns)
    tail = float(chdtrc(1, threshold))
    needed = float(chdtri(freedom, tail)) - freedom
    needed += POWER * np.sqrt(2 * (freedom + 2 * needed))
    per_unit = sum(
        float(np.trace(Block(b.local, b.shared, b.precision).eliminated(c))) / c.shape[1]
        for b, c in zip(fit.blocks, columns, strict=True)
    )
    return float(np.sqrt(needed / per_unit)) if per_unit > 0 else float("inf")


def confusion(signs: Signatures, candidates: Mapping[str, Effect]) -> tuple[tuple[str, ...], Array]:
    """Return the candidates with shared numbers and the largest cosine between their signatures.

    The signature of each candidate is that of its smallest size; of several strengths the pair that
    is most alike counts.
    """
    smallest: dict[str, list[int]] = {}
    for id_, effect in candidates.items():
        for parameter in strengths(effect):
            p = effect.parameters[parameter]
            nodes = [k for k, q in enumerate(signs.probes) if q.effect == id_ and q.parameter == parameter]
            if nodes:
                nearest = min(nodes, key=lambda k: abs(signs.probes[k].size - p.neutral))
                smallest.setdefault(id_, []).append(nearest)
    ids = tuple(smallest)
    norm = np.sqrt(np.fmax(np.diag(signs.gram), 1e-300))
    cosine = signs.gram / np.outer(norm, norm)
    matrix = np.eye(len(ids))
    for a, one in enumerate(ids):
        for b, other in enumerate(ids):
            if a != b:
                pairs = cosine[np.ix_(smallest[one], smallest[other])]
                matrix[a, b] = pairs.ravel()[np.argmax(np.abs(pairs))]
    return ids, matrix
