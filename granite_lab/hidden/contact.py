"""Forces between a rigid wheel and soft ground, (1) and (4)-(17), by Clenshaw-Curtis quadrature.

Written from the paper alone, for any number of wheels at once; independent of the package.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Literal

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

V_FLOOR = 0.02
"""Velocity [m/s] below which slip and shear displacement fade to standstill."""


@lru_cache
def clenshaw_curtis(intervals: int) -> tuple[Array, Array]:
    """Return nodes and weights on [-1, 1] for `intervals` + 1 points (intervals even)."""
    theta = np.pi * np.arange(intervals + 1) / intervals
    k = np.arange(1, intervals // 2 + 1)
    b = np.where(k == intervals // 2, 1.0, 2.0)
    inner = (b / (4 * k**2 - 1) * np.cos(2 * np.outer(theta, k))).sum(axis=1)
    c = np.full(intervals + 1, 2.0)
    c[[0, -1]] = 1.0
    return np.cos(theta), c / intervals * (1 - inner)


def panels(edges: tuple[Array, ...], intervals: int) -> tuple[Array, Array]:
    """Return nodes and weights (wheels, nodes) of the rule on each panel between `edges` (wheels,)."""
    nodes, weights = clenshaw_curtis(intervals)
    arcs, factors = [], []
    for low, high in pairwise(edges):
        half = 0.5 * (high - low)[:, None]
        arcs.append(0.5 * (high + low)[:, None] + half * nodes)
        factors.append(half * weights)
    return np.concatenate(arcs, axis=1), np.concatenate(factors, axis=1)


def over_arc(values: Array, weight: Array) -> Array:
    """Return the integrals (wheels,) of values (wheels, nodes)."""
    return np.asarray(np.einsum("ij,ij->i", values, weight))


@dataclass(frozen=True)
class Ground:
    """Soil and wheel numbers of (6)-(17), in the paper's symbols and SI units.

    A number of the soil may differ from wheel to wheel: an array (wheels, 1) then. `harden` gives
    a factor on the pressure (8) from sin(theta) along the arc, (wheels, nodes).
    """

    r: float
    b: float
    n: float | Array
    k_c: float | Array
    k_phi: float | Array
    c: float | Array
    tan_phi: float
    K: float | Array
    mu_s: float
    c_t: float
    harden: Callable[[Array], Array] | None = None


@dataclass(frozen=True)
class Contact:
    """What (12)-(17) give for each wheel: forces [N], torque [N m], and what they came from."""

    slip: Array
    sinkage: Array
    W: Array
    R: Array
    F: Array
    M: Array
    normal: Array


def smoothstep(s: Array | float) -> Array:
    """Return s^2 (3 - 2 s), s held within 0 and 1."""
    s = np.minimum(np.maximum(s, 0.0), 1.0)
    return np.asarray(s * s * (3.0 - 2.0 * s))


@dataclass(frozen=True)
class NearRest:
    """How (1) and (11), which are not defined at rest, and the drive go on below a few cm/s.

    Attributes:
        law: "floor": the speed in the denominator of (1) has a floor, and the shear at no slip fades by a
            cubic; "parabola": the denominator u goes over into (u² + s²) / (2 s), with the slope of 1 where
            it begins, and the shear fades by u (2 s - u) / s². That slip needs a law of its own at low speed:
            Bernard and Clover, SAE 950311, 1995. Above `speed` both are (1) and (11) themselves.
        speed: s, below which the law holds [m/s].
        holds_below: velocity of the tread below which, after the command, the motor is switched off and
            the gear locks [m/s]; 0: the controller stays on.
    """

    law: Literal["floor", "parabola"] = "floor"
    speed: float = V_FLOOR
    holds_below: float = 0.0


FLOOR = NearRest()


def slip_ratio(v_o: Array, v: Array, near_rest: NearRest = FLOOR) -> Array:
    """Return (1): (v_o - v) / max(abs(v_o), abs(v)), with another denominator near rest."""
    u, s = np.maximum(np.abs(v_o), np.abs(v)), near_rest.speed
    if near_rest.law == "floor":
        return (v_o - v) / np.maximum(u, s)
    return (v_o - v) / np.where(u < s, (u * u + s * s) / (2 * s), u)


def moving(v_o: Array, v: Array, near_rest: NearRest = FLOOR) -> Array:
    """Return 0 at rest and 1 where (11) holds: the share of the shear that rolling without slip gives."""
    u = np.maximum(np.abs(v_o), np.abs(v)) / near_rest.speed
    if near_rest.law == "floor":
        return smoothstep(u)
    u = np.minimum(u, 1.0)
    return np.asarray(u * (2.0 - u))


def contact(
    ground: Ground,
    *,
    v_o: Array,
    v: Array,
    z0: Array,
    dz0: Array,
    k92: Array | float,
    intervals: int = 32,
    flat: Array | None = None,
    near_rest: NearRest = FLOOR,
) -> Contact:
    """Return the forces on each wheel.

    Args:
        ground: soil and wheel.
        v_o: circumferential velocity of the wheel [m/s].
        v: longitudinal velocity of the wheel centre [m/s].
        z0: sinkage [m].
        dz0: its rate [m/s].
        k92: ratio of rear to front contact angle.
        intervals: of the quadrature.
        flat: by how much the tyre's lowest part is pressed in [m]; its underside is level there.
        near_rest: how (1) and (11) go on there.
    """
    g = ground
    slip, fade = slip_ratio(v_o, v, near_rest), moving(v_o, v, near_rest)
    touching = z0 > 0
    drop = z0 if flat is None else z0 + flat
    front = np.arccos(np.maximum(1.0 - np.maximum(np.where(touching, drop, 0.0), 0.0) / g.r, -1.0))  # theta_1
    rear = k92 * front  # (4)
    if flat is None:
        nodes, weights = clenshaw_curtis(intervals)
        half = 0.5 * (front + rear)[:, None]
        arc, weight = 0.5 * (front - rear)[:, None] + half * nodes, half * weights
    else:
        level = np.arccos(1.0 - np.clip(flat / g.r, 0.0, 1.0))
        edges = (-rear, np.maximum(-level, -rear), np.minimum(level, front), front)
        arc, weight = panels(edges, intervals // 2)
    sin, cos = np.sin(arc), np.cos(arc)
    z = np.maximum(drop[:, None] - g.r * (1.0 - cos), 0.0)  # (7)
    steep = sin
    if flat is not None:
        below = slice(intervals // 2 + 1, 2 * (intervals // 2 + 1))
        steep = sin.copy()
        steep[:, below] = 0.0
        z[:, below] = np.maximum(z0[:, None], 0.0)
    sigma = (g.k_c / g.b + g.k_phi) * z**g.n  # (8), (9)
    if g.harden is not None:
        sigma = sigma * g.harden(sin)
    reach = np.sin(front)[:, None] - sin
    j = g.r * (fade[:, None] * (front[:, None] - arc - reach) + slip[:, None] * reach)  # (6)
    limit = np.minimum(g.mu_s * sigma, g.c + sigma * g.tan_phi)  # (10)
    tau = np.sign(j) * limit * -np.expm1(-np.abs(j) / g.K)  # (11)
    area = g.b * g.r
    W = area * over_arc(sigma * cos + tau * steep, weight)  # (12)
    R = -area * over_arc(sigma * steep, weight)  # (13), with the sign that opposes motion
    F = area * over_arc(tau * cos, weight)  # (14)
    M = -area * g.r * over_arc(tau, weight)  # (15)
    normal = np.where(touching, np.maximum(W + g.c_t * dz0, 0.0), 0.0)  # (17), never pulls
    return Contact(slip, z0, W, R, F, M, normal)
