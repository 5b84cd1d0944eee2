"""Friction of gear and bearings that the constant efficiency of (24) does not hold."""

from __future__ import annotations

from typing import Any

import casadi as ca

from granite_lab.model.contact import WheelState
from granite_lab.model.effect import Effect, EffectParameter, Own

TURNING = 0.1
"""Rate of a wheel at which Coulomb friction is fully there [rad/s]; 1 cm/s on the circumference."""


class DrivetrainFriction(Effect):
    """Coulomb and viscous friction of one drive unit, referred to the wheel."""

    id = "drivetrain_friction"
    title = "Coulomb and viscous friction in the drive units"
    equation = "T = η_d n_d k_m i − coulomb · tanh(ω / 0.1 rad/s) − viscous · ω"
    source = (
        "Armstrong-Hélouvry, Dupont, Canudas de Wit, A survey of models, analysis tools and compensation "
        "methods for the control of machines with friction, Automatica 30, 1994, 1083-1138; range: 2-20 % "
        "of the 5-10 N m that the paper's wheels need, as no-load currents of 0.1-0.8 A give"
    )
    signature = (
        "every current higher by the same amount while the wheels turn, a little more at higher speed; "
        "wheels and body move as before, because the controller makes up for it; shorter coasting"
    )
    parameters = (
        EffectParameter("coulomb", "N m", "dry friction at the wheel", -1.0, 20.0, 0.0, 0.1, 1.5),
        EffectParameter("viscous", "N m s/rad", "friction per rate of the wheel", -0.5, 5.0, 0.0, 0.01, 0.2),
    )

    def drive_torque(self, torque: Any, state: WheelState, own: Own) -> Any:
        """Subtract the friction from what reaches the rim."""
        return torque - own.p["coulomb"] * ca.tanh(state.rate / TURNING) - own.p["viscous"] * state.rate
