"""The residuals of a time history, their slopes and their covariance; see `trajectory`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import block_diag

from granite_lab.fitting.bins import AXLES, CHANNELS, Bins, SimulatedBins
from granite_lab.fitting.fit import K92Law
from granite_lab.fitting.slip import K92_BOUNDS, simulate_k92
from granite_lab.logs.trial import Array
from granite_lab.model import Run
from granite_lab.model.effect import Active
from granite_lab.parameters import Currents, Robot, Soil, Variant

VELOCITY_CORRELATION = 2.0
"""Assumed correlation time of the smoothed velocity's error [s]: between two standstills the errors
of tilt and bias that make it up last for the better part of the motion."""

STEP_K92, STEP_TIME = 0.005, 0.002  # of the finite differences


class History:
    """Residuals of the trajectory fit; unknowns are k_92, t_start and one z per nuisance."""

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
        self.law: K92Law = law
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
            run = simulate_k92(*self._system, key, self.law, effects=self._effects)
            self._runs[key] = SimulatedBins(run)
        return self._runs[key]

    def _stack(self, of: SimulatedBins, t_start: float) -> Array:
        return np.concatenate([of(c, self.bins.edges, t_start)[self.masks[c]] for c in self.channels])

    def add_nuisances(
        self,
        at: tuple[float, float],
        sand: dict[str, tuple[Run, Run]],
        offsets: dict[str, float],
        clock_std: float,
        sensors: Currents,
    ) -> None:
        """Compute the signature of each nuisance at k_92 and t_start."""
        for minus, plus in sand.values():
            ends = [self._stack(SimulatedBins(run), at[1]) for run in (minus, plus)]
            self.signatures.append((ends[1] - ends[0]) / 2)
        simulated = self._stack(self._at(at[0]), at[1])
        if "velocity" in self.channels and clock_std > 0:
            own = self._only({c for c in self.channels if c != "velocity"})
            self.signatures.append(own * self._by_time(at[0], at[1]) * clock_std)
        for axle in AXLES:
            name = f"current_{axle}"
            if name in self.channels:
                own = self._only({name})
                self.signatures += [own * simulated * sensors.gain / np.sqrt(2), own * offsets[name]]

    def _only(self, channels: set[str]) -> Array:
        """Return 1 in the bins of these channels and 0 elsewhere."""
        return np.concatenate([np.full(self.sigma[c].size, float(c in channels)) for c in self.channels])

    def _by_time(self, k92: float, t_start: float) -> Array:
        of = self._at(k92)
        later, sooner = self._stack(of, t_start + STEP_TIME), self._stack(of, t_start - STEP_TIME)
        return np.asarray((later - sooner) / (2 * STEP_TIME))

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
        other = x[0] + (STEP_K92 if x[0] + STEP_K92 <= K92_BOUNDS[1] else -STEP_K92)
        here, there = self._at(x[0]), self._at(other)
        by_k92 = (self._stack(there, x[1]) - self._stack(here, x[1])) / (other - x[0])
        return np.column_stack([by_k92, self._by_time(x[0], x[1]), *self.signatures])

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
