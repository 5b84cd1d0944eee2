"""Friction of gears and bearings beyond the constant efficiency of (24)."""

from __future__ import annotations

from typing import Any

import casadi as ca

from granite_lab.model.contact import WheelState
from granite_lab.model.effect import Axle, Effect, EffectParameter, Symbols
from granite_lab.model.symbols import ModelParameters


class DrivetrainFriction(Effect):
    """Coulomb and viscous friction of one drive unit, referred to the wheel."""

    id = "drivetrain_friction"
    title = "Coulomb and viscous friction in the drive units"
    equation = "T = η_d n_d k_m i − coulomb · z − viscous · ω, ż = (ω − |ω| z) / creep"
    source = (
        "Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30, 1994, 1083-1138; Dahl, Aerospace "
        "Corporation TOR-0158(3107-18)-1, 1968; range: no-load currents of 0.1-0.8 A"
    )
    signature = (
        "All currents are higher by nearly the same amount while the wheels turn, and a current remains "
        "after the stop. The motion is unchanged; only coasting is shorter."
    )
    parameters = (
        EffectParameter("coulomb", "N m", "dry friction at the wheel",
                        -1.0, 20.0, 0.0, 0.1, 1.5, linear=True),
        EffectParameter("viscous", "N m s/rad", "viscous friction per wheel rate",
                        -0.5, 5.0, 0.0, 0.01, 0.2, linear=True),
        EffectParameter("creep", "rad", "wheel rotation over which dry friction builds up",
                        5e-4, 0.02, 0.005, 0.001, 0.01, shape=True),
    )  # fmt: skip
    states = ("held_f", "held_r")

    def drive_torque(self, torque: Any, state: WheelState, sym: Symbols) -> Any:
        """Subtract the friction from what reaches the rim."""
        held = sym.x[f"held_{state.letter}"]
        return torque - sym.p["coulomb"] * held - sym.p["viscous"] * state.rate

    def rates(self, axles: tuple[Axle, Axle], p: ModelParameters, sym: Symbols) -> dict[str, Any]:
        """Let the share of the dry friction at work approach 1 in the sense of the turning."""
        rates: dict[str, Any] = {}
        for name, axle in zip("fr", axles, strict=True):
            ω, z = axle.state.rate, sym.x[f"held_{name}"]
            rates[f"held_{name}"] = (ω - ca.fabs(ω) * z) / sym.p["creep"]
        return rates
