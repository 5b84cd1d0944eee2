"""Rear contact angle set by the actual speed instead of the desired one."""

from __future__ import annotations

from typing import Any

from granite_lab.model.command import magnitude, relaxed
from granite_lab.model.effect import Axle, Effect, EffectParameter, Symbols
from granite_lab.model.symbols import ModelParameters

ROUND = 1e-3
"""Speed below which |v| is rounded off [m/s]."""


class ContactAngleActualSpeed(Effect):
    """The contact arc depends on the speed at which the wheel made its rut, not on the commanded one."""

    id = "contact_angle_actual_speed"
    name = "contact angle by speed"
    title = "rear contact angle set by the actual speed"
    equation = "(5) with v = v_d + weight · (u − v_d), du/dt = (|v_R| − u) |v_R| / length"
    source = (
        "the paper uses the desired velocity in place of the actual one; a rut takes its shape over a "
        "contact patch, the relaxation length of tyres: Pacejka, Tire and Vehicle Dynamics, 2012, ch. 7"
    )
    signature = (
        "The start is faster at high speed, as with contact_angle_lag. At constant speed slip and current "
        "are slightly lower; a larger a_θ cancels this."
    )
    parameters = (
        EffectParameter("weight", "", "0: desired velocity, 1: actual velocity",
                        -0.5, 1.5, 0.0, 0.3, 1.0),
        EffectParameter("length", "m", "travel over which the actual velocity is averaged",
                        0.0002, 0.2, 0.03, 0.0002, 0.1, shape=True, kinds=(0.0002, 0.03)),
    )  # fmt: skip
    states = ("speed",)

    def desired_velocity(self, v_desired: Any, v: Any, sym: Symbols) -> Any:
        """Move from the desired to the actual velocity."""
        return v_desired + sym.p["weight"] * (sym.x["speed"] - v_desired)

    def rates(self, axles: tuple[Axle, Axle], p: ModelParameters, sym: Symbols) -> dict[str, Any]:
        """Let the average follow with the travel; below V_FLOOR as with that speed."""
        v = axles[0].state.velocity
        return {"speed": relaxed(magnitude(v, ROUND), sym.x["speed"], v, sym.p["length"])}
