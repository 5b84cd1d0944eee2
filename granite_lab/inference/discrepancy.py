r"""The discrepancy of the model: what every repetition of a command shares and no parameter explains.

After Kennedy and O'Hagan (J. R. Statist. Soc. B 63, 2001, 425-464) the measurement is

.. math:: y = h(θ) + δ(t) + ε

with a Gaussian process δ for each command and channel. Here δ is a sum of bumps of two widths whose
amplitudes are independent normal numbers, modulated by how large it may be at each time:

* in motion: a share s of the channel's rms, the same share for all channels;
* near rest, where the laws of the model are not defined: a share that is fixed and large;
* for each effect in the model: a share ρ of the effect's own trace, since its formula is not exact.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from granite_lab.inference.constants import NEAR_ZERO, REST_SHARE, REST_SPEED, SMOOTH, TINY, TOLERANCE
from granite_lab.inference.noise import stretches
from granite_lab.inference.nuisances import TrialModel
from granite_lab.inference.observation import Mask
from granite_lab.inference.pool import SIGNALS
from granite_lab.logs.trial import Array
from granite_lab.model.command import distances_at

MOTION, REST, FORMULA = 0, 1, 2
"""Kinds of columns of a basis."""


@dataclass(frozen=True, eq=False)
class Basis:
    """The discrepancy of one channel of one command.

    Attributes:
        columns: (n, m) values at the bins, for amplitudes of unit share [unit of the channel].
        kind: (m,) MOTION, REST or FORMULA.
    """

    columns: Array
    kind: npt.NDArray[np.int64]


def variances(kind: npt.NDArray[np.int64], share: float, formula: float) -> Array:
    """Return the (m,) variances of the amplitudes of columns of some kinds."""
    return np.asarray(np.array([share**2, REST_SHARE**2, formula**2])[kind])


@lru_cache
def bumps(n: int, width: float, spacing: float) -> Array:
    """Return (n, m) raised cosines that add up to one, a spacing apart.

    Args:
        n: number of bins.
        width: of a bin [s].
        spacing: between the centres of the bumps [s].
    """
    t = (np.arange(n) + 0.5) * width
    centres = np.arange(0.0, n * width + spacing, spacing)
    away = np.clip(np.abs(t[:, None] - centres) / spacing, 0, 1)
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * away))


@lru_cache
def smooth(n: int, width: float, times: tuple[float, ...] = SMOOTH) -> Array:
    """Return the (n, m) bumps of several widths; with unit variances their sum has about unit variance."""
    fine = [bumps(n, width, max(spacing, 2 * width)) for spacing in times]
    return np.asarray(np.hstack(fine) * np.sqrt(4 / 3 / len(fine)))  # cos^4 + sin^4 is 3/4 on average


def modulated(size: Array, kind: int, width: float) -> Basis:
    """Return the discrepancy of one kind of a channel.

    Args:
        size: (n,) how large it may be at each bin, for a share of one [unit of the channel].
        kind: MOTION, REST or FORMULA.
        width: of a bin [s].
    """
    times = (float(np.sqrt(np.prod(SMOOTH))),) if kind == FORMULA else SMOOTH
    columns = smooth(size.size, width, times) * size[:, None]
    power = np.sqrt((columns**2).sum(axis=0))
    columns = columns[:, power > NEAR_ZERO * max(float(power.max()), TINY)]
    return Basis(columns, np.full(columns.shape[1], kind))


def joined(parts: Sequence[Basis]) -> Basis:
    """Return several bases as one."""
    return Basis(np.hstack([p.columns for p in parts]), np.concatenate([p.kind for p in parts]))


def plain_bases(size: float, moving: Mask, resting: Mask, width: float) -> tuple[Basis, ...]:
    """Return per stretch of a command the discrepancy of a channel, that of effects' formulas left out.

    Args:
        size: rms of the channel in motion.
        moving, resting: (n,) where the robot moves, and where it is near rest.
        width: of a bin [s].
    """
    sizes = ((MOTION, np.where(moving, size, 0.0)), (REST, np.where(resting, size, 0.0)))
    return tuple(
        joined([modulated(values[part], kind, width) for kind, values in sizes])
        for part in stretches(moving.size, width)
    )


def scale_of(
    trial: TrialModel, response: Array, bins: Mapping[str, Array]
) -> tuple[dict[str, float], Mask, Mask]:
    """Return the rms of each channel in motion, and (n,) where the robot moves and where it is near rest.

    A wheel's angle follows the command; what the ground does to it is how far it lags behind, so that is
    what its rms is taken of.

    Args:
        trial: gives the command.
        response: (8, M) of it.
        bins: channel to (n,).
    """
    o, radius = trial.observation, trial.radius
    angles = [SIGNALS.index(name) for name in ("enc_f_rad", "enc_r_rad")]
    wheels = np.minimum(*(np.interp(o.t, trial.t, np.gradient(response[k], trial.t)) for k in angles))
    body = np.interp(o.t, trial.t, response[SIGNALS.index("v_mps")])
    if np.abs(body).max() < REST_SPEED:
        body = wheels * radius  # on a block: only the wheels can tell
    slowest = np.minimum(np.abs(wheels) * radius, np.abs(body))
    begun = o.t > -o.width
    resting, moving = begun & (slowest < REST_SPEED), begun & (slowest >= REST_SPEED)
    moving = moving if moving.any() else begun
    before = ~begun
    size: dict[str, float] = {}
    desired = distances_at(o.t + o.width / 2, o.variant) / radius
    for c, values in bins.items():
        if c.startswith("wheel"):
            signal = values - desired if c == "wheel" else values
        else:
            signal = values - (values[before].mean() if before.any() else 0.0)
        size[c] = float(np.sqrt(np.mean(signal[moving] ** 2)))
    if "wheel_split" in size and "wheel" in size:
        size["wheel_split"] = size["wheel"]
    return size, moving, resting


def least_size(repeated: Sequence[TrialModel], channel: str, moving: Mask) -> float:
    """Return the least that the discrepancy of a channel is a share of.

    It is the rms in motion as measured, vibration included. Wheels follow a command; theirs is such that the
    rounding of the encoders, which repetitions and wheels that roll alike share, is within the tolerance.

    Args:
        repeated: trials of a command.
        channel: its name.
        moving: (n,) where the robot moves.
    """
    if channel.startswith("wheel"):
        return max(t.observation.rounding(channel) for t in repeated) / TOLERANCE
    squares = []
    for t in (t for t in repeated if channel in t.channels):
        values = t.measured[t.channels.index(channel)]
        before = values[t.observation.t < 0]
        level = float(np.nanmean(before)) if np.isfinite(before).any() else 0.0
        squares.append((values[moving] - level) ** 2)
    every = np.concatenate(squares)
    return float(np.sqrt(np.nanmean(every))) if np.isfinite(every).any() else 0.0


def sizes_of(
    repeated: Sequence[TrialModel], response: Array, bins: Mapping[str, Array]
) -> tuple[dict[str, float], Mask, Mask]:
    """Return what `scale_of` does for the first of some trials of a command, none below `least_size`."""
    size, moving, resting = scale_of(repeated[0], response, bins)
    return {c: max(level, least_size(repeated, c, moving)) for c, level in size.items()}, moving, resting
