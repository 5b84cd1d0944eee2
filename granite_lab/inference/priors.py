"""Priors of the numbers of files and of effects, and the steps of differences by the latter."""

from __future__ import annotations

import numpy as np

from granite_lab.inference.constants import LINEAR, NEGLIGIBLE, SAND_STD
from granite_lab.inference.pool import SAND
from granite_lab.model.effect import EffectParameter
from granite_lab.parameters import Robot, Soil

EFFECT_STEP = 0.05
"""Step of a difference by an effect's parameter, as a share of its prior range, where each simulation chooses
its integration steps. At 0.02 the errors of the integrator moved a number of little influence by 0.6 of its
std from one point to the next."""


def step_of(p: EffectParameter, value: float, share: float | None = None) -> float:
    """Return the step of the difference by an effect's parameter.

    Args:
        p: the parameter.
        value: at which it is differentiated.
        share: of its prior range; by default `EFFECT_STEP`.
    """
    h = (share or EFFECT_STEP) * (p.prior_high - p.prior_low)
    if p.moving:  # blows come at other times already with a little more of it
        h = float(np.clip(LINEAR * abs(value - p.neutral), NEGLIGIBLE * h, h))
    return h if value + h <= p.high else -h


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


RADIUS_STD = 0.005
"""Std of the mean wheel radius where the robot's file states none, as a share of it: a tape measure over a
driven distance gives the mean wheel diameter to 0.3 to 0.5 % (Borenstein and Feng, IEEE Transactions on
Robotics and Automation 12, 1996, 869-880)."""


def sand_std(soil: Soil) -> tuple[float, ...]:
    """Return the std of the logarithm of each number of `SAND`.

    It is the soil file's (``friction_angle_std_deg = 1.5``); by default that of the literature, `SAND_STD`.
    """
    stds = []
    for name, usual in zip(SAND, SAND_STD, strict=True):
        stated = float(getattr(soil, f"{name}_std", 0.0))
        stds.append(stated / float(getattr(soil, name)) if stated > 0 else usual)
    return tuple(stds)


def radius_std(robot: Robot) -> float:
    """Return the std of the wheel radius over the radius: the robot file's, else `RADIUS_STD`."""
    return robot.wheels.radius_std / robot.wheels.radius or RADIUS_STD
