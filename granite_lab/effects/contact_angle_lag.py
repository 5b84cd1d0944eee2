"""Rear contact angle with a time lag."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca

from granite_lab.model.command import V_FLOOR
from granite_lab.model.contact import ContactAngles, WheelState
from granite_lab.model.effect import Axle, Effect, EffectParameter, Symbols
from granite_lab.model.symbols import ModelParameters

REFERENCE = 0.4
"""Speed at which `time` is stated [m/s]."""

FASTEST = 5e-3
"""Time constant that is added to the lag's state [s] and taken out again by a lead, so that the
filter (1 + s FASTEST) / (1 + s (T + FASTEST)) becomes 1 at T = 0 and stays finite on the way."""


class ContactAngleLag(Effect):
    """The rut behind the wheel needs a time, or a distance, to take its new shape."""

    id = "contact_angle_lag"
    name = "contact-angle lag"
    by_command = True
    follows = True
    title = "rear contact angle with a time lag"
    equation = "T dρ/dt + ρ = k_92, or another law of ϑ2/ϑ1; ϑ2 = ρ ϑ1; T = time · (0.4 m/s / |v|)^exponent"
    source = (
        "relaxation length of tyres: Pacejka, Tire and Vehicle Dynamics, 3rd ed., 2012, ch. 7; range: a "
        "contact patch of 0.04-0.1 m gives 0.05-0.25 s"
    )
    signature = (
        "During acceleration k_92 is still large: the start is faster, with less current. Braking shows "
        "the opposite. Constant speed is unchanged. contact_angle_actual_speed is very similar."
    )
    parameters = (
        EffectParameter("time", "s", "time constant at 0.4 m/s", 0.0, 3.0, 0.0, 0.03, 0.4),
        EffectParameter("exponent", "", "0: a time constant; 1: a length constant",
                        -0.5, 1.5, 0.5, 0.0, 1.0, shape=True),
    )  # fmt: skip
    states = ("ratio",)

    def contact_angles(self, angles: ContactAngles, state: WheelState, sym: Symbols) -> ContactAngles:
        """Move the rear angle to where it follows with its lag, whatever law sets it."""
        T = _lag(state, sym)
        behind = T / (T + FASTEST) * (sym.x["ratio"] * angles.front - angles.rear)
        return replace(angles, rear=angles.rear + behind)

    def rates(self, axles: tuple[Axle, Axle], p: ModelParameters, sym: Symbols) -> dict[str, Any]:
        """Let the lagged ratio follow with T + FASTEST, by the angles that already follow it."""
        angles = axles[0].angles
        return {"ratio": (angles.rear / angles.front - sym.x["ratio"]) / FASTEST}


def _lag(state: WheelState, sym: Symbols) -> Any:
    """Return T [s] at the speed of the moment; speeds below V_FLOOR count as that."""
    speed = ca.sqrt(state.velocity**2 + V_FLOOR**2)
    return sym.p["time"] * (REFERENCE / speed) ** sym.p["exponent"]
