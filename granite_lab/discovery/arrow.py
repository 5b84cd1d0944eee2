"""Least squares with an arrow: numbers of each trial, and numbers that all trials share.

The numbers of a trial touch only that trial, so they are eliminated one trial after the other. The
same elimination, applied to any further columns, shows what of them survives the nuisances.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import lsq_linear

from granite_lab.logs.trial import Array


@dataclass(frozen=True, eq=False)
class Block:
    """The whitened derivatives of one trial.

    Attributes:
        local: (m, p) by the trial's own numbers.
        shared: (m, q) by the shared numbers.
        precision: (p,) inverse variances of the trial's priors.
    """

    local: Array
    shared: Array
    precision: Array

    @cached_property
    def normal(self) -> Array:
        """The trial's own normal matrix (p, p), prior included."""
        return np.asarray(self.local.T @ self.local + np.diag(self.precision))

    @cached_property
    def coupling(self) -> Array:
        """Products of the trial's and the shared derivatives (p, q)."""
        return np.asarray(self.local.T @ self.shared)

    @cached_property
    def _factor(self) -> tuple[Array, bool]:
        return cho_factor(self.normal)

    def solve(self, right: Array, damping: float = 0.0) -> Array:
        """Return the inverse of the trial's normal matrix, its diagonal enlarged, times `right`."""
        if damping:
            return np.asarray(np.linalg.solve(self.normal + damping * np.diag(np.diag(self.normal)), right))
        return np.asarray(cho_solve(self._factor, right))

    def eliminated(self, columns: Array) -> Array:
        """Return the inner products (k, k) of further columns once the trial's numbers are refitted."""
        across = self.local.T @ columns
        return np.asarray(columns.T @ columns - across.T @ self.solve(across))


def covariance(blocks: Sequence[Block], prior: Array) -> Array:
    """Return the (q, q) covariance of the shared numbers once the trials' own are refitted.

    Args:
        blocks: per trial.
        prior: (q,) inverse variances of the shared numbers.
    """
    N = np.diag(prior)
    for block in blocks:
        N = N + block.eliminated(block.shared)
    scale = 1 / np.sqrt(np.fmax(np.diag(N), 1e-300))
    inverse = np.linalg.pinv(N * np.outer(scale, scale), rcond=1e-12, hermitian=True)
    return np.asarray(inverse * np.outer(scale, scale))


@dataclass(frozen=True, eq=False)
class Step:
    """A step of the iteration.

    Attributes:
        shared: (q,) change of the shared numbers.
        local: change of each trial's numbers.
    """

    shared: Array
    local: list[Array]


def step(
    blocks: list[Block],
    residuals: list[Array],
    local: list[Array],
    shared: Array,
    prior: tuple[Array, Array],
    bounds: tuple[Array, Array],
    damping: float = 0.0,
) -> Step:
    """Return the Gauss-Newton step.

    Args:
        blocks: per trial.
        residuals: (m,) measured minus predicted, whitened, per trial.
        local, shared: the present numbers; the priors pull those of a trial to zero.
        prior: (q,) inverse variances of the shared numbers, and what they are pulled to.
        bounds: lowest and highest shared numbers.
        damping: Levenberg's and Marquardt's, on the diagonals.
    """
    q = shared.size
    N, g, gains = np.diag(prior[0]), -prior[0] * (shared - prior[1]), []
    for block, r, x in zip(blocks, residuals, local, strict=True):
        own = block.local.T @ r - block.precision * x
        gains.append((block.solve(own, damping), block.solve(block.coupling, damping)))
        N = N + block.shared.T @ block.shared - block.coupling.T @ gains[-1][1]
        g = g + block.shared.T @ r - block.coupling.T @ gains[-1][0]
    change = np.zeros(q)
    if q:
        scale = 1 / np.sqrt(np.fmax(np.diag(N), 1e-300))
        M = N * np.outer(scale, scale) + (damping + 1e-12) * np.eye(q)
        L = np.linalg.cholesky(M)
        low, high = ((b - shared) / scale for b in bounds)
        free = np.linalg.solve(M, scale * g)
        if (free < low).any() or (free > high).any():
            tiny = 1e-9
            free = lsq_linear(
                L.T, np.linalg.solve(L, scale * g), (np.fmin(low, -tiny), np.fmax(high, tiny)), method="bvls"
            ).x
        change = scale * free
    return Step(change, [own - pull @ change for own, pull in gains])


@dataclass(frozen=True, eq=False)
class Projection:
    """Further columns once all nuisances are refitted.

    Attributes:
        gram: (k, k) inner products of what survives, the priors' share included.
        left: per trial the (m, k) surviving columns.
        pull: per trial (p, k) how far the trial's numbers follow a column.
        through: (q, k) how far the shared numbers follow.
    """

    gram: Array
    left: list[Array]
    pull: list[Array]
    through: Array


def project(blocks: list[Block], columns: list[Array], prior: Array) -> Projection:
    """Project the nuisances out of further columns.

    Args:
        blocks: per trial.
        columns: (m, k) per trial, whitened.
        prior: (q,) inverse variances of the shared numbers.
    """
    q, k = prior.size, columns[0].shape[1]
    N, across, total = np.diag(prior + 1e-12), np.zeros((q, k)), np.zeros((k, k))
    pulls = []
    for block, own in zip(blocks, columns, strict=True):
        with_own = block.local.T @ own
        pull = block.solve(np.hstack([with_own, block.coupling]))
        total += own.T @ own - with_own.T @ pull[:, :k]
        across += block.shared.T @ own - block.coupling.T @ pull[:, :k]
        N = N + block.shared.T @ block.shared - block.coupling.T @ pull[:, k:]
        pulls.append((pull[:, :k], pull[:, k:]))
    scale = 1 / np.sqrt(np.diag(N))
    scaled = np.linalg.lstsq(N * np.outer(scale, scale), across * scale[:, None], rcond=1e-12)[0]
    through = scaled * scale[:, None]
    follow = [own - shared @ through for own, shared in pulls]
    left = [c - b.local @ f - b.shared @ through for b, c, f in zip(blocks, columns, follow, strict=True)]
    return Projection(total - across.T @ through, left, follow, through)
