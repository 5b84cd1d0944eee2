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
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from granite_lab.estimate import Estimate
from granite_lab.fitting.fit import Law
from granite_lab.fitting.points import Points
from granite_lab.logs.trial import Array

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
                "where a speed has one trial only, the line over λ_R is given that trial's own λ_R, from "
                "which its k_92 was computed: it fits there by construction"
            )
    else:
        notes.append("no line over λ_R: the slip ratios are missing or all alike")
    laws = [_fit(rival, points) for rival in rivals if len(rival.names) <= points.v.size]
    few = [law.id for law in laws if math.isnan(law.aicc)]
    if few:
        notes.append(f"{points.v.size} points are too few for an AICc of: {', '.join(few)}")
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
