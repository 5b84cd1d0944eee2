r"""k_92 and the start time from the whole time history of a trial.

Table 3's k_92 is a constant of the trial, (5) lets it follow the desired velocity from 1 at rest.
On the steady part the two are the same; in the ramps they are not, and the time history shows
which it was. Both are fitted with their value at the steady desired velocity as the unknown, and
the one that fits better is kept.

Velocity, wheel speeds and currents are compared in bins. The errors are

.. math:: y_c(t) = f_c(t - t_0; k) + \sum_j z_j g_{cj}(t) + e_c(t), \quad z_j \sim N(0, 1)

with g_j the change of the simulation for one std of a nuisance (sand of `SAND_SCATTER`, gain and
offset of the current sensors); k, t_0 and all z are estimated together, so that whatever a
nuisance explains is not taken for k_92.

The errors e are correlated in time, those of a smoothed velocity over seconds. The estimate is
therefore an ordinary weighted one in which each bin of width Δ counts about Δ / 2T (T: correlation time),
and its covariance is that of a weighted estimate under the full correlated covariance
Σ(t, t') = σ(t) σ(t') exp(-|t - t'| / T) ("sandwich"). σ and T are the larger of what is stated for
the sensor and what the residuals show, so a channel that the model does not reproduce loses weight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import least_squares

from granite_lab.estimate import Estimate
from granite_lab.fitting.bins import AXLES, CHANNELS, Bins, SimulatedBins
from granite_lab.fitting.fit import FitStatus, K92Law
from granite_lab.fitting.slip import K92_BOUNDS, LEAST_K92, simulate_k92
from granite_lab.logs.trial import Array
from granite_lab.model import Run
from granite_lab.model.effect import Active
from granite_lab.parameters import Currents, Robot, Soil, Variant

VELOCITY_CORRELATION = 2.0
"""Assumed correlation time of the smoothed velocity's error [s]: between two standstills the errors
of tilt and bias that make it up last for the better part of the motion."""

_STEP_K92, _STEP_TIME = 0.005, 0.002
_START_RANGE = 0.5  # how far the start may move from its first estimate [s]


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
        cost: half the sum of squares under the stated noise, to compare laws.
    """

    k92: Estimate
    law: K92Law
    t_start: Estimate
    status: FitStatus
    misfit: dict[str, float]
    correlation: dict[str, float]
    cost: float


def fit_trajectory(
    bins: Bins,
    variant: Variant,
    robot: Robot,
    soil: Soil,
    *,
    start: tuple[float, float],
    sand: dict[str, tuple[Run, Run]],
    offsets: dict[str, float],
    law: K92Law,
    effects: Sequence[Active] = (),
) -> TrajectoryFit:
    """Fit k_92 and the start of the command to the binned time history.

    Args:
        bins: the measurement.
        variant, robot, soil, effects: of the simulation.
        start: k_92 and t_start [s] to begin with.
        sand: parameter of the sand to runs at minus and plus one std.
        offsets: current channel to std of its remaining offset [A].
        law: how k_92 gets to its value.

    Raises:
        EstimateError: the simulation fails.
    """
    problem = _Problem(bins, variant, robot, soil, law, effects)
    problem.add_nuisances(start, sand, offsets, robot.currents)
    x0 = np.concatenate([start, np.zeros(len(problem.signatures))])
    low, high = (K92_BOUNDS[0] if law == "constant" else LEAST_K92), K92_BOUNDS[1]
    x0[0] = np.clip(x0[0], low + 1e-3, high - 1e-3)  # at a bound no direction leads out
    free = np.full(x0.size - 2, np.inf)
    bounds = (
        np.concatenate([[low, start[1] - _START_RANGE], -free]),
        np.concatenate([[high, start[1] + _START_RANGE], free]),
    )
    costs = []
    for _ in range(2):  # the second time with the noise that the first found
        solution = least_squares(
            problem.residuals, x0, problem.jacobian, bounds, method="dogbox",
            x_scale=np.concatenate([[0.05, 0.02], np.ones(x0.size - 2)]), xtol=1e-6, ftol=1e-6, max_nfev=30,
        )  # fmt: skip
        x0 = solution.x
        costs.append(float(solution.cost))
        problem.learn_noise(x0)
    covariance = problem.covariance(x0)
    status: FitStatus = "ok" if solution.status > 0 else "not_converged"
    if solution.active_mask[1]:
        status = "not_converged"
    elif solution.active_mask[0]:
        status = "at_lower_bound" if solution.active_mask[0] < 0 else "at_upper_bound"
    std = np.sqrt(np.diag(covariance))
    return TrajectoryFit(
        Estimate(float(x0[0]), float(std[0])),
        law,
        Estimate(float(x0[1]), float(std[1])),
        status,
        problem.misfit,
        problem.correlation,
        costs[0],
    )


class _Problem:
    """Residuals of the fit; unknowns are k_92, t_start and one z per nuisance."""

    def __init__(
        self,
        bins: Bins,
        variant: Variant,
        robot: Robot,
        soil: Soil,
        law: K92Law,
        effects: Sequence[Active],
    ) -> None:
        self.bins = bins
        self._system = (variant, robot, soil)
        self._law: K92Law = law
        self._effects = effects
        self.masks = {c: np.isfinite(bins.values[c]) & np.isfinite(bins.std[c]) for c in CHANNELS}
        self.channels = [c for c in CHANNELS if self.masks[c].any()]
        self.sigma = {c: bins.std[c][self.masks[c]] for c in self.channels}
        self.correlation = {c: VELOCITY_CORRELATION if c == "velocity" else 0.0 for c in self.channels}
        self.misfit = dict.fromkeys(self.channels, np.nan)
        self.signatures: list[Array] = []
        self._runs: dict[float, SimulatedBins] = {}

    def _at(self, k92: float) -> SimulatedBins:
        key = float(k92)
        if key not in self._runs:
            run = simulate_k92(*self._system, key, self._law, effects=self._effects)
            self._runs[key] = SimulatedBins(run)
        return self._runs[key]

    def _stack(self, of: SimulatedBins, t_start: float) -> Array:
        return np.concatenate([of(c, self.bins.edges, t_start)[self.masks[c]] for c in self.channels])

    def add_nuisances(
        self,
        at: tuple[float, float],
        sand: dict[str, tuple[Run, Run]],
        offsets: dict[str, float],
        sensors: Currents,
    ) -> None:
        """Compute the signature of each nuisance at k_92 and t_start."""
        for minus, plus in sand.values():
            ends = [self._stack(SimulatedBins(run), at[1]) for run in (minus, plus)]
            self.signatures.append((ends[1] - ends[0]) / 2)
        simulated = self._stack(self._at(at[0]), at[1])
        for axle in AXLES:
            name = f"current_{axle}"
            if name in self.channels:
                own = np.concatenate([np.full(self.sigma[c].size, float(c == name)) for c in self.channels])
                self.signatures += [own * simulated * sensors.gain / np.sqrt(2), own * offsets[name]]

    def weights(self) -> Array:
        """Return 1 / (σ sqrt(m)) of every bin, m = coth(Δ/2T) the bins that count as one (about 2T/Δ)."""
        width = self.bins.width
        count = {c: 1 / np.tanh(width / (2 * max(T, 1e-6))) for c, T in self.correlation.items()}
        return np.concatenate([1 / (self.sigma[c] * np.sqrt(count[c])) for c in self.channels])

    def difference(self, x: Array) -> Array:
        """Return simulation with nuisances minus measurement, all channels in a row."""
        measured = np.concatenate([self.bins.values[c][self.masks[c]] for c in self.channels])
        simulated = self._stack(self._at(x[0]), x[1])
        return np.asarray(
            simulated + sum(z * g for z, g in zip(x[2:], self.signatures, strict=True)) - measured
        )

    def residuals(self, x: Array) -> Array:
        """Return the weighted differences, and z for the priors of the nuisances."""
        return np.concatenate([self.weights() * self.difference(x), x[2:]])

    def _slopes(self, x: Array) -> Array:
        """Return d difference / dx, one column per unknown."""
        other = x[0] + (_STEP_K92 if x[0] + _STEP_K92 <= K92_BOUNDS[1] else -_STEP_K92)
        here, there = self._at(x[0]), self._at(other)
        by_k92 = (self._stack(there, x[1]) - self._stack(here, x[1])) / (other - x[0])
        by_time = (self._stack(here, x[1] + _STEP_TIME) - self._stack(here, x[1] - _STEP_TIME)) / (
            2 * _STEP_TIME
        )
        return np.column_stack([by_k92, by_time, *self.signatures])

    def jacobian(self, x: Array) -> Array:
        """Return the derivative of `residuals`."""
        prior = np.eye(x.size)[2:]
        return np.vstack([self.weights()[:, None] * self._slopes(x), prior])

    def learn_noise(self, x: Array) -> None:
        """Enlarge σ and T of each channel to what its residuals show."""
        difference, begin = self.difference(x), 0
        for c in self.channels:
            size = self.sigma[c].size
            residual = difference[begin : begin + size]
            begin += size
            stated = self.bins.std[c][self.masks[c]]
            self.misfit[c] = float(np.sqrt(np.mean((residual / stated) ** 2)))
            self.sigma[c] = stated * max(1.0, self.misfit[c])
            assumed = VELOCITY_CORRELATION if c == "velocity" else 0.0
            self.correlation[c] = max(assumed, correlation_time(residual / stated, self.bins.width))

    def covariance(self, x: Array) -> Array:
        """Return the covariance of the estimate under the correlated errors of every channel."""
        slopes, weights = self._slopes(x), self.weights() ** 2
        prior = np.diag(np.concatenate([[0.0, 0.0], np.ones(x.size - 2)]))
        hessian = slopes.T @ (weights[:, None] * slopes) + prior
        blocks = []
        for c in self.channels:
            t = self.bins.edges[:-1][self.masks[c]]
            lag = np.abs(t[:, None] - t[None])
            T = max(self.correlation[c], 1e-6)
            blocks.append(np.outer(self.sigma[c], self.sigma[c]) * np.exp(-lag / T))
        weighted = weights[:, None] * slopes
        middle = weighted.T @ block_diag(*blocks) @ weighted + prior
        inverse = np.linalg.inv(hessian)
        return np.asarray(inverse @ middle @ inverse)


def correlation_time(residual: Array, width: float) -> float:
    """Return the correlation time T [s] of a residual sampled every `width` seconds.

    The autocorrelation is summed until it first turns negative; T is that of the exponential
    correlation exp(-t/T) with the same sum.
    """
    n = residual.size
    power = float(residual @ residual)
    if n < 4 or power == 0:
        return 0.0
    ρ = np.correlate(residual, residual, "full")[n : 2 * n - 1] / power
    negative = np.flatnonzero(ρ < 0)
    total = 1 + 2 * float(ρ[: negative[0] if negative.size else ρ.size].sum())
    return width / float(np.log((total + 1) / (total - 1))) if total > 1 else 0.0
