"""Noise of the residuals: its covariance in time, learnt from repetitions, and what makes it white.

A channel's noise is the sum of three parts: that of the standstill, a vibration whose strength
grows with the speed, and the jitter of the stamps where the signal is steep. Each has its own
spectrum, so that the mixture changes along the trial; the Cholesky factor of its covariance turns
residuals into independent numbers of unit variance.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.linalg import cholesky, solve_toeplitz, toeplitz
from scipy.linalg.blas import dtrmm
from scipy.linalg.lapack import dtrtri
from scipy.optimize import nnls

from granite_lab.inference.constants import BIN, LOW_PASS, SMOOTH
from granite_lab.logs.trial import Array

EACH = 12
"""Bins for each coefficient of an autoregression; a rule of thumb asks for ten or more."""

ORDER = 16
"""Order of the autoregression that smooths a spectrum; frame and lugs vibrate in narrow peaks."""

REST_ORDER = 2
"""The same of a sensor at standstill: a low-pass of second order."""

FEWEST_BINS = 9
"""Bins of which a spectrum can be told: several of each coefficient of `REST_ORDER`."""

FAST = 0.8
"""Share of the full speed from which a bin tells of the vibration."""

CUT = 4.0
"""Below this frequency [Hz] a residual without repetitions may be a missing effect, not noise."""

TOP = 0.8
"""Largest share of the Nyquist frequency at which the band above the cut may begin."""

ABOVE = LOW_PASS / CUT
"""The band above `CUT` that shows how large noise and vibration are ends at this multiple of it, where an
IMU's low-pass may begin."""

WHOLE = 20.0
"""Longest trial that is treated as a whole [s]: the slowest command of Table 2 takes less."""

STRETCH = 8 * SMOOTH[1]
"""Length of a stretch of a longer one [s], eight times the widest bump of the discrepancy: noise and
discrepancy on both sides of a cut are taken to be independent."""

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Filter:
    """Makes the noise of one channel over one stretch of a trial white with unit variance.

    Attributes:
        inverse: (k, k) inverse of the lower Cholesky factor of the covariance of the bins that were
            measured, or (k,) inverse of their std where the noise is white.
        measured: (n,) bins that were measured.
    """

    inverse: Array
    measured: Mask

    def __call__(self, columns: Array) -> Array:
        """Return the whitened (n,) or (n, k) columns; zero where nothing was measured."""
        if not self.inverse.size:
            return np.zeros_like(columns)
        whole = bool(self.measured.all())
        rows = columns if whole else columns[self.measured]
        if self.inverse.ndim == 1:
            whitened = (rows.T * self.inverse).T
        elif rows.ndim == 1:
            whitened = self.inverse @ rows
        else:  # half the work of a full matrix
            whitened = dtrmm(1.0, self.inverse.T, rows.T, side=1, lower=0).T
        if whole:
            return np.asarray(whitened)
        out = np.zeros_like(columns)
        out[self.measured] = whitened
        return out


@dataclass(frozen=True, eq=False)
class Whitener:
    """Makes the noise of one channel of a trial white with unit variance, one stretch after the other."""

    filters: tuple[Filter, ...]

    @cached_property
    def measured(self) -> Mask:
        """(n,) bins that were measured."""
        return np.concatenate([f.measured for f in self.filters])

    def __call__(self, columns: Array) -> Array:
        """Return the whitened (n,) or (n, k) columns; zero where nothing was measured."""
        if len(self.filters) == 1:
            return self.filters[0](columns)
        ends = np.cumsum([f.measured.size for f in self.filters])
        parts = np.split(columns, ends[:-1])
        return np.concatenate([f(part) for f, part in zip(self.filters, parts, strict=True)])


def stretches(n: int, width: float) -> tuple[slice, ...]:
    """Return the stretches into which the bins of a trial are cut, of equal length but for rounding.

    Work and memory grow with the square of a stretch, but only in proportion to their number.

    Args:
        n: number of bins.
        width: of a bin [s].
    """
    count = 1 if n * width <= WHOLE else int(np.ceil(n * width / STRETCH))
    edges = np.linspace(0, n, count + 1).round().astype(int).tolist()
    return tuple(slice(a, b) for a, b in itertools.pairwise(edges))


def white(level: float, measured: Mask, width: float) -> Whitener:
    """Return the filter of white noise.

    Args:
        level: its std.
        measured: (n,) bins that were measured.
        width: of a bin [s].
    """
    masks = [measured[stretch] for stretch in stretches(measured.size, width)]
    return Whitener(tuple(Filter(np.full(int(part.sum()), 1 / level), part) for part in masks))


def whitener(measured: Mask, width: float, covariance: Callable[[slice], Array]) -> Whitener:
    """Return the filter of noise with some covariance.

    Args:
        measured: (n,) bins that were measured.
        width: of a bin [s].
        covariance: returns that of the bins of a stretch.
    """
    filters = []
    for stretch in stretches(measured.size, width):
        mask = measured[stretch]
        inverse = np.zeros((0, 0))
        if mask.any():
            L = cholesky(covariance(stretch)[np.ix_(mask, mask)], lower=True)
            inverse = np.tril(dtrtri(L, lower=1)[0])
        filters.append(Filter(inverse, mask))
    return Whitener(tuple(filters))


def errors(residuals: Sequence[Array]) -> Array:
    """Return the (trials, n) noise in the residuals of the trials of one command.

    With repetitions the residual minus its mean over them is noise alone: what the model misses is
    common to all.

    Args:
        residuals: (n,) per trial, NaN where nothing was measured, aligned on the command.
    """
    table = np.stack(residuals)
    if len(residuals) < 2:
        return table
    count = np.fmax(1, np.isfinite(table).sum(axis=0))
    return np.asarray((table - np.nansum(table, axis=0) / count) * np.sqrt(count / np.fmax(1, count - 1)))


def at_rest(noise: Sequence[Array], floor: float, width: float) -> Array:
    """Return the power spectrum of a sensor at standstill.

    A command has half a second of it, and by chance its repetitions resemble each other there; the
    sensor is the same in all commands.

    Args:
        noise: rows of `errors`, of the bins at standstill only, from however many commands.
        floor: smallest std worth telling from zero.
        width: of a bin [s].
    """
    return _spectrum(noise, REST_ORDER, floor, width, 0.0)


def identify(
    residuals: Sequence[Array],
    speed: Array,
    slope: Array,
    floor: float,
    width: float,
    rest: Array | None = None,
    more: Array | None = None,
) -> list[Whitener]:
    """Identify the noise of one channel from the trials of one command; those with the same bins share it.

    Without repetitions the slow part of the spectrum is taken to be as large as in the band above, and there
    is no jitter: what the model lacks is largest where the signal is steep, too.

    Args:
        residuals: (n,) per trial, NaN where nothing was measured, aligned on the command.
        speed: (n,) speed over its largest, zero at standstill.
        slope: (n,) change of the signal over a bin.
        floor: smallest std worth telling from zero.
        width: of a bin [s].
        rest: what `at_rest` found; by default it looks at these trials alone.
        more: (n,) variance of what is neither noise nor smooth: blows of a robot that comes to rest.
    """
    table, error = np.stack(residuals), errors(residuals)
    cut = 0.0 if len(residuals) > 1 else CUT
    if rest is None:
        rest = at_rest(list(error[:, speed == 0]), floor, width)
    fast = speed >= FAST * min(1.0, float(speed.max()))
    driven = _spectrum(list(error[:, fast]), ORDER, floor, width, cut)
    vibration = np.fmax(driven - rest, 0.0)
    of_rest, of_vibration = (np.fft.irfft(spectrum) for spectrum in (rest, vibration))
    apart = np.zeros(speed.size)  # variance of what one bin does not share with the next
    if len(residuals) > 1:
        apart += _jitter(error, of_rest[0] + speed**2 * of_vibration[0], slope)
    if more is not None:
        apart += more

    def covariance(stretch: slice) -> Array:
        n, v = stretch.stop - stretch.start, speed[stretch]
        Σ = toeplitz(of_rest[:n]) + np.outer(v, v) * toeplitz(of_vibration[:n])
        Σ[np.diag_indices(n)] += apart[stretch]
        return np.asarray(Σ)

    measured = np.isfinite(table)
    whiteners: dict[bytes, Whitener] = {}
    for mask in measured:
        if mask.tobytes() not in whiteners:
            whiteners[mask.tobytes()] = whitener(mask, width, covariance)
    return [whiteners[mask.tobytes()] for mask in measured]


GRID = 2 ** math.ceil(math.log2(WHOLE / BIN))
"""Frequencies of a spectrum: those of the bins of `WHOLE`, rounded up to a power of two."""


def _spectrum(error: Sequence[Array], order: int, floor: float, width: float, cut: float) -> Array:
    """Return the power spectrum on `GRID` + 1 frequencies, smoothed by an autoregression.

    The floor enters as white noise: a sensor at rest on one step of its scale has no noise to learn.
    """
    every = [row[np.isfinite(row)] for row in error]
    rows = [row for row in every if row.size >= FEWEST_BINS]
    if not rows:  # wide bins, of slow sensors: too few for a spectrum, enough for a level
        few = np.concatenate([np.zeros(0), *every])
        return np.full(GRID + 1, floor**2 + (float(np.mean(few**2)) if few.size else 0.0))
    raw = np.mean([np.abs(np.fft.rfft(row, 2 * GRID)) ** 2 / row.size for row in rows], axis=0)
    f = np.fft.rfftfreq(2 * GRID, width)
    if cut:
        cut = min(cut, TOP * 0.5 / width)  # wide bins, of slow sensors, may hold no frequency above the cut
        raw[f < cut] = np.mean(raw[(f >= cut) & (f < ABOVE * cut)])
    order = min(order, sum(row.size for row in rows) // EACH)
    r = np.fft.irfft(raw)[: order + 1]
    r[0] += floor**2
    a = solve_toeplitz(r[:-1], r[1:]) if order else np.zeros(0)
    variance = r[0] - a @ r[1 : order + 1]
    response = np.ones(GRID + 1) - sum(
        c * np.exp(-1j * np.pi * (k + 1) * np.arange(GRID + 1) / GRID) for k, c in enumerate(a)
    )
    return np.asarray(variance / np.abs(response) ** 2)


def _jitter(error: Array, explained: Array, slope: Array) -> Array:
    """Return the (n,) variance that grows with the squared slope of the signal, beyond what is explained."""
    steep = np.maximum.reduce([np.roll(slope, 1) ** 2, slope**2, np.roll(slope, -1) ** 2])
    if steep.max() <= 0:
        return np.zeros_like(steep)
    power, count = np.nansum(error**2, axis=0), np.isfinite(error).sum(axis=0)
    seen = count > 0
    variance = explained.copy()
    share = np.zeros(2)
    for _ in range(6):  # the scatter of a square is its mean
        weight = np.sqrt(count[seen] / 2) / variance[seen]
        basis = np.column_stack([explained, steep])[seen] * weight[:, None]
        share, _ = nnls(basis, power[seen] / count[seen] * weight)
        variance = explained * max(share[0], 0.2) + steep * share[1]
    return np.asarray(steep * share[1])


_LINEAR, _TURNING, _AMPERES = 2e-3, 1e-4, 5e-3
FLOOR = {
    "accel_x": _LINEAR, "accel_z": _LINEAR, "pitch_rate": _TURNING,
    "wheel": _TURNING, "wheel_split": _TURNING,
    "current_f": _AMPERES, "current_r": _AMPERES, "current_side": _AMPERES,
}  # fmt: skip
"""Std below which no agreement is believed, however quiet the sensor: a wheel angle of 1e-4 rad is
10 µm on the circumference. It enters as white noise beside what the sensor shows."""

NOMINAL = {
    "accel_x": 0.05, "accel_z": 0.07, "pitch_rate": 0.003, "wheel": 1e-3, "wheel_split": 3e-4,
} | dict.fromkeys(("current_f", "current_r", "current_side"), 0.05)  # fmt: skip
"""Std of a bin with which the first fit weights the channels [unit of the channel]: on a robot that drives
each is 3 to 35 times as large as `FLOOR`. The fits that follow learn the noise."""
