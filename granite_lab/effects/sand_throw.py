"""Thrust lost to sand that a slipping wheel throws behind itself."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from granite_lab.model.command import V_FLOOR, smoothstep
from granite_lab.model.contact import ContactAngles, WheelForces, WheelState
from granite_lab.model.effect import Effect, EffectParameter, Symbols
from granite_lab.parameters import Soil

HALF = 0.15
"""Speed of slip at which half of `loss` is reached [m/s]."""


class SandThrow(Effect):
    """Sand in motion transfers less shear to the ground below; the torque is not reduced."""

    id = "sand_throw"
    title = "thrust lost to sand thrown behind the wheels"
    equation = "F = (14) · (1 − loss · s² / (s² + (0.15 m/s)²)), s = max(v_o − v, 0), M_ω as in (15)"
    source = "suggested in section 5 of the paper; the formula is empirical"
    signature = (
        "Slip and currents rise at 0.7 m/s and not at 0.2 m/s. The body is late at the start, where the "
        "slip speed is largest. Sinkage is unchanged."
    )
    parameters = (
        EffectParameter("loss", "", "share of the thrust lost in fast slip", 0.0, 0.9, 0.0, 0.02, 0.25),
    )

    def wheel_forces(
        self, forces: WheelForces, state: WheelState, angles: ContactAngles, soil: Soil, sym: Symbols
    ) -> WheelForces:
        """Reduce the traction force, but not the moment."""
        v_o = state.circumferential_velocity
        driving = smoothstep(v_o / V_FLOOR)  # a wheel that turns backward would be given power else
        s = driving * ca.fmax(v_o - state.velocity, 0) ** 2
        return replace(forces, thrust=forces.thrust * (1 - sym.p["loss"] * s / (s + HALF**2)))
