"""Rear contact angle set by the sinkage in place of the desired velocity."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from granite_lab.model.command import V_FLOOR, smoothstep
from granite_lab.model.contact import ContactAngles, WheelState
from granite_lab.model.effect import Effect, EffectParameter, Own

LEAST_COSINE = -0.99
"""Least cosine of the rear angle, as of the front one."""


class ExitBySinkage(Effect):
    """Sand rises again behind the wheel by a share of the sinkage, at any speed."""

    id = "exit_by_sinkage"
    law = True
    name = "exit angle by sinkage"
    title = "rear contact angle set by the sinkage"
    equation = "(4) with ϑ2 = (1 − share) k_92 ϑ1 + share · arccos(1 − κ z/r)"
    source = (
        "Ishigami, Miwa, Nagatani, Yoshida, J. Field Robotics 24, 2007, 233-250: κ, the sinkage behind the "
        "wheel over that in front, is below 1 where soil is compacted and above 1 where the wheel carries it "
        "to the rear; without recovery of the soil κ = 0"
    )
    signature = (
        "Slip and currents change little with speed: more slip at low and less at high speed than by the "
        "paper's k_92."
    )
    parameters = (
        EffectParameter("share", "", "0: the paper's k_92, 1: exit angle by sinkage", 0.0, 1.5, 0.0, 0.3, 1.0),
        EffectParameter("recovery", "", "κ, sinkage behind the wheel over sinkage in front",
                        0.005, 1.2, 0.1, 0.01, 1.0, shape=True),
    )  # fmt: skip

    def contact_angles(self, angles: ContactAngles, state: WheelState, own: Own) -> ContactAngles:
        """Move from the paper's rear angle to that of the sinkage; a robot at rest has no rear."""
        share = own.p["share"] * smoothstep(state.velocity / V_FLOOR)
        risen = own.p["recovery"] * (1 - ca.cos(angles.front))
        rear = ca.acos(ca.fmax(1 - risen, LEAST_COSINE))
        return replace(angles, rear=angles.rear + share * (rear - angles.rear))
