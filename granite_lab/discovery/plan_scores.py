"""The screen's scores for many sets of residuals at once, from their products with the signatures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtrc, chdtri

from granite_lab.discovery.screen import LEAST_TAIL
from granite_lab.discovery.signature import Probe, strengths
from granite_lab.logs.trial import Array
from granite_lab.model.effect import Effect


def amounts_at(
    probes: Sequence[Probe], effect: Effect, parameter: int, distance: float, n: int
) -> Array | None:
    """Return the (n,) amounts of the probes that make up the response at a size between them.

    Args:
        probes: in the order of the columns.
        effect: the candidate.
        parameter: place of its strength.
        distance: of the size from the neutral value, with its sign.
        n: number of columns.

    Returns:
        None where no probe lies on that side.
    """
    neutral, side = effect.parameters[parameter].neutral, np.sign(distance)
    path = sorted(
        (abs(p.size - neutral), k)
        for k, p in enumerate(probes)
        if p.effect == effect.id and p.parameter == parameter and (p.size - neutral) * side > 0
    )
    if not path:
        return None
    after = next((j for j, (s, _) in enumerate(path) if s >= abs(distance)), len(path) - 1)
    s0, before = path[after - 1] if after else (0.0, -1)
    s1, node = path[after]
    u = (abs(distance) - s0) / (s1 - s0)
    amounts = np.zeros(n)
    amounts[node] = u
    if before >= 0:
        amounts[before] = 1 - u
    return amounts


def path_drop(effect: Effect, probes: Sequence[Probe], gram: Array, B: Array) -> tuple[Array, Array]:
    """Return (draws,) how far chi2 falls with a candidate, and by how many numbers, as `screen.scores`.

    Args:
        effect: with numbers that all trials share.
        probes: in the order of the columns.
        gram: (n, n) inner products of the surviving signatures.
        B: (n, draws) their products with residuals.
    """
    place = [k for k, p in enumerate(probes) if p.effect == effect.id]
    draws = B.shape[1]
    best, nodes = np.zeros((0, draws)), np.zeros((0, draws), dtype=int)
    for parameter in strengths(effect):
        neutral = effect.parameters[parameter].neutral
        top, at = np.zeros(draws), np.full(draws, -1)
        for side in (1, -1):
            path = sorted(
                (k for k in place if probes[k].parameter == parameter
                 and (probes[k].size - neutral) * side > 0),
                key=lambda k: abs(probes[k].size - neutral),
            )  # fmt: skip
            for n, k in enumerate(path):
                drop = _segment(gram, B, path[n - 1] if n else None, k, 2.0 if n == len(path) - 1 else 1.0)
                at = np.where(drop > top, k, at)
                top = np.fmax(top, drop)
        best, nodes = np.vstack([best, top]), np.vstack([nodes, at])
    drop, count = best.max(axis=0), np.ones(draws, dtype=int)
    for combination in np.unique(nodes, axis=1).T:
        used = [k for k in combination if k >= 0]
        if len(used) < 2:
            continue
        here = np.flatnonzero((nodes == combination[:, None]).all(axis=0))
        amounts = np.linalg.lstsq(gram[np.ix_(used, used)], B[np.ix_(used, here)], rcond=1e-9)[0]
        together = np.sum(amounts * B[np.ix_(used, here)], axis=0)
        wins = (amounts > 0).all(axis=0) & (evidence_of(together, np.full(here.size, len(used))) > drop[here])
        drop[here[wins]], count[here[wins]] = together[wins], len(used)
    return drop, count


def _segment(gram: Array, B: Array, previous: int | None, k: int, most: float) -> Array:
    """Return (draws,) the drop at the best point between two sizes, or between neutral and the first."""
    g00, g01 = (gram[previous, previous], gram[previous, k]) if previous is not None else (0.0, 0.0)
    b0 = B[previous] if previous is not None else np.zeros(B.shape[1])
    curvature = g00 - 2 * g01 + gram[k, k]
    u = np.clip((B[k] - b0 - (g01 - g00)) / curvature, 0.0, most) if curvature > 0 else np.zeros(B.shape[1])
    norm = (1 - u) ** 2 * g00 + 2 * u * (1 - u) * g01 + u**2 * gram[k, k]
    return np.asarray(2 * ((1 - u) * b0 + u * B[k]) - norm)


def evidence_of(drop: Array, count: Array) -> Array:
    """Translate drops of chi2 by several numbers into those by one of the same rarity, `screen.evidence`."""
    result = drop.astype(float).copy()
    for n in np.unique(count[count > 1]):
        own = (count == n) & (drop > 0)
        log_p = np.log(np.fmax(chdtrc(n, drop[own]), LEAST_TAIL))
        far = np.exp(-600.0)
        beyond = drop[own] - (chdtri(n, far) - chdtri(1, far))
        result[own] = np.where(log_p < -600, beyond, chdtri(1, np.exp(np.fmax(log_p, -600))))
    return result
