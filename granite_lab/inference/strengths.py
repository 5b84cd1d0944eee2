"""Numbers of effects as parameters of a fit: their priors, and the steps of differences by them."""

from __future__ import annotations

import numpy as np

from granite_lab.inference.constants import CLOSE, LINEAR
from granite_lab.model.effect import EffectParameter

EFFECT_STEP = 0.05
"""Step of a difference by an effect's parameter, as a share of its prior range. At 0.02 the errors of the
integrator moved a number of little influence by 0.6 of its std from one point to the next."""

MOVING_STEP = LINEAR
"""Step by a parameter whose trace moves in time, as a share of its value."""


def step_of(p: EffectParameter, value: float) -> float:
    """Return the step of the difference by an effect's parameter."""
    width = p.prior_high - p.prior_low
    h = EFFECT_STEP * width
    if p.moving:  # blows come at other times already with a little more of it
        h = float(np.clip(MOVING_STEP * abs(value - p.neutral), CLOSE * h, h))
    return h if value + h <= p.high else -h


def is_central(p: EffectParameter, value: float, step: float) -> bool:
    """Tell whether a difference by an effect's parameter is to be taken to both sides.

    Not so where the trace is proportional to it, where blows come at other times, and at a bound.
    """
    return not (p.linear or p.moving) and p.low <= value - step <= p.high


def trial_scale_name(id_: str) -> str:
    """Return the name of the scale of the numbers that an effect has in each trial."""
    return f"{id_} own"


def width_of(p: EffectParameter) -> float:
    """Return the std of the prior of an effect's parameter: the range that the literature leads to expect."""
    if p.shape:
        return (p.prior_high - p.prior_low) / 2
    return max(abs(p.prior_high - p.neutral), abs(p.prior_low - p.neutral))


def centre_of(p: EffectParameter) -> float:
    """Return the mean of the prior of an effect's parameter."""
    return (p.prior_high + p.prior_low) / 2 if p.shape else p.neutral
