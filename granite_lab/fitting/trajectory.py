r"""k_92 and the start time from the whole time history of a trial.

Table 3's k_92 is a constant of the trial, (5) lets it follow the desired velocity from 1 at rest.
On the steady part the two are the same; in the ramps they are not, and the time history shows
which it was. Both are fitted with their value at the steady desired velocity as the unknown, and
the one that fits better is kept.

Velocity, wheel speeds and currents are compared in bins. The errors are

.. math:: y_c(t) = f_c(t - t_0; k) + \sum_j z_j g_{cj}(t) + e_c(t), \quad z_j \sim N(0, 1)

with g_j the change of the simulation for one std of a nuisance (sand of `SAND_SCATTER`, gain and
offset of the current sensors, the encoders' clock); k, t_0 and all z are estimated together, so
that whatever a nuisance explains is not taken for k_92.

The errors e are correlated in time, those of a smoothed velocity over seconds. The estimate is
therefore an ordinary weighted one in which each bin of width Δ counts about Δ / 2T (T: correlation time),
and its covariance is that of a weighted estimate under the full correlated covariance
Σ(t, t') = σ(t) σ(t') exp(-|t - t'| / T) ("sandwich"). σ and T are the larger of what is stated for
the sensor and what the residuals show, so a channel that the model does not reproduce loses weight.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from granite_lab.estimate import Estimate
from granite_lab.fitting.bins import Bins
from granite_lab.fitting.fit import FitStatus, K92Law
from granite_lab.fitting.history import History
from granite_lab.fitting.slip import K92_BOUNDS, LEAST_K92
from granite_lab.logs.trial import Array
from granite_lab.model import Run
from granite_lab.model.effect import Active
from granite_lab.parameters import Robot, Soil, Variant

LAWS: tuple[K92Law, ...] = ("exponential", "constant")

_START_RANGE = 0.5  # how far the start may move from its first estimate [s]
_ITERATIONS = 12
_INTERPOLATION = 4e-4  # error of the start from linear interpolation between samples 10 ms apart [s]
_ROUGHLY = 0.03
"""Share of the cost that a step must promise to be worth it while laws are compared."""

_SMOOTH = 0.01
"""Share of the cost below which a promise may fail for the accuracy of the integration."""

_FINELY = 0.05
"""The same of the result, as a sum of squares: about a fifth of a std. The last step is still taken."""


@dataclass(frozen=True)
class TrajectoryFit:
    """Result of the trajectory fit.

    Attributes:
        k92: at the steady desired velocity.
        law: how k_92 gets there.
        t_start: start of the command [s, the log's time].
        status: of `k92`.
        misfit: channel to rms of its residuals over the stated std (1: as stated).
        correlation: channel to the correlation time that was used [s].
    """

    k92: Estimate
    law: K92Law
    t_start: Estimate
    status: FitStatus
    misfit: dict[str, float]
    correlation: dict[str, float]


@dataclass(frozen=True, eq=False)
class _Optimum:
    history: History
    x: Array
    cost: float
    converged: bool


def fit_trajectory(
    bins: Bins,
    variant: Variant,
    robot: Robot,
    soil: Soil,
    *,
    start: tuple[float, float],
    sand: Callable[[K92Law], dict[str, tuple[Run, Run]]],
    offsets: dict[str, float],
    clock_std: float,
    effects: Sequence[Active] = (),
) -> TrajectoryFit:
    """Fit k_92 and the start of the command to the binned time history.

    Args:
        bins: the measurement.
        variant, robot, soil, effects: of the simulation.
        start: k_92 and t_start [s] to begin with.
        sand: runs with each parameter of the sand at minus and plus one std, for a law.
        offsets: current channel to std of its remaining offset [A].
        clock_std: std of the offset between the clocks of IMU and encoders [s].

    Raises:
        EstimateError: the simulation fails.
    """

    def by(law: K92Law) -> _Optimum:
        history = History(bins, variant, robot, soil, law, effects)
        history.add_nuisances(start, sand(law), offsets, clock_std, robot.currents)
        x = np.concatenate([start, np.zeros(len(history.signatures))])
        low, high = _bounds(law, start[1])
        x[0] = np.clip(x[0], low[0] + 1e-3, high[0] - 1e-3)
        return _minimise(history, x, low, high, relative=_ROUGHLY)

    best = min((by(law) for law in LAWS), key=lambda optimum: optimum.cost)
    history = best.history
    low, high = _bounds(history.law, start[1])
    history.learn_noise(best.x)
    best = _minimise(history, best.x, low, high)
    history.learn_noise(best.x)

    std = np.sqrt(np.diag(history.covariance(best.x)))
    status: FitStatus = "ok" if best.converged else "not_converged"
    if not low[1] < best.x[1] < high[1]:
        status = "not_converged"
    elif best.x[0] <= low[0]:
        status = "at_lower_bound"
    elif best.x[0] >= high[0]:
        status = "at_upper_bound"
    return TrajectoryFit(
        k92=Estimate(float(best.x[0]), float(std[0])),
        law=history.law,
        t_start=Estimate(float(best.x[1]), float(np.hypot(std[1], _INTERPOLATION))),
        status=status,
        misfit=history.misfit,
        correlation=history.correlation,
    )


def _bounds(law: K92Law, t_start: float) -> tuple[Array, Array]:
    """Return the bounds of k_92 and t_start [s]."""
    least = K92_BOUNDS[0] if law == "constant" else LEAST_K92
    return np.array([least, t_start - _START_RANGE]), np.array([K92_BOUNDS[1], t_start + _START_RANGE])


def _minimise(history: History, x: Array, low: Array, high: Array, *, relative: float = 0.0) -> _Optimum:
    """Minimise the sum of squares by Gauss-Newton steps within bounds, shortened where they overshoot.

    Ends when the next step promises little; that step is taken, but not checked.
    """

    def moved(step: Array) -> Array:
        candidate = x + step
        candidate[:2] = np.clip(candidate[:2], low, high)
        return np.asarray(candidate)

    residuals = history.residuals(x)
    cost = float(residuals @ residuals)
    for _ in range(_ITERATIONS):
        slopes = history.jacobian(x)
        step = _least_squares(slopes, -residuals)
        held = ((x[:2] <= low) & (step[:2] < 0)) | ((x[:2] >= high) & (step[:2] > 0))
        if held.any():
            free = np.append(~held, np.ones(x.size - 2, dtype=bool))
            step = np.zeros(x.size)
            step[free] = _least_squares(slopes[:, free], -residuals)
        expected = residuals + slopes @ (moved(step) - x)
        promised = cost - float(expected @ expected)
        if promised < max(_FINELY, relative * cost):
            return _Optimum(history, moved(step), cost, True)
        for share in (1.0, 0.5, 0.25, 0.1):
            there = history.residuals(moved(share * step))
            if there @ there < cost:
                break
        else:
            # the cost itself is only as smooth as the integration is accurate
            return _Optimum(history, x, cost, promised < _SMOOTH * cost)
        x, residuals, cost = moved(share * step), there, float(there @ there)
    return _Optimum(history, x, cost, False)


def _least_squares(slopes: Array, target: Array) -> Array:
    return np.asarray(np.linalg.lstsq(slopes, target, rcond=None)[0], dtype=np.float64)
