"""Kalman filter and Rauch-Tung-Striebel smoother over the nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from granite_lab.estimation.nodes import Nodes
from granite_lab.estimation.process import SIZE
from granite_lab.logs.trial import Array

BLOCK = 2000
"""Nodes whose matrices are inverted at once."""


@dataclass(frozen=True, eq=False)
class Innovations:
    """What each scalar measurement (U in all) brought, in the order the filter took them.

    Attributes:
        node: (U,) at which node.
        kind: (U,) which measurement.
        value: (U,) measurement minus prediction.
        variance: (U,) predicted variance of it.
        noise: (U,) variance of the measurement alone.
    """

    node: np.ndarray
    kind: tuple[str, ...]
    value: Array
    variance: Array
    noise: Array

    @property
    def log_likelihood(self) -> float:
        """Log-likelihood, counted so that a measurement as good as its noise, and none at all, give 0.

        Then filters over slightly different sets of measurements can be compared.
        """
        ratio = self.value**2 / self.variance
        return float(-0.5 * np.sum(ratio - 1.0 + np.log(self.variance / self.noise)))


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Joint estimate of the drift.

    Attributes:
        x: (K, 14) smoothed states.
        P: (K, 14, 14) their covariance.
        gains: (K, 14, 14) smoother gains; the covariance of nodes i < j is
            gains[i] ... gains[j - 1] P[j].
        innovations: of the filter.
    """

    x: Array
    P: Array
    gains: Array
    innovations: Innovations

    def cross(self, i: int, j: int) -> Array:
        """(14, 14) covariance of the states at nodes i <= j."""
        total = np.eye(SIZE)
        for k in range(i, j):
            total = total @ self.gains[k]
        return np.asarray(total @ self.P[j])


def forward(nodes: Nodes) -> tuple[Array, Array, Innovations]:
    """Filter over all nodes; states (K, 14) and covariances (K, 14, 14) after each, innovations as they came.

    Measurements are scalar, so no matrix is inverted, and the covariance stays symmetric by construction.
    """
    n = nodes.t.size
    x, P = nodes.x0[:, 0].copy(), nodes.P0.copy()
    xs, Ps = np.empty((n, SIZE)), np.empty((n, SIZE, SIZE))
    came: list[tuple[int, str, float, float, float]] = []
    for k in range(n):
        if k:
            F = nodes.F[k]
            x = F @ x
            P = F @ P @ F.T + nodes.Q[k]
        for update in nodes.updates[k]:
            h = update.H[0]
            Ph = P @ h
            variance = float(h @ Ph) + update.R
            innovation = update.z - float(h @ x)
            x = x + Ph * (innovation / variance)
            P = P - np.outer(Ph, Ph / variance)
            came.append((k, update.kind, innovation, variance, update.R))
        xs[k], Ps[k] = x, P
    columns = list(zip(*came, strict=True)) if came else [(), (), (), (), ()]
    node, kind, innovations, variances, noises = columns
    return (
        xs,
        Ps,
        Innovations(
            node=np.array(node, dtype=int),
            kind=tuple(str(name) for name in kind),
            value=np.array(innovations, dtype=float),
            variance=np.array(variances, dtype=float),
            noise=np.array(noises, dtype=float),
        ),
    )


def filter_only(nodes: Nodes) -> float:
    """Log-likelihood of the measurements, without smoothing."""
    return forward(nodes)[2].log_likelihood


def run(nodes: Nodes) -> Smoothed:
    """Filter forwards, smooth backwards (Rauch, Tung & Striebel 1965); F and Q lead *into* each node."""
    x, P, innovations = forward(nodes)
    n = x.shape[0]
    gains = np.zeros_like(P)
    for end in range(n - 1, 0, -BLOCK):
        begin = max(end - BLOCK, 0)
        F = nodes.F[begin + 1 : end + 1]
        lifted = P[begin:end] @ F.transpose(0, 2, 1)
        ahead = F @ lifted + nodes.Q[begin + 1 : end + 1]
        # variances differ by many powers of ten
        scale = 1.0 / np.sqrt(np.diagonal(ahead, axis1=1, axis2=2))
        weight = scale[:, :, None] * scale[:, None, :]
        gains[begin:end] = lifted @ (np.linalg.inv(ahead * weight) * weight)
        predicted = (F @ x[begin:end, :, None])[:, :, 0]
        for k in range(end - 1, begin - 1, -1):
            gain = gains[k]
            x[k] += gain @ (x[k + 1] - predicted[k - begin])
            P[k] += gain @ (P[k + 1] - ahead[k - begin]) @ gain.T
    return Smoothed(x=x, P=P, gains=gains, innovations=innovations)
