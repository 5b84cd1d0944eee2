r"""a_θ of the exponential law (27) over trials, and 95 % intervals where the covariance is not enough.

With stated uncertainties the weighted estimate solves

.. math:: \sum_i w_i (k_i - m_i) \, \partial m_i/\partial a = 0, \quad m_i = e^{-a v_i}, \quad
          w_i = 1 / (\sigma_i^2 + \tau^2 m_i^2)

where the relative scatter τ of k_92 from trial to trial follows from Paule and Mandel's condition
Σ w_i (k_i - m_i)^2 = n - 1 (J. Res. Natl. Bur. Stand. 87 (1982) 377-385). It works on k_92 itself: the error
of log k_92 is neither normal nor of known size near k_92 = 0. Without uncertainties it is the paper's
estimate, least squares on log k_92.

What is measured is λ_R, whose error is near normal; k_92 follows from it through the curve of the model,
which bends, and which ends at k_92 = 0. For an interval by the likelihood the deviation of a trial is in λ_R,

.. math:: d_i(k) = (λ_i - λ_i(k)) / |λ_i'|

in units of k_92 by the slope λ_i' at the root. The sand's shift of λ_R is profiled out, which adds its
variance, and the scatter between trials is held: both kinds of interval differ by the bend alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq, minimize_scalar
from scipy.special import fdtrc, ndtri, stdtrit

from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate, Part
from granite_lab.estimation.motion import TELLING
from granite_lab.fitting.fit import K92_BOUNDS, AThetaFit, K92Fit
from granite_lab.fitting.laws import Points, fit_laws, gather, row_of, usable
from granite_lab.logs.trial import Array
from granite_lab.parameters import load_paper, variant_of

LACK_OF_FIT = 0.05
"""Significance at which the speeds are taken to disagree with (27) by more than their trials do."""

DIFFERENT = 0.1
"""An interval by the likelihood takes the place of that by the covariance where an end of it is off by more
than this share of half its width."""

_MOST = 50.0  # of a_θ [s/m]; k_92 at 0.2 m/s would be 5e-5
_LARGEST = 3.0  # relative scatter; beyond it k_92 does not determine a_θ
_REACH = 8.0  # stds of a_θ within which the ends of its interval are looked for

Interval = tuple[float, float]


@dataclass(frozen=True, eq=False)
class _Weighted:
    """A fit of a_θ [s/m] to n points.

    Attributes:
        scatter: relative std of k_92 from trial to trial beyond the stated ones.
        dof: degrees of freedom of the interval.
        parts: of the std, besides that of the points.
        sensitivity, covariance: (n,) da_θ/dk_92 [s/m], and (n, n) of k_92 with the scatter between trials and
            what the trials at one speed share; empty where the points have no std.
    """

    a: float
    std: float
    scatter: float
    dof: int
    parts: tuple[Part, ...]
    sensitivity: Array
    covariance: Array


def fit_a_theta(fits: Sequence[K92Fit]) -> AThetaFit:
    """Fit a_θ over trials, the paper's way and with uncertainty, beside rival laws.

    Args:
        fits: of single trials, of which the k_92 by the steady slip is taken.

    Raises:
        EstimateError: no k_92 from which a_θ follows.
    """
    if fits and all(fit.slip_measured.std > TELLING for fit in fits):
        raise EstimateError(
            "no trial has a λ_R that is known to 5 points, so k_92 and a_θ cannot be computed",
            "granite-lab ingest shows why: it grades the estimate of each trial",
        )
    kept, points, notes = gather(fits)
    inner, stated = points.of(points.inner), bool((points.sigma > 0).all())
    if not inner.v.size:
        raise EstimateError(
            "every k_92 is at a bound, so there is no a_θ",
            "the model does not reach the measured slip ratios",
        )
    fit, more = _weighted(points) if stated else _unweighted(inner)
    notes += more
    quantile = float(stdtrit(fit.dof, 0.975) if fit.dof else ndtri(0.975))
    a_theta = Estimate(fit.a, fit.std)
    ci95 = linear = a_theta.interval(quantile)
    if stated:
        ci95 = a_theta_interval(kept, points.v, fit.covariance, a_theta, quantile)
    if ci95 != linear:
        notes.append(
            f"The interval of a_θ follows from the likelihood; from the covariance it is {linear[0]:.3f} to "
            f"{linear[1]:.3f} s/m."
        )
    if left_out := int((inner.k <= 0).sum()):
        notes.append(f"{left_out} values of k_92 <= 0 cannot enter the fit of log k_92.")
    laws, remarks = fit_laws(points)
    total, total_ci95, shared = _with_shared(kept, points, fit, ci95)
    published, rows, each = load_paper().a_theta, list(map(row_of, fits)), iter(fit.sensitivity.tolist())
    return AThetaFit(
        a_theta=a_theta,
        ci95=ci95,
        log_linear=points.log_slope(),
        ordinary=inner.a_theta(np.ones_like),
        scatter=fit.scatter,
        published=published,
        agrees=ci95[0] <= published <= ci95[1],
        points=tuple(rows),
        laws=laws,
        notes=(*notes, *remarks),
        parts=fit.parts,
        sensitivity=tuple(next(each) if usable(row) else 0.0 for row in rows) if stated else (),
        virtual=any(fit.virtual for fit in fits),
        total=total,
        total_ci95=total_ci95,
        shared=shared,
    )


def _with_shared(
    fits: Sequence[K92Fit], points: Points, fit: _Weighted, ci95: Interval
) -> tuple[Estimate, Interval, tuple[Part, ...]]:
    """Return a_θ with the uncertainty of the numbers that all trials share, its interval, and the parts.

    a_θ is fitted anew to the k_92 of all trials moved by one std of a number. It changes by factors: the
    contribution of a number is the rms of both logarithms, so that the interval is one of log a_θ.
    """
    names = {s.name: s.std for f in fits for s in f.shared}
    unknown = Estimate(math.nan), (math.nan, math.nan), ()
    if not names or not fit.a > 0 or not fit.sensitivity.size:
        return unknown
    table = [{s.name: s for s in f.shared} for f in fits]
    if any(row.keys() != names.keys() for row in table):
        return unknown
    parts = []
    for name, std in names.items():
        moves = [np.array([getattr(row[name], side) for row in table]) for side in ("up", "down")]
        ratios = [math.log(_with_shift(points, fit, shift) / fit.a) for shift in moves]
        whole = fit.a * math.sqrt(sum(r**2 for r in ratios) / 2)
        parts.append(Part(name, "B", "log-normal", "1", std, whole))
    more = math.hypot(*(part.contribution for part in parts))
    apart = ndtri(0.975) * more / fit.a
    sides = [math.hypot(math.log(end / fit.a) if end > 0 else math.inf, apart) for end in ci95]
    interval = fit.a * math.exp(-sides[0]), fit.a * math.exp(sides[1])
    return Estimate(fit.a, math.hypot(fit.std, more)), interval, tuple(parts)


def _with_shift(points: Points, fit: _Weighted, shift: Array) -> float:
    """Return a_θ with other k_92, by the same weights; what leaves the bounds counts as beyond them."""
    low, high = K92_BOUNDS
    k = points.k + shift
    side = np.where(k <= low, -1, np.where(k >= high, 1, 0))
    there = replace(points, k=np.clip(k, low, high), censored=np.where(points.inner, side, points.censored))
    scatter = np.sqrt(np.maximum(np.diag(fit.covariance) - points.sigma**2, 0.0)) / np.exp(-fit.a * points.v)
    a = there.a_theta(lambda m: np.asarray(np.hypot(points.sigma, scatter * m)))
    return a if 0 < a < _MOST else max(fit.a + float(fit.sensitivity @ shift), fit.a * math.exp(-_LARGEST))


def published_fit() -> AThetaFit:
    """Return the fit to Table 3, whose k_92 and λ_R come without uncertainties."""
    nothing = Estimate(math.nan)
    return fit_a_theta(
        [
            K92Fit(
                trial=f"{row.velocity:g} m/s in Table 3", virtual=False, variant=variant_of(row.velocity),
                k92=Estimate(row.k92), k92_trajectory=nothing, t_start=nothing,
                slip_measured=Estimate(row.slip_measured), slip_simulated=row.slip_simulated,
                status="ok", status_trajectory="not_evaluated",
            )
            for row in load_paper().table3
        ]
    )  # fmt: skip


def _unweighted(points: Points) -> tuple[_Weighted, list[str]]:
    """Return the paper's estimate with the std that its own residuals give."""
    points = points.of(points.k > 0)
    if not points.v.size:
        raise EstimateError("no k_92 above zero, so there is no a_θ", "the law (27) is positive")
    v, a, dof = points.v, points.log_slope(), points.v.size - 1
    scatter = math.sqrt(float(((np.log(points.k) + a * v) ** 2).sum()) / dof) if dof else math.nan
    std = scatter / math.sqrt(v @ v)
    parts = (Part("residuals of ln k_92", "A", "normal", "1", scatter, std),)
    note = "k_92 has no stated uncertainties: the interval follows from the residuals."
    return _Weighted(a, std, scatter, dof, parts, np.zeros(0), np.zeros((0, 0))), [note]


def _weighted(points: Points) -> tuple[_Weighted, list[str]]:
    """Return the random-effects estimate, over speeds instead of trials where (27) does not hold."""
    fit, notes = _paule_mandel(points), []
    inner = points.of(points.inner)
    within, p_value = _scatter_and_lack_of_fit(inner, fit.a)
    if p_value < LACK_OF_FIT:
        notes.append(
            f"The speeds deviate from (27) by more than their repetitions scatter (p = {p_value:.2g}). "
            f"The interval of a_θ is over {len(inner.by_speed())} speeds, not {points.v.size} trials."
        )
        fit = _over_speeds(points, fit.a, within)
    if not fit.dof:
        notes.append("There is one trial only: the interval holds no scatter between trials.")
    return fit, notes


def _scatter_and_lack_of_fit(points: Points, a: float) -> tuple[float, float]:
    """Compare k_92 between and within speeds, by its relative deviation from (27).

    Returns:
        the scatter within speeds beyond the stated std (method of moments), and the p value of the speeds'
        deviation against it; 1 if it cannot be tested.
    """
    groups, m = list(points.by_speed().values()), np.exp(-a * points.v)
    deviation, sigma = (points.k - m) / m, points.sigma / m
    n, S = points.v.size, len(groups)
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
    return scatter, float(fdtrc(S - 1, n - S, (between / (S - 1)) / (within / (n - S))))


def _over_speeds(points: Points, a: float, within: float) -> _Weighted:
    """Return the fit to one point a speed, with the sensitivity of each trial in the mean of its speed.

    The point is the weighted mean of the trials that are no bounds. Their relative scatter `within` speeds is
    that of k_92 by `a`, which is fitted to all trials.
    """
    scatter = within * np.exp(-a * points.v)
    variance = points.sigma**2 + scatter**2
    weight = np.where(points.inner, 1 / variance, 0.0)
    group_of = np.empty(points.v.size, np.int64)
    for number, group in enumerate(points.by_speed().values()):
        group_of[group] = number
    seen = np.unique(group_of[points.inner])
    speed_of = np.minimum(np.searchsorted(seen, group_of), seen.size - 1)
    total = np.bincount(speed_of, weight)
    share, sigma, nothing = weight / total[speed_of], 1 / np.sqrt(total), np.full(seen.size, math.nan)
    v, k = (np.asarray(np.bincount(speed_of, share * x), dtype=np.float64) for x in (points.v, points.k))
    speeds = _paule_mandel(Points(v, k, sigma, nothing, nothing, np.zeros(seen.size, np.int64)))
    between = np.sqrt(np.maximum(np.diag(speeds.covariance) - sigma**2, 0.0))
    sensitivity = share * speeds.sensitivity[speed_of]
    departure = Part(
        "departure of the speeds from the law (27)", "A", "normal", "1", speeds.scatter,
        float(np.linalg.norm(speeds.sensitivity * between)),
    )  # fmt: skip
    shared = np.where(np.equal.outer(group_of, group_of), between[speed_of] ** 2, 0.0)
    return replace(
        speeds,
        scatter=within,
        parts=(_between_trials(within, sensitivity * scatter), departure),
        sensitivity=sensitivity,
        covariance=np.diag(variance) + shared,
    )


def _between_trials(scatter: float, contributions: Array) -> Part:
    """Return the part of the std of a_θ that the scatter between trials causes."""
    whole = float(np.linalg.norm(contributions))
    return Part("scatter of k_92 between trials", "A", "normal", "1", scatter, whole)


def _paule_mandel(points: Points) -> _Weighted:
    """Return the random-effects estimate over the points.

    Raises:
        EstimateError: the points contradict each other, or no finite a_θ fits them.
    """
    dof = int(points.inner.sum()) - 1

    def solved(τ: float) -> tuple[float, Array, Array]:
        """Return a_θ, k_92 by (27) and its std for a given scatter."""

        def std_of(m: Array) -> Array:
            return np.asarray(np.sqrt(points.sigma**2 + (τ * m) ** 2))

        a = points.a_theta(std_of)
        if not abs(a) < _MOST:
            raise EstimateError("no finite a_θ fits the k_92 of the trials", "look at their fits")
        m = np.exp(-a * points.v)
        return a, m, std_of(m)

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
    return _Weighted(a, 1 / math.sqrt(information), τ, dof, parts, sensitivity, np.diag(std**2))


def deviations(fits: Sequence[K92Fit]) -> Callable[[Array | float], Array] | None:
    """Return d of all trials for one k_92 or one each; None where the curve of one is not known."""
    curves = []
    for fit in fits:
        slope = fit.slip_measured.std / fit.std_measurement if fit.std_measurement > 0 else math.nan
        if len(fit.curve) < 4 or not 0 < slope < math.inf:
            return None
        k, slip = np.array(fit.curve).T
        curves.append((fit.slip_measured.value, PchipInterpolator(k, slip), slope))

    def d(k: Array | float) -> Array:
        pairs = zip(curves, np.broadcast_to(k, len(curves)), strict=True)
        return np.array([(λ - of(np.clip(x, *of.x[[0, -1]]))) / slope for (λ, of, slope), x in pairs])

    return d


def k92_interval(fits: Sequence[K92Fit], linear: Interval) -> Interval:
    """Return the interval of the mean k_92 of trials at one speed.

    It holds the k_92 within their bounds for which the mean deviation is half the width of `linear` or less.
    That, by the covariance, stays where a trial's curve is not known, and where both agree.
    """
    d, half = deviations(fits) if fits else None, (linear[1] - linear[0]) / 2
    if d is None or not math.isfinite(half):
        return linear

    def end(target: float, bound: float) -> float:
        def off(k: float) -> float:
            return float(d(k).mean()) - target

        low, high = K92_BOUNDS
        return float(brentq(off, low, high, xtol=1e-7)) if off(low) * off(high) <= 0 else bound

    return _chosen(linear, (end(-half, K92_BOUNDS[0]), end(half, K92_BOUNDS[1])))


def a_theta_interval(
    fits: Sequence[K92Fit], v: Array, covariance: Array, a_theta: Estimate, quantile: float
) -> Interval:
    """Return the interval of a_θ for which the deviance stays within `quantile` squared of its least [s/m].

    That by the covariance stays where a trial's curve is not known, where the deviance does not close the
    interval, and where both agree.

    Args:
        fits: of n trials.
        v: (n,) desired velocities [m/s].
        covariance: (n, n) of their k_92.
        a_theta: with its std by the covariance [s/m].
        quantile: half the width of the interval in stds.
    """
    d, linear = deviations(fits), a_theta.interval(quantile)
    if d is None:
        return linear
    precision = np.linalg.inv(covariance)

    def deviance(a: float) -> float:
        away = d(np.exp(-a * v))
        return float(away @ precision @ away)

    a, std = a_theta.value, a_theta.std
    far = _REACH * std
    best = minimize_scalar(
        deviance, bounds=(a - far, a + far), method="bounded", options={"xatol": 1e-4 * std}
    )
    least, limit = float(best.x), float(best.fun) + quantile**2
    ends = []
    for step in (-quantile * std, quantile * std):
        reach = least + step
        while deviance(reach) < limit and abs(reach - least) < 2 * far:
            reach += step
        if deviance(reach) < limit:
            return linear
        ends.append(float(brentq(lambda x: deviance(x) - limit, least, reach, xtol=1e-6 * std)))
    return _chosen(linear, (ends[0], ends[1]))


def _chosen(linear: Interval, likelihood: Interval) -> Interval:
    """Return the interval by the covariance, or that by the likelihood where both differ."""
    off = max(abs(a - b) for a, b in zip(linear, likelihood, strict=True))
    half = (linear[1] - linear[0]) / 2
    return likelihood if math.isfinite(off) and off > DIFFERENT * half else linear
