"""Is what differs from trial to trial only a phase?

A wheel starts each trial at another angle, so that cosine and sine of its run-out are new each time; the
run-out itself is not. A candidate free in both can follow a disturbance that has nothing to do with wheels,
but then at another size in each trial.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtri

from granite_lab.discovery.point import Fit
from granite_lab.discovery.problem import Problem
from granite_lab.logs.trial import Array

TOLERANCE = 0.1
"""Share of a size that is not held against a candidate: no formula is exact."""

CHANCE = 1e-4
"""Probability with which one size in all trials is taken for several."""

_SIZES = np.linspace(0, 1.2, 161)
_PHASES = np.linspace(0, 2 * np.pi, 128, endpoint=False)


def uneven(problem: Problem, fit: Fit, id_: str) -> bool:
    """Tell whether an effect has another size in each trial, where only its phase may differ.

    Args:
        problem: the trials.
        fit: with the effect.
        id_: of the effect.
    """
    circles = problem.effect(id_).circles
    if not circles or len(problem.trials) < 2:
        return False
    names = [(e, p.name) for e, p in problem.own_parameters(fit.point.effects)]
    own = [x[t.size :] for t, x in zip(problem.trials, fit.point.trials, strict=True)]
    covariances = [
        b.solve(np.eye(b.precision.size))[-x.size :, -x.size :] for b, x in zip(fit.blocks, own, strict=True)
    ]
    limit = chdtri(len(own) - 1, CHANCE / len(circles))
    for pair in circles:
        at = [names.index((id_, name)) for name in pair]
        if apart([x[at] for x in own], [C[np.ix_(at, at)] for C in covariances]) > limit:
            return True
    return False


def apart(vectors: Sequence[Array], covariances: Sequence[Array]) -> float:
    """Return χ² of vectors about the circle around zero that is nearest to all of them.

    Args:
        vectors: (2,) each.
        covariances: (2, 2) of each.
    """
    x, C = np.stack(vectors), np.stack(covariances)
    around = np.stack([np.cos(_PHASES), np.sin(_PHASES)], axis=1)
    best = np.inf
    for a in _SIZES * np.hypot(*x.T).max():
        inverse = np.linalg.inv(C + (TOLERANCE * a) ** 2 * np.eye(2))
        off = x[:, None] - a * around
        best = min(best, float(np.einsum("ipj,ijk,ipk->ip", off, inverse, off).min(axis=1).sum()))
    return best
