"""Slip ratios by (1) and (2), with their std."""

from __future__ import annotations

import numpy as np

from granite_lab.estimate import Estimate
from granite_lab.estimation.process import PD, V_FLOOR, D, G, P, S, V, X
from granite_lab.estimation.smoother import Smoothed
from granite_lab.logs.trial import Array


def wheel_slip(v_o: Array, v_o_std: Array, v: Array, v_std: Array) -> tuple[Array, Array]:
    """Return λ_i by (1) with its floor, (v_o - v) / max(|v_o|, |v|, v_floor), and its std.

    The two velocities are taken for independent.

    Args:
        v_o, v_o_std: (N, 4) circumferential velocities and std [m/s].
        v, v_std: (N,) body velocity and std [m/s].
    """
    body, body_std = v[:, None], v_std[:, None]
    size = np.maximum(np.maximum(np.abs(v_o), np.abs(body)), V_FLOOR)
    ratio = (v_o - body) / size
    # dλ = (dv_o - dv) / size - λ dsize / size
    by_wheel = np.where(np.abs(v_o) >= size, np.sign(v_o), 0.0)
    by_body = np.where((np.abs(body) >= size) & (by_wheel == 0), np.sign(body), 0.0)
    d_wheel = (1 - ratio * by_wheel) / size
    d_body = (-1 - ratio * by_body) / size
    return ratio, np.hypot(d_wheel * v_o_std, d_body * body_std)


def robot_slip(found: Smoothed, x: Array, d: Array, i: int, j: int) -> Estimate:
    """Return λ_R by (2) between two nodes, 1 - (travelled / rolled).

    The covariance of distances at different instants comes from the smoother's gains.

    Args:
        found: the smoothed states.
        x, d: (K,) travelled distance and rolled minus travelled distance at the nodes [m].
        i, j: nodes.
    """
    travelled, slipped = x[j] - x[i], d[j] - d[i]
    rolled = travelled + slipped
    if abs(rolled) < 1e-3:
        return Estimate(float("nan"))
    gx = np.zeros(found.x.shape[1])
    gx[[X, P]] = 1.0, -1.0
    gd = np.zeros(found.x.shape[1])
    gd[D] = 1.0
    # λ = slipped / rolled: its gradient towards the difference of the states
    gradient = (gd * travelled - gx * slipped) / rolled**2
    cross = found.cross(i, j)
    spread = found.P[i] + found.P[j] - cross - cross.T
    return Estimate(float(slipped / rolled), float(np.sqrt(max(gradient @ spread @ gradient, 0.0))))


def velocity_std(found: Smoothed) -> Array:
    """(K,) std of the body velocity, drift minus vibration [m/s]."""
    variance = found.P[:, V, V] - 2 * found.P[:, V, PD] + found.P[:, PD, PD]
    return np.sqrt(np.maximum(variance, 0.0))


def distance_std(found: Smoothed) -> Array:
    """(K,) std of the travelled distance [m]."""
    variance = found.P[:, X, X] - 2 * found.P[:, X, P] + found.P[:, P, P]
    return np.sqrt(np.maximum(variance, 0.0))


def slip_velocity(found: Smoothed, w: Array, mean: Array) -> tuple[Array, Array]:
    """(K,) slip velocity of the mean of the wheels and its std [m/s]."""
    variance = found.P[:, S, S] + 2 * found.P[:, S, G] + found.P[:, G, G]
    return w * (mean + found.x[:, S] + found.x[:, G]), np.abs(w) * np.sqrt(np.maximum(variance, 0.0))
