"""Lugs of the tread that modulate the pressure."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from granite_lab.model.contact import WheelState
from granite_lab.model.effect import Effect, EffectParameter, Own
from granite_lab.parameters import Soil


class TreadRipple(Effect):
    """Each lug that enters the soil raises the pressure, each gap lowers it.

    Cosine and sine parts replace amplitude and phase, which keeps the model linear near zero. The
    initial angles of front and rear wheels are unknown, hence four numbers for each trial.
    """

    id = "tread_ripple"
    title = "force ripple from the lugs of the tread"
    equation = "(8) with k (1 + c cos(N θ) + s sin(N θ)), N lugs on the circumference"
    source = (
        "Irani, Bauer, Warkentin, J. Terramechanics 48, 2011, 307-318; Shikanai et al., J. "
        "Terramechanics 37, 2000, 21-39 (sinusoidal drawbar pull)"
    )
    signature = (
        "Accelerations and pitch rate oscillate at N times the wheel rate, 8-28 Hz for 24 lugs at 0.2-0.7 "
        "m/s. The mean is zero."
    )
    parameters = tuple(
        EffectParameter(f"{part}_{axle}", "", f"{word} part of the relative pressure ripple, {axle} wheels",
                        -0.8, 0.8, 0.0, -0.3, 0.3, per_trial=True)
        for axle in ("front", "rear") for part, word in (("cos", "cosine"), ("sin", "sine"))
    )  # fmt: skip
    circles = (("cos_front", "sin_front"), ("cos_rear", "sin_rear"))

    def soil(self, soil: Soil, state: WheelState, own: Own) -> Soil:
        """Modulate both moduli with the angle of the wheel."""
        name = "front" if state.front else "rear"
        angle = own.model.wheels.lugs * state.angle
        factor = 1 + own.p[f"cos_{name}"] * ca.cos(angle) + own.p[f"sin_{name}"] * ca.sin(angle)
        return replace(
            soil,
            cohesive_modulus=soil.cohesive_modulus * factor,
            frictional_modulus=soil.frictional_modulus * factor,
        )
