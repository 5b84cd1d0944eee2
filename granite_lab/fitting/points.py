"""What a law for k_92 is fitted to: one point a trial."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.special import log_ndtr

from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate
from granite_lab.fitting.fit import K92Fit
from granite_lab.logs.trial import Array
from granite_lab.model.command import peak_velocity

PointRow = tuple[str, float, Estimate, Estimate]
"""(trial, velocity [m/s], k_92, λ_R), as in `AThetaFit.points`."""


@dataclass(frozen=True, eq=False)
class Points:
    """The points as columns (N,).

    Attributes:
        trial: names.
        v: desired velocity of the steady part [m/s]; k_92 is a function of it, (5).
        k: k_92; the bound where the fit ended at one.
        sigma: std of k_92; 0 for all where none is stated.
        slip, slip_std: λ_R and its std; 0 where none is stated.
        censored: -1: the true root lies below `k`; 1: above; 0: `k` is the root.
    """

    trial: tuple[str, ...]
    v: Array
    k: Array
    sigma: Array
    slip: Array
    slip_std: Array
    censored: npt.NDArray[np.int64]

    @property
    def known(self) -> bool:
        """Whether the points come with a std."""
        return bool((self.sigma > 0).all())

    @property
    def inner(self) -> npt.NDArray[np.bool_]:
        """(N,) which points are no bounds."""
        return np.asarray(self.censored == 0)

    def only(self, mask: npt.NDArray[np.bool_]) -> Points:
        """Return the chosen points."""
        columns = {f.name: getattr(self, f.name)[mask] for f in dataclasses.fields(self)[1:]}
        return Points(tuple(n for n, keep in zip(self.trial, mask, strict=True) if keep), **columns)


Source = Literal["slip", "trajectory"]
"""Which k_92 of a fit is meant."""


def rows_of(items: Sequence[K92Fit | PointRow], by: Source) -> tuple[PointRow, ...]:
    """Return the points of fits; rows pass through."""
    return tuple(_row_of(item, by) if isinstance(item, K92Fit) else item for item in items)


def usable_row(row: PointRow) -> bool:
    """Whether a row has k_92 and velocity."""
    return math.isfinite(row[2].value) and math.isfinite(row[1]) and row[1] > 0


def _row_of(fit: K92Fit, by: Source) -> PointRow:
    k92 = fit.k92 if by == "slip" else fit.k92_trajectory
    return fit.trial, peak_velocity(fit.variant), k92, fit.slip_measured


def gather(items: Sequence[K92Fit | PointRow], by: Source) -> tuple[Points, tuple[str, ...]]:
    """Turn fits or rows into columns, with notes on what was left out or treated specially.

    Raises:
        EstimateError: nothing usable.
    """
    notes: list[str] = []
    usable = []
    for item in items:
        (row,) = rows_of([item], by)
        if usable_row(row):
            usable.append((row, _censored(item, by)))
    if len(usable) < len(items):
        notes.append(f"{len(items) - len(usable)} of {len(items)} trials have no k_92 and are left out")
    if not usable:
        raise EstimateError("no trial has a k_92, so there is no a_θ", "look at the fits of the trials first")
    rows = [row for row, _ in usable]
    k = np.array([row[2].value for row in rows])
    sigma = np.array([row[2].std for row in rows])
    stated = np.isfinite(sigma) & (sigma > 0)
    if not stated.any():
        sigma = np.zeros(k.size)
    elif not stated.all():
        sigma = np.where(stated, sigma, np.median(sigma[stated]))
        notes.append(f"{int((~stated).sum())} k_92 without std are given the median of the others'")
    points = Points(
        trial=tuple(row[0] for row in rows),
        v=np.array([row[1] for row in rows]),
        k=k,
        sigma=sigma,
        slip=np.array([row[3].value for row in rows]),
        slip_std=np.nan_to_num([row[3].std for row in rows]),
        censored=np.array([side for _, side in usable], dtype=np.int64),
    )
    bound = [n for n, inner in zip(points.trial, points.inner, strict=True) if not inner]
    if bound:
        notes.append(
            f"k_92 of {', '.join(bound)} ended at a bound: it enters the weighted fit as 'beyond it' "
            "(censored), and not the unweighted ones"
        )
    return points, tuple(notes)


def groups(points: Points) -> list[npt.NDArray[np.int64]]:
    """Return the indices of the points of each speed, slowest first."""
    rounded = np.round(points.v, 4)
    return [np.flatnonzero(rounded == v) for v in np.unique(rounded)]


def negative_log_likelihood(points: Points, mean: Array, std: Array) -> float:
    """Return -log L of the points for normal errors; a censored point counts as 'beyond its bound'."""
    z, side = (points.k - mean) / std, points.censored
    each = np.where(side == 0, 0.5 * z**2 + np.log(std) + 0.5 * math.log(2 * math.pi), -log_ndtr(-side * z))
    return float(each.sum())


def beyond(z: Array, side: npt.NDArray[np.int64]) -> Array:
    """Return the mean of a standard normal error that lies beyond z on one side (-1, 1), without sign."""
    return np.exp(-0.5 * z**2 - log_ndtr(-side * z)) / math.sqrt(2 * math.pi)


def expected(points: Points, mean: Array, std: Array) -> Array:
    """Return k_92, and for a censored point what it is expected to be beyond its bound."""
    z, side = (points.k - mean) / std, points.censored
    return np.where(side == 0, points.k, mean + side * std * beyond(z, side))


def _censored(item: K92Fit | PointRow, by: Source) -> int:
    if not isinstance(item, K92Fit):
        return 0
    status = item.status if by == "slip" else item.status_trajectory
    return {"at_lower_bound": -1, "at_upper_bound": 1}.get(status, 0)
