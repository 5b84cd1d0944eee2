"""Lines in what the model leaves: what repeats with a phase, as the angle of a wheel, a place or the time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array

SHOWN_BY = ("accel_x", "accel_z", "pitch_rate")
"""Channels that are not behind the inertia of wheel and motor."""


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
        numbers: (k,) periods per unit of it.
        sizes: per trial (n,) of a line, None as `axis`; constant by default.
    """
    table = np.zeros((len(SHOWN_BY), len(problem.commands), numbers.size))
    for command, repetitions in enumerate(problem.commands):
        for i in repetitions:
            x, size = axis[i], None if sizes is None else sizes[i]
            if x is None or (sizes is not None and size is None):
                continue
            phases, channels = 2 * np.pi * np.outer(numbers, x), problem.trials[i].channels
            for w, name in enumerate(SHOWN_BY):
                if name in channels:
                    table[w, command] += line_gains(phases, left[i][channels.index(name)], size)
    return np.concatenate([table, table.sum(axis=0, keepdims=True)])


def without_the_loudest(table: Array) -> Array:
    """Return (w, k): gains of all commands but the one that speaks most for a number.

    Where there is one command, it is its gain.
    """
    whole: Array = table.sum(axis=1) - (table.max(axis=1) if table.shape[1] > 1 else 0.0)
    return whole


def line_gains(phases: Array, residual: Array, size: Array | None = None) -> Array:
    """Return (k,) gain of log likelihood of a cosine and a sine by the criterion of Schwarz, per phase.

    The residual's own variance is taken for that of the noise. The noise as learnt does not serve: a line has
    another phase in each trial, so that it counts as noise, and the line itself weighs least. Slow parts are
    taken out by differences.

    Args:
        phases: (k, n) [rad].
        residual: (n,) what the model leaves; NaN where nothing was measured.
        size: (n,) of the line, of any unit; constant by default.
    """
    y, columns = _differences(phases, residual, size)
    if y.size <= 2:
        return np.zeros(len(phases))
    before = float(y @ y)
    left = before - np.einsum("kc,kc->k", _amplitudes(y, columns), columns @ y)
    # a residual that is a line and nothing else leaves rounding errors
    explained = y.size * np.log(before / np.maximum(left, before * np.finfo(float).eps))
    gains: Array = (explained - 2 * np.log(y.size)) / 2 if before > 0 else np.zeros(len(phases))
    return gains


def line_amplitude(phase: Array, residual: Array) -> float:
    """Return the amplitude of a line in a residual [its unit], both (n,); NaN where too little was measured.

    Args:
        phase: (n,) [rad].
        residual: (n,) as in `line_gains`.
    """
    y, columns = _differences(phase[None], residual, None)
    return float(np.hypot(*_amplitudes(y, columns)[0])) if y.size > 2 else float("nan")


def _differences(phases: Array, residual: Array, size: Array | None) -> tuple[Array, Array]:
    """Return (n−1,) residual and (k, 2, n−1) cosine and sine, each less that of the bin before."""
    finite = np.isfinite(residual) & np.isfinite(phases).all(axis=0)
    waves = np.stack([np.cos(phases[:, finite]), np.sin(phases[:, finite])], axis=1)
    return np.diff(residual[finite]), np.diff(waves if size is None else waves * size[finite], axis=2)


def _amplitudes(y: Array, columns: Array) -> Array:
    """Return (k, 2) the least squares amplitudes of (k, 2, n) columns; the smallest where they are alike."""
    normal = columns @ columns.transpose(0, 2, 1)
    amplitudes: Array = np.einsum("kcd,kd->kc", np.linalg.pinv(normal, hermitian=True), columns @ y)
    return amplitudes
