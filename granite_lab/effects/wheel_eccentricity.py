"""Wheels that are not centred on their axles."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca

from granite_lab.model.command import V_FLOOR, smoothstep
from granite_lab.model.contact import ContactAngles, WheelForces, WheelState
from granite_lab.model.effect import Effect, Symbols, turning_parameters
from granite_lab.parameters import Soil


class WheelEccentricity(Effect):
    """The geometric centre of the wheel circles about the axle.

    Its place relative to the axle is (c sin θ − s cos θ, c cos θ + s sin θ) in x and z. The
    initial angles of front and rear wheels are unknown, hence four numbers for each trial.
    """

    id = "wheel_eccentricity"
    title = "eccentric wheels"
    equation = "wheel centre = axle + (c sin θ − s cos θ, c cos θ + s sin θ)"
    source = "kinematics; range: run-out of 0.2-1.5 mm for moulded tyres on pressed hubs"
    signature = (
        "Vertical motion, pitch and currents oscillate once per wheel turn (0.33-1.2 Hz at 0.2-0.7 m/s)."
    )
    parameters = turning_parameters("m", "run-out", 0.01, 0.0015)
    circles = (("cos_front", "sin_front"), ("cos_rear", "sin_rear"))

    def wheel(self, state: WheelState, sym: Symbols) -> WheelState:
        """Move the wheel as the soil meets it."""
        d_x, d_z = _offset(state, sym)
        return replace(
            state,
            sinkage=state.sinkage - d_z,
            sinkage_rate=state.sinkage_rate + state.rate * d_x,
            velocity=state.velocity + state.rate * d_z,
        )

    def wheel_forces(
        self, forces: WheelForces, state: WheelState, angles: ContactAngles, soil: Soil, sym: Symbols
    ) -> WheelForces:
        """Carry the forces from the wheel's centre to the axle.

        At standstill the moment fades, as the shear does: the friction of the gears would hold it.
        """
        d_x, d_z = _offset(state, sym)
        lever = d_z * forces.longitudinal - d_x * forces.normal
        moving = smoothstep(ca.fabs(state.circumferential_velocity) / V_FLOOR)
        return replace(forces, moment=forces.moment + moving * lever)


def _offset(state: WheelState, sym: Symbols) -> tuple[Any, Any]:
    """Return the place of the wheel's centre relative to the axle [m]."""
    name = "front" if state.front else "rear"
    c, s = sym.p[f"cos_{name}"], sym.p[f"sin_{name}"]
    cos, sin = ca.cos(state.angle), ca.sin(state.angle)
    return c * sin - s * cos, c * cos + s * sin
