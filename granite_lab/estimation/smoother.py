"""Kalman filter and Rauch-Tung-Striebel smoother over the nodes, by FilterPy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from filterpy.kalman import KalmanFilter

from granite_lab.estimation.nodes import Nodes
from granite_lab.estimation.process import SIZE
from granite_lab.logs.trial import Array


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Joint estimate of the drift.

    Attributes:
        x: (K, 12) smoothed states.
        P: (K, 12, 12) their covariance.
        gains: (K, 12, 12) smoother gains; the covariance of nodes i < j is
            gains[i] ... gains[j - 1] P[j].
        node, kind, innovation, innovation_std: (U,) the filter's innovations in the order they came.
        log_likelihood: of all measurements.
    """

    x: Array
    P: Array
    gains: Array
    node: np.ndarray
    kind: tuple[str, ...]
    innovation: Array
    innovation_std: Array
    log_likelihood: float

    def cross(self, i: int, j: int) -> Array:
        """(12, 12) covariance of the states at nodes i <= j."""
        total = np.eye(SIZE)
        for k in range(i, j):
            total = total @ self.gains[k]
        return np.asarray(total @ self.P[j])


def scaled_inverse(matrix: Array) -> Array:
    """Invert a covariance whose variances differ by many powers of ten."""
    scale = 1.0 / np.sqrt(matrix.diagonal())
    weight = np.outer(scale, scale)
    return np.asarray(np.linalg.inv(matrix * weight) * weight)


def forward(nodes: Nodes) -> tuple[Array, Array, list[int], list[str], Array, Array]:
    """Filter over all nodes; states, covariances, and innovations with their variance as they came."""
    n = nodes.t.size
    kf = KalmanFilter(dim_x=SIZE, dim_z=1)
    kf.x, kf.P = nodes.x0.copy(), nodes.P0.copy()
    xs, Ps = np.empty((n, SIZE, 1)), np.empty((n, SIZE, SIZE))
    node: list[int] = []
    kind: list[str] = []
    innovation: list[float] = []
    variance: list[float] = []
    for k in range(n):
        if k:
            kf.predict(F=nodes.F[k], Q=nodes.Q[k])
        for update in nodes.updates[k]:
            kf.update(np.array([[update.z]]), R=np.array([[update.R]]), H=update.H)
            node.append(k)
            kind.append(update.kind)
            innovation.append(float(kf.y[0, 0]))
            variance.append(float(kf.S[0, 0]))
        xs[k], Ps[k] = kf.x, kf.P
    return xs, Ps, node, kind, np.array(innovation), np.array(variance)


def log_likelihood(y: Array, s2: Array) -> float:
    """Log-likelihood of innovations y with variances s2."""
    return float(-0.5 * np.sum(y**2 / s2 + np.log(2 * np.pi * s2)))


def filter_only(nodes: Nodes) -> float:
    """Log-likelihood of the measurements, without smoothing."""
    *_, y, s2 = forward(nodes)
    return log_likelihood(y, s2)


def run(nodes: Nodes) -> Smoothed:
    """Filter forwards, smooth backwards.

    The method `rts_smoother` takes F and Q of the step *into* each node (it uses index k + 1), which
    is how `Nodes` holds them; FilterPy's module function of that name would need them shifted by one.
    """
    xs, Ps, node, kind, y, s2 = forward(nodes)
    kf = KalmanFilter(dim_x=SIZE, dim_z=1)
    x, P, gains, _ = kf.rts_smoother(xs, Ps, nodes.F, nodes.Q, inv=scaled_inverse)
    return Smoothed(
        x=x[:, :, 0], P=P, gains=gains, node=np.array(node, dtype=int), kind=tuple(kind), innovation=y,
        innovation_std=np.sqrt(s2), log_likelihood=log_likelihood(y, s2),
    )  # fmt: skip
