"""A tyre that gives way under its load."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca

from granite_lab.model.contact import WheelState
from granite_lab.model.effect import Axle, Effect, EffectParameter, Own
from granite_lab.model.symbols import ModelParameters

SETTLING = 5e-3
"""Time in which the deflection follows the load [s], the damping of the tyre over its stiffness."""

SHALLOW = 1e-3
"""Depth below which the flattened arc keeps its curvature [m]: an unloaded tyre is round."""


class RadialTyreCompliance(Effect):
    r"""The arc of a deflected tyre is that of a larger circle through the same ends.

    With the deflection δ = κ W at the bottom, a depth z_0 of the soil below it and the ends of the
    contact where the undeflected circle meets the surface, the substitute circle has the radius

    .. math:: r^* = r + \delta (2 (r - z_0) - \delta) / (2 z_0),

    and the tyre rolls as a wheel of radius r − δ/3.
    """

    id = "radial_tyre_compliance"
    title = "tyre that deflects under its load"
    equation = "δ = W / k_r, rolling radius r − δ/3, arc of radius r + δ (2 (r − z0) − δ) / (2 z0)"
    source = (
        "substitute circle: Bekker, Introduction to Terrain-Vehicle Systems, University of Michigan Press "
        "1969; Harnisch et al., A new tyre-soil interaction model for vehicle simulation on deformable "
        "ground, Vehicle System Dynamics 43, 2005, 384-394; rolling radius: Gillespie, Fundamentals of "
        "Vehicle Dynamics, SAE 1992, and R sin ϑ/ϑ expanded; the paper lists k_r = 40 kN/m, 2.5e-5 m/N"
    )
    signature = (
        "a softer, flatter contact, at standstill, too: axles sit lower than the soil alone would have "
        "them, wheels sink less into the sand, currents fall; slip rises a little at 0.2 m/s and falls "
        "at 0.7 m/s"
    )
    parameters = (
        EffectParameter("compliance", "m/N", "deflection of one tyre per load, 1/k_r",
                        0.0, 1e-4, 0.0, 4e-6, 5e-5),
    )  # fmt: skip
    states = ("load_f", "load_r")

    def wheel(self, state: WheelState, own: Own) -> WheelState:
        """Share the way of the axle between tyre and soil, and flatten the arc."""
        δ = own.p["compliance"] * own.x["load_f" if state.front else "load_r"]
        r, z0 = state.radius, state.sinkage - δ
        widening = δ * (2 * (r - z0) - δ) / (2 * ca.fmax(z0, SHALLOW))
        return replace(state, sinkage=z0, radius=r - δ / 3, flattening=state.flattening + widening + δ / 3)

    def rates(self, axles: tuple[Axle, Axle], p: ModelParameters, own: Own) -> dict[str, Any]:
        """Let the deflecting load follow the vertical load of the soil."""
        return {
            f"load_{name}": (axle.forces.vertical - own.x[f"load_{name}"]) / SETTLING
            for name, axle in zip("fr", axles, strict=True)
        }
