"""Kalman filter and Rauch-Tung-Striebel smoother over the nodes, by FilterPy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from filterpy.kalman import KalmanFilter

from granite_lab.estimation.nodes import Nodes
from granite_lab.estimation.process import SIZE
from granite_lab.logs.trial import Array


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


def scaled_inverse(matrix: Array) -> Array:
    """Invert a covariance whose variances differ by many powers of ten."""
    scale = 1.0 / np.sqrt(matrix.diagonal())
    weight = np.outer(scale, scale)
    return np.asarray(np.linalg.inv(matrix * weight) * weight)


def forward(nodes: Nodes) -> tuple[Array, Array, Innovations]:
    """Filter over all nodes; states and covariances after each, and the innovations as they came."""
    n = nodes.t.size
    kf = KalmanFilter(dim_x=SIZE, dim_z=1)
    kf.x, kf.P = nodes.x0.copy(), nodes.P0.copy()
    xs, Ps = np.empty((n, SIZE, 1)), np.empty((n, SIZE, SIZE))
    node: list[int] = []
    kind: list[str] = []
    innovation: list[float] = []
    variance: list[float] = []
    noise: list[float] = []
    for k in range(n):
        if k:
            kf.predict(F=nodes.F[k], Q=nodes.Q[k])
        for update in nodes.updates[k]:
            kf.update(np.array([[update.z]]), R=np.array([[update.R]]), H=update.H)
            node.append(k)
            kind.append(update.kind)
            innovation.append(float(kf.y[0, 0]))
            variance.append(float(kf.S[0, 0]))
            noise.append(update.R)
        xs[k], Ps[k] = kf.x, kf.P
    return (
        xs,
        Ps,
        Innovations(
            np.array(node, dtype=int), tuple(kind), np.array(innovation), np.array(variance), np.array(noise)
        ),
    )


def filter_only(nodes: Nodes) -> float:
    """Log-likelihood of the measurements, without smoothing."""
    return forward(nodes)[2].log_likelihood


def run(nodes: Nodes) -> Smoothed:
    """Filter forwards, smooth backwards.

    The method `rts_smoother` takes F and Q of the step *into* each node (it uses index k + 1), which
    is how `Nodes` holds them; FilterPy's module function of that name would need them shifted by one.
    """
    xs, Ps, innovations = forward(nodes)
    kf = KalmanFilter(dim_x=SIZE, dim_z=1)
    x, P, gains, _ = kf.rts_smoother(xs, Ps, nodes.F, nodes.Q, inv=scaled_inverse)
    return Smoothed(x=x[:, :, 0], P=P, gains=gains, innovations=innovations)
