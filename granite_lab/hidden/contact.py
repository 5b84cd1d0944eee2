"""Forces between a rigid wheel and soft ground, (1) and (4)-(17), by Clenshaw-Curtis quadrature.

Written from the paper alone, for any number of wheels at once; independent of the package.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

V_FLOOR = 0.02
"""Velocity [m/s] below which slip and shear displacement fade to standstill."""


@lru_cache
def clenshaw_curtis(intervals: int) -> Array:
    """Return nodes and weights (2, intervals + 1) on [-1, 1] for `intervals` + 1 points (intervals even)."""
    theta = np.pi * np.arange(intervals + 1) / intervals
    k = np.arange(1, intervals // 2 + 1)
    b = np.where(k == intervals // 2, 1.0, 2.0)
    inner = (b / (4 * k**2 - 1) * np.cos(2 * np.outer(theta, k))).sum(axis=1)
    c = np.full(intervals + 1, 2.0)
    c[[0, -1]] = 1.0
    return np.stack([np.cos(theta), c / intervals * (1 - inner)])


@dataclass(frozen=True)
class Ground:
    """Soil and wheel numbers of (6)-(17), in the paper's symbols and SI units.

    A number of the soil may differ from wheel to wheel: an array (wheels,) then. The pressure (8) grows
    by the factor 1 + harden log(1 + v sin(theta) / harden_speed) where the arc moves into the soil.

    A part `moved` of the normal stress is greatest at the angle (ahead + ahead_slip |λ|) θ_1 and falls from
    there to zero at -θ_2 along a straight line. The pressure is bounded by `bearing` [Pa], where that is not
    zero. The shear stress has the peak and the residual value of `oida` where `residual` is below 1.
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
    harden: float = 0.0
    harden_speed: float = 1.0
    moved: float = 0.0
    ahead: float = 0.0
    ahead_slip: float = 0.0
    bearing: float = 0.0
    residual: float = 1.0
    peak: float = 1.0

    @cached_property
    def packed(self) -> tuple[Array, Array]:
        """Return n, k of (8), c and K as (4, wheels) or (4, 1), and the other numbers as a vector."""
        rows = self.n, self.k_c / self.b + self.k_phi, self.c, self.K
        soil = np.empty((4, max(map(np.size, rows))))
        soil[0], soil[1], soil[2], soil[3] = rows
        numbers = self.r, self.b, self.tan_phi, self.mu_s, self.c_t, self.harden, self.harden_speed
        law = self.moved, self.ahead, self.ahead_slip, self.bearing, self.residual, self.peak
        return soil, np.array([*numbers, *law])


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


def oida(j: Array, residual: float, peak: float) -> Array:
    """Return the share of the strength that a shear displacement mobilises.

    It is 1 at K_w, near the peak, and falls to K_r. Oida (1979), as in Wong, Theory of Ground Vehicles,
    4th ed., 2008, section 2.4.3:
    K_r (1 + (1 / (K_r (1 - 1/e)) - 1) exp(1 - j / K_w)) (1 - exp(-j / K_w)).

    Args:
        j: displacements, not negative [m].
        residual: K_r, residual over greatest shear stress.
        peak: K_w, where the shear stress is greatest [m].
    """
    x = j / peak
    rise = 1.0 / (residual * (1.0 - np.exp(-1.0))) - 1.0
    return np.asarray(-residual * (1.0 + rise * np.exp(1.0 - x)) * np.expm1(-x))


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


def slip_and_share(v_o: Array, v: Array, near_rest: NearRest = FLOOR) -> tuple[Array, Array]:
    """Return the slip (1), (v_o - v) / max(abs(v_o), abs(v)), and the share of the shear without slip.

    Near rest the denominator is another, and the share falls from 1 to 0.
    """
    u, s = np.maximum(np.abs(v_o), np.abs(v)), near_rest.speed
    if near_rest.law == "floor":
        return (v_o - v) / np.maximum(u, s), smoothstep(u / s)
    low = np.minimum(u / s, 1.0)
    return (v_o - v) / np.where(u < s, 0.5 * s * (low * low + 1.0), u), low * (2.0 - low)


def slip_ratio(v_o: Array, v: Array, near_rest: NearRest = FLOOR) -> Array:
    """Return the slip (1)."""
    return slip_and_share(v_o, v, near_rest)[0]


@dataclass(frozen=True)
class Stance:
    """How wheels meet the ground, (wheels,) each.

    Attributes:
        v_o: circumferential velocity [m/s].
        v: longitudinal velocity of the wheel's geometric centre [m/s].
        z0, dz0: sinkage [m] and its rate [m/s].
        radius: of the circle that meets the soil [m]; None where it is the wheel's, as moments have it.
    """

    v_o: Array
    v: Array
    z0: Array
    dz0: Array
    radius: Array | None = None


def contact(
    ground: Ground, at: Stance, k92: float, *, intervals: int = 32, near_rest: NearRest = FLOOR
) -> Contact:
    """Return the forces on each wheel.

    Args:
        ground: soil and wheel.
        at: how the wheels meet it.
        k92: ratio of rear to front contact angle.
        intervals: of the quadrature.
        near_rest: how (1) and (11) go on there.
    """
    soil, numbers = ground.packed
    arcs = numbers[:1] if at.radius is None else at.radius
    floor = near_rest.speed if near_rest.law == "floor" else -near_rest.speed
    motion, law = np.stack([at.v_o, at.v, at.z0, at.dz0]), np.array([k92, floor])
    slip, W, R, F, M, normal = faster(forces_by_loops, forces_of_arrays)(
        soil, np.concatenate([numbers, law]), arcs, motion, clenshaw_curtis(intervals)
    )
    return Contact(slip, at.z0, W, R, F, M, normal)


def forces_of_arrays(soil: Array, numbers: Array, arcs: Array, motion: Array, rule: Array) -> Array:
    """Return slip, W, R, F, M and the normal force of each wheel, (6, wheels).

    Args:
        soil: of `Ground.packed`.
        numbers: of `Ground.packed`, behind them k_92 and the speed of `NearRest`, negative for the law of
            the parabola.
        arcs: (wheels,) or (1,) radius of the circle that meets the soil [m].
        motion: (4, wheels) v_o, v, z0 and dz0 of `Stance`.
        rule: (2, N) nodes and weights of the quadrature on [-1, 1].
    """
    r, b, tan_phi, mu_s, c_t, harden, harden_speed = numbers[:7]
    moved, ahead, ahead_slip, bearing, residual, peak, k92, floor = numbers[7:]
    (v_o, v, z0, dz0), (nodes, weights) = motion, rule
    n, k, c, K = soil[:, :, None]
    slip, share = slip_and_share(v_o, v, NearRest("floor" if floor > 0 else "parabola", abs(floor)))
    front = np.arccos(1.0 - np.clip(z0 / arcs, 0.0, 2.0))[:, None]  # theta_1
    half = 0.5 * (1.0 + k92) * front  # (4)
    arc = front - half + half * nodes
    sin, cos = np.sin(arc), np.cos(arc)
    depth = np.maximum(z0, 0.0)[:, None]
    sigma = k * np.maximum(depth - arcs[:, None] * (1.0 - cos), 0.0) ** n  # (7)-(9)
    if moved:
        top = (ahead + ahead_slip * np.abs(slip))[:, None] * front
        highest = np.maximum(depth - arcs[:, None] * (1.0 - np.cos(np.maximum(arc, top))), 0.0)
        line = np.minimum((arc + k92 * front) / (k92 * front + top), 1.0)
        sigma += moved * (k * highest**n * line - sigma)
    if bearing:
        sigma = bearing * np.tanh(sigma / bearing)
    if harden:
        sigma *= 1.0 + harden * np.log1p(np.abs(v)[:, None] / harden_speed * np.maximum(sin, 0.0))
    reach = np.sin(front) - sin
    j = arcs[:, None] * (share[:, None] * (front - arc - reach) + slip[:, None] * reach)  # (6)
    limit = np.minimum(mu_s * sigma, c + sigma * tan_phi)  # (10)
    share = -np.expm1(-np.abs(j) / K)  # of the limit that is mobilised, (11)
    if residual < 1.0:
        share = oida(np.abs(j), residual, peak)
    tau = np.sign(j) * limit * share
    parts = np.stack([sigma * cos + tau * sin, sigma * sin, tau * cos, tau])
    W, R, F, S = b * arcs * (parts * (half * weights)).sum(axis=2)  # (12)-(15)
    normal = np.where(z0 > 0, np.maximum(W + c_t * dz0, 0.0), 0.0)  # (17), never pulls
    return np.stack([slip, W, -R, F, -r * S, normal])  # (13) with the sign that opposes motion


def forces_by_loops(soil: Array, numbers: Array, arcs: Array, motion: Array, rule: Array) -> Array:
    """Do the same as `forces_of_arrays`, written for a compiler."""
    r, b, tan_phi, mu_s, c_t, harden, harden_speed = numbers[:7]
    moved, ahead, ahead_slip, bearing, residual, peak, k92, floor = numbers[7:]
    v_o, v, z0, dz0 = motion
    out = np.zeros((6, v.size))
    for i in range(v.size):
        own = min(i, soil.shape[1] - 1)
        n, k, c, K = soil[0, own], soil[1, own], soil[2, own], soil[3, own]
        radius = arcs[min(i, arcs.size - 1)]
        u, s = max(abs(v_o[i]), abs(v[i])), abs(floor)
        low = min(u / s, 1.0)
        if floor > 0:
            slip, share = (v_o[i] - v[i]) / max(u, s), low * low * (3.0 - 2.0 * low)
        else:
            slip = (v_o[i] - v[i]) / (u if u >= s else 0.5 * s * (low * low + 1.0))
            share = low * (2.0 - low)
        out[0, i] = slip
        if z0[i] <= 0.0:
            continue
        front = math.acos(1.0 - min(z0[i] / radius, 2.0))
        half, top = 0.5 * (1.0 + k92) * front, math.sin(front)
        for node, weight in rule.T:
            arc = front - half + half * node
            sin, cos = math.sin(arc), math.cos(arc)
            z = z0[i] - radius * (1.0 - cos)
            if z <= 0.0:
                continue
            sigma = k * z**n
            if moved != 0.0:
                crest = (ahead + ahead_slip * abs(slip)) * front
                highest = max(z0[i] - radius * (1.0 - math.cos(max(arc, crest))), 0.0)
                line = min((arc + k92 * front) / (k92 * front + crest), 1.0)
                sigma += moved * (k * highest**n * line - sigma)
            if bearing != 0.0:
                sigma = bearing * math.tanh(sigma / bearing)
            if harden != 0.0:
                sigma *= 1.0 + harden * math.log1p(abs(v[i]) / harden_speed * max(sin, 0.0))
            reach = top - sin
            j = radius * (share * (front - arc - reach) + slip * reach)
            limit = min(mu_s * sigma, c + sigma * tan_phi)
            mobilised = -math.expm1(-abs(j) / K)
            if residual < 1.0:
                x = abs(j) / peak
                rise = 1.0 / (residual * (1.0 - math.exp(-1.0))) - 1.0
                mobilised = -residual * (1.0 + rise * math.exp(1.0 - x)) * math.expm1(-x)
            tau = math.copysign(limit * mobilised, j)
            w = b * radius * half * weight
            out[1, i] += w * (sigma * cos + tau * sin)
            out[2, i] -= w * sigma * sin
            out[3, i] += w * tau * cos
            out[4, i] -= w * r * tau
        out[5, i] = max(out[1, i] + c_t * dz0[i], 0.0)
    return out


@cache
def faster(loops: Callable[..., Array], plain: Callable[..., Array]) -> Callable[..., Array]:
    """Return a function compiled by Numba where that is installed, else one that needs no compiler."""
    try:
        from numba import njit  # noqa: PLC0415, half a second to import; five times faster for it
    except ImportError:
        return plain
    fast: Callable[..., Array] = njit(cache=True)(loops)
    return fast
