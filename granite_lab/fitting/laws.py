"""Rival laws for k_92, fitted to the same points with the same kind of error.

Every law predicts k_92 of each point; the errors are normal with the point's own variance and a
scatter s of the law's own, by maximum likelihood. A point at a bound of k_92 counts with the
probability of lying beyond it. AICc compares what is left over.

k_92 is computed from λ_R, so a line over a trial's own λ_R fits by construction. Where a speed was
repeated the line is therefore given the mean λ_R of the *other* trials at that speed, whose errors
have nothing to do with the trial's k_92.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize_scalar
from scipy.special import log_ndtr

from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate
from granite_lab.fitting.fit import K92Fit, Law, PointRow
from granite_lab.logs.trial import Array
from granite_lab.model.command import peak_velocity


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

    def by_speed(self, mask: npt.NDArray[np.bool_] | None = None) -> list[npt.NDArray[np.int64]]:
        """Return the places of the chosen points of each speed, slowest first."""
        speed = np.round(self.v, 4)
        chosen = np.ones(speed.size, dtype=bool) if mask is None else mask
        return [np.flatnonzero(chosen & (speed == v)) for v in np.unique(speed[chosen])]

    def log_slope(self) -> float:
        """Return a_θ [s/m] by least squares on log k_92 through (0, 1); bounds and k_92 <= 0 left out.

        NaN where no point is left.
        """
        use = self.inner & (self.k > 0)
        v = self.v[use]
        return float(-(v @ np.log(self.k[use])) / (v @ v)) if use.any() else math.nan

    def beyond(self, mean: Array, std: Array) -> Array:
        """Return the mean of a standard normal error that lies beyond a point's bound, without sign."""
        z = (self.k - mean) / std
        return np.exp(-0.5 * z**2 - log_ndtr(-self.censored * z)) / math.sqrt(2 * math.pi)

    def expected(self, mean: Array, std: Array) -> Array:
        """Return k_92, and for a censored point what it is expected to be beyond its bound."""
        side = self.censored
        return np.where(side == 0, self.k, mean + side * std * self.beyond(mean, std))

    def negative_log_likelihood(self, mean: Array, std: Array) -> float:
        """Return -log L for normal errors; a censored point counts as 'beyond its bound'."""
        z, side = (self.k - mean) / std, self.censored
        known = 0.5 * z**2 + np.log(std) + 0.5 * math.log(2 * math.pi)
        return float(np.where(side == 0, known, -log_ndtr(-side * z)).sum())


def row_of(item: K92Fit | PointRow) -> PointRow:
    """Return the point of a fit; a row passes through."""
    if not isinstance(item, K92Fit):
        return item
    return item.trial, peak_velocity(item.variant), item.k92, item.slip_measured


def usable(row: PointRow) -> bool:
    """Whether a row has k_92 and velocity."""
    return math.isfinite(row[2].value) and math.isfinite(row[1]) and row[1] > 0


def gather(items: Sequence[K92Fit | PointRow]) -> tuple[Points, list[str]]:
    """Turn fits or rows into columns, with notes on what was left out or treated specially.

    Raises:
        EstimateError: nothing usable.
    """
    notes = []
    kept = [item for item in items if usable(row_of(item))]
    if len(kept) < len(items):
        notes.append(f"{len(items) - len(kept)} of {len(items)} trials have no k_92 and are left out.")
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
    status = [item.status if isinstance(item, K92Fit) else "ok" for item in kept]
    points = Points(
        v=np.array(v),
        k=np.array([k.value for k in k92]),
        sigma=sigma,
        slip=np.array([s.value for s in slip]),
        slip_std=np.nan_to_num([s.std for s in slip]),
        censored=np.array([{"at_lower_bound": -1, "at_upper_bound": 1}.get(s, 0) for s in status]),
    )
    bound = [name for name, inner in zip(trials, points.inner, strict=True) if not inner]
    if bound:
        notes.append(
            f"k_92 of {', '.join(bound)} ended at a bound. The weighted fit takes it as censored, the "
            "unweighted fits leave it out."
        )
    return points, notes


_LEAST_SCATTER = 1e-5  # of k_92; keeps the likelihood finite where a law passes through all points


@dataclass(frozen=True, eq=False)
class _Rival:
    """A law before it is fitted.

    Attributes:
        id, names, units: as in `Law`.
        start: parameters to begin with (P,).
        predict: parameters to k_92 of the points and its derivative (N, P).
        variance: parameters to the variance of each point (N,), without the scatter.
        formula: fitted parameters to text.
    """

    id: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    start: Array
    predict: Callable[[Array], tuple[Array, Array]]
    variance: Callable[[Array], Array]
    formula: Callable[[Array], str]


def fit_laws(points: Points) -> tuple[tuple[Law, ...], list[str]]:
    """Fit the exponential law (27), the line over λ_R (28) and a constant per speed, best first.

    Returns:
        the laws, and notes on what could not be compared.
    """
    notes = []
    rivals = [_exponential(points), _free(points)]
    if np.isfinite(points.slip).all() and np.ptp(points.slip) > 1e-3:
        rivals.append(_linear(points))
        if any(group.size == 1 for group in points.by_speed()):
            notes.append(
                "Some speeds have one trial. Their k_92 was computed from the λ_R that the line uses, so the "
                "line over λ_R fits them exactly."
            )
    else:
        notes.append("The line over λ_R was not fitted: slip ratios are missing or equal.")
    laws = [_fit(rival, points) for rival in rivals if len(rival.names) <= points.v.size]
    few = [law.id for law in laws if math.isnan(law.aicc)]
    if few:
        notes.append(f"{points.v.size} values of k_92 are too few for the AICc of {len(few)} of the laws.")
    known = [law.aicc for law in laws if math.isfinite(law.aicc)]
    best = min(known, default=math.nan)
    total = sum(math.exp(-(aicc - best) / 2) for aicc in known) if len(known) > 1 else math.nan
    weighted = [replace(law, weight=math.exp(-(law.aicc - best) / 2) / total) for law in laws]
    weighted.sort(key=lambda law: (math.isnan(law.aicc), law.rms if math.isnan(law.aicc) else law.aicc))
    return tuple(weighted), notes


def _exponential(points: Points) -> _Rival:
    def predict(θ: Array) -> tuple[Array, Array]:
        m = np.exp(-θ[0] * points.v)
        return m, (-points.v * m)[:, None]

    start = points.log_slope()
    return _Rival(
        id="exponential",
        names=("a_theta",),
        units=("s/m",),
        start=np.array([start if math.isfinite(start) else 5.0]),
        predict=predict,
        variance=lambda _: points.sigma**2,
        formula=lambda θ: f"k_92 = exp(-{θ[0]:.3f} v)",
    )


def _linear(points: Points) -> _Rival:
    λ, λ_std = points.slip.copy(), np.zeros(points.v.size)
    for group in points.by_speed():
        for i in group if group.size > 1 else ():
            others = group[group != i]
            λ[i] = points.slip[others].mean()
            λ_std[i] = np.sqrt((points.slip_std[others] ** 2).sum()) / others.size
    design = np.column_stack([np.ones(λ.size), 100 * λ])
    return _Rival(
        id="linear_slip",
        names=("b_0", "b_1"),
        units=("", "1/%"),
        start=np.asarray(np.linalg.lstsq(design, points.k, rcond=None)[0], dtype=np.float64),
        predict=lambda θ: (design @ θ, design),
        variance=lambda θ: points.sigma**2 + (θ[1] * 100 * λ_std) ** 2,
        formula=lambda θ: f"k_92 = {θ[0]:.4f} {'-' if θ[1] < 0 else '+'} {abs(θ[1]):.4f} λ_R (in %)",
    )


def _free(points: Points) -> _Rival:
    groups = points.by_speed()
    design = np.zeros((points.v.size, len(groups)))
    for column, group in enumerate(groups):
        design[group, column] = 1
    return _Rival(
        id="free",
        names=tuple(f"k_92 at {points.v[group[0]]:.3g} m/s" for group in groups),
        units=("",) * len(groups),
        start=np.array([points.k[group].mean() for group in groups]),
        predict=lambda θ: (design @ θ, design),
        variance=lambda _: points.sigma**2,
        formula=lambda _: "k_92 = a constant per speed",
    )


def _solve(rival: _Rival, points: Points, scatter: float) -> tuple[Array, Array]:
    """Return parameters and the std of the points for a given scatter, by Gauss-Newton steps.

    Censored points are replaced by their expectation in every step (EM).
    """
    θ = rival.start
    for _ in range(200):
        m, slopes = rival.predict(θ)
        std = np.sqrt(rival.variance(θ) + scatter**2)
        away = (points.expected(m, std) - m) / std
        step = np.linalg.lstsq(slopes / std[:, None], away, rcond=None)[0]
        θ = θ + step
        if np.abs(step).max() < 1e-10:
            break
    return θ, np.sqrt(rival.variance(θ) + scatter**2)


def _fit(rival: _Rival, points: Points) -> Law:
    n, p = points.v.size, len(rival.names)

    def nll(log_scatter: float) -> float:
        θ, std = _solve(rival, points, math.exp(log_scatter))
        return points.negative_log_likelihood(rival.predict(θ)[0], std)

    best = minimize_scalar(nll, bounds=(math.log(_LEAST_SCATTER), 0.0), method="bounded")
    scatter = math.exp(float(best.x))
    θ, _ = _solve(rival, points, scatter)
    m, slopes = rival.predict(θ)
    inner = points.inner
    rms = float(np.sqrt(np.mean((points.k - m)[inner] ** 2))) if inner.any() else math.nan
    # maximum likelihood understates a scatter by the parameters it fitted
    dof = n - p
    variance = rival.variance(θ) + scatter**2 * (n / dof if dof else math.nan)
    weighted = slopes / np.sqrt(variance)[:, None]
    spread = np.sqrt(np.diag(np.linalg.inv(weighted.T @ weighted))) if dof else np.full(p, math.nan)
    count = p + 1
    more = 2 * count * (1 + (count + 1) / (n - count - 1)) if n > count + 1 else math.nan
    return Law(
        id=rival.id,
        formula=rival.formula(θ),
        parameters={
            name: Estimate(float(value), float(s))
            for name, value, s in zip(rival.names, θ, spread, strict=True)
        },
        units=dict(zip(rival.names, rival.units, strict=True)),
        n_parameters=p,
        rms=rms,
        aicc=2 * float(best.fun) + more,
        weight=math.nan,
    )
