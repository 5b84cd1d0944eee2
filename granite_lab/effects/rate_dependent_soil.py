"""Soil that bears more when it is loaded faster."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from granite_lab.model.contact import WheelState
from granite_lab.model.effect import Effect, EffectParameter, Own
from granite_lab.parameters import Soil

REFERENCE = 0.1
"""Speed of penetration at which `stiffening` is stated [m/s]."""

ROUND = 0.05
"""Relative speed below which the power law is rounded off; with an exponent below 1 it is steep at 0."""


class RateDependentSoil(Effect):
    """The pressure of (8) rises with the speed at which the wheel's face drives into the soil."""

    id = "rate_dependent_soil"
    title = "pressure that rises with the speed of penetration"
    equation = "(8) with k (1 + stiffening · (v_p / 0.1 m/s)^exponent), v_p = |v| sin(ϑ1) / 2"
    source = (
        "Grahn, Prediction of sinkage and rolling resistance for off-the-road vehicles considering "
        "penetration velocity, Journal of Terramechanics 28, 1991, 339-347; Irani, Bauer, Warkentin, "
        "Dynamic wheel-soil model for lightweight mobile robots with smooth wheels, Journal of "
        "Intelligent and Robotic Systems 71, 2013 (dynamic pressure-sinkage in dry sand)"
    )
    signature = (
        "the faster, the shallower: the body rises by millimetres while it accelerates and falls when "
        "it brakes, the currents at 0.7 m/s drop against those at 0.2 m/s; slip grows a little, since a "
        "shorter arc shears less; nothing at standstill"
    )
    parameters = (
        EffectParameter("stiffening", "", "relative rise of the pressure at 0.1 m/s of penetration",
                        -0.5, 5.0, 0.0, 0.05, 1.0),
        EffectParameter("exponent", "", "power of the speed of penetration",
                        0.2, 2.0, 1.0, 0.3, 1.5, shape=True),
    )  # fmt: skip

    def soil(self, soil: Soil, state: WheelState, own: Own) -> Soil:
        """Multiply both moduli; v_p is the mean over the face of the wheel, from 0 at its bottom."""
        depth = ca.fmax(state.sinkage, 1e-9) / state.radius
        v_p = ca.fabs(state.velocity) * ca.sqrt(ca.fmax(depth * (2 - depth), 1e-9)) / 2
        m = own.p["exponent"]
        rise = ((v_p / REFERENCE) ** 2 + ROUND**2) ** (m / 2) - ROUND**m
        factor = 1 + own.p["stiffening"] * rise
        return replace(
            soil,
            cohesive_modulus=soil.cohesive_modulus * factor,
            frictional_modulus=soil.frictional_modulus * factor,
        )
