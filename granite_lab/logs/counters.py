"""Counters of clocks and wheel encoders: wraps, resets, resolution; and statistics of samples with gaps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from granite_lab.logs.sensors.doubt import Doubt, Grade
from granite_lab.logs.trial import Array
from granite_lab.rounding import plural

Rows = npt.NDArray[np.intp]
Mask = npt.NDArray[np.bool_]

_ROUNDED = 1e-3  # by this share of a range the values may go beyond it: angles are rounded


def runs(flags: Mask) -> list[tuple[int, int]]:
    """Return the first sample of each stretch of flags, and the one behind its last."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(np.int8), [0]))))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def flagged(
    flags: Mask, t: Array, noun: str, seen: str, remedy: str, *, where: str = "", grade: Grade = "good"
) -> list[Doubt]:
    """Return the doubt about flagged samples (N,), none if none is flagged.

    It says how many they are, what is `seen` of them, and the first times [s].
    """
    if not flags.any():
        return []
    at = ", ".join(f"{t[begin]:.3f}" for begin, _ in runs(flags)[:3])
    what = f"{plural(int(np.count_nonzero(flags)), noun)} {seen} (t = {at} s)"
    return [Doubt(what, where, remedy, grade)]


def integral(t: Array, x: Array) -> Array:
    """Integrate samples (N,) over their stamps (N,) by trapezoids, from 0 at the first."""
    return np.concatenate(([0.0], np.cumsum(np.diff(t) * (x[1:] + x[:-1]) / 2)))


def interpolated(at: Array | float, t: Array, x: Array) -> Array:
    """Interpolate x (N,) at stamps t (N,) linearly at instants `at` [s], without samples that are NaN."""
    finite = np.isfinite(x)
    return np.asarray(np.interp(at, t[finite], x[finite]))


def powers(count: float = 1.0) -> list[float]:
    """Return the ranges of counters of 7 to 32 bits, where one count is `count` of the logged unit."""
    return [2.0**bits * count for bits in range(7, 33)]


def unwrap(
    raw: Array, ranges: Sequence[float], slack: float = 0.02, *, stated: bool = False
) -> tuple[Array, int, float]:
    """Undo the wraps of a counter, exactly for whole numbers.

    A step of more than half the range is a wrap, forwards or backwards (so the counter may be
    logged as signed or unsigned), if the motion goes on across it as it was before; after a reset it
    does not. The first range that holds all values and is wrapped in the data is taken. A step across a
    wrap may measure `slack` of the range, however small the others are; a `stated` range holds where it is
    wrapped more than twice. Returns values (N,) without wraps, the number of wraps, and the range.
    """
    steps = np.diff(raw)
    span = float(np.ptp(raw)) if len(raw) else 0.0
    for width in ranges:
        wraps = np.abs(steps) > width / 2
        count = int(np.count_nonzero(wraps))
        if span > width * (1 + _ROUNDED) or count == 0:
            continue
        short = np.where(wraps, steps - np.sign(steps) * width, steps)
        usual = float(np.abs(steps[~wraps]).max(initial=0.0))
        alike = (np.abs(short[wraps]) <= max(5 * usual, slack * width)).all()
        # Each wrap makes the steps jump by the range and back; without wraps they change little.
        changes, left = (np.diff(x, prepend=0.0, append=0.0) for x in (steps, short))
        saved = float(np.abs(changes).sum() - np.abs(short_way(left, width)).sum())
        if (alike and saved > width * count) or (stated and count > 2):
            turns = np.concatenate(([0.0], np.cumsum(np.where(wraps, -np.sign(steps), 0.0))))
            return raw + turns * width, count, width
    return raw, 0, 0.0


def short_way(steps: Array, width: Array | float) -> Array:
    """Return steps (N,) of a counter that starts again after `width`, each read the short way round."""
    return np.asarray(steps - width * np.rint(steps / width))


def quantum(raw: Array) -> float:
    """Return the step of a quantised signal (N,) by its first 20000 samples; 0 where there is none."""
    levels = np.unique(raw[:20000])
    steps = np.diff(levels)
    steps = steps[steps > 1e-9 * (levels[-1] - levels[0])] if len(levels) > 1 else steps
    if len(steps) < 3:
        return 0.0
    for part in (1, 2, 3, 4, 5):
        multiples = steps * (part / steps.min())
        whole = np.rint(multiples)
        # Equal steps alone may be a uniform motion; different multiples, or values that return, are a grid.
        if np.abs(multiples - whole).max() < 0.02 and (
            len(raw[:20000]) >= 3 * len(levels) or len(np.unique(whole)) >= 3
        ):
            return float(np.median(steps[whole == whole.min()]) / whole.min())
    return 0.0


def mean_known(values: Array, axis: int = 1) -> Array:
    """Return the mean along an axis, as over the wheels; NaN where nothing is known, without a warning."""
    n = np.isfinite(values).sum(axis)
    total = np.where(np.isfinite(values), values, 0.0).sum(axis)
    return np.where(n > 0, total / np.maximum(n, 1), np.nan)


def mad_std(values: Array, centre: float | None = None) -> float:
    """Return the std of values (N,) by their median absolute deviation, from the median by default."""
    return 1.4826 * float(np.median(np.abs(values - (np.median(values) if centre is None else centre))))


def repeated(reading: Array) -> Array:
    """(N,) how often each of successive readings is repeated: they have one rounding error in common."""
    group = np.cumsum(np.diff(reading, prepend=np.nan) != 0) - 1
    return np.bincount(group)[group].astype(float) if group.size else np.ones(0)
