"""Play in the gears between motor and wheel."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from granite_lab.model.effect import Axle, Effect, EffectParameter, Shaft, Symbols
from granite_lab.model.symbols import ModelParameters

SEATING = 10.0
"""Torque at the wheel [N m] that deflects the teeth by `GIVE`."""

GIVE = 0.05
"""Deflection of loaded teeth as a share of half the play; the stiffness grows as the play shrinks."""

ROUND = 0.02
"""Share of half the play over which the corner of the dead zone is rounded."""

DAMPING = 0.2
"""Damping ratio of teeth that touch; steel on steel rebounds."""

RIGID = 2e-6
"""Half a play [rad] at which the teeth are half rigid; without play the model is the paper's."""


class GearBacklash(Effect):
    r"""Motor and wheel are two inertias; the teeth between them act only when the play is taken up.

    The lead u of the motor over the wheel is counted in half plays h:

    .. math:: J_w \dot\omega = T_t + M_\omega, \qquad
        J_m (\dot\omega + h \ddot u) = T - T_t, \qquad J_m + J_w = I_\omega

    with the torque of the teeth T_t, which is zero for \|u\| < 1. Rotor and encoder are on the motor's side.
    """

    id = "gear_backlash"
    title = "play in the gears"
    equation = "J_w dω/dt = T_t + M_ω, J_m (dω/dt + h d²u/dt²) = T − T_t, T_t = 0 within |u| < 1, h = play/2"
    source = (
        "Nordin and Gutman, Automatica 38, 2002, 1633-1649; range: makers state 0.15-1° for planetary "
        "gears; key, hub and coupling add as much"
    )
    signature = (
        "The encoders start while wheels and body wait (60 ms for 0.75° at 0.6 m/s²); a jerk follows. The "
        "same, with a current spike, when braking reverses the torque."
    )
    parameters = (
        EffectParameter("play", "deg", "total play between motor and wheel, at the wheel",
                        0.0, 20.0, 0.0, 0.2, 3.0, moving=True),
        EffectParameter("motor_share", "-", "share of the wheel's inertia that turns with the motor",
                        0.05, 0.95, 0.4, 0.1, 0.8, shape=True),
    )  # fmt: skip
    states = ("lead_f", "lead_rate_f", "lead_r", "lead_rate_r")

    def shaft(self, shaft: Shaft, axle: Axle, sym: Symbols) -> Shaft:
        """Let the motor lead the wheel."""
        half, name = _half(sym), axle.state.letter
        return Shaft(
            shaft.angle + half * sym.x[f"lead_{name}"], shaft.rate + half * sym.x[f"lead_rate_{name}"]
        )

    def rim_acceleration(self, acceleration: Any, axle: Axle, p: ModelParameters, sym: Symbols) -> Any:
        """Let the teeth turn the rim, whose inertia is without the motor's."""
        rim = (1 - sym.p["motor_share"]) * p.chassis.wheel_inertia
        return acceleration + _loose(sym) * ((_teeth(axle, p, sym) + axle.rim_load) / rim - acceleration)

    def rates(self, axles: tuple[Axle, Axle], p: ModelParameters, sym: Symbols) -> dict[str, Any]:
        """Return the rates of the leads."""
        rates: dict[str, Any] = {}
        for axle in axles:
            name = axle.state.letter
            plain = axle.rim_acceleration(p.chassis.wheel_inertia)
            motor = sym.p["motor_share"] * p.chassis.wheel_inertia
            ahead = (axle.drive_torque - _teeth(axle, p, sym)) / motor
            ahead -= self.rim_acceleration(plain, axle, p, sym)
            rates[f"lead_{name}"] = sym.x[f"lead_rate_{name}"]
            rates[f"lead_rate_{name}"] = ahead / _reach(sym)
        return rates


def _half(sym: Symbols) -> Any:
    return sym.p["play"] * np.pi / 360


def _loose(sym: Symbols) -> Any:
    """Return 1 with play, and 0 without; between them for very small play."""
    return _half(sym) ** 2 / (_half(sym) ** 2 + RIGID**2)


def _reach(sym: Symbols) -> Any:
    """Return half the play [rad], but never so little that the rates become infinite."""
    return _half(sym) + 50 * RIGID * (1 - _loose(sym))


def _teeth(axle: Axle, p: ModelParameters, sym: Symbols) -> Any:
    """Return the torque of the teeth: a spring beyond the dead zone, damped where they touch."""
    u, rate = (sym.x[f"{name}_{axle.state.letter}"] for name in ("lead", "lead_rate"))
    over, under = ca.sqrt((u - 1) ** 2 + ROUND**2), ca.sqrt((u + 1) ** 2 + ROUND**2)
    loose = _loose(sym)
    bite = u - loose * (under - over) / 2
    touch = 1 - loose * ((u + 1) / under - (u - 1) / over) / 2
    stiffness = SEATING / GIVE
    inertia = sym.p["motor_share"] * p.chassis.wheel_inertia * _reach(sym)
    # rigid teeth do not ring
    damping = 2 * (1 + loose * (DAMPING - 1)) * ca.sqrt(stiffness * inertia)
    return stiffness * bite + damping * touch * rate
