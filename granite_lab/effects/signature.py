"""What an effect changes: the run with it less the run without, over the variants of Table 2."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from granite_lab.model import simulate
from granite_lab.model.effect import Active, Effect, activate
from granite_lab.parameters import Robot, Soil, Variant, load_variants

Array = npt.NDArray[np.float64]

CHANNELS = ("imu_ax_mps2", "imu_az_mps2", "imu_gy_radps", "enc_f_rad", "enc_r_rad", "cur_f_A", "cur_r_A")
"""What the sensors read, in which a signature is stated; beside it come the velocity and the slip."""

SHOWN = (*CHANNELS, "v_mps", "slip_f", "slip_r", "sinkage_f_m", "sinkage_r_m")


@dataclass(frozen=True, eq=False)
class Signature:
    """One variant's signature.

    Attributes:
        t: (N,) time since the start of the command [s].
        difference: channel to (N,) run with the effect less run without it.
        plain: channel to (N,) run without it.
    """

    t: Array
    difference: dict[str, Array]
    plain: dict[str, Array]


def typical(effect: Effect) -> Active:
    """Switch an effect on at a value in the middle of what the literature leads to expect.

    A parameter that may have either sign stands halfway up its positive side, a shape at its start.
    """
    values = {}
    for p in effect.parameters:
        if p.shape:
            values[p.name] = p.neutral
        elif p.prior_low < p.neutral:
            values[p.name] = (p.neutral + p.prior_high) / 2
        else:
            values[p.name] = (p.prior_low + p.prior_high) / 2
    return activate(effect, values)


def signature(
    effect: Effect,
    robot: Robot,
    soil: Soil,
    *,
    values: Mapping[str, float] | None = None,
    variants: tuple[Variant, ...] | None = None,
) -> dict[float, Signature]:
    """Return what an effect changes, by the variant's desired velocity [m/s].

    Args:
        effect: the effect.
        robot, soil: with which it is simulated.
        values: its parameters, those of `typical` by default.
        variants: those of Table 2 by default.

    Raises:
        InputError: a parameter is unknown or out of bounds, or the robot has no chassis or drive.
        EstimateError: a simulation does not converge.
    """
    active = typical(effect) if values is None else activate(effect, values)
    found = {}
    for variant in variants or load_variants():
        plain = simulate(variant, robot, soil)
        run = simulate(variant, robot, soil, effects=(active,))
        found[variant.velocity] = Signature(
            plain.t,
            {name: run[name] - plain[name] for name in SHOWN},
            {name: plain[name] for name in SHOWN},
        )
    return found
