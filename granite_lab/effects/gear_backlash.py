"""Play in the gears between motor and wheel."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from granite_lab.model.effect import Axle, Effect, EffectParameter, Own, Shaft
from granite_lab.model.symbols import ModelParameters

SEATING = 0.15
"""Torque at the wheel that seats the teeth [N m]; it rounds the corners of the dead zone."""

CROSSING = 0.01
"""Time constant with which the motor crosses the play [s], its mechanical one; 5-10 ms for DC motors."""


class GearBacklash(Effect):
    r"""The motor leads the wheel by half the play when it pulls and trails it by half when it brakes.

    A massless gear passes the torque on and gives way by a spring that is soft around zero torque
    only. Rotor and encoder sit before the play, the wheel behind it:

    .. math:: \theta_m / n_d = \theta + \delta, \qquad
        \tau \dot\delta = \tfrac{play}{2} \tanh(T / T_0) - \delta
    """

    id = "gear_backlash"
    title = "play in the gears"
    equation = "θ_m/n_d = θ + δ, 10 ms · dδ/dt + δ = play/2 · tanh(T / 0.15 N m)"
    source = (
        "Nordin and Gutman, Controlling mechanical systems with backlash: a survey, Automatica 38, 2002, "
        "1633-1649 (dead zone between motor and load); makers state 0.15-0.5° for planetary gearheads of low "
        "play and about 1° for common ones; key, hub and coupling add as much"
    )
    signature = (
        "wheels and body start late by the time in which the motor, following the command, takes up "
        "half the play (some 60 ms for 0.75° at 0.6 m/s²) while the encoders already turn; then a jerk; "
        "again, with a spike of current, where the torque changes sign at the braking, and a rocking "
        "about rest"
    )
    parameters = (
        EffectParameter("play", "deg", "whole play between motor and wheel, at the wheel",
                        0.0, 20.0, 0.0, 0.2, 3.0),
    )  # fmt: skip
    states = ("part_f", "part_r")

    def shaft(self, shaft: Shaft, axle: Axle, own: Own) -> Shaft:
        """Let the motor lead the wheel."""
        half = own.p["play"] * np.pi / 360
        part = own.x["part_f" if axle.state.front else "part_r"]
        return Shaft(shaft.angle + half * part, shaft.rate + half * _part_rate(part, axle))

    def rates(self, axles: tuple[Axle, Axle], p: ModelParameters, own: Own) -> dict[str, Any]:
        """Return the rate of δ as a part of half the play."""
        return {
            f"part_{name}": _part_rate(own.x[f"part_{name}"], axle)
            for name, axle in zip("fr", axles, strict=True)
        }


def _part_rate(part: Any, axle: Axle) -> Any:
    return (ca.tanh(axle.drive_torque / SEATING) - part) / CROSSING
