"""Tyre-ground contact of a rigid wheel on deformable soil: equations (1), (4) and (6)-(17)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from granite_lab.logs.trial import Array
from granite_lab.model.command import V_FLOOR, smoothstep
from granite_lab.parameters import Soil

COUNT, DENSER = 4, 0.6
"""Places of the rule on each branch of (9), and by how much they are denser towards the ends of the contact.
Forces are then within 8e-5 of those by 60 places, also under Wong and Reece's law, and within 1e-3 where (10)
goes over from one limit to the other on the arc. A robot at rest needs as many places on both branches."""


def _rule() -> tuple[Array, Array, Array]:
    """Return places (n,) and weights (n,) on [0, 1] after Gauss and Legendre, denser towards 1.

    At the ends of the contact the pressure grows with a broken power of the distance: by the root of that
    distance it is smooth. The third (n, n) takes values to their changes over the part of the interval for
    which each place stands.
    """
    x, w = np.polynomial.legendre.leggauss(COUNT)
    u, powers = (x + 1) / 2, np.arange(COUNT)
    slopes = powers * x[:, None] ** np.fmax(powers - 1, 0) @ np.linalg.inv(x[:, None] ** powers)
    return u + DENSER * u * (1 - u), w / 2 * (1 + DENSER * (1 - 2 * u)), slopes * w[:, None]


NODES, WEIGHTS, CHANGES = _rule()

_TINY = 1e-9  # sinkage [m] at which a contact begins to exist numerically


@dataclass(frozen=True)
class WheelState:
    """How one wheel of a pair moves; all fields are expressions.

    Attributes:
        front: True for the front pair.
        travel: how far the wheel has come since the start [m].
        angle, rate: spin of the rim [rad], [rad/s].
        tread_rate: spin of the tread, which meets the soil [rad/s].
        velocity: longitudinal velocity of the wheel centre in R [m/s].
        sinkage, sinkage_rate: z_0 [m] and its rate [m/s].
        radius, width: r, b [m].
        v_desired: desired velocity of the robot at the moment [m/s].
        k92: the ratio k_92 of the moment by (5), which a hook may find already overruled.
        deflection: by how much the tyre's underside is pressed in [m]; zero for the paper's rigid wheel.
        shortened: by how much the radius on which a deflected tyre rolls is less than that of its tread [m].
    """

    front: bool
    travel: Any
    angle: Any
    rate: Any
    tread_rate: Any
    velocity: Any
    sinkage: Any
    sinkage_rate: Any
    radius: Any
    width: Any
    v_desired: Any
    k92: Any = 1.0
    deflection: Any = 0.0
    shortened: Any = 0.0

    @property
    def letter(self) -> str:
        """End of the names of what belongs to the wheel pair: "f" or "r"."""
        return "f" if self.front else "r"

    @property
    def arc_radius(self) -> Any:
        """Radius of the undeflected tread [m]; r for a rigid wheel."""
        return self.radius + self.shortened

    @property
    def circumferential_velocity(self) -> Any:
        """v_o of (1) [m/s]."""
        return self.tread_rate * self.radius

    @property
    def speed(self) -> Any:
        """The larger of the wheel's two speeds, without sign [m/s]."""
        return ca.fmax(ca.fabs(self.circumferential_velocity), ca.fabs(self.velocity))

    @property
    def slip(self) -> Any:
        """λ of (1); its denominator has the floor V_FLOOR, above which (1) is exact."""
        return (self.circumferential_velocity - self.velocity) / ca.fmax(self.speed, V_FLOOR)


@dataclass(frozen=True)
class ContactAngles:
    """Front and rear contact angles ϑ_1, ϑ_2 [rad]."""

    front: Any
    rear: Any


@dataclass(frozen=True)
class WheelForces:
    """Forces and moment of the ground on one wheel, in the ground frame O.

    Attributes:
        vertical: static vertical load W, (12) [N].
        resistance: motion resistance R, (13), negative when it opposes forward motion [N].
        thrust: traction force F, (14) [N].
        moment: load torque M_ω, (15) [N m].
        normal: F_Tz with damping, (17), never pulling [N].
        extra: further longitudinal force, zero in the paper's model [N].
    """

    vertical: Any
    resistance: Any
    thrust: Any
    moment: Any
    normal: Any
    extra: Any = 0.0

    @property
    def longitudinal(self) -> Any:
        """F_Tx, (16) [N]."""
        return self.thrust + self.resistance + self.extra


def stiffer(soil: Soil, factor: Any) -> Soil:
    """Return soil whose pressure (8) is larger by a factor at every depth."""
    return replace(
        soil,
        cohesive_modulus=soil.cohesive_modulus * factor,
        frictional_modulus=soil.frictional_modulus * factor,
    )


def stronger(soil: Soil, factor: Any) -> Soil:
    """Return soil whose shear strength (10) is larger by a factor under every pressure."""
    degree = np.pi / 180
    return replace(
        soil,
        cohesion=soil.cohesion * factor,
        tyre_friction=soil.tyre_friction * factor,
        friction_angle=ca.atan(factor * ca.tan(soil.friction_angle * degree)) / degree,
    )


def contact_angles(state: WheelState, k92: Any) -> ContactAngles:
    """Return ϑ_1 from the sinkage and ϑ_2 = k_92 ϑ_1 (4)."""
    z0 = ca.fmax(state.sinkage + state.deflection, _TINY)
    front = ca.acos(ca.fmax(1 - z0 / state.arc_radius, -0.99))
    return ContactAngles(front, k92 * front)


@dataclass(frozen=True)
class ArcLaws:
    """How effects rewrite the laws along the contact arc; the defaults are the paper's.

    Attributes:
        bearing: angle ϑ [rad] to the angle whose depth (7) sets the pressure at ϑ.
        corner: angle ϑ [rad] between the front and the rear branch of (9), where the pressure has a corner.
        pressure: pressure σ [Pa] of (9) and angle ϑ [rad] to the pressure at ϑ.
        shear: share of τ_max that (11) mobilises and shear displacement |j| [m] to that share.
    """

    bearing: Callable[[Any], Any] = lambda ϑ: ϑ
    corner: Any = 0.0
    pressure: Callable[[Any, Any], Any] = lambda σ, _: σ
    shear: Callable[[Any, Any], Any] = lambda share, _: share


PAPER = ArcLaws()


def arc_stresses(
    state: WheelState,
    angles: ContactAngles,
    soil: Soil,
    laws: ArcLaws = PAPER,
    change: Callable[[Any], Any] = lambda _: 0.0,
) -> Callable[[Any], tuple[Any, Any]]:
    """Return a function that gives σ and τ [Pa] at an angle ϑ [rad], (6)-(11).

    The part of the shear displacement (6) that does not depend on slip fades to zero at
    standstill, or a robot at rest would creep. (11) is continued as an odd function for wheels
    that brake.

    Args:
        state, angles, soil, laws: as for `wheel_forces`.
        change: pressures at places of a rule to their changes over the parts of the arc that these stand for.
    """
    r, ϑ1, λ = state.arc_radius, angles.front, state.slip
    moving = smoothstep(state.speed / V_FLOOR)
    k = soil.cohesive_modulus / state.width + soil.frictional_modulus  # (8)
    tan_φ = ca.tan(soil.friction_angle * np.pi / 180)
    sin_ϑ1 = ca.sin(ϑ1)

    def stresses(ϑ: Any) -> tuple[Any, Any]:
        rolled = sin_ϑ1 - ca.sin(ϑ)
        j = r * (moving * (ϑ1 - ϑ) - (moving - λ) * rolled)  # (6)
        z, _ = outline(state, angles, soil, laws.bearing(ϑ))  # (7)
        σ = laws.pressure(k * ca.fmax(z, 1e-12) ** soil.exponent, ϑ)  # (8), (9)
        more, half = tan_φ - soil.tyre_friction, ca.fmin(ca.fabs(change(σ)) / 2, σ)
        τ_max = soil.tyre_friction * σ + _negative(soil.cohesion + more * σ, more * half)  # (10)
        mobilised = laws.shear(1 - ca.exp(-ca.fabs(j) / soil.shear_modulus), ca.fabs(j))
        return σ, ca.sign(j) * τ_max * mobilised  # (11)

    return stresses


def _negative(x: Any, half: Any) -> Any:
    """Return the negative part of x, as its mean over values that lie evenly within ± `half` of it.

    At single places of a rule the forces would have a kink wherever (10) goes over from one limit to the
    other at one of them, and a fit of c, φ or μ_s would stop there.
    """
    half = ca.fmax(ca.fabs(half), _TINY)
    return ca.fmin(x + half, 0) - (half - ca.fmin(ca.fmax(x, -half), half)) ** 2 / (4 * half)


def outline(state: WheelState, angles: ContactAngles, soil: Soil, ϑ: Any) -> tuple[Any, Any]:
    """Return the depth of the wheel's outline [m], (7), and the sine of its slope, at angles ϑ [rad].

    A tyre that is pressed in is a row of radial springs: each place gives by its own pressure, (8), so that
    the deflection falls from the underside to the ends of the contact.
    """
    r = state.arc_radius
    depth, slope = state.sinkage + state.deflection - r * (1 - ca.cos(ϑ)), ca.sin(ϑ)
    if isinstance(state.deflection, float) and state.deflection == 0:
        return depth, slope
    δ, n, whole = ca.fmax(state.deflection, 0), soil.exponent, 1 - ca.cos(angles.front)
    share = ca.fmax((ca.cos(ϑ) - ca.cos(angles.front)) / whole, 1e-9)
    return depth - δ * share**n, slope * (1 - δ * n * share ** (n - 1) / (r * whole))


def wheel_forces(
    state: WheelState,
    angles: ContactAngles,
    soil: Soil,
    damping: Any,
    laws: ArcLaws = PAPER,
) -> WheelForces:
    """Integrate the stresses over the contact arc, (6)-(17).

    (13) carries the minus sign that its print lacks.

    Args:
        state: motion of the wheel.
        angles: ends of the arc [-ϑ_2, ϑ_1].
        soil: pressure-sinkage and shear parameters, Table 1.
        damping: c_t [N s/m].
        laws: along the arc; by default those of the paper.
    """
    r, b = state.arc_radius, state.width
    ϑ1, ϑ2 = angles.front, angles.rear
    changes = ca.diagcat(ca.DM(CHANGES), ca.DM(CHANGES))
    strength = arc_stresses(state, angles, soil, laws, lambda σ: ca.mtimes(changes, σ))

    def stresses(ϑ: Any) -> Any:
        """Return W, R, F and M/r per area at each ϑ."""
        cos_ϑ, (_, slope) = ca.cos(ϑ), outline(state, angles, soil, ϑ)
        σ, τ = strength(ϑ)
        return ca.horzcat(σ * cos_ϑ + τ * slope, -σ * slope, τ * cos_ϑ, τ)  # (12)-(15)

    total = b * r * _over(stresses, laws.corner, ϑ1, -ϑ2)
    W, R, F, S = (total[k] for k in range(4))
    M = -state.radius * S  # (15)
    touching = ca.if_else(state.sinkage > 0, 1, 0)
    normal = normal_force(state.sinkage, W, damping, state.sinkage_rate)
    return WheelForces(touching * W, touching * R, touching * F, touching * M, normal)


def normal_force(sinkage: Any, load: Any, damping: Any, rate: Any) -> Any:
    """Return F_Tz of (17) [N], never pulling, by sinkage [m], static load [N], c_t [N s/m] and rate [m/s]."""
    return ca.if_else(sinkage > 0, 1, 0) * ca.fmax(0, load + damping * rate)


def _over(f: Callable[[Any], Any], corner: Any, high: Any, low: Any) -> Any:
    """Return the integral from low to high of f, smooth on both sides of a corner.

    f takes a column of places and returns a row of values for each. Places and weights of both sides are
    written alike, so that one vector instruction serves both.
    """
    half, off = (high - low) / 2, (high + low) / 2 - corner  # the sides are half + off and half - off long
    places = corner + off * ca.DM([*NODES, *NODES]) + half * ca.DM([*NODES, *-NODES])
    return ca.mtimes((half * ca.DM([*WEIGHTS, *WEIGHTS]) + off * ca.DM([*WEIGHTS, *-WEIGHTS])).T, f(places))
