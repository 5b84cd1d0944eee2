"""Forces that follow no law: short pushes, to learn how the sensors would show any force."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from granite_lab.model.body import BodyLoad, BodyState, to_ground
from granite_lab.model.command import smoothstep
from granite_lab.model.contact import WheelState
from granite_lab.model.effect import Axle, Effect, EffectParameter, Symbols
from granite_lab.model.symbols import ModelParameters

PUSHES = {"force": "N", "lift": "N", "moment": "N m", "torque_f": "N m", "torque_r": "N m"}
"""Force along the robot, lift, moment on the body (nose down), torque against each front and rear wheel, with
their units. No other force can act on the planar robot and its wheels."""

SPACING = 0.15
"""Time between neighbouring pushes [s]; each lasts about twice as long, as transients of pitch do."""

PERIOD = 20 * SPACING
"""Time after which a push repeats in one run [s]; what it did has faded by then."""

WIDTH = 0.8 * SPACING
"""Std of a push in time [s]; with it the pushes add up to a constant within 1e-5."""

SHARPNESS = (PERIOD / (2 * np.pi * WIDTH)) ** 2


class LatentForce(Effect):
    """No physical effect: pushes of about a quarter of a second, several in each run."""

    id = "latent"
    title = "pushes of any force, moment or torque"
    equation = "Σ size · exp(κ (cos(2π (t − centre) / period) − 1))"
    source = "latent force models, Alvarez, Luengo, Lawrence, AISTATS 2009; shape of von Mises"
    signature = "whatever a force can do"
    parameters = (
        *(
            EffectParameter(name, unit, name.replace("_", " "), -1e3, 1e3, 0.0, -1.0, 1.0)
            for name, unit in PUSHES.items()
        ),
        EffectParameter("centre", "s", "time of the first push", 0.0, PERIOD, 0.0, 0.0, PERIOD, shape=True),
    )

    def body_load(
        self,
        load: BodyLoad,
        body: BodyState,
        axles: tuple[Axle, Axle],  # noqa: ARG002
        p: ModelParameters,  # noqa: ARG002
        sym: Symbols,
    ) -> BodyLoad:
        """Add the force, the lift and the moment."""
        push = _push(sym)
        x, z = to_ground(body.pitch, sym.p["force"] * push, sym.p["lift"] * push)
        return replace(load, x=load.x + x, z=load.z + z, moment=load.moment + sym.p["moment"] * push)

    def rim_load(self, load: Any, state: WheelState, sym: Symbols) -> Any:
        """Add the torque against the wheel."""
        return load - sym.p[f"torque_{state.letter}"] * _push(sym)


def _push(sym: Symbols) -> Any:
    """Return the pushes of unit size; there are none before the command."""
    turn = 2 * np.pi * (sym.t - sym.p["centre"]) / PERIOD
    return smoothstep(sym.t / SPACING) * ca.exp(SHARPNESS * (ca.cos(turn) - 1))
