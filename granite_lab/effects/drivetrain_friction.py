"""Friction of gear and bearings that the constant efficiency of (24) does not hold."""

from __future__ import annotations

from typing import Any

import casadi as ca

from granite_lab.model.contact import WheelState
from granite_lab.model.effect import Axle, Effect, EffectParameter, Own
from granite_lab.model.symbols import ModelParameters


class DrivetrainFriction(Effect):
    """Coulomb and viscous friction of one drive unit, referred to the wheel."""

    id = "drivetrain_friction"
    title = "Coulomb and viscous friction in the drive units"
    equation = "T = η_d n_d k_m i − coulomb · z − viscous · ω, ż = (ω − |ω| z) / creep"
    source = (
        "Armstrong-Hélouvry, Dupont, Canudas de Wit, A survey of models, analysis tools and compensation "
        "methods for the control of machines with friction, Automatica 30, 1994, 1083-1138, with the model "
        "of Dahl, A solid friction model, Aerospace Corporation TOR-0158(3107-18)-1, 1968; range: 2-20 % "
        "of the 5-10 N m that the paper's wheels need, as no-load currents of 0.1-0.8 A give"
    )
    signature = (
        "every current higher by the same amount while the wheels turn, a little more at higher speed; "
        "wheels and body move as before, because the controller makes up for it; shorter coasting; "
        "after the stop the friction holds, and a current remains that was not there before the start"
    )
    parameters = (
        EffectParameter("coulomb", "N m", "dry friction at the wheel", -1.0, 20.0, 0.0, 0.1, 1.5),
        EffectParameter("viscous", "N m s/rad", "friction per rate of the wheel", -0.5, 5.0, 0.0, 0.01, 0.2),
        EffectParameter("creep", "rad", "turn of the wheel over which dry friction builds up",
                        5e-4, 0.02, 0.005, 0.001, 0.01, shape=True),
    )  # fmt: skip
    states = ("held_f", "held_r")

    def drive_torque(self, torque: Any, state: WheelState, own: Own) -> Any:
        """Subtract the friction from what reaches the rim."""
        held = own.x["held_f" if state.front else "held_r"]
        return torque - own.p["coulomb"] * held - own.p["viscous"] * state.rate

    def rates(self, axles: tuple[Axle, Axle], p: ModelParameters, own: Own) -> dict[str, Any]:
        """Let the share of the dry friction at work approach 1 in the sense of the turning."""
        rates: dict[str, Any] = {}
        for name, axle in zip("fr", axles, strict=True):
            ω, z = axle.state.rate, own.x[f"held_{name}"]
            rates[f"held_{name}"] = (ω - ca.fabs(ω) * z) / own.p["creep"]
        return rates
