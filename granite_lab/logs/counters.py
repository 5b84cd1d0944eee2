"""What counts: clocks and wheel encoders; their units, wraps, resets and resolution."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from granite_lab.logs.layouts import Column
from granite_lab.logs.quantities import Unit
from granite_lab.logs.trial import Array

Rows = npt.NDArray[np.intp]
Mask = npt.NDArray[np.bool_]

_TURN = 2 * math.pi
_FASTEST_WHEEL = 300.0  # no wheel of a ground robot turns faster [rad/s]; a step that needs more is a fault


def runs(flags: Mask) -> list[tuple[int, int]]:
    """Return the first sample of each stretch of flags, and the one behind its last."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(np.int8), [0]))))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def integral(t: Array, x: Array) -> Array:
    """Integrate samples (N,) over their stamps (N,) by trapezoids, from 0 at the first."""
    return np.concatenate(([0.0], np.cumsum(np.diff(t) * (x[1:] + x[:-1]) / 2)))


def joined(at: Array | float, t: Array, x: Array) -> Array:
    """Return at instants `at` [s] what x (N,) is on straight lines between its known samples at t (N,)."""
    known = np.isfinite(x)
    return np.asarray(np.interp(at, t[known], x[known]))


def unwrap(raw: Array, ranges: Sequence[float], slack: float = 0.02) -> tuple[Array, int, float]:
    """Undo the wraps of a counter, exactly for whole numbers.

    A step of more than half the range is a wrap, forwards or backwards (so the counter may be
    logged as signed or unsigned), if the motion goes on across it as it was before; after a reset it
    does not. The first range that holds all values and is wrapped in the data is taken. A step across a
    wrap may measure `slack` of the range, however small the others are. Returns values (N,) without wraps,
    the number of wraps, and the range.
    """
    steps = np.diff(raw)
    span = float(np.ptp(raw)) if len(raw) else 0.0
    for width in ranges:
        wraps = np.abs(steps) > width / 2
        if span > width * (1 + 1e-9) or not wraps.any():
            continue
        across = np.abs(steps[wraps] - np.sign(steps[wraps]) * width)
        usual = float(np.abs(steps[~wraps]).max(initial=0.0))
        if (across <= max(5 * usual or width / 4, slack * width)).all():
            turns = np.concatenate(([0.0], np.cumsum(np.where(wraps, -np.sign(steps), 0.0))))
            return raw + turns * width, int(np.count_nonzero(wraps)), width
    return raw, 0, 0.0


def wrap_ranges(raw: Array, unit: Unit, given: float, per_rev: float) -> list[float]:
    """List the ranges that a counter in this unit may have; `given` is the column map's (0: none)."""
    if given:
        return [given]
    if unit.name == "counts":
        return [2.0**16, 2.0**32] if (raw == np.rint(raw)).all() else []
    if unit.quantity != "angle":
        return []
    turn = _TURN / unit.factor  # or a counter that the logger has turned into an angle
    return [turn, *(size * turn / per_rev for size in (2.0**16, 2.0**32) if per_rev)]


def convert(
    t: Array, raw: Array, unit: Unit, said: Column, per_rev: float, radius: float, doubts: list[str]
) -> tuple[Array, Array | None, float]:
    """Turn one encoder's values (N,), finite, at increasing stamps [s] into wheel angle and rate.

    The unit says what kind of value they are; scale, wrap and increment are `said` by the column map;
    `per_rev` are counts per wheel revolution (0: not known); the wheel's radius is in [m]. Returns the angle
    (N,) [rad], the rate (N,) [rad/s] if that is logged, and the smallest step of what is logged.
    """
    counted, is_angle = unit.name in ("counts", "counts/s"), unit.quantity in ("angle", "length")
    values = np.cumsum(raw) if said.increment else raw
    if not said.increment and is_angle:
        values, wraps, width = unwrap(values, wrap_ranges(values, unit, said.wrap, per_rev))
        if wraps:
            doubts.append(f"the counter wrapped {wraps} times at {width:g}; unwrapped")
    factor = said.scale * ((_TURN / per_rev if per_rev else math.nan) if counted else unit.factor)
    if unit.quantity in ("length", "speed"):
        factor /= radius
    si = values * factor
    step = (1.0 if counted else quantum(raw)) * abs(factor)
    if is_angle:
        return _without_jumps(t, si, doubts), None, step
    return integral(t, si), si, step


def _without_jumps(t: Array, angle: Array, doubts: list[str]) -> Array:
    """Take out steps that no wheel can make: the counter was reset, or a sample is wrong.

    A single sample from which the next one returns is replaced by the line between its neighbours. After a
    reset the wheel goes on at the rate between those before and after it.
    """

    def too_fast(step: Array, time: Array) -> np.ndarray:
        return np.abs(step) > _FASTEST_WHEEL * time

    wild = too_fast(np.diff(angle), np.diff(t))
    if not wild.any() or wild.all() or np.count_nonzero(wild) > 0.01 * len(wild) + 2:
        return angle
    alone = np.zeros(len(angle), dtype=bool)
    alone[1:-1] = wild[:-1] & wild[1:] & ~too_fast(angle[2:] - angle[:-2], t[2:] - t[:-2])
    angle = np.interp(t, t[~alone], angle[~alone])
    steps, times = np.diff(angle), np.diff(t)
    wild = too_fast(steps, times)
    middle = (t[1:] + t[:-1]) / 2
    usual = np.interp(middle, middle[~wild], (steps / times)[~wild]) * times
    for found, what, done in (
        (alone[1:], "thrown off", "replaced by their neighbours"),
        (wild, "from which the counter starts anew", "joined to what was before"),
    ):
        if found.any():
            at = ", ".join(f"{x:.3f}" for x in t[1:][found][:3])
            doubts.append(f"{np.count_nonzero(found)} readings {what} (t = {at} s); {done}")
    return angle - np.concatenate(([0.0], np.cumsum(np.where(wild, steps - usual, 0.0))))


def quantum(raw: Array) -> float:
    """Return the smallest step of a quantised signal (N,), of which 20000 samples are seen; 0: none shows."""
    levels = np.unique(raw[:20000])
    steps = np.diff(levels)
    steps = steps[steps > 1e-9 * (levels[-1] - levels[0])] if len(levels) > 1 else steps
    if len(steps) < 3:
        return 0.0
    for part in (1, 2, 3, 4, 5):
        multiples = steps * (part / steps.min())
        whole = np.rint(multiples)
        # Equal steps alone may be a uniform motion; different multiples, or values that return, are a grid.
        grid = len(np.unique(whole)) >= 3 or len(raw[:20000]) >= 3 * len(levels)
        if np.abs(multiples - whole).max() < 0.02 and grid:
            return float(np.median(steps[whole == whole.min()]) / whole.min())
    return 0.0
