"""Forces between a rigid wheel and soft ground, (1) and (4)-(17), by Clenshaw-Curtis quadrature.

Written from the paper alone, for any number of wheels and of states at once; independent of the package.
"Wheels" in the shapes below stands for (wheels,), or (wheels, states).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
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

    A number of the soil may differ from wheel to wheel: an array of wheels then. The pressure (8) grows
    by the factor 1 + harden log(1 + v sin(theta) / harden_speed) where the arc moves into the soil.

    A part `moved` of the normal stress, if any, is greatest at the angle (ahead + ahead_slip |λ|) θ_1 and
    falls from there to zero at -θ_2 along a straight line. The pressure is bounded by `bearing` [Pa], where
    that is not zero. The shear stress has the peak and the residual value of `oida` where `residual` is
    below 1.
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
    moved: float | Array | None = None
    ahead: float = 0.0
    ahead_slip: float = 0.0
    bearing: float = 0.0
    residual: float = 1.0
    peak: float = 1.0


@dataclass(frozen=True)
class Contact:
    """What (12)-(17) give for each of the wheels: forces [N], torque [N m], and what they came from."""

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
    """How wheels meet the ground.

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


def _on_arc(x: float | Array) -> float | Array:
    """Return a number of each wheel with an axis for the nodes along its arc."""
    return x[..., None] if isinstance(x, np.ndarray) and x.ndim else x


def contact(
    ground: Ground, at: Stance, k92: float | Array, *, intervals: int = 32, near_rest: NearRest = FLOOR
) -> Contact:
    """Return the forces on each wheel.

    Args:
        ground: soil and wheel.
        at: how the wheels meet it.
        k92: ratio of rear to front contact angle; (states,) where it differs.
        intervals: of the quadrature.
        near_rest: how (1) and (11) go on there.
    """
    g, z0, (nodes, weights) = ground, at.z0[..., None], clenshaw_curtis(intervals)
    n, k, c, K = _on_arc(g.n), _on_arc(g.k_c / g.b + g.k_phi), _on_arc(g.c), _on_arc(g.K)
    radius, k92 = g.r if at.radius is None else at.radius, _on_arc(k92)
    arcs = _on_arc(radius)
    slip, share = (x[..., None] for x in slip_and_share(at.v_o, at.v, near_rest))
    front = np.arccos(1.0 - np.minimum(np.maximum(z0 / arcs, 0.0), 2.0))  # theta_1
    half = 0.5 * (1.0 + k92) * front  # (4)
    arc = front - half + half * nodes
    sin, cos = np.sin(arc), np.cos(arc)
    centre = np.maximum(z0, 0.0) - arcs  # of the wheel, below the ground
    sigma = k * np.maximum(centre + arcs * cos, 0.0) ** n  # (7)-(9)
    if g.moved is not None:
        top = (g.ahead + g.ahead_slip * np.abs(slip)) * front
        highest = np.maximum(centre + arcs * np.cos(np.maximum(arc, top)), 0.0)
        whole = np.maximum(k92 * front + top, 1e-12)  # none where the wheel is clear of the ground
        line = np.minimum((arc + k92 * front) / whole, 1.0)
        sigma += _on_arc(g.moved) * (k * highest**n * line - sigma)
    if g.bearing:
        sigma = g.bearing * np.tanh(sigma / g.bearing)
    if g.harden:
        speed = np.abs(at.v)[..., None] / g.harden_speed
        sigma *= 1.0 + g.harden * np.log1p(speed * np.maximum(sin, 0.0))
    reach = np.sin(front) - sin
    j = arcs * (share * (front - arc - reach) + slip * reach)  # (6)
    limit = np.minimum(g.mu_s * sigma, c + sigma * g.tan_phi)  # (10)
    size = np.abs(j)
    mobilised = oida(size, g.residual, g.peak) if g.residual < 1.0 else -np.expm1(-size / K)  # (11)
    tau = np.copysign(limit * mobilised, j)
    area = g.b * radius * half[..., 0]
    W, R, F, S = (
        area * (stress @ weights) for stress in (sigma * cos + tau * sin, sigma * sin, tau * cos, tau)
    )  # (12)-(15)
    normal = np.where(at.z0 > 0, np.maximum(W + g.c_t * at.dz0, 0.0), 0.0)  # (17), never pulls
    return Contact(slip[..., 0], at.z0, W, -R, F, -g.r * S, normal)  # (13) with the sign that opposes motion
