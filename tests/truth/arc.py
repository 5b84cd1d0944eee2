"""Forces on one wheel by (6)-(17) as the paper prints them, with adaptive quadrature over the arc."""

from __future__ import annotations

import math
from collections.abc import Callable

from scipy.integrate import quad

from granite_lab.parameters import Soil, Wheels


def forces(
    wheels: Wheels,
    soil: Soil,
    *,
    v_o: float,
    v: float,
    z: float,
    k92: float,
    harden: float = 0.0,
    radius: float | None = None,
) -> tuple[float, float, float, float]:
    """Return W, R, F [N] and M [N m] without damping.

    Args:
        wheels, soil: whose numbers are used.
        v_o, v: velocity of the circumference and of the wheel's centre [m/s].
        z: sinkage [m].
        k92: ratio of the contact angles.
        harden: by which the pressure grows with the logarithm of the arc's speed into the soil over 0.02 m/s.
        radius: of the arc in the soil, where it is not that of the wheel [m].
    """
    b, arc = wheels.width, radius or wheels.radius
    modulus = soil.cohesive_modulus / b + soil.frictional_modulus
    tan_phi = math.tan(math.radians(soil.friction_angle))
    fastest = max(abs(v_o), abs(v))
    slip, s = (v_o - v) / max(fastest, 0.02), min(1.0, fastest / 0.02)
    fade = s * s * (3 - 2 * s)
    front = math.acos(1 - z / arc)

    def stresses(a: float) -> tuple[float, float]:
        sigma = modulus * max(z - arc * (1 - math.cos(a)), 0.0) ** soil.exponent
        sigma *= 1 + harden * math.log1p(abs(v) * max(math.sin(a), 0.0) / 0.02)
        entered = math.sin(front) - math.sin(a)
        j = arc * (fade * ((front - a) - entered) + slip * entered)
        limit = min(soil.tyre_friction * sigma, soil.cohesion + sigma * tan_phi)
        return sigma, math.copysign(limit * (1 - math.exp(-abs(j) / soil.shear_modulus)), j)

    def integral(weight: Callable[[float, float, float], float]) -> float:
        whole = quad(lambda a: weight(a, *stresses(a)), -k92 * front, front, epsabs=1e-9, limit=400)
        return b * arc * float(whole[0])

    return (
        integral(lambda a, sigma, tau: sigma * math.cos(a) + tau * math.sin(a)),
        integral(lambda a, sigma, _: -sigma * math.sin(a)),
        integral(lambda a, _, tau: tau * math.cos(a)),
        -wheels.radius * integral(lambda _a, _sigma, tau: tau),
    )
