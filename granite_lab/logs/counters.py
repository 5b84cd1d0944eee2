"""What counts: stamps and counters; their units, wraps, resets, order, gaps and resolution."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from granite_lab.errors import InputError
from granite_lab.logs.quantities import DATE, factors
from granite_lab.logs.trial import Array

Rows = npt.NDArray[np.intp]
Mask = npt.NDArray[np.bool_]

GAP_PERIODS = 3.0  # a gap is a step of more than this many median periods
SECONDS = {unit: factor for unit, factor in factors("time").items() if unit != DATE}
_EPOCH = (9.4e8, 2.6e9)  # 2000 to 2052 in seconds since 1970
_FASTEST = 20000.0  # [Hz]
_ROUNDED = 1e-3  # by this share of a range the values may go beyond it: angles are rounded


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


def powers(count: float = 1.0) -> list[float]:
    """Return the ranges of counters of 7 to 32 bits, where one count is `count` of the logged unit."""
    return [2.0**bits * count for bits in range(7, 33)]


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
        count = int(np.count_nonzero(wraps))
        if span > width * (1 + _ROUNDED) or count == 0:
            continue
        short = np.where(wraps, steps - np.sign(steps) * width, steps)
        usual = float(np.abs(steps[~wraps]).max(initial=0.0))
        alike = (np.abs(short[wraps]) <= max(5 * usual, slack * width)).all()
        # Each wrap makes the steps jump by the range and back; without wraps they change little.
        changes, left = (np.diff(x, prepend=0.0, append=0.0) for x in (steps, short))
        saved = float(np.abs(changes).sum() - np.abs(short_way(left, width)).sum())
        if alike and saved > width * count:
            turns = np.concatenate(([0.0], np.cumsum(np.where(wraps, -np.sign(steps), 0.0))))
            return raw + turns * width, count, width
    return raw, 0, 0.0


def short_way(steps: Array, width: Array | float) -> Array:
    """Return steps (N,) of a counter that starts again after `width`, each read the short way round."""
    return np.asarray(steps - width * np.rint(steps / width))


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
