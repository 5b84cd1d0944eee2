"""Where a fit stands, how the responses change there, and what came of it."""

from __future__ import annotations

from dataclasses import dataclass

from granite_lab.discovery.arrow import Block
from granite_lab.logs.trial import Array


@dataclass(frozen=True, eq=False)
class Point:
    """Where the numbers stand.

    Attributes:
        sand: (7,) logarithms common to all trials.
        effects: ids of the effects that are switched on.
        common: (e,) parameters of those effects that all trials share, in order.
        trials: per trial its numbers: those of `TrialModel`, then its own parameters of effects.
    """

    sand: Array
    effects: tuple[str, ...]
    common: Array
    trials: tuple[Array, ...]


@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives of the responses at one point.

    Attributes:
        response: per command the (7, M) response.
        sand: per command (7, 7, M), by the logarithms of the sand.
        common, own: per command (e, 7, M), by the effects' shared and per-trial parameters.
    """

    response: list[Array]
    sand: list[Array]
    common: list[Array]
    own: list[Array]


@dataclass(frozen=True, eq=False)
class Fit:
    """A converged fit.

    Attributes:
        point: where.
        residuals: per trial (C, n) measured minus predicted, NaN where nothing was measured.
        chi2: sum of squares of the whitened residuals and of the priors.
        blocks: whitened derivatives per trial.
        slopes: from which they were made.
        converged: the last step was small.
        white: per trial (m,) whitened residuals, zero where nothing was measured.
    """

    point: Point
    residuals: tuple[Array, ...]
    chi2: float
    blocks: list[Block]
    slopes: Slopes
    converged: bool
    white: tuple[Array, ...]
