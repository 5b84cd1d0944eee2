"""What a law for k_92 is fitted to: one point a trial, which may lie beyond a bound of k_92."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import log_ndtr

from granite_lab.errors import EstimateError
from granite_lab.fitting.fit import K92Fit, PointRow
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
        notes.append(f"{len(items) - len(kept)} of {len(items)} trials have no k_92 and are left out")
    if not kept:
        raise EstimateError("no trial has a k_92, so there is no a_θ", "look at the fits of the trials first")
    trials, v, k92, slip = zip(*map(row_of, kept), strict=True)
    sigma = np.array([k.std for k in k92])
    stated = np.isfinite(sigma) & (sigma > 0)
    if not stated.any():
        sigma = np.zeros(sigma.size)
    elif not stated.all():
        sigma = np.where(stated, sigma, np.median(sigma[stated]))
        notes.append(f"{int((~stated).sum())} k_92 without std are given the median of the others'")
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
            f"k_92 of {', '.join(bound)} ended at a bound: it enters the weighted fit as 'beyond it' "
            "(censored), and not the unweighted ones"
        )
    return points, notes
