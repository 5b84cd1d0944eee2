"""Rear contact angle set by the sinkage in place of the desired velocity."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from granite_lab.model.command import contact_angle_ratio, magnitude
from granite_lab.model.contact import ContactAngles, WheelState
from granite_lab.model.effect import Effect, EffectParameter, Symbols

REFERENCE = 0.4
"""Velocity at which (5) gives the rear angle [m/s]: the middle of Table 2."""

ROUND = 1e-3
"""Speed below which |v| is rounded off [m/s]."""


class ExitBySinkage(Effect):
    """Sand rises again behind the wheel by a share κ of the sinkage, at any speed.

    κ0 is no number of its own: where the desired velocity has no say, a_θ says how large the angle is. A
    robot at rest has equal angles, as below (4).
    """

    id = "exit_by_sinkage"
    law = True
    name = "exit angle by sinkage"
    title = "rear contact angle set by the sinkage"
    equation = (
        "(4) with ϑ2 = (1 − share) k_92 ϑ1 + share · arccos(1 − κ z/r), κ = κ0 + (1 − κ0) exp(−|v|/onset), "
        "√κ0 = k_92 at 0.4 m/s"
    )
    source = (
        "Ishigami, Miwa, Nagatani, Yoshida, J. Field Robotics 24, 2007, 233-250: κ, the sinkage behind the "
        "wheel over that in front, is below 1 where soil is compacted and above 1 where the wheel carries it "
        "to the rear"
    )
    signature = (
        "Slip and currents change little with speed: more slip at low and less at high speed than by the "
        "paper's k_92."
    )
    parameters = (
        EffectParameter("share", "", "0: the paper's k_92, 1: exit angle by sinkage",
                        0.0, 1.5, 0.0, 0.3, 1.0),
        EffectParameter("onset", "m/s", "speed over which κ falls from 1 at rest",
                        0.005, 0.2, 0.03, 0.01, 0.1, shape=True),
    )  # fmt: skip

    def contact_angles(self, angles: ContactAngles, state: WheelState, sym: Symbols) -> ContactAngles:
        """Move from the paper's rear angle to that of the sinkage."""
        rest = ca.exp(-magnitude(state.velocity, ROUND) / sym.p["onset"])
        κ0 = contact_angle_ratio(REFERENCE, sym.model) ** 2
        root = ca.sqrt(κ0 + (1 - κ0) * rest)
        rear = 2 * ca.asin(root * ca.sin(angles.front / 2))  # arccos(1 − κ z/r), exact also for small angles
        return replace(angles, rear=angles.rear + sym.p["share"] * (rear - angles.rear))
