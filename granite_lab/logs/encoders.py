"""From what an encoder reports to wheel angle and rate: wraps, resets, resolution, units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from granite_lab.logs.clocks import integral
from granite_lab.logs.layouts import Column
from granite_lab.logs.quantities import Unit
from granite_lab.logs.trial import Array

TURN = 2 * math.pi
FASTEST = 300.0
"""No wheel of a ground robot turns faster [rad/s]; a step that needs more is a fault."""


@dataclass(frozen=True)
class Wheel:
    """One encoder's samples in SI.

    Attributes:
        angle: (N,) accumulated wheel angle [rad].
        rate: (N,) wheel rate [rad/s] if that is what is logged.
        step: resolution of the logged quantity [rad] or [rad/s]; 0: not known.
        doubts: what had to be done.
    """

    angle: Array
    rate: Array | None
    step: float
    doubts: tuple[str, ...]


def unwrap(raw: Array, ranges: Sequence[float], slack: float = 0.02) -> tuple[Array, int, float]:
    """Undo the wraps of a counter, exactly for whole numbers.

    A step of more than half the range is a wrap, forwards or backwards (so the counter may be
    logged as signed or unsigned), if the motion goes on across it as it was before; after a reset it
    does not. The first range that holds all values and is wrapped in the data is taken.

    Args:
        raw: (N,) finite values as logged, in the order of time.
        ranges: candidates for the range after which the counter starts again.
        slack: share of the range that a step across a wrap may measure, however small the others are.

    Returns:
        (N,) values without wraps, number of wraps, range.
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
    """List the ranges that a counter in this unit may have.

    Args:
        raw: (N,) finite values.
        unit: their unit.
        given: what the column map says (0: nothing).
        per_rev: counts per wheel revolution (0: not known).
    """
    if given:
        return [given]
    if unit.name == "counts":
        return [2.0**16, 2.0**32] if (raw == np.rint(raw)).all() else []
    if unit.quantity != "angle":
        return []
    turn = TURN / unit.factor
    ranges = [turn]
    if per_rev:  # a counter that the logger has turned into an angle
        ranges += [2.0**16 * turn / per_rev, 2.0**32 * turn / per_rev]
    return ranges


def convert(t: Array, raw: Array, unit: Unit, said: Column, per_rev: float, radius: float) -> Wheel:
    """Turn one encoder's raw values into wheel angle and rate.

    Args:
        t: (N,) stamps [s], increasing.
        raw: (N,) values as logged, finite.
        unit: their unit; it says what kind of value they are.
        said: scale, wrap and increment, as the column map has them.
        per_rev: counts per wheel revolution (0: not known).
        radius: wheel radius [m].
    """
    doubts: list[str] = []
    counted, is_angle = unit.name in ("counts", "counts/s"), unit.quantity in ("angle", "length")
    values = np.cumsum(raw) if said.increment else raw
    if not said.increment and is_angle:
        values, wraps, width = unwrap(values, wrap_ranges(values, unit, said.wrap, per_rev))
        if wraps:
            doubts.append(f"the counter wrapped {wraps} times at {width:g}; unwrapped")
    factor = said.scale * ((TURN / per_rev if per_rev else math.nan) if counted else unit.factor)
    if unit.quantity in ("length", "speed"):
        factor /= radius
    si = values * factor
    step = (1.0 if counted else quantum(raw)) * abs(factor)
    if is_angle:
        return Wheel(_without_jumps(t, si, doubts), None, step, tuple(doubts))
    return Wheel(integral(t, si), si, step, tuple(doubts))


def _without_jumps(t: Array, angle: Array, doubts: list[str]) -> Array:
    """Take out steps that no wheel can make: the counter was reset, or a sample is wrong.

    A single sample from which the next one returns is replaced by the line between its neighbours. After a
    reset the wheel goes on at the rate between those before and after it.
    """

    def too_fast(step: Array, time: Array) -> np.ndarray:
        return np.abs(step) > FASTEST * time

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
    """Return the smallest step of a quantised signal, or 0 where no such step shows.

    Args:
        raw: (N,) finite values; the first 20000 are looked at.
    """
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
