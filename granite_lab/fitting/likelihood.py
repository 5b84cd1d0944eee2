r"""95 % intervals of k_92 and a_θ by the likelihood, where the covariance is not enough.

What is measured is λ_R, whose error is near normal; k_92 follows from it through the curve of the model,
which bends, and which ends at k_92 = 0. The deviation of trial i is therefore taken in λ_R,

.. math:: d_i(k) = (λ_i - λ_i(k)) / |λ_i'|

in units of k_92 by the slope λ_i' at the root, so that for a straight curve d_i(k) is k less the root. Sand
and scatter enter as in the covariance: the sand's shift of λ_R is profiled out, which adds its variance, and
the scatter between trials is held at its estimate. The two kinds of interval then differ by the bend of the
curve alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq, minimize_scalar

from granite_lab.estimate import Estimate
from granite_lab.fitting.fit import K92_BOUNDS, K92Fit
from granite_lab.logs.trial import Array

Interval = tuple[float, float]

DIFFERENT = 0.1
"""An interval by the likelihood takes the place of that by the covariance where an end of it is off by more
than this share of half its width."""

_FAR = 8.0  # stds of a_θ within which the ends of its interval are looked for


Deviation = Callable[[float], float]
"""d(k) of a trial, in units of k_92."""


def deviations(fits: Sequence[K92Fit]) -> list[Deviation]:
    """Return the deviation of each trial; nothing where the curve of one is not known."""
    found = []
    for fit in fits:
        slope = fit.slip_measured.std / fit.std_measurement if fit.std_measurement > 0 else math.nan
        if len(fit.curve) < 4 or not math.isfinite(slope) or slope <= 0:
            return []
        found.append(_deviation(fit, slope))
    return found


def _deviation(fit: K92Fit, slope: float) -> Deviation:
    k, slip = np.array(fit.curve).T
    curve = PchipInterpolator(k, slip)
    return lambda at: float(fit.slip_measured.value - curve(min(max(at, k[0]), k[-1]))) / slope


def k92_interval(fits: Sequence[K92Fit], linear: Interval) -> Interval:
    """Return the interval of the mean k_92 of trials at one speed.

    It holds the k_92 within their bounds for which the mean deviation is half the width of `linear` or less.

    Args:
        fits: of the trials.
        linear: by the covariance; it stays where a trial's curve is not known, and where both agree.
    """
    known, half = deviations(fits), (linear[1] - linear[0]) / 2
    if not known or not math.isfinite(half):
        return linear

    def mean(k: float) -> float:
        return float(np.mean([d(k) for d in known]))

    low, high = K92_BOUNDS

    def end(target: float, beyond: float) -> float:
        if (mean(low) - target) * (mean(high) - target) > 0:
            return beyond
        return float(brentq(lambda k: mean(k) - target, low, high, xtol=1e-7))

    return _chosen(linear, (end(-half, low), end(half, high)))


def a_theta_interval(
    fits: Sequence[K92Fit], v: Array, own: Array, common: Array, a_theta: Estimate, quantile: float
) -> Interval:
    """Return the interval of a_θ for which the deviance stays within `quantile` squared of its least [s/m].

    That by the covariance stays where a trial's curve is not known, where the deviance does not close the
    interval, and where both agree.

    Args:
        fits: of n trials.
        v: (n,) desired velocities [m/s]; equal ones share an error.
        own: (n,) variance of each k_92 with the scatter between trials.
        common: (n,) variance that the trials of a speed share.
        a_theta: with its std by the covariance [s/m].
        quantile: half the width of the interval in stds.
    """
    known, linear = deviations(fits), a_theta.interval(quantile)
    if not known:
        return linear
    covariance = np.diag(own) + np.where(v[:, None] == v[None, :], np.sqrt(np.outer(common, common)), 0.0)
    precision = np.linalg.inv(covariance)

    def deviance(a: float) -> float:
        d = np.array([of(k) for of, k in zip(known, np.exp(-a * v), strict=True)])
        return float(d @ precision @ d)

    a, std = a_theta.value, a_theta.std
    far = _FAR * std
    best = minimize_scalar(
        deviance, bounds=(a - far, a + far), method="bounded", options={"xatol": 1e-4 * std}
    )
    least, limit = float(best.x), float(best.fun) + quantile**2
    ends = []
    for step in (-std, std):
        reach = least + quantile * step
        while deviance(reach) < limit and abs(reach - least) < 2 * far:
            reach += quantile * step
        if deviance(reach) < limit:
            return linear
        ends.append(float(brentq(lambda x: deviance(x) - limit, least, reach, xtol=1e-6 * std)))
    return _chosen(linear, (ends[0], ends[1]))


def _chosen(linear: Interval, likelihood: Interval) -> Interval:
    """Return the interval by the likelihood where it differs from that by the covariance, else the latter."""
    if not all(map(math.isfinite, (*linear, *likelihood))):
        return linear
    half = (linear[1] - linear[0]) / 2
    off = max(abs(a - b) for a, b in zip(linear, likelihood, strict=True))
    return likelihood if off > DIFFERENT * half else linear
