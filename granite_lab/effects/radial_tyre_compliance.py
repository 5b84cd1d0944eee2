"""A tyre that deflects under its load."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca

from granite_lab.model.contact import ContactAngles, WheelForces, WheelState, normal_force
from granite_lab.model.effect import Axle, Effect, EffectParameter, Symbols
from granite_lab.model.symbols import ModelParameters
from granite_lab.parameters import Soil


class RadialTyreCompliance(Effect):
    """A tyre in series with the soil: the axle goes down by δ = κ L more than the tread.

    Spring and damper of the tyre carry what the soil does: its static load W, and its share d of the damping
    of the tire-ground system in (17), L + τ dL/dt = W + d c_t d(z_axle − κ L)/dt. The rest damps the axle.

    The tread lies between two limits. A stiff ring stays round and keeps its length: the soil meets the
    paper's wheel. A row of radial springs gives by the local pressure. Where that is proportional to depth,
    the outline is a circle of larger radius, the substitute circle of soft-soil tyre models. The radius on
    which the tyre rolls lies between that of a tread that keeps its length, r, and the loaded one, r − δ; on
    roads it is about r − δ/3. A torque that acts on a longer lever than this radius feeds the tyre's losses.
    """

    id = "radial_tyre_compliance"
    title = "tyre that deflects under its load"
    equation = (
        "z(ϑ) = z_ring(ϑ) − f δ (z_ring(ϑ)/z_ring(0))^n, ring at the axle + (1 − f) δ, δ = L / k_r, rolling "
        "radius r − e δ, M_ω at r − l e δ, L + τ dL/dt = W + d c_t dz_0/dt"
    )
    source = (
        "Ring: Pacejka, Tire and Vehicle Dynamics, 2012, chapter 9; Rhyne and Cron, Tire Science and "
        "Technology 34, 2006, 150-169 (non-pneumatic). Springs after Winkler: Schmid, Journal of "
        "Terramechanics 32, 1995, 3-26; Gillespie, Fundamentals of Vehicle Dynamics, 1992; the paper's k_r "
        "of 40 kN/m is 2.5e-5 m/N"
    )
    signature = (
        "The axles sit lower and the body bounces when it stops. With a tread that flattens the wheels sink "
        "less; slip and currents fall at all speeds."
    )
    parameters = (
        EffectParameter("compliance", "m/N", "deflection of one tyre per load, 1/k_r",
                        0.0, 1e-4, 0.0, 4e-6, 5e-5),
        EffectParameter("flattening", "", "f, 0: the tread stays round, 1: it gives as radial springs",
                        0.0, 1.0, 0.5, 0.0, 1.0, shape=True),
        EffectParameter("rolling", "", "e, loss of rolling radius over the deflection",
                        0.0, 1.0, 1 / 3, 0.0, 1.0, shape=True),
        EffectParameter("lever", "", "l, loss of the torque's lever over that of rolling radius, 1: no loss",
                        0.0, 1.0, 0.5, 0.0, 1.0, shape=True),
        EffectParameter("retardation", "s", "τ, damping of the tyre over its stiffness",
                        1e-3, 0.05, 5e-3, 2e-3, 2e-2, shape=True),
        EffectParameter("damped", "", "d, share of c_t that is the soil's, 0: all acts on the axle",
                        0.0, 1.0, 0.5, 0.0, 1.0, shape=True, kinds=(0.0, 1.0)),
    )  # fmt: skip
    states = ("load_f", "load_r")

    def wheel(self, state: WheelState, sym: Symbols) -> WheelState:
        """Divide the descent of the axle between tyre and soil."""
        δ = sym.p["compliance"] * sym.x[f"load_{state.letter}"]
        shorter = sym.p["rolling"] * δ
        return replace(
            state,
            sinkage=state.sinkage - δ,
            radius=state.radius - shorter,
            deflection=state.deflection + sym.p["flattening"] * δ,
            shortened=state.shortened + shorter,
        )

    def wheel_forces(
        self, forces: WheelForces, state: WheelState, angles: ContactAngles, soil: Soil, sym: Symbols
    ) -> WheelForces:
        """Let the soil's share of (17) damp the tread, which goes down by less than the axle; move (15)."""
        in_tyre = sym.p["damped"] * sym.p["compliance"] * self._load_rate(forces, state, sym)
        damping, rate = sym.model.chassis.contact_damping, state.sinkage_rate - in_tyre
        normal = normal_force(state.sinkage, forces.vertical, damping, rate)
        longer = (1 - sym.p["lever"]) * state.shortened / state.radius
        return replace(forces, normal=normal, moment=forces.moment * (1 + longer))

    def rates(self, axles: tuple[Axle, Axle], p: ModelParameters, sym: Symbols) -> dict[str, Any]:
        """Let the load that deflects the tyre follow that of the soil."""
        return {f"load_{axle.state.letter}": self._load_rate(axle.forces, axle.state, sym) for axle in axles}

    @staticmethod
    def _load_rate(forces: WheelForces, state: WheelState, sym: Symbols) -> Any:
        """Return dL/dt [N/s]."""
        damping = sym.p["damped"] * sym.model.chassis.contact_damping
        damped = forces.vertical + ca.if_else(state.sinkage > 0, damping, 0) * state.sinkage_rate
        time_constant = sym.p["compliance"] * damping + sym.p["retardation"]
        return (damped - sym.x[f"load_{state.letter}"]) / time_constant
