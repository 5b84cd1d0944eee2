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
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq, least_squares
from scipy.stats import f as f_distribution
from scipy.stats import norm, t

from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate, Part
from granite_lab.fitting.fit import AThetaFit, K92Fit, PointRow
from granite_lab.fitting.laws import Points, fit_laws, gather, row_of, usable
from granite_lab.fitting.likelihood import a_theta_interval
from granite_lab.logs.trial import Array
from granite_lab.parameters import load_paper

LACK_OF_FIT = 0.05
"""Significance at which the speeds are taken to disagree with (27) by more than their trials do."""

_FAR = 50.0  # of a_θ [s/m]; k_92 at 0.2 m/s would be 5e-5
_LARGEST = 3.0  # relative scatter; beyond it k_92 says nothing about a_θ


@dataclass(frozen=True, eq=False)
class _Weighted:
    """A fit of a_θ to n points.

    Attributes:
        a, std: a_θ [s/m].
        scatter: relative std of k_92 from trial to trial beyond the stated ones.
        dof: degrees of freedom of the interval.
        parts: of the std, besides that of the points.
        sensitivity: (n,) da_θ/dk_92 [s/m]; empty where the points have no std, as the next two.
        own: (n,) variance of each k_92 with the scatter between trials.
        common: (n,) variance that the trials at one speed share.
    """

    a: float
    std: float
    scatter: float
    dof: int
    parts: tuple[Part, ...]
    sensitivity: Array
    own: Array
    common: Array


def fit_a_theta(items: Sequence[K92Fit | PointRow]) -> AThetaFit:
    """Fit a_θ over trials, the paper's way and with uncertainty, beside rival laws.

    Args:
        items: fits of single trials, of which the k_92 by the steady slip is taken, or rows (trial,
            velocity [m/s], k_92, λ_R); the velocity is the desired one of the steady part.

    Raises:
        EstimateError: no k_92 that says anything about a_θ.
    """
    points, notes = gather(items)
    inner = points.inner
    if not inner.any():
        raise EstimateError(
            "every k_92 is at a bound, so there is no a_θ",
            "the model does not reach the measured slip ratios",
        )
    fit, more = _weighted(points) if (points.sigma > 0).all() else _unweighted(points)
    notes += more
    quantile = float(t.ppf(0.975, fit.dof) if fit.dof else norm.ppf(0.975))
    a_theta = Estimate(fit.a, fit.std)
    ci95 = linear = a_theta.interval(quantile)
    rows = [row_of(item) for item in items]
    fits = [i for i, row in zip(items, rows, strict=True) if isinstance(i, K92Fit) and usable(row)]
    if len(fits) == points.v.size and fit.own.size:
        ci95 = a_theta_interval(fits, points.v, fit.own, fit.common, a_theta, quantile)
    if ci95 != linear:
        notes.append(
            f"The interval of a_θ follows from the likelihood; from the covariance it is {linear[0]:.3f} to "
            f"{linear[1]:.3f} s/m."
        )
    left_out = inner & (points.k <= 0)
    if left_out.any():
        notes.append(f"{int(left_out.sum())} values of k_92 <= 0 cannot enter the fit of log k_92.")
    laws, remarks = fit_laws(points)
    published = load_paper().a_theta
    found = iter(fit.sensitivity.tolist())
    return AThetaFit(
        a_theta=a_theta,
        ci95=ci95,
        log_linear=points.log_slope(),
        ordinary=_ordinary(points),
        scatter=fit.scatter,
        published=published,
        agrees=ci95[0] <= published <= ci95[1],
        points=tuple(rows),
        laws=laws,
        notes=(*notes, *remarks),
        parts=fit.parts,
        sensitivity=tuple(next(found) if usable(row) else 0.0 for row in rows) if fit.own.size else (),
        virtual=any(isinstance(item, K92Fit) and item.virtual for item in items),
    )


def published_fit() -> AThetaFit:
    """Return the fit to Table 3, whose k_92 and λ_R come without uncertainties."""
    return fit_a_theta(
        [
            (f"{row.velocity:g} m/s in Table 3", row.velocity, Estimate(row.k92), Estimate(row.slip_measured))
            for row in load_paper().table3
        ]
    )


def _start(points: Points) -> float:
    """Return the paper's estimate of a_θ, or what it is near to in its place."""
    a = points.log_slope()
    return a if math.isfinite(a) else 5.0


def _ordinary(points: Points) -> float:
    """Return a_θ by ordinary least squares on k_92, bounds left out."""
    v, k = points.v[points.inner], points.k[points.inner]

    def residuals(a: Array) -> Array:
        return np.asarray(np.exp(-a[0] * v) - k)

    return float(least_squares(residuals, [_start(points)], xtol=1e-12).x[0])


def _unweighted(points: Points) -> tuple[_Weighted, list[str]]:
    """Return the paper's estimate with the std that its own residuals give."""
    use = points.inner & (points.k > 0)
    if not use.any():
        raise EstimateError("no k_92 above zero, so there is no a_θ", "the law (27) is positive")
    v, y = points.v[use], np.log(points.k[use])
    a, dof = points.log_slope(), int(use.sum()) - 1
    scatter = math.sqrt(float(((y + a * v) ** 2).sum()) / dof) if dof else math.nan
    std = scatter / math.sqrt(v @ v)
    parts = (Part("residuals of ln k_92", "A", "normal", "1", scatter, std),)
    note = "k_92 has no stated uncertainties: the interval follows from the residuals."
    nothing = np.zeros(0)
    return _Weighted(a, std, scatter, dof, parts, nothing, nothing, nothing), [note]


def _weighted(points: Points) -> tuple[_Weighted, list[str]]:
    """Return the random-effects estimate, over speeds instead of trials where (27) does not hold."""
    fit, notes = _paule_mandel(points), []
    groups = points.by_speed(points.inner)
    within, p_value = _scatter_and_lack_of_fit(points, groups, fit.a)
    if p_value < LACK_OF_FIT:
        notes.append(
            f"The speeds deviate from (27) by more than their repetitions scatter (p = {p_value:.2g}). "
            f"The interval of a_θ is over {len(groups)} speeds, not {points.v.size} trials."
        )
        fit = _over_speeds(points, groups, fit.a, within)
    if not fit.dof:
        notes.append("There is one trial only: the interval holds no scatter between trials.")
    return fit, notes


def _scatter_and_lack_of_fit(
    points: Points, groups: Sequence[npt.NDArray[np.int64]], a: float
) -> tuple[float, float]:
    """Compare k_92 between and within speeds, by its relative deviation from (27).

    Returns:
        the relative scatter within speeds beyond the stated std (method of moments), and the p value of the
        speeds' deviation from (27) against that within speeds; 1 if it cannot be tested.
    """
    m = np.exp(-a * points.v)
    deviation, sigma = (points.k - m) / m, points.sigma / m
    n, S = sum(group.size for group in groups), len(groups)
    excess = 0.0
    for group in groups:
        d = deviation[group] - deviation[group].mean()
        excess += float((d**2).sum()) - (group.size - 1) * float((sigma[group] ** 2).mean())
    scatter = math.sqrt(max(0.0, excess / (n - S))) if n > S else 0.0
    if S < 2 or n - S < 2:
        return scatter, 1.0
    w = 1 / (sigma**2 + scatter**2)
    between = within = 0.0
    for group in groups:
        mean = np.average(deviation[group], weights=w[group])
        between += w[group].sum() * mean**2
        within += float((w[group] * (deviation[group] - mean) ** 2).sum())
    within = max(within, float(n - S))  # the stated std are taken to be no exaggeration
    return scatter, float(f_distribution.sf((between / (S - 1)) / (within / (n - S)), S - 1, n - S))


def _over_speeds(
    points: Points, groups: Sequence[npt.NDArray[np.int64]], a: float, within: float
) -> _Weighted:
    """Return the fit to one point a speed, with the sensitivity of each trial in the mean of its speed.

    Args:
        points: of all trials.
        groups: places of those of each speed that are no bounds; their weighted mean is the point.
        a: by all trials, which gives the size of the scatter.
        within: relative scatter of k_92 within speeds.
    """
    spread = within * np.exp(-a * points.v)
    own = points.sigma**2 + spread**2
    w = [1 / own[group] for group in groups]
    v = np.array([points.v[group[0]] for group in groups])
    k = np.array([np.average(points.k[group], weights=x) for group, x in zip(groups, w, strict=True)])
    sigma = np.array([1 / math.sqrt(x.sum()) for x in w])
    nothing = np.full(v.size, math.nan)
    speeds = _paule_mandel(Points(v, k, sigma, nothing, nothing, np.zeros(v.size, np.int64)))
    between = np.sqrt(np.maximum(speeds.own - sigma**2, 0.0))

    speed_of = np.minimum(np.searchsorted(np.round(v, 4), np.round(points.v, 4)), v.size - 1)
    weight = np.where(points.inner, 1 / own, 0.0)
    share = weight / np.bincount(speed_of, weight)[speed_of]
    sensitivity = share * speeds.sensitivity[speed_of]
    departure = Part(
        "departure of the speeds from the law (27)", "A", "normal", "1", speeds.scatter,
        float(np.linalg.norm(speeds.sensitivity * between)),
    )  # fmt: skip
    parts = (_between_trials(within, sensitivity * spread), departure)
    return replace(
        speeds,
        scatter=within,
        parts=parts,
        sensitivity=sensitivity,
        own=own,
        common=between[speed_of] ** 2,
    )


def _between_trials(scatter: float, contributions: Array) -> Part:
    """Return the part of the std of a_θ that the scatter between trials causes."""
    whole = float(np.linalg.norm(contributions))
    return Part("scatter of k_92 between trials", "A", "normal", "1", scatter, whole)


def _paule_mandel(points: Points) -> _Weighted:
    """Return the random-effects estimate over the points."""
    dof = int(points.inner.sum()) - 1

    def solved(τ: float) -> tuple[float, Array, Array]:
        """Return a_θ, k_92 by (27) and its std for a given scatter."""
        a = _solve(points, τ)
        return a, *_model(points, a, τ)

    def surplus(τ: float) -> float:
        _, m, std = solved(τ)
        return float((((points.k - m) / std)[points.inner] ** 2).sum()) - dof

    τ = 0.0
    if dof and surplus(0.0) > 0:
        if surplus(_LARGEST) > 0:
            raise EstimateError(
                "the k_92 of the trials contradict each other and any law like (27)", "look at their fits"
            )
        τ = float(brentq(surplus, 0.0, _LARGEST, xtol=1e-6))
    a, m, std = solved(τ)
    # the share of its information that a point keeps when it is known only to lie beyond a bound
    z, side = (points.k - m) / std, points.censored
    tail = points.beyond(m, std)
    kept = np.where(side == 0, 1.0, np.clip(tail * (tail - side * z), 0.0, 1.0))
    information = float((((points.v * m / std) ** 2) * kept).sum())
    sensitivity = -np.sqrt(kept) * points.v * m / std**2 / information
    parts = (_between_trials(τ, sensitivity * τ * m),) if τ > 0 else ()
    return _Weighted(a, 1 / math.sqrt(information), τ, dof, parts, sensitivity, std**2, np.zeros(m.size))


def _model(points: Points, a: float, τ: float) -> tuple[Array, Array]:
    m = np.exp(-a * points.v)
    return m, np.sqrt(points.sigma**2 + (τ * m) ** 2)


def _solve(points: Points, τ: float) -> float:
    """Return the root in a of the estimating equation, searched for outwards from the paper's estimate."""

    def equation(a: float) -> float:
        m, std = _model(points, a, τ)
        return float((points.v * m * (m - points.expected(m, std)) / std**2).sum())

    low = high = _start(points)
    step = 0.25
    while equation(low) < 0 and low > -_FAR:  # a too large: k_92 lies above the law on the whole
        low, step = low - step, 2 * step
    step = 0.25
    while equation(high) > 0 and high < _FAR:
        high, step = high + step, 2 * step
    if equation(low) < 0 or equation(high) > 0:
        raise EstimateError("no finite a_θ fits the k_92 of the trials", "look at their fits")
    return float(brentq(equation, low, high, xtol=1e-8)) if high > low else low
