"""A rear contact angle that follows the actual speed instead of the desired one."""

from __future__ import annotations

from typing import Any

import casadi as ca

from granite_lab.model.effect import Effect, EffectParameter, Own

ROUND = 1e-3
"""Speed below which |v| is rounded off [m/s]."""


class ContactAngleActualSpeed(Effect):
    """The sand cannot know which speed was commanded."""

    id = "contact_angle_actual_speed"
    title = "rear contact angle that follows the actual speed"
    equation = "(5) with v = v_d + weight · (|v_R| − v_d)"
    source = (
        "the paper's (4), (5) take the desired velocity for want of the actual one; near twin of "
        "contact_angle_lag, whose delay is that of the body behind the command"
    )
    signature = (
        "a faster start at high speed, as contact_angle_lag has it; in the steady part k_92 stays a "
        "little larger, by a_θ times the speed lost to slip, so slip and current fall a little, which a "
        "larger a_θ undoes"
    )
    parameters = (
        EffectParameter("weight", "", "0: desired velocity, 1: actual velocity",
                        -0.5, 1.5, 0.0, 0.3, 1.0),
    )  # fmt: skip

    def desired_velocity(self, v_desired: Any, v: Any, own: Own) -> Any:
        """Move from the desired to the actual velocity."""
        speed = ca.sqrt(v**2 + ROUND**2) - ROUND
        return v_desired + own.p["weight"] * (speed - v_desired)
