"""Rival laws for k_92, fitted to the same points with the same kind of error.

The errors are normal with the point's own variance and a scatter of the law's own, by maximum likelihood. A
point at a bound of k_92 counts with the probability of lying beyond it. AICc compares what is left over.

k_92 is computed from λ_R, so a line over a trial's own λ_R fits by construction. Where a speed was repeated
the line is therefore given the mean λ_R of the *other* trials, whose errors are independent of its k_92.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize_scalar
from scipy.special import log_ndtr

from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate
from granite_lab.fitting.fit import K92Fit, Law, PointRow
from granite_lab.logs.trial import Array
from granite_lab.model.command import reference_velocity
from granite_lab.parameters import by_speed

LEAST_SCATTER = 1e-5
"""Of k_92; keeps the likelihood finite where a law passes through all points."""

Predict = Callable[[Array], tuple[Array, Array]]
"""Parameters (p,) of a law to k_92 (N,) and its derivatives (N, p)."""


@dataclass(frozen=True, eq=False)
class Points:
    """The points as columns (N,).

    Attributes:
        v: desired velocity of the steady part [m/s]; k_92 is a function of it, (5).
        k: k_92; the bound where the fit ended at one.
        sigma: std of k_92; 0 for all where none is stated.
        slip, slip_std: λ_R and its std; 0 where none is stated.
        censored: -1: the true root lies below `k`; 1: above; 0: `k` is the root.
    """

    v: Array
    k: Array
    sigma: Array
    slip: Array
    slip_std: Array
    censored: npt.NDArray[np.int64]

    @property
    def inner(self) -> npt.NDArray[np.bool_]:
        """(N,) which points are no bounds."""
        return np.asarray(self.censored == 0)

    def of(self, mask: npt.NDArray[np.bool_]) -> Points:
        """Return some of the points."""
        return Points(*(getattr(self, f.name)[mask] for f in fields(self)))

    def by_speed(self) -> dict[float, npt.NDArray[np.int64]]:
        """Return each speed [m/s], slowest first, and the positions of its points."""
        return {speed: np.array(positions) for speed, positions in by_speed(self.v).items()}

    def log_slope(self) -> float:
        """Return a_θ [s/m] by least squares on log k_92 through (0, 1); NaN where no inner k_92 is > 0."""
        use = self.inner & (self.k > 0)
        v = self.v[use]
        return float(-(v @ np.log(self.k[use])) / (v @ v)) if use.any() else math.nan

    def beyond(self, mean: Array, std: Array) -> Array:
        """Return the mean of a standard normal error that lies beyond a point's bound, without sign."""
        z = (self.k - mean) / std
        return np.exp(-0.5 * z**2 - log_ndtr(-self.censored * z)) / math.sqrt(2 * math.pi)

    def negative_log_likelihood(self, mean: Array, std: Array) -> float:
        """Return -log L for normal errors; a censored point counts as 'beyond its bound'."""
        z, side = (self.k - mean) / std, self.censored
        inner = 0.5 * z**2 + np.log(std) + 0.5 * math.log(2 * math.pi)
        return float(np.where(side == 0, inner, -log_ndtr(-side * z)).sum())

    def exponential(self, a: Array) -> tuple[Array, Array]:
        """Return k_92 by (27) and its derivative by a_θ."""
        m = np.exp(-a[0] * self.v)
        return m, (-self.v * m)[:, None]

    @property
    def start(self) -> Array:
        """(1,) a_θ with which fits of (27) begin [s/m]."""
        return np.array([np.nan_to_num(self.log_slope(), nan=5.0)])

    def a_theta(self, std_of: Callable[[Array], Array]) -> float:
        """Return a_θ [s/m] by least squares on k_92, weighted by the std of the points at k_92 by (27)."""
        return float(self.solve(self.exponential, self.start, lambda _, m: std_of(m))[0])

    def solve(self, predict: Predict, start: Array, std_of: Callable[[Array, Array], Array]) -> Array:
        """Return the parameters (p,) of a law by damped Gauss-Newton steps from `start`.

        In each step the weights are renewed, by the std of the points at given parameters and k_92, and
        censored points are replaced by their expectation (EM).
        """
        θ = start
        for _ in range(200):
            m, slopes = predict(θ)
            std = std_of(θ, m)
            k = np.where(self.inner, self.k, m + self.censored * std * self.beyond(m, std))
            step = np.linalg.lstsq(slopes / std[:, None], (k - m) / std, rcond=None)[0]
            θ = θ + np.clip(step, -1, 1)
            if np.abs(step).max() < 1e-10:
                break
        return θ


def row_of(fit: K92Fit) -> PointRow:
    """Return the point of a fit."""
    return fit.trial, reference_velocity(fit.variant), fit.k92, fit.slip_measured


def usable(row: PointRow) -> bool:
    """Whether a row has k_92 and velocity."""
    return math.isfinite(row[2].value) and math.isfinite(row[1]) and row[1] > 0


def gather(fits: Sequence[K92Fit]) -> tuple[list[K92Fit], Points, list[str]]:
    """Return the usable fits, the same as columns, and notes on the others.

    Raises:
        EstimateError: nothing usable.
    """
    notes = []
    kept = [fit for fit in fits if usable(row_of(fit))]
    if len(kept) < len(fits):
        notes.append(f"{len(fits) - len(kept)} of {len(fits)} trials have no k_92 and are left out.")
    if not kept:
        raise EstimateError(
            "no trial has a k_92, so there is no a_θ", "granite-lab fit-k92 --verbose shows why"
        )
    trials, v, k92, slip = zip(*map(row_of, kept), strict=True)
    sigma = np.array([k.std for k in k92])
    stated = np.isfinite(sigma) & (sigma > 0)
    if not stated.any():
        sigma = np.zeros(sigma.size)
    elif not stated.all():
        sigma = np.where(stated, sigma, np.median(sigma[stated]))
        notes.append(f"{int((~stated).sum())} values of k_92 have no std; they get the median of the others.")
    side = {"at_lower_bound": -1, "at_upper_bound": 1}
    points = Points(
        v=np.array(v),
        k=np.array([k.value for k in k92]),
        sigma=sigma,
        slip=np.array([s.value for s in slip]),
        slip_std=np.nan_to_num([s.std for s in slip]),
        censored=np.array([side.get(fit.status, 0) for fit in kept]),
    )
    bound = [name for name, inner in zip(trials, points.inner, strict=True) if not inner]
    if bound:
        notes.append(
            f"k_92 of {', '.join(bound)} ended at a bound. The weighted fit takes it as censored, the "
            "unweighted fits leave it out."
        )
    return kept, points, notes


def fit_laws(points: Points) -> tuple[tuple[Law, ...], list[str]]:
    """Fit the exponential law (27), the line over λ_R (28) and a constant per speed, best first.

    Returns:
        the laws, and notes on what could not be compared.
    """
    notes, groups = [], points.by_speed()
    columns = np.zeros((points.v.size, len(groups)))
    for column, group in enumerate(groups.values()):
        columns[group, column] = 1.0
    constants = {f"k_92 at {speed:.3g} m/s": "" for speed in groups}
    laws = [
        _fit(
            points, "exponential", {"a_theta": "s/m"}, points.exponential, points.start,
            lambda θ: f"k_92 = exp(-{θ[0]:.3f} v)",
        ),
        _fit(points, "free", constants, *_linear(points, columns), lambda _: "k_92 = a constant per speed"),
    ]  # fmt: skip
    if np.isfinite(points.slip).all() and np.ptp(points.slip) > 1e-3:
        laws.append(_over_slip(points))
        if any(group.size == 1 for group in groups.values()):
            notes.append(
                "Some speeds have one trial. Their k_92 was computed from the λ_R that the line uses, so the "
                "line over λ_R fits them exactly."
            )
    else:
        notes.append("The line over λ_R was not fitted: slip ratios are missing or equal.")
    aiccs = [law.aicc for law in laws if math.isfinite(law.aicc)]
    if few := len(laws) - len(aiccs):
        notes.append(f"{points.v.size} values of k_92 are too few for the AICc of {few} of the laws.")
    best = min(aiccs, default=math.nan)
    total = sum(math.exp(-(aicc - best) / 2) for aicc in aiccs) if len(aiccs) > 1 else math.nan
    weighted = [replace(law, weight=math.exp(-(law.aicc - best) / 2) / total) for law in laws]
    weighted.sort(key=lambda law: (math.isnan(law.aicc), law.rms if math.isnan(law.aicc) else law.aicc))
    return tuple(weighted), notes


def _over_slip(points: Points) -> Law:
    λ, λ_std = points.slip.copy(), np.zeros(points.v.size)
    for group in points.by_speed().values():
        for i in group if group.size > 1 else ():
            others = group[group != i]
            λ[i] = points.slip[others].mean()
            λ_std[i] = np.sqrt((points.slip_std[others] ** 2).sum()) / others.size
    design = np.column_stack([np.ones(λ.size), 100 * λ])
    return _fit(
        points, "linear_slip", {"b_0": "", "b_1": "1/%"}, *_linear(points, design),
        lambda θ: f"k_92 = {θ[0]:.4f} {'-' if θ[1] < 0 else '+'} {abs(θ[1]):.4f} λ_R (in %)", 100 * λ_std,
    )  # fmt: skip


def _linear(points: Points, design: Array) -> tuple[Predict, Array]:
    """Return a law that is linear in its parameters, and where its fit begins."""
    start = np.asarray(np.linalg.lstsq(design, points.k, rcond=None)[0], dtype=np.float64)
    return lambda θ: (design @ θ, design), start


def _fit(
    points: Points, id_: str, units: dict[str, str], predict: Predict, start: Array,
    formula: Callable[[Array], str], slope_std: Array | float = 0.0,
) -> Law:  # fmt: skip
    """Fit a law; `slope_std` is the (N,) std of the derivatives by its last parameter."""
    n, p = points.v.size, len(units)

    def std(θ: Array, variance: float) -> Array:
        return np.asarray(np.sqrt(points.sigma**2 + (θ[-1] * slope_std) ** 2 + variance))

    def solved(log_scatter: float) -> Array:
        return points.solve(predict, start, lambda θ, _: std(θ, math.exp(log_scatter) ** 2))

    def nll(log_scatter: float) -> float:
        θ = solved(log_scatter)
        return points.negative_log_likelihood(predict(θ)[0], std(θ, math.exp(log_scatter) ** 2))

    best = minimize_scalar(nll, bounds=(math.log(LEAST_SCATTER), 0.0), method="bounded")
    θ = solved(float(best.x))
    (m, slopes), inner = predict(θ), points.inner
    rms = float(np.sqrt(np.mean((points.k - m)[inner] ** 2))) if inner.any() else math.nan
    # maximum likelihood understates a scatter by the parameters it fitted
    dof, count = n - p, p + 1
    weighted = slopes / std(θ, math.exp(float(best.x)) ** 2 * (n / dof if dof else math.nan))[:, None]
    stds = np.sqrt(np.diag(np.linalg.inv(weighted.T @ weighted))) if dof else np.full(p, math.nan)
    more = 2 * count * (1 + (count + 1) / (n - count - 1)) if n > count + 1 else math.nan
    return Law(
        id=id_,
        formula=formula(θ),
        parameters=dict(zip(units, map(Estimate, θ.tolist(), stds.tolist()), strict=True)),
        units=units,
        n_parameters=p,
        rms=rms,
        aicc=2 * float(best.fun) + more,
        weight=math.nan,
    )
