"""Commands other than a trapezoid: a logged desired velocity, or a stated list of times and velocities."""

from __future__ import annotations

import math

import numpy as np

from granite_lab.estimate import Estimate
from granite_lab.logs.trial import Array, Series, Trial
from granite_lab.parameters import Course, Variant, course_of, parse_path

SAME = 0.05
"""A logged command that misses a stated trapezoid by less than this share, rms over its own rms, is that one;
a shift of the start by half of the sampling period, 5 ms, makes 1 %."""

HELD_PERIODS = 3.0
"""A command without a new value for this many periods is held, not interpolated."""


def commanded(
    trial: Trial,
    start: Estimate,
    offset: Estimate,
    steady: tuple[float, float],
    variant: Variant,
    source: str,
) -> tuple[Course, str, str | None] | None:
    """Return the command that is stated or logged, with its source and a doubt or None.

    None where that is the trapezoid, or nothing else is known.

    Args:
        trial: with its command, and what its metadata state.
        start: of the command [s, the IMU's clock].
        offset: of the encoders' clock, which stamps the command [s].
        steady: over which λ_R was measured [s]; NaN where it was not.
        variant, source: the trapezoid by metadata or motion.
    """
    stretch = (steady[0] - start.value, steady[1] - start.value)
    measured = stretch if math.isfinite(stretch[0]) else None
    if trial.info.command:
        return _from_start(np.array(parse_path(trial.info.command)).T, measured), "stated", None
    if trial.command is None or not math.isfinite(start.value):
        return None
    t, v = _points(trial.command, np.nan_to_num(offset.value) - start.value)
    if t.size < 3 or v.max() <= 0:
        return None
    off = _deviation(t, v, variant)
    if source != "measured" and off <= SAME:
        return None
    doubt = None
    if source == "given":
        doubt = (
            f"the logged command misses the stated trapezoid by {100 * off:.0f} %: the logged one is taken"
        )
    return _from_start(np.array([t, v]), measured), "logged", doubt


def _points(command: Series, shift: float) -> tuple[Array, Array]:
    """Return times since the start [s] and velocities [m/s], from the start to the last that is not zero."""
    good = np.isfinite(command.value)
    t, v = command.t[good] + shift, command.value[good]
    if t.size < 3:
        return t, v
    period = float(np.median(np.diff(t)))
    late = np.flatnonzero(np.diff(t) > HELD_PERIODS * period)
    t, v = np.insert(t, late + 1, t[late + 1] - period), np.insert(v, late + 1, v[late])
    driving = np.flatnonzero(np.abs(v) > 1e-6)
    if driving.size == 0:
        return t[:0], v[:0]
    last = min(int(driving[-1]) + 2, t.size)
    inside = t[:last] > 1e-6
    return t[:last][inside], v[:last][inside]


def _from_start(path: Array, stretch: tuple[float, float] | None) -> Course:
    """Return the course of (2, N) times and velocities, which begins and ends at rest."""
    t, v = path
    moving = np.flatnonzero(np.abs(v) > 1e-6)
    first = max(int(moving[0]) - 1, 0) if moving.size else 0
    if v[first] != 0.0 and t[first] > 1e-6:  # from rest at the start
        t, v = np.concatenate([[0.0], t]), np.concatenate([[0.0], v])
    else:
        t, v = t[first:] - t[first], v[first:]
    if v[-1] != 0.0:
        t, v = np.append(t, t[-1] + 0.02), np.append(v, 0.0)
    return course_of(t, v, stretch)


def _deviation(t: Array, v: Array, variant: Variant) -> float:
    """Return the rms by which a command misses a trapezoid over its own rms."""
    a, peak = variant.acceleration, math.sqrt(variant.acceleration * variant.distance)
    top = min(variant.velocity, peak)
    end = variant.distance / top + top / a
    fine = np.linspace(0.0, max(float(t[-1]), end), 500)
    wanted = np.clip(np.minimum(a * fine, a * (end - fine)), 0.0, top)
    given = np.interp(fine, t, v, left=0.0, right=0.0)
    return float(np.sqrt(np.mean((given - wanted) ** 2) / np.mean(given**2)))
