"""Time stamps: their unit, order, duplicates, gaps; and resets, which are refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from granite_lab.errors import InputError
from granite_lab.logs.quantities import DATE, factors
from granite_lab.logs.trial import Array

Rows = npt.NDArray[np.intp]
Mask = npt.NDArray[np.bool_]

GAP_PERIODS = 3.0
"""A gap is a step of more than this many median periods."""

SECONDS = {unit: factor for unit, factor in factors("time").items() if unit != DATE}
_EPOCH = (9.4e8, 2.6e9)  # 2000 to 2052 in seconds since 1970
_FASTEST = 20000.0


def runs(flags: Mask) -> list[tuple[int, int]]:
    """Return first and last sample of each stretch of flags."""
    edges = np.diff(np.concatenate(([0], flags.astype(np.int8), [0])))
    ends = np.flatnonzero(edges == -1) - 1
    return [(int(a), int(b)) for a, b in zip(np.flatnonzero(edges == 1), ends, strict=True)]


def integral(t: Array, x: Array) -> Array:
    """Integrate samples (N,) over their stamps (N,) by trapezoids, from 0 at the first."""
    return np.concatenate(([0.0], np.cumsum(np.diff(t) * (x[1:] + x[:-1]) / 2)))


def unit_factor(raw: Array, factor: float, slowest: float) -> tuple[float, str]:
    """Check the declared unit of stamps against their values.

    Args:
        raw: (N,) stamps of one sensor as logged.
        factor: seconds per unit, as declared.
        slowest: the lowest plausible sampling rate [Hz].

    Returns:
        the factor to use, and a warning if it is not the declared one.

    Raises:
        InputError: the stamps fit neither the declared nor exactly one other unit.
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
        raise InputError(
            f"stamps {rate / factor:.3g} times a second in the declared unit, expected {slowest:g} to 20000",
            "correct the unit of the time column",
        )
    unit = next(name for name, f in SECONDS.items() if f == fits[0])
    return fits[0], f"stamps are in {unit}, not in the unit declared: {rate / fits[0]:.4g} Hz"


def stray(raw: Array) -> list[slice]:
    """Find rows whose stamps leave the time line and come back to it as if the rows had been in time.

    A block that was written late is none of these: where it is missing, the time line has no hole.

    Args:
        raw: (N,) stamps as logged, in any unit.

    Returns:
        the blocks of rows whose stamps are wrong.
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
    """Put stamps in order: drop missing ones, sort late ones, keep the first of equal ones.

    Args:
        t: (N,) [s].
        values: (N, K) samples, to tell a block that was written twice from a new start.
        what: the sensor, for messages.
        where: from a row to its place in the file; None: the file.
        doubts: what had to be done is added here.

    Returns:
        (M,) stamps, strictly increasing, and the row each came from.

    Raises:
        InputError: the clock starts over in mid-file, or no two different stamps.
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
        raise InputError(
            f"{where(None)}: {what}: {count}, expected at least two",
            "the log is too short, or its clock stands still",
        )
    return stamps[new], rows[new]


def _refuse_reset(stamps: Array, values: Array, where: Callable[[int], str]) -> None:
    """Tell a clock that starts over from samples that merely arrived late.

    Late samples are few, or come as blocks that fit into holes of the time line. After a reset two
    long blocks of the file take turns on the time line.
    """
    cuts = np.flatnonzero(np.diff(stamps) < 0) + 1
    if len(cuts) > 0.5 * len(stamps):
        raise InputError(
            f"{where(int(cuts[0]))}: time runs backwards, from {stamps[0]:.3f} s to {stamps[-1]:.3f} s",
            "stamps increase from row to row: sort the log, or correct its time column",
        )
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
        raise InputError(
            f"{where(cut)}: time runs backwards by {jump:.3f} s and starts over at {stamps[cut]:.3f} s",
            "the clock was reset: cut the file there and read the parts as separate trials",
        )


def describe_gaps(t: Array, what: str) -> str:
    """Return a warning about gaps longer than `GAP_PERIODS` median periods, or nothing."""
    steps = np.diff(t)
    gaps = np.flatnonzero(steps > GAP_PERIODS * np.median(steps))
    if len(gaps) == 0:
        return ""
    worst = gaps[np.argmax(steps[gaps])]
    count = "one gap" if len(gaps) == 1 else f"{len(gaps)} gaps"
    return f"{what}: {count}, the longest {steps[worst]:.3f} s at t = {t[worst]:.3f} s"
