"""Speeds of wheels with their std: steady ones smooth, corners sharp.

The acceleration of a wheel walks at random, at a rate that is learnt for each place. Where nothing changes
the rate is small and many samples are averaged. At the corner of a ramp it is large: few samples are
averaged, and the std is larger.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.ndimage import uniform_filter1d

Array = npt.NDArray[np.float64]

STEP, SHARES = 0.01, 4
"""Acceleration is constant for this long [s], as motors need it to follow a corner; with slow encoders for
1/4 of their period."""

NEAR = 5
"""Steps that share a rate: a corner lies in the middle ones, wherever it is in its step, and motors need the
others to follow it."""

LONGEST = 0.5
"""Speeds are not averaged over longer than this [s]: ground and lugs change them meanwhile."""

FREEDOM = 1.0
"""Degrees of freedom of the rates' prior: jumps are of any size, as those of a Cauchy distribution."""

PASSES, SETTLED = 60, 0.02
"""Most passes in which rates are learnt; the last one changes no speed by more than this share of its std."""

COARSE, FIRST = 3, 100.0
"""Passes with one rate for all places, from which the others start; the first rate [m²/s⁵], of 1 m/s² each
step."""

PART, OVERLAP = 60.0, 2.0
"""Long logs are smoothed in parts of this length, which overlap [s]."""

WEAK = 1e-3
"""Weight of straight lines between the samples, over that of the samples: gaps leave no singular matrix."""


def speeds_of(t: Array, y: Array, sigma: Array, *, rates: bool = False) -> tuple[Array, Array]:
    """Return the speeds of wheels and their common std at the stamps.

    A distance is a parabola over each `STEP` of length h, and its speed is continuous. Changes of
    acceleration from step to step are normal with variance Q h. 1/Q of `NEAR` steps has a gamma prior, so
    that the changes have a Student distribution; its scale is learnt, too. Q is the fixed point of the
    evidence (MacKay, Neural Computation 4, 1992, 415). Wheels share the command, and so Q; together they
    count as one.

    Args:
        t: (M,) stamps [s], rising.
        y: (M, W) rolled distances [m], or speeds [m/s] with `rates`.
        sigma: (M,) std of one sample of each.
        rates: speeds were logged.

    Returns:
        (M, W) speeds [m/s]; (M,) std of each.
    """
    step, degree = max(STEP, float(np.median(np.diff(t))) / SHARES), 1 if rates else 2
    length = min(float(t[-1] - t[0]), PART)
    size = max(int(np.ceil(length / step)), 4)
    begins = np.linspace(t[0], t[-1] - length, 1 + int(np.ceil((t[-1] - t[0] - length) / (PART - OVERLAP))))
    parts = [_Part(t, y, sigma, Grid(begin, step, size, degree)) for begin in begins]
    speeds, stds = _smoothed(parts, step, degree)
    speed, std = np.empty_like(y), np.empty_like(t)
    of_part = np.searchsorted((begins[1:] + begins[:-1] + length) / 2, t)
    for k, part in enumerate(parts):
        inside = of_part == k
        std[inside] = np.interp(t[inside], part.at, stds[k])
        speed[inside] = np.column_stack([np.interp(t[inside], part.at, v) for v in speeds[k].T])
    return speed, std


class Grid(NamedTuple):
    """Steps of a part: their begin and length [s] and their number; the degree of its splines."""

    begin: float
    step: float
    size: int
    degree: int


class _Part:
    """Normal equations of the splines of a part.

    Attributes:
        at: (K,) ends of the steps [s].
        precision: (degree + 2, m) upper band of the matrix of the samples.
        rhs: (m, W) right-hand sides.
        least: the rate at which samples are averaged for `LONGEST` [m²/s⁵].
    """

    def __init__(self, t: Array, y: Array, sigma: Array, grid: Grid) -> None:
        degree = grid.degree
        knots = grid.begin + grid.step * np.arange(-degree, grid.size + degree + 1)
        self.at = knots[degree:-degree]
        near = (t >= self.at[0]) & (t <= self.at[-1])
        weight = 1 / sigma[near] ** 2
        basis = BSpline.design_matrix(t[near], knots, degree)
        weighted = basis.multiply(weight[:, None]).T.tocsr()
        squares, m = weighted @ basis, basis.shape[1]
        usual = float(np.median(weight)) * weight.size / m if weight.size else 1.0  # of a spline
        self.precision = np.zeros((degree + 2, m))
        for j in range(degree + 1):
            self.precision[-1 - j, j:] = squares.diagonal(j)
        self.precision[-1] += WEAK * usual
        y = y - y[near.argmax()] if degree == 2 else y
        centre = grid.begin + grid.step * (np.arange(m) + (1 - degree) / 2)
        lines = np.column_stack([np.interp(centre, t, column) for column in y.T])
        self.rhs = weighted @ y[near] + WEAK * usual * lines
        self.least = grid.step / (usual * LONGEST ** (2 * degree + 2))


def _smoothed(parts: list[_Part], h: float, degree: int) -> tuple[Array, Array]:
    """Return (B, K, W) speeds [m/s] and (B, K) their std, of B parts at the ends of their steps of h [s]."""
    change = np.array([1.0, -2.0, 1.0]) / h if degree == 1 else np.array([-1.0, 3.0, -3.0, 1.0]) / h**2
    slope = np.array([1.0]) if degree == 1 else np.array([-1.0, 1.0]) / h
    band, rhs, least = (np.array([getattr(p, name) for p in parts]) for name in ("precision", "rhs", "least"))
    least, width = least[:, None], change.size
    rate = np.full((len(parts), band.shape[2] - width + 1), FIRST)
    speed = np.zeros(())
    for k in range(PASSES):
        factor = np.array([cholesky_banded(a) for a in band + _squares(change, 1 / (rate * h), band.shape)])
        x = np.array([cho_solve_banded((f, False), r) for f, r in zip(factor, rhs, strict=True)])
        covariance = _band_of_inverse(factor)
        before, speed = speed, sliding_window_view(x, slope.size, axis=1) @ slope
        std = np.sqrt(_variance(covariance, slope))
        if k > COARSE and (np.abs(speed - before).max(axis=2) <= SETTLED * std).all():
            break
        squares = ((sliding_window_view(x, width, axis=1) @ change) ** 2).mean(axis=2) / h
        determined = np.clip(1 - _variance(covariance, change) / (rate * h), 0.0, 1.0)  # degrees of freedom
        if k < COARSE:
            squares, determined = (a.mean(axis=1, keepdims=True) for a in (squares, determined))
            rate = np.maximum(squares / np.maximum(determined, WEAK), least) + np.zeros_like(rate)
        else:
            squares, determined = (
                NEAR * uniform_filter1d(a, NEAR, axis=1, mode="nearest") for a in (squares, determined)
            )
            usual = 1 / np.mean(1 / rate, axis=1, keepdims=True)
            rate = np.maximum((FREEDOM * usual + squares) / (FREEDOM + determined), least)
    return speed, std


def _squares(weights: Array, precision: Array, shape: tuple[int, ...]) -> Array:
    """Return the upper band of the matrix of Σ p_i (Σ_j w_j x_{i+j})² for (B, R) precisions p."""
    band, n = np.zeros(shape), precision.shape[1]
    for a, first in enumerate(weights):
        for b, second in enumerate(weights[a:], a):
            band[:, -1 - (b - a), b : b + n] += precision * first * second
    return band


def _variance(covariance: Array, weights: Array) -> Array:
    """Return (B, R) variances of Σ_j w_j x_{i+j}, by the band of the covariance (B, m, k + 1).

    At rest neighbours are so alike that their difference may vanish in the rounding errors of its terms: it
    is known no better than these.
    """
    n = covariance.shape[1] - weights.size + 1
    total = np.zeros((covariance.shape[0], n))
    for a, first in enumerate(weights):
        for b, second in enumerate(weights):
            total += first * second * covariance[:, min(a, b) : min(a, b) + n, abs(a - b)]
    rounding = np.finfo(np.float64).eps * float(weights @ weights) * covariance[:, :n, 0]
    return np.asarray(np.maximum(total, rounding))


def _band_of_inverse(factor: Array) -> Array:
    """Return (B, m, k + 1) the inverse's elements at i, i + j, of (B, k + 1, m) banded Cholesky factors.

    They follow from the last to the first one (Takahashi, Fagan & Chin 1973): an unknown is a sum of the k
    next ones and an independent part. About sqrt(m) stretches are passed at once, twice: first each as if
    what follows it were known, then by what does follow it.
    """
    count, size, m = factor.shape
    length = int(np.ceil(np.sqrt(m)))
    stretches = -(-m // length)
    rows = np.zeros((stretches * length, count, size))  # of the upper factor
    for j in range(size):
        rows[: m - j, :, j] = factor[:, -1 - j, j:].T
    rows[m:, :, 0] = np.inf  # unknowns beyond the end have neither part
    std = 1 / rows[:, :, 0]
    ahead = -rows[:, :, 1:] * std[:, :, None]
    ahead, std = (a.reshape(stretches, length, *a.shape[1:]).swapaxes(0, 1) for a in (ahead, std))

    inside = np.zeros((stretches, count, size - 1, size - 1))  # of the next unknowns
    weights = inside + np.eye(size - 1)  # of what follows a stretch
    for i in range(length - 1, -1, -1):
        _step_back(inside, ahead[i], std[i])
        first = ahead[i][..., None, :] @ weights
        weights[..., 1:, :] = weights[..., :-1, :].copy()
        weights[..., :1, :] = first
    block = np.zeros_like(inside)
    for n in range(stretches - 1, 0, -1):
        block[n - 1] = weights[n] @ block[n] @ weights[n].swapaxes(1, 2) + inside[n]
    inverse = np.stack([_step_back(block, ahead[i], std[i]) for i in range(length - 1, -1, -1)])
    return inverse[::-1].transpose(2, 1, 0, 3).reshape(count, -1, size)[:, :m]


def _step_back(block: Array, ahead: Array, std: Array) -> Array:
    """Return the (..., k + 1) covariances of an unknown with itself and the k next ones.

    Their (..., k, k) covariance `block` becomes that of the unknown and the k - 1 next ones, in place.
    """
    covariance = (block @ ahead[..., None])[..., 0]
    variance = std**2 + np.vecdot(ahead, covariance)
    row = np.concatenate([variance[..., None], covariance], axis=-1)
    block[..., 1:, 1:] = block[..., :-1, :-1].copy()
    block[..., 0] = block[..., 0, :] = row[..., :-1]
    return row
