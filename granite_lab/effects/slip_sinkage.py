"""Sinkage that grows with slip."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from granite_lab.model.command import magnitude, relaxed
from granite_lab.model.contact import WheelState
from granite_lab.model.effect import Axle, Effect, EffectParameter, Symbols
from granite_lab.model.symbols import ModelParameters
from granite_lab.parameters import Soil

ROUND = 0.01
"""Slip below which |λ| is rounded off, so that the model stays smooth."""


class SlipSinkage(Effect):
    """A slipping wheel moves soil backward from under itself; the exponent of (8) follows the slip.

    The sources have no memory: at the shortest length the sinkage follows within 10 ms, even at rest.
    """

    id = "slip_sinkage"
    law = True
    title = "sinkage that grows with slip"
    equation = "(8) with n = n0 + n1 |s|, ds/dt = (λ − s) |v_o| / length"
    source = (
        "Ding, Gao, Deng, Tao, J. Cent. South Univ. Technol. 17, 2010, 129-135 (n1 = 0.8-2 in their "
        "soil); Lyasko, J. Terramechanics 47, 2010, 21-31, for sand"
    )
    signature = (
        "Sinkage and currents grow with slip: little at 0.2 m/s, most at 0.7 m/s and during acceleration, "
        "not at standstill. Slip falls slightly."
    )
    parameters = (
        EffectParameter("growth", "", "n1, increase of the exponent n per unit of slip",
                        -0.5, 3.0, 0.0, 0.05, 0.8),
        EffectParameter("length", "m", "travel of the tread over which the sinkage follows the slip",
                        0.0002, 0.2, 0.03, 0.0002, 0.1, shape=True, kinds=(0.0002, 0.03)),
    )  # fmt: skip
    states = ("front", "rear")

    def soil(self, soil: Soil, state: WheelState, sym: Symbols) -> Soil:
        """Raise the exponent, which lowers the pressure at depths below 1 m."""
        slip = sym.x["front" if state.front else "rear"]
        return replace(soil, exponent=soil.exponent + sym.p["growth"] * magnitude(slip, ROUND))

    def rates(self, axles: tuple[Axle, Axle], p: ModelParameters, sym: Symbols) -> dict[str, Any]:
        """Let the mean slip follow with the travel; below V_FLOOR as with that speed."""
        states = {"front": axles[0].state, "rear": axles[1].state}
        return {
            name: relaxed(state.slip, sym.x[name], state.speed, sym.p["length"])
            for name, state in states.items()
        }
