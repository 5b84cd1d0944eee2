"""a_θ of the exponential law (27) over trials.

With stated uncertainties the weighted estimate solves

.. math:: \\sum_i w_i (k_i - m_i) \\, \\partial m_i/\\partial a = 0, \\quad m_i = e^{-a v_i}, \\quad
          w_i = 1 / (\\sigma_i^2 + \\tau^2 m_i^2)

where the relative scatter τ of k_92 from trial to trial follows from Paule and Mandel's condition
Σ w_i (k_i - m_i)^2 = n - 1 [1]. It works on k_92 itself, because the error of log k_92 is neither
normal nor of known size where k_92 is near zero. Without uncertainties it is the paper's estimate,
least squares on log k_92.

References:
    [1] R. C. Paule, J. Mandel: Consensus values and weighting factors. J. Res. Natl. Bur. Stand.
        87 (1982) 377-385.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq, least_squares
from scipy.stats import f as f_distribution
from scipy.stats import norm, t

from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate, Part
from granite_lab.fitting.fit import AThetaFit, K92Fit
from granite_lab.fitting.laws import fit_laws, log_slope
from granite_lab.fitting.likelihood import a_theta_interval, chosen
from granite_lab.fitting.points import (
    PointRow,
    Points,
    Source,
    beyond,
    expected,
    gather,
    groups,
    rows_of,
    usable_row,
)
from granite_lab.logs.trial import Array
from granite_lab.parameters import load_paper

if TYPE_CHECKING:
    from granite_lab.fitting.trajectory import Trajectories

LACK_OF_FIT = 0.05
"""Significance at which the speeds are taken to disagree with (27) by more than their trials do."""

WITHIN = "scatter of k_92 between trials"
"""Name of that component in a budget."""

_FAR = 50.0  # of a_θ [s/m]; k_92 at 0.2 m/s would be 5e-5
_LARGEST = 3.0  # relative scatter; beyond it k_92 says nothing about a_θ


@dataclass(frozen=True, eq=False)
class _Weighted:
    """A fit of a_θ.

    Attributes:
        a, std: a_θ [s/m].
        scatter: relative std of k_92 from trial to trial beyond the stated ones.
        dof: degrees of freedom of the interval.
        sensitivity: (n,) da_θ/dk_92 of the points [s/m].
        own, common: (n,) variance of each k_92 with the scatter between trials, and that which the trials at
            one speed share.
        parts: of the std, besides that of the points.
    """

    a: float
    std: float
    scatter: float
    dof: int
    sensitivity: Array = field(default_factory=lambda: np.zeros(0))
    own: Array = field(default_factory=lambda: np.zeros(0))
    common: Array = field(default_factory=lambda: np.zeros(0))
    parts: tuple[Part, ...] = ()


def fit_a_theta(
    items: Sequence[K92Fit | PointRow], *, by: Source = "slip", together: Trajectories | None = None
) -> AThetaFit:
    """Fit a_θ over trials, the paper's way and with uncertainty, beside rival laws.

    Args:
        items: fits of single trials, or rows (trial, velocity [m/s], k_92, λ_R); the velocity is
            the desired one of the steady part.
        by: of fits, use the k_92 by steady slip, as the paper, or that by the whole trajectory,
            which is sharper and leans on all of the model.
        together: by trajectory, what `fit_trajectories` found from all trials at once; a_θ is then its.

    Raises:
        EstimateError: no k_92 that says anything about a_θ.
    """
    points, notes = gather(items, by)
    if not points.inner.any():
        raise EstimateError(
            "every k_92 is at a bound, so there is no a_θ",
            "the model does not reach the measured slip ratios",
        )
    paper = log_slope(points)
    if by == "trajectory" and together is not None:
        a_theta = together.a_theta
        fit = _Weighted(a_theta.value, a_theta.std, together.scatter, len(together.own) - 1)
        more = [f"a_θ by the time histories of {len(together.own)} trials at once"]
    else:
        fit, more = _weighted(points) if points.known else _unweighted(points)
    quantile = float(t.ppf(0.975, fit.dof) if fit.dof else norm.ppf(0.975))
    linear = (fit.a - quantile * fit.std, fit.a + quantile * fit.std)
    ci95 = chosen(linear, _by_likelihood(items, points, fit, quantile) if by == "slip" else None)
    laws, remarks = fit_laws(points)
    published = load_paper().a_theta
    if ci95 != linear:
        more.append(
            f"the interval of a_θ is by the likelihood; by the covariance it is {linear[0]:.3f} to "
            f"{linear[1]:.3f} s/m"
        )
    left_out = points.inner & (points.k <= 0)
    if left_out.any():
        more.append(f"{int(left_out.sum())} k_92 <= 0 cannot enter the fit on log k_92")
    return AThetaFit(
        a_theta=Estimate(fit.a, fit.std),
        ci95=ci95,
        log_linear=paper,
        ordinary=_ordinary(points),
        scatter=fit.scatter,
        published=published,
        agrees=ci95[0] <= published <= ci95[1],
        points=tuple(rows_of(items, by)),
        laws=laws,
        notes=(*notes, *more, *remarks),
        parts=fit.parts,
        sensitivity=_of_all(rows_of(items, by), fit),
        linear95=linear,
    )


def _by_likelihood(
    items: Sequence[K92Fit | PointRow], points: Points, fit: _Weighted, quantile: float
) -> tuple[float, float] | None:
    """Return the interval of a_θ by the likelihood; None for rows, and where it cannot be had."""
    rows = zip(items, rows_of(items, "slip"), strict=True)
    fits = [item for item, row in rows if isinstance(item, K92Fit) and usable_row(row)]
    if len(fits) < points.v.size or not fit.own.size:
        return None
    return a_theta_interval(fits, points.v, fit.own, fit.common, (fit.a, fit.std), quantile)


def _of_all(rows: Sequence[PointRow], fit: _Weighted) -> tuple[float, ...]:
    """Return da_θ/dk_92 of all rows, those that were left out too; empty where it is not known."""
    if not fit.sensitivity.size:
        return ()
    found = iter(fit.sensitivity.tolist())
    return tuple(next(found) if usable_row(row) else 0.0 for row in rows)


def published_fit() -> AThetaFit:
    """Return the fit to Table 3, whose k_92 and λ_R come without uncertainties."""
    return fit_a_theta(
        [
            (f"Table 3, {row.velocity:g} m/s", row.velocity, Estimate(row.k92), Estimate(row.slip_measured))
            for row in load_paper().table3
        ]
    )


def _ordinary(points: Points) -> float:
    """Return a_θ by ordinary least squares on k_92, bounds left out."""
    v, k = points.v[points.inner], points.k[points.inner]
    start = log_slope(points)

    def residuals(a: Array) -> Array:
        return np.asarray(np.exp(-a[0] * v) - k)

    return float(least_squares(residuals, [start if math.isfinite(start) else 5.0], xtol=1e-12).x[0])


def _unweighted(points: Points) -> tuple[_Weighted, list[str]]:
    """Return the paper's estimate with the std that its own residuals give."""
    use = points.inner & (points.k > 0)
    if not use.any():
        raise EstimateError("no k_92 above zero, so there is no a_θ", "the law (27) is positive")
    v, y = points.v[use], np.log(points.k[use])
    a, dof = log_slope(points), int(use.sum()) - 1
    scatter = math.sqrt(float(((y + a * v) ** 2).sum()) / dof) if dof else math.nan
    note = "k_92 without stated uncertainties: the interval follows from the residuals alone"
    std = scatter / math.sqrt(v @ v)
    parts = (Part("residuals of ln k_92", "A", "normal", "1", scatter, std),)
    return _Weighted(a, std, scatter, dof, parts=parts), [note]


def _weighted(points: Points) -> tuple[_Weighted, list[str]]:
    """Return the random-effects estimate, over speeds instead of trials where (27) does not hold."""
    fit, notes = _paule_mandel(points), []
    p_value = _lack_of_fit(points, fit)
    if p_value < LACK_OF_FIT:
        means = _speed_means(points, fit)
        over_speeds = _paule_mandel(means)
        notes.append(
            f"the speeds deviate from (27) by more than their repetitions scatter (p = {p_value:.2g}): "
            f"the interval of a_θ is over {means.v.size} speeds, not {points.v.size} trials"
        )
        fit = _over_speeds(points, fit, means, over_speeds)
    if not fit.dof:
        notes.append("one trial only: the interval holds no scatter between trials")
    return fit, notes


def _over_speeds(points: Points, trials: _Weighted, means: Points, speeds: _Weighted) -> _Weighted:
    """Return the fit over speeds, with the sensitivity of each trial in the mean of its speed."""
    within = _within_scatter(points, trials)
    spread = within * np.exp(-trials.a * points.v)
    own, group = points.sigma**2 + spread**2, np.searchsorted(np.round(means.v, 4), np.round(points.v, 4))
    group = np.minimum(group, means.v.size - 1)  # of a speed at a bound only; its weight is 0

    inner = points.inner
    weight = np.where(inner, 1 / own, 0.0)
    share = weight / np.bincount(group, weight)[group]
    sensitivity, between = (
        share * speeds.sensitivity[group],
        np.sqrt(np.maximum(speeds.own - means.sigma**2, 0.0)),
    )
    by_trials = Part(WITHIN, "A", "normal", "1", within, float(np.linalg.norm(sensitivity * spread)))
    by_speeds = Part(
        "departure of the speeds from the law (27)", "A", "normal", "1", speeds.scatter,
        float(np.linalg.norm(speeds.sensitivity * between)),
    )  # fmt: skip
    return _Weighted(
        speeds.a,
        speeds.std,
        within,
        speeds.dof,
        sensitivity,
        own,
        between[group] ** 2,
        (by_trials, by_speeds),
    )


def _paule_mandel(points: Points) -> _Weighted:
    dof = int(points.inner.sum()) - 1

    def surplus(τ: float) -> float:
        a = _solve(points, τ)
        m, std = _model(points, a, τ)
        return float((((points.k - m) / std)[points.inner] ** 2).sum()) - dof

    τ = 0.0
    if dof and surplus(0.0) > 0:
        if surplus(_LARGEST) > 0:
            raise EstimateError(
                "the k_92 of the trials contradict each other and any law like (27)", "look at their fits"
            )
        τ = float(brentq(surplus, 0.0, _LARGEST, xtol=1e-6))
    a = _solve(points, τ)
    m, std = _model(points, a, τ)
    kept = _information(points, m, std)
    information = float((((points.v * m / std) ** 2) * kept).sum())
    sensitivity = -np.sqrt(kept) * points.v * m / std**2 / information
    scatter = Part(WITHIN, "A", "normal", "1", τ, float(np.linalg.norm(sensitivity * τ * m)))
    parts = (scatter,) if τ > 0 else ()
    return _Weighted(a, 1 / math.sqrt(information), τ, dof, sensitivity, std**2, np.zeros(m.size), parts)


def _model(points: Points, a: float, τ: float) -> tuple[Array, Array]:
    m = np.exp(-a * points.v)
    return m, np.sqrt(points.sigma**2 + (τ * m) ** 2)


def _solve(points: Points, τ: float) -> float:
    """Return the root in a of the estimating equation, searched for outwards from the paper's estimate."""

    def equation(a: float) -> float:
        m, std = _model(points, a, τ)
        return float((points.v * m * (m - expected(points, m, std)) / std**2).sum())

    start = log_slope(points)
    low = high = start if math.isfinite(start) else 5.0
    step = 0.25
    while equation(low) < 0 and low > -_FAR:  # a too large: k_92 lies above the law on the whole
        low, step = low - step, 2 * step
    step = 0.25
    while equation(high) > 0 and high < _FAR:
        high, step = high + step, 2 * step
    if equation(low) < 0 or equation(high) > 0:
        raise EstimateError("no finite a_θ fits the k_92 of the trials", "look at their fits")
    return float(brentq(equation, low, high, xtol=1e-8)) if high > low else low


def _information(points: Points, m: Array, std: Array) -> Array:
    """Return the share of its information that a point keeps when it is known only to lie beyond a bound."""
    z, side = (points.k - m) / std, points.censored
    tail = beyond(z, side)
    return np.where(side == 0, 1.0, np.clip(tail * (tail - side * z), 0.0, 1.0))


def _deviations(points: Points, fit: _Weighted) -> tuple[Array, Array]:
    """Return (k - m) / m and its std without scatter, of the points that are no bounds."""
    m = np.exp(-fit.a * points.v)
    return (points.k - m) / m, points.sigma / m


def _lack_of_fit(points: Points, fit: _Weighted) -> float:
    """Return the p value of the speeds' deviation from (27), against that within speeds; 1 if untestable."""
    inner = points.only(points.inner)
    by_speed = groups(inner)
    n, S = inner.v.size, len(by_speed)
    if S < 2 or n - S < 2:
        return 1.0
    deviation, sigma = _deviations(inner, fit)
    w = 1 / (sigma**2 + _within_scatter(points, fit) ** 2)
    between = within = 0.0
    for group in by_speed:
        mean = np.average(deviation[group], weights=w[group])
        between += w[group].sum() * mean**2
        within += float((w[group] * (deviation[group] - mean) ** 2).sum())
    within = max(within, float(n - S))  # the stated std are taken to be no exaggeration
    return float(f_distribution.sf((between / (S - 1)) / (within / (n - S)), S - 1, n - S))


def _within_scatter(points: Points, fit: _Weighted) -> float:
    """Return the relative scatter of k_92 within speeds beyond the stated std (method of moments)."""
    inner = points.only(points.inner)
    deviation, sigma = _deviations(inner, fit)
    excess, dof = 0.0, 0
    for group in groups(inner):
        d = deviation[group] - deviation[group].mean()
        excess += float((d**2).sum()) - (group.size - 1) * float((sigma[group] ** 2).mean())
        dof += group.size - 1
    return math.sqrt(max(0.0, excess / dof)) if dof else 0.0


def _speed_means(points: Points, fit: _Weighted) -> Points:
    """Return one point a speed: the weighted mean of its trials, bounds left out."""
    inner = points.only(points.inner)
    within = _within_scatter(points, fit)
    variance = inner.sigma**2 + (within * np.exp(-fit.a * inner.v)) ** 2
    rows = []
    for group in groups(inner):
        w = 1 / variance[group]
        rows.append((inner.v[group[0]], np.average(inner.k[group], weights=w), 1 / math.sqrt(w.sum())))
    v, k, sigma = (np.array(column) for column in zip(*rows, strict=True))
    nothing = np.full(v.size, math.nan)
    return Points(tuple(f"{x:g} m/s" for x in v), v, k, sigma, nothing, nothing, np.zeros(v.size, np.int64))
