"""Rear wheels in the rut that the front wheels have compacted."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca

from granite_lab.model.command import smoothstep
from granite_lab.model.contact import WheelState, stiffer
from granite_lab.model.effect import Effect, EffectParameter, Symbols
from granite_lab.parameters import Soil


class MultiPass(Effect):
    """From about one wheelbase of travel on, the rear wheels run where the front wheels have been.

    A wheel touches the soil ahead of its centre and behind it. The rear wheels therefore meet soil that the
    front wheels loaded while the robot stood up to one contact length before their centre comes there.
    """

    id = "multi_pass"
    name = "multi-pass compaction"
    title = "rear wheels in the compacted rut"
    equation = (
        "rear wheels, x > L − lead: k_c, k_φ times 1 + pressure · g, K divided by 1 + shear · g, "
        "g = 1 + slip_growth · |λ|; z_0 less by depth"
    )
    source = (
        "Holm, J. Terramechanics 6(3), 1969, 47-71 (depth of the rut, pass by pass); Wong, Theory of Ground "
        "Vehicles, 4th ed., 2008, ch. 2 (loaded again, soil yields little up to the load that it has borne); "
        "Senatore and Sandu, J. Terramechanics 48, 2011, 265-276 (growth with the slip of the first pass)"
    )
    signature = (
        "After one wheelbase of travel the pitch angle steps, and slip and currents fall. Firmer sand lifts "
        "the rear, a rut that stays deep lowers it. The step is fixed in distance, not in time."
    )
    parameters = (
        EffectParameter("pressure", "", "relative increase of k_c and k_φ in the rut",
                        -0.5, 5.0, 0.0, 0.05, 1.0),
        EffectParameter("shear", "", "relative increase of 1/K in the rut",
                        -0.5, 5.0, 0.0, 0.05, 1.0),
        EffectParameter("depth", "m", "how much deeper than the surface the ground of the rut is",
                        0.0, 0.05, 0.0, 0.0005, 0.01),
        EffectParameter("slip_growth", "", "relative growth of both per unit of slip",
                        0.0, 20.0, 1.0, 0.0, 6.0, shape=True),
        EffectParameter("lead", "m", "how far before one wheelbase the rear wheels enter the rut",
                        -0.05, 0.15, 0.0, 0.0, 0.08, shape=True, kinds=(0.0, 0.05)),
        EffectParameter("entry", "m", "length over which they enter it, about that of a contact patch",
                        0.002, 0.3, 0.06, 0.02, 0.12, shape=True),
    )  # fmt: skip

    def wheel(self, state: WheelState, sym: Symbols) -> WheelState:
        """Lower the ground under the rear wheels by the depth of the rut."""
        if state.front:
            return state
        share, depth = ca.fmin(1, ca.fmax(0, _entered(state, sym))), sym.p["depth"]
        slope = 6 * share * (1 - share) / sym.p["entry"]  # of `smoothstep`
        return replace(
            state,
            sinkage=state.sinkage - depth * smoothstep(share),
            sinkage_rate=state.sinkage_rate - depth * slope * state.velocity,
        )

    def soil(self, soil: Soil, state: WheelState, sym: Symbols) -> Soil:
        """Stiffen the soil under the rear wheels behind the place where the front wheels stood."""
        if state.front:
            return soil
        inside = smoothstep(_entered(state, sym))
        # the front wheels passed here with about the present slip of the rear wheels
        inside *= 1 + sym.p["slip_growth"] * ca.fabs(state.slip)
        sheared = replace(soil, shear_modulus=soil.shear_modulus / (1 + sym.p["shear"] * inside))
        return stiffer(sheared, 1 + sym.p["pressure"] * inside)


def _entered(state: WheelState, sym: Symbols) -> Any:
    """Return how far the rear wheels have come into the rut, as a share of their contact patch."""
    return (state.travel + sym.p["lead"] - sym.model.chassis.wheel_base) / sym.p["entry"] + 0.5
