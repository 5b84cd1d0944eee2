"""Lugs of the tread that modulate the pressure."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from granite_lab.model.contact import WheelState
from granite_lab.model.effect import Effect, EffectParameter, Own
from granite_lab.parameters import Soil


class TreadRipple(Effect):
    """Each lug that enters the soil raises the pressure, each gap lowers it.

    Cosine and sine stand for amplitude and phase: so the model is linear in them near zero. Front
    and rear wheels start a trial at angles that nobody knows, hence four numbers, new in each trial.
    """

    id = "tread_ripple"
    title = "forces modulated by the lugs of the tread"
    equation = "(8) with k (1 + c cos(N θ) + s sin(N θ)), N lugs on the circumference"
    source = (
        "Irani, Bauer, Warkentin, A dynamic terramechanic model for small lightweight vehicles with rigid "
        "wheels and grousers operating in sandy soil, Journal of Terramechanics 48, 2011, 307-318; Shikanai "
        "et al., Journal of Terramechanics 37, 2000, 21-39: sinusoidal fluctuation of the drawbar pull"
    )
    signature = (
        "a ripple of vertical and longitudinal acceleration and of the pitch rate at N times the wheels' "
        "rate, 8-28 Hz for 24 lugs at 0.2-0.7 m/s; its frequency follows the speed and its mean is nil"
    )
    parameters = tuple(
        EffectParameter(f"{part}_{axle}", "", f"{word} of the relative ripple of pressure, {axle} wheels",
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
