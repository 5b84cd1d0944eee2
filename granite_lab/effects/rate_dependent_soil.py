"""Soil that bears more when it is loaded faster."""

from __future__ import annotations

from typing import Any

import casadi as ca

from granite_lab.model.contact import WheelState
from granite_lab.model.effect import Effect, EffectParameter, Symbols

REFERENCE = 0.1
"""Speed of penetration at which `stiffening` is stated [m/s]."""

ROUND = 0.05
"""Relative speed below which the power law is rounded off; with an exponent below 1 it is steep at 0."""


class RateDependentSoil(Effect):
    """The pressure of (9) rises with the speed at which that part of the wheel drives into the soil."""

    id = "rate_dependent_soil"
    law = True
    name = "rate-dependent soil"
    title = "soil pressure that rises with penetration speed"
    equation = "(9) with σ (1 + stiffening · (v_p / 0.1 m/s)^exponent), v_p = max(0, v sin ϑ)"
    source = (
        "Grahn, J. Terramechanics 28, 1991, 339-347; Irani, Bauer, Warkentin, Journal of "
        "Intelligent and Robotic Systems 71, 2013"
    )
    signature = (
        "Sinkage falls as speed rises: the body rises by millimetres, and the currents at 0.7 m/s fall "
        "relative to those at 0.2 m/s. Standstill is unchanged."
    )
    parameters = (
        EffectParameter("stiffening", "", "relative increase of pressure at 0.1 m/s",
                        -0.5, 5.0, 0.0, 0.05, 1.0),
        EffectParameter("exponent", "", "exponent of the penetration speed",
                        0.2, 2.0, 1.0, 0.3, 1.5, shape=True),
    )  # fmt: skip

    def pressure(self, pressure: Any, angle: Any, state: WheelState, sym: Symbols) -> Any:
        """Raise the pressure where the arc moves into the soil, ahead of the lowest point."""
        v_p = ca.fmax(state.velocity * ca.sin(angle), 0)
        m = sym.p["exponent"]
        rise = ((v_p / REFERENCE) ** 2 + ROUND**2) ** (m / 2) - ROUND**m
        return pressure * (1 + sym.p["stiffening"] * rise)
