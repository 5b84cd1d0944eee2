"""A tyre that deflects under its load."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from granite_lab.model.contact import WheelState
from granite_lab.model.effect import Axle, Effect, EffectParameter, Own
from granite_lab.model.symbols import ModelParameters

SETTLING = 5e-3
"""Time in which the deflection follows the load [s], the damping of the tyre over its stiffness."""


class RadialTyreCompliance(Effect):
    """A tyre in series with the soil, as a row of radial springs: its underside gives by δ = κ W.

    Each place of the contact gives by its own pressure. Where that is proportional to depth, the outline is
    a circle of larger radius, the substitute circle of soft-soil tyre models. The tyre rolls as a wheel of
    radius r − δ/3.
    """

    id = "radial_tyre_compliance"
    title = "tyre that deflects under its load"
    equation = "z(ϑ) = z_rigid(ϑ) − δ (z_rigid(ϑ)/z_rigid(0))^n, δ = W / k_r, rolling radius r − δ/3"
    source = (
        "Springs after Winkler; Schmid, Journal of Terramechanics 32, 1995, 3-26; Gillespie, "
        "Fundamentals of Vehicle Dynamics, 1992; the paper's k_r of 40 kN/m is 2.5e-5 m/N"
    )
    signature = (
        "The axles sit lower and the wheels sink less, also at standstill. Slip and currents fall at all "
        "speeds."
    )
    parameters = (
        EffectParameter("compliance", "m/N", "deflection of one tyre per load, 1/k_r",
                        0.0, 1e-4, 0.0, 4e-6, 5e-5),
    )  # fmt: skip
    states = ("load_f", "load_r")

    def wheel(self, state: WheelState, own: Own) -> WheelState:
        """Divide the descent of the axle between tyre and soil."""
        δ = own.p["compliance"] * own.x["load_f" if state.front else "load_r"]
        return replace(
            state,
            sinkage=state.sinkage - δ,
            radius=state.radius - δ / 3,
            deflection=state.deflection + δ,
        )

    def rates(self, axles: tuple[Axle, Axle], p: ModelParameters, own: Own) -> dict[str, Any]:
        """Let the deflecting load follow the vertical load of the soil."""
        return {
            f"load_{name}": (axle.forces.vertical - own.x[f"load_{name}"]) / SETTLING
            for name, axle in zip("fr", axles, strict=True)
        }
