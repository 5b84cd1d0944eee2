"""What counts: time stamps and wheel encoders; their units, wraps, resets, order, gaps and resolution."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from granite_lab.errors import InputError
from granite_lab.logs.layouts import Column
from granite_lab.logs.quantities import DATE, Unit, factors
from granite_lab.logs.trial import Array

Rows = npt.NDArray[np.intp]
Mask = npt.NDArray[np.bool_]

GAP_PERIODS = 3.0  # a gap is a step of more than this many median periods
SECONDS = {unit: factor for unit, factor in factors("time").items() if unit != DATE}
_EPOCH = (9.4e8, 2.6e9)  # 2000 to 2052 in seconds since 1970
_FASTEST = 20000.0  # [Hz]
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


def unit_factor(raw: Array, factor: float, slowest: float) -> tuple[float, str]:
    """Check the declared unit of stamps (N,) of one sensor, `factor` seconds each, against their values.

    The sampling rate is `slowest` [Hz] at least. Returns the factor to use, and a warning if it is not the
    declared one. Stamps that fit neither the declared nor exactly one other unit are refused.
    """
    steps = np.abs(np.diff(raw))
    steps = steps[steps > 0]
    if len(steps) == 0:
        return factor, ""
    rate = 1 / float(np.median(steps))  # a unit
    if slowest <= rate / factor <= _FASTEST:
        return factor, ""
    # A clock that counts from 1970 names its own unit; else only one unit may give a usual rate.
    middle = abs(float(np.median(raw)))
    fits = [f for f in SECONDS.values() if _EPOCH[0] <= middle * f <= _EPOCH[1]] or [
        f for f in SECONDS.values() if max(slowest, 4.0) <= rate / f <= 2000.0
    ]
    if len(fits) != 1 or not slowest <= rate / fits[0] <= _FASTEST:
        seen = f"stamps {rate / factor:.3g} times a second in the declared unit"
        raise InputError(f"{seen}, expected {slowest:g} to 20000", "correct the unit of the time column")
    unit = next(name for name, f in SECONDS.items() if f == fits[0])
    return fits[0], f"stamps are in {unit}, not in the unit declared: {rate / fits[0]:.4g} Hz"


def stray(raw: Array) -> list[slice]:
    """Return blocks of rows whose stamps (N,) leave the time line and come back as if they had been in time.

    A block that was written late is none of these: where it is missing, the time line has no hole.
    """
    seen = np.flatnonzero(np.isfinite(raw))
    steps = np.diff(raw[seen])
    usual = float(np.median(np.abs(steps[steps != 0]))) if (steps != 0).any() else 0.0
    jumps = np.flatnonzero(np.abs(steps) > 20 * usual)
    if not 2 <= len(jumps) <= 1000:
        return []
    period = float(np.mean(np.delete(steps, jumps))) if len(jumps) < len(steps) else 0.0
    if period <= 0:
        return []
    found: list[slice] = []
    done = -1
    for k, i in enumerate(jumps):
        for j in jumps[k + 1 : k + 20]:
            hole, count = raw[seen[j + 1]] - raw[seen[i]], int(j - i)
            if i > done and count < 0.2 * len(seen) and 0.3 < hole / ((count + 1) * period) < 3:
                found.append(slice(int(seen[i + 1]), int(seen[j]) + 1))
                done = j
                break
    return found


def tidy(
    t: Array, values: Array, what: str, where: Callable[[int | None], str], doubts: list[str]
) -> tuple[Array, Rows]:
    """Put stamps (N,) [s] in order: drop missing ones, sort late ones, keep the first of equal ones.

    The samples (N, K) tell a block that was written twice from a new start, which is refused, as a single
    stamp is. `where` names the place in the file of a row, or the file (None). Returns stamps (M,), strictly
    increasing, and the row each came from.
    """
    rows = np.flatnonzero(np.isfinite(t))
    if len(rows) < len(t):
        doubts.append(f"{what}: {len(t) - len(rows)} samples without a time stamp were left out")
    stamps = t[rows]
    if (np.diff(stamps) < 0).any():
        _refuse_reset(stamps, values[rows], lambda row: f"{where(int(rows[row]))}: {what}")
        late = int(np.count_nonzero(stamps < np.maximum.accumulate(stamps)))
        order = np.argsort(stamps, kind="stable")
        rows, stamps = rows[order], stamps[order]
        doubts.append(f"{what}: {late} samples were not in the order of time; sorted")
    new = np.concatenate(([True], np.diff(stamps) > 0))[: len(stamps)]
    if not new.all():
        doubts.append(f"{what}: {int(np.count_nonzero(~new))} duplicate stamps; the first of each was kept")
    if np.count_nonzero(new) < 2:
        count = "a single stamp" if new.any() else "no sample"
        hint = "the log is too short, or its clock stands still"
        raise InputError(f"{where(None)}: {what}: {count}, expected at least two", hint)
    return stamps[new], rows[new]


def _refuse_reset(stamps: Array, values: Array, where: Callable[[int], str]) -> None:
    """Tell a clock that starts over from samples that merely arrived late.

    Late samples are few, or come as blocks that fit into holes of the time line. After a reset two
    long blocks of the file take turns on the time line.
    """
    cuts = np.flatnonzero(np.diff(stamps) < 0) + 1
    if len(cuts) > 0.5 * len(stamps):
        first = where(int(cuts[0]))
        hint = "stamps increase from row to row: sort the log, or correct its time column"
        raise InputError(f"{first}: time runs backwards, from {stamps[0]:.3f} s to {stamps[-1]:.3f} s", hint)
    block = np.searchsorted(cuts, np.arange(len(stamps)), side="right")
    order = np.argsort(stamps, kind="stable")
    t, x, block = stamps[order], np.nan_to_num(values[order]), block[order]
    again = (np.diff(t) == 0) & (x[1:] == x[:-1]).all(axis=1)  # written twice
    block = block[np.concatenate(([True], ~again))]
    turns = np.bincount(block[1:][np.diff(block) != 0], minlength=len(cuts) + 1)
    jumps = np.maximum.accumulate(stamps)[cuts - 1] - stamps[cuts]
    period = float(np.median(np.abs(np.diff(stamps)))) or 1.0
    reset = np.flatnonzero((turns[1:] >= 10) & (jumps >= 20 * period))
    if len(reset):
        cut, jump = int(cuts[reset[0]]), jumps[reset[0]]
        what = f"{where(cut)}: time runs backwards by {jump:.3f} s and starts over at {stamps[cut]:.3f} s"
        hint = "the clock was reset: cut the file there and read the parts as separate trials"
        raise InputError(what, hint)


def describe_gaps(t: Array, what: str) -> str:
    """Return a warning about gaps longer than `GAP_PERIODS` median periods, or nothing."""
    steps = np.diff(t)
    gaps = np.flatnonzero(steps > GAP_PERIODS * np.median(steps))
    if len(gaps) == 0:
        return ""
    worst = gaps[np.argmax(steps[gaps])]
    count = "one gap" if len(gaps) == 1 else f"{len(gaps)} gaps"
    return f"{what}: {count}, the longest {steps[worst]:.3f} s at t = {t[worst]:.3f} s"


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
