"""Rear contact angle set by the actual speed instead of the desired one."""

from __future__ import annotations

from typing import Any

import casadi as ca

from granite_lab.model.effect import Effect, EffectParameter, Own

ROUND = 1e-3
"""Speed below which |v| is rounded off [m/s]."""


class ContactAngleActualSpeed(Effect):
    """The contact arc depends on the actual speed, not on the commanded one."""

    id = "contact_angle_actual_speed"
    title = "rear contact angle set by the actual speed"
    equation = "(5) with v = v_d + weight · (|v_R| − v_d)"
    source = "the paper uses the desired velocity in place of the actual one"
    signature = (
        "The start is faster at high speed, as with contact_angle_lag. At constant speed slip and current "
        "are slightly lower; a larger a_θ cancels this."
    )
    parameters = (
        EffectParameter("weight", "", "0: desired velocity, 1: actual velocity",
                        -0.5, 1.5, 0.0, 0.3, 1.0),
    )  # fmt: skip

    def desired_velocity(self, v_desired: Any, v: Any, own: Own) -> Any:
        """Move from the desired to the actual velocity."""
        speed = ca.sqrt(v**2 + ROUND**2) - ROUND
        return v_desired + own.p["weight"] * (speed - v_desired)
