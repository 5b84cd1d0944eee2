"""Wheels that are not centred on their axles, and not round."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca

from granite_lab.model.command import V_FLOOR, smoothstep
from granite_lab.model.contact import ContactAngles, WheelForces, WheelState
from granite_lab.model.effect import Effect, EffectParameter, Symbols, turning_parameters
from granite_lab.parameters import Soil

SMOOTH = 1e-6
"""Run-out [m] below which that of the second order, relative to it, has no direction."""


class WheelEccentricity(Effect):
    """The radius at the lowest point changes once a turn, and twice where the wheel is oval.

    It is less by h, with ρ cos ψ = c cos θ + s sin θ and ρ sin ψ = c sin θ − s cos θ. The initial angles of
    front and rear wheels are unknown, hence four numbers for each trial. The second order is fixed to the
    wheel: relative to the first one it is the same in all trials. The moment is what makes the work of the
    forces that of the motor.
    """

    id = "wheel_eccentricity"
    title = "eccentric wheels"
    equation = (
        "radius r − h, h = ρ (cos ψ + b cos 2ψ + a sin 2ψ); moment about the axle more by h F_x + (dh/dθ) F_z"
    )
    source = (
        "kinematics; range: run-out of 0.2-1.5 mm for moulded tyres on pressed hubs; first and second order "
        "are most common, higher ones rare (Isuzu, vehicle service manual, radial force variation)"
    )
    signature = (
        "Vertical motion, pitch and currents oscillate once per wheel turn (0.33-1.2 Hz at 0.2-0.7 m/s), and "
        "twice where the wheels are oval."
    )
    parameters = (
        *turning_parameters("m", "run-out", 0.01, 0.0015),
        *(
            EffectParameter(f"{part}_{axle}", "", f"{word} part of the second order over the first, {axle}",
                            -1.0, 1.0, 0.0, -0.5, 0.5, shape=True)
            for axle in ("front", "rear") for part, word in (("oval", "cosine"), ("oval_sin", "sine"))
        ),
    )  # fmt: skip
    circles = (("cos_front", "sin_front"), ("cos_rear", "sin_rear"))

    def wheel(self, state: WheelState, sym: Symbols) -> WheelState:
        """Shorten the radius as the soil meets it."""
        shorter, falling = _shortened(state, sym)
        return replace(
            state,
            sinkage=state.sinkage - shorter,
            sinkage_rate=state.sinkage_rate + state.rate * falling,
            velocity=state.velocity + state.rate * shorter,
        )

    def wheel_forces(
        self, forces: WheelForces, state: WheelState, angles: ContactAngles, soil: Soil, sym: Symbols
    ) -> WheelForces:
        """Add the moment of the forces about the axle.

        At standstill the moment fades, as the shear does: the friction of the gears would hold it.
        """
        shorter, falling = _shortened(state, sym)
        lever = shorter * forces.longitudinal - falling * forces.normal
        moving = smoothstep(ca.fabs(state.circumferential_velocity) / V_FLOOR)
        return replace(forces, moment=forces.moment + moving * lever)


def _shortened(state: WheelState, sym: Symbols) -> tuple[Any, Any]:
    """Return by how much the radius at the lowest point is less [m], and how that falls with the angle."""
    name = "front" if state.front else "rear"
    c, s, b, a = (sym.p[f"{part}_{name}"] for part in ("cos", "sin", "oval", "oval_sin"))
    cos, sin = ca.cos(state.angle), ca.sin(state.angle)
    ρ_cos, ρ_sin = c * cos + s * sin, c * sin - s * cos
    ρ = ca.sqrt(c**2 + s**2 + SMOOTH**2)
    cos_twice, sin_twice = (ρ_cos**2 - ρ_sin**2) / ρ, 2 * ρ_cos * ρ_sin / ρ
    return ρ_cos + b * cos_twice + a * sin_twice, ρ_sin + 2 * (b * sin_twice - a * cos_twice)
