"""Lines in what the model leaves: what repeats with a phase, as the angle of a wheel, a place or the time."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array

SHOWN_BY = ("accel_x", "accel_z", "pitch_rate")
"""Channels that are not behind the inertia of wheel and motor."""

ALIKE = 1e-9
"""Share of the larger one below which a cosine and a sine are alike: sums of so many bins are off by less."""


def table_of_gains(
    problem: Problem,
    left: Sequence[Array],
    axis: Sequence[Array | None],
    numbers: Array,
    sizes: Sequence[Array | None] | None = None,
) -> Array:
    """Return (w, c, k): gain of lines by channel of `SHOWN_BY` and in all of them, command and number.

    Args:
        problem: the trials.
        left: per trial its residuals.
        axis: per trial (n,) that along which a line repeats; a trial with None shows no line.
        numbers: (k,) periods per unit of it, at equal steps.
        sizes: per trial (n,) of a line, None as `axis`; constant by default.
    """
    table = np.zeros((len(SHOWN_BY), len(problem.commands), numbers.size))
    for command, repetitions in enumerate(problem.commands):
        for i in repetitions:
            x, size = axis[i], None if sizes is None else sizes[i]
            if x is None or (sizes is not None and size is None):
                continue
            channels = problem.trials[i].channels
            shown = [w for w, name in enumerate(SHOWN_BY) if name in channels]
            rows = np.array([left[i][channels.index(SHOWN_BY[w])] for w in shown]).reshape(-1, x.size)
            table[shown, command] += line_gains(numbers, x, rows, size)
    return np.concatenate([table, table.sum(axis=0, keepdims=True)])


def without_strongest_command(table: Array) -> Array:
    """Return (w, k): gains of all commands but the one that speaks most for a number.

    Where there is one command, it is its gain.
    """
    whole: Array = table.sum(axis=1) - (table.max(axis=1) if table.shape[1] > 1 else 0.0)
    return whole


def line_gains(numbers: Array, axis: Array, residuals: Array, size: Array | None = None) -> Array:
    """Return (c, k) gain of log likelihood of a cosine and a sine by the criterion of Schwarz, per number.

    The residual's own variance is taken for that of the noise. The noise as learnt does not serve: a line has
    another phase in each trial, so that it counts as noise, and the line itself weighs least. Slow parts are
    taken out by differences.

    Args:
        numbers: (k,) periods per unit of the axis, at equal steps.
        axis: (n,) that along which a line repeats.
        residuals: (c, n) what the model leaves of each channel; NaN where nothing was measured.
        size: (n,) of the line, of any unit; constant by default.
    """
    gains = np.zeros((len(residuals), numbers.size))
    told = np.isfinite(residuals) & np.isfinite(axis)
    for measured in np.unique(told, axis=0):
        alike, x = np.flatnonzero((told == measured).all(axis=1)), axis[measured]
        if x.size <= 3:
            continue
        y = np.diff(residuals[np.ix_(alike, measured)])
        squares = np.sum(y**2, axis=1)[:, None]
        left = _left(y, numbers, x, None if size is None else size[measured])
        # a residual that is a line and nothing else leaves rounding errors
        least = np.maximum(squares * np.finfo(float).eps, np.finfo(float).tiny)
        explained = y.shape[1] * np.log(np.maximum(squares, least) / np.maximum(left, least))
        gains[alike] = np.where(squares > 0, (explained - 2 * np.log(y.shape[1])) / 2, 0.0)
    return gains


def _left(y: Array, numbers: Array, x: Array, size: Array | None) -> Array:
    """Return (c, k) sums of squares that a cosine and a sine leave of y (c, n−1), which are differences.

    A line is the real and the imaginary part of d = Δ(s e^{iφ}). Sums of y d, d² and |d|² over the bins are
    sums of weights times e^{iφ}: at the bins, at twice their phase, between two of them, at their distance.
    """
    s = np.ones(x.size) if size is None else size
    beside = s[1:] * s[:-1]
    twice = np.append(s[:-1] ** 2, 0.0) + np.append(0.0, s[1:] ** 2)
    with_y = _sums(numbers, x, -np.diff(y, prepend=0.0, append=0.0).T * s[:, None])
    square = _sums(numbers, 2 * x, twice[:, None]) - 2 * _sums(numbers, x[1:] + x[:-1], beside[:, None])
    size_of = twice.sum() - 2 * _sums(numbers, np.diff(x), beside[:, None]).real
    d, dd = square[:, 0], size_of[:, 0]
    normal = np.array([[dd + d.real, d.imag], [d.imag, dd - d.real]]).transpose(2, 0, 1) / 2
    along = np.stack([with_y.real, with_y.imag], axis=1)  # (k, 2, c)
    solved = np.linalg.pinv(normal, rcond=ALIKE, hermitian=True) @ along
    return np.asarray(np.sum(y**2, axis=1)[:, None] - np.sum(along * solved, axis=1).T)


def _sums(numbers: Array, x: Array, weights: Array) -> Array:
    """Return (k, m) sums of weights (n, m) times exp(2πi number x) at x (n,), numbers (k,) at equal steps.

    The exponentials of a block of numbers are those of its first one times those of the steps, which are the
    same in all blocks: a block is a product of matrices, and no table of all numbers and bins is needed.
    """
    step = float(numbers[1] - numbers[0]) if numbers.size > 1 else 0.0
    block = math.ceil(math.sqrt(numbers.size))
    steps = np.exp(2j * np.pi * step * np.outer(np.arange(block), x))
    parts = [steps @ (np.exp(2j * np.pi * first * x)[:, None] * weights) for first in numbers[::block]]
    return np.asarray(np.concatenate(parts)[: numbers.size])


def line_amplitude(phase: Array, residual: Array) -> float:
    """Return the amplitude of a line in a residual [its unit], both (n,); NaN where too little was measured.

    Args:
        phase: (n,) [rad].
        residual: (n,) as in `line_gains`.
    """
    finite = np.isfinite(residual) & np.isfinite(phase)
    if np.count_nonzero(finite) <= 3:
        return float("nan")
    waves = np.diff(np.stack([np.cos(phase[finite]), np.sin(phase[finite])], axis=1), axis=0)
    return float(np.hypot(*np.linalg.lstsq(waves, np.diff(residual[finite]))[0]))
