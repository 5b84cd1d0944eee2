"""Stamps of one sensor: unit, order, stamps that several samples share, gaps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.ndimage import uniform_filter1d

from granite_lab.errors import InputError
from granite_lab.logs.counters import Mask, Rows, mad_std
from granite_lab.logs.quantities import DATE, factors
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.trial import Array

GAP_PERIODS = 3.0  # a gap is a step of more than this many median periods
SECONDS = {unit: factor for unit, factor in factors("time").items() if unit != DATE}
_EPOCH = (9.4e8, 2.6e9)  # 2000 to 2052 in seconds since 1970
_FASTEST = 20000.0  # [Hz]
LONGEST_BATCH = 0.1
"""Samples that share a stamp for longer are not spread [s]: half of it is the time in which the slowest of
the robot's ramps is over."""
_DIFFER = 0.02  # share of the neighbours with one stamp that hold different values, if they are no copies
# Time since the last stamp over the time that the samples need. Below the first number a sample is a copy,
# above the second one some are lost.
_ROOM = 0.6, 2.0
_PAIR = 0.55  # so much for two that differ: a tick that is shorter holds two in less than one case in ten
_ON_GRID = 1e-3  # stamps that are multiples of their spacing to this share of it are those of a slow clock
_ROUNDED = 1 + 1e-6  # stamps every 0.1 s are not later for their rounding
_FEWEST = 3  # stamps of a clock that runs
_UNEVEN = 0.1  # scatter of the steps, as a share of the period, that motion sees
# If each stamp is late by itself, differences of stamps `_AHEAD` samples apart scatter as single steps do. If
# the steps themselves are uneven, the scatter grows by the root of `_AHEAD`. `_BOUNDED` of that is the limit.
_AHEAD, _BOUNDED = 10, 0.5
_BEYOND = 8.0  # a step this many std longer than usual is a gap
_LINE = 1.0  # length of the line about which stamps scatter [s]: clocks keep their rate meanwhile
_UNSTEADY = 0.1  # share of the batches for which there may have been too little or too much time


CRYSTAL = 1e-3
"""Rates of clocks with crystals differ by less: 100 ppm each, or 500 ppm while one is set by a network. Those
of a sensor without one are off by 1 % and more (MPU-6050, LSM6DS3)."""
FASTEST = 0.05
"""Oscillators without a crystal are off by some per cent: 1 % in a microcontroller after calibration, 10 %
without (ATmega328P), 5 % in an IMU (LSM6DS3)."""
_PARTS = 20  # of a log, in each of which the message that took least to arrive tells how its clock goes


@dataclass(frozen=True, eq=False)
class Stamps:
    """Stamps of one sensor in order.

    Attributes:
        t: (M,) [s], strictly increasing.
        rows: (M,) the sample each came from.
        std: of what all may be too early or too late by [s].
    """

    t: Array
    rows: Rows
    std: float = 0.0


def sampling_period(raw: Array) -> float:
    """Return the usual time from sample to sample (N,), some of which share a stamp; 0 if none differ."""
    steps = np.abs(np.diff(raw))
    ticks = np.flatnonzero(steps > 0)
    if len(ticks) == 0:
        return 0.0
    usual = float(np.median(steps[ticks]))
    if len(ticks) == len(steps):
        return usual
    sizes = np.diff(np.append(ticks, len(steps)))  # samples from each tick on
    near = steps[ticks] <= 1.5 * usual
    return float(steps[ticks][near].sum() / sizes[near].sum())


def unit_factor(raw: Array, factor: float, slowest: float) -> tuple[float, str]:
    """Check the declared unit of stamps (N,) of one sensor, `factor` seconds each, against their values.

    The sampling rate is `slowest` [Hz] at least. Returns the factor to use, and a warning if it is not the
    declared one. Stamps that fit neither the declared nor exactly one other unit are refused.
    """
    period = sampling_period(raw)
    if period == 0:
        return factor, ""
    rate = 1 / period  # a unit
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


Where = Callable[[int], str]
"""Names the place in the file of a sample, as ``folder/log.csv:12``."""


def _first(where: Where, row: int) -> str:
    """Name the first place in a warning, without the folder."""
    return f"({Path(where(row)).name} first)"


def tidy(
    t: Array, values: Array, sensor: str, where: Where, doubts: list[Doubt], *, spread: bool = True
) -> Stamps:
    """Put stamps (N,) [s] in order: drop missing ones, sort late ones, spread or drop equal ones.

    The samples (N, K) tell those that were written twice from those that share a stamp; `sensor` names the
    sensor. Without `spread` the first of equal stamps is kept.

    Raises:
        InputError: time runs backwards, stamps are shared for too long, or there are less than two.
    """
    rows, lost = np.flatnonzero(np.isfinite(t)), np.flatnonzero(~np.isfinite(t))
    if len(lost):
        first = _first(where, int(lost[0]))
        doubts.append(Doubt(f"{len(lost)} samples without a time stamp were left out {first}"))
    stamps = t[rows]
    back = np.flatnonzero(np.diff(stamps) < 0) + 1
    if len(back) > 0.5 * len(stamps):
        seen = f"time runs backwards, from {stamps[0]:.3f} s to {stamps[-1]:.3f} s"
        hint = "stamps increase from row to row: sort the log, or correct its time column"
        raise InputError(f"{where(int(rows[back[0]]))}: {sensor}: {seen}", hint)
    if len(back):
        late = int(np.count_nonzero(stamps < np.maximum.accumulate(stamps)))
        first = _first(where, int(rows[back[0]]))
        order = np.argsort(stamps, kind="stable")
        rows, stamps = rows[order], stamps[order]
        doubts.append(Doubt(f"{late} samples were not in the order of time {first}", remedy="sorted"))
    spaced = _apart(stamps, values[rows], sensor, lambda row: where(int(rows[row])), doubts, spread)
    if len(spaced.t) < 2:
        count = "a single stamp" if len(spaced.t) else "no sample"
        hint = "the log is too short, or its clock stands still"
        place = where(int(rows[0] if len(rows) else 0))
        raise InputError(f"{place}: {sensor}: {count}, expected at least two", hint)
    even, scatter = evened(spaced.t)
    if scatter:
        seen = f"stamps scatter by {1e3 * scatter:.2g} ms about an even spacing"
        doubts.append(Doubt(seen, remedy="spaced evenly; all may be late by as much"))
    return Stamps(even, rows[spaced.rows], float(np.hypot(spaced.std, scatter)))


def evened(t: Array) -> tuple[Array, float]:
    """Return stamps (N,) [s] by a line through those around each, and their scatter [s] if they need it.

    A sensor that samples evenly, but is stamped when the computer gets to it, has stamps that scatter about
    a line. Where the sampling itself is uneven, or samples are lost, they leave it farther and farther: then
    they stay, and the scatter is 0. So they do where it is below `_UNEVEN` of a period.
    """
    steps = np.diff(t)
    if len(steps) < 10 * _AHEAD:
        return t, 0.0
    period = float(np.median(steps))
    late = steps > max(GAP_PERIODS * period, period + _BEYOND * mad_std(steps))
    # stamps of a slow clock differ by whole ticks: of such steps the median deviation may be none
    gaps, std = np.flatnonzero(late) + 1, float(np.std(steps[~late]))
    passed = np.concatenate(([0], np.cumsum(late)))
    ahead = float(np.std((t[_AHEAD:] - t[:-_AHEAD])[passed[_AHEAD:] == passed[:-_AHEAD]]))
    if std < _UNEVEN * period or not ahead <= _BOUNDED * std * math.sqrt(_AHEAD):
        return t, 0.0
    even = t.copy()
    for begin, end in pairwise([0, *gaps, len(t)]):
        if end - begin > _AHEAD:
            index = np.arange(end - begin)
            line = np.polyval(np.polyfit(index, t[begin:end], 1), index)
            even[begin:end] = line + uniform_filter1d(t[begin:end] - line, round(_LINE / period) | 1)
    return even, std / math.sqrt(2.0)


def _apart(t: Array, values: Array, sensor: str, where: Where, doubts: list[Doubt], spread: bool) -> Stamps:
    """Give samples that share a stamp (N,), in order, stamps of their own; copies are dropped."""
    new = np.concatenate(([True], np.diff(t) > 0))[: len(t)]
    if new.all():
        return Stamps(t, np.arange(len(t)))
    tied = np.flatnonzero(~new)
    change = values[tied] - values[tied - 1]
    different = (np.isfinite(change) & (change != 0)).any(axis=1)
    keep, apart, std = new, t, 0.0
    if spread and different.mean() >= _DIFFER:
        apart, kept, std = _share_out(t, new, tied[different], f"{where(int(tied[0]))}: {sensor}")
        keep = new | kept
    if shared := int(np.count_nonzero(keep & ~new)):
        late = f"; all may be off by {1e3 * std:.3g} ms" if std else ""
        first = _first(where, int(tied[0]))
        same = f"{shared} samples ({shared / len(t):.0%}) have the stamp of another one {first}"
        doubts.append(Doubt(same, remedy=f"spread evenly over the time between stamps{late}"))
    if len(copies := np.flatnonzero(~keep)):
        first = _first(where, int(copies[0]))
        doubts.append(Doubt(f"{len(copies)} duplicate stamps {first}", remedy="the first of each was kept"))
    return Stamps(apart[keep], np.flatnonzero(keep), std)


def _share_out(t: Array, new: Mask, different: Rows, place: str) -> tuple[Array, Mask, float]:
    """Spread samples with equal stamps over the time of their batch; `new` (N,) is True where a batch begins.

    Samples (K,) are `different` from the one before, though they have its stamp.

    A driver that empties the FIFO of a sensor gives all samples the stamp of the read, so they lie between it
    and the one before, evenly. Stamps of the first sample, or of the last tick of a slow clock, stand for the
    time that follows: so it is where batches of different sizes fit into that better. A sample for which
    there is no room is a copy.

    Returns:
        stamps (N,) [s], which samples have one, and the std of what all may be off by, half a batch [s].

    Raises:
        InputError: batches last too long, or are so unsteady that samples are missing from them.
    """
    begin = np.flatnonzero(new)
    ticks, sizes = t[begin], np.diff(np.append(begin, len(t)))
    if len(ticks) < _FEWEST:
        return t, new, 0.0
    intervals, needed = np.diff(ticks), sizes * sampling_period(t)
    length = float(np.median(intervals))
    before, after = np.concatenate(([length], intervals)), np.append(intervals, length)
    usual = bool(sizes[sizes > 1].sum() > 0.5 * len(t))
    grid = usual and bool(np.quantile(np.abs(ticks / length - np.rint(ticks / length)), 0.9) < _ON_GRID)
    misfits = [float(np.abs(np.log(time / needed)[1:-1]).mean()) for time in (before, after)]
    follows = grid or (usual and misfits[1] < 0.5 * misfits[0])
    time = after if follows else before
    # a tick that is a little longer than a period may hold two samples
    pairs = np.isin(begin + 1, different) & (sizes == 2) & (time > _PAIR * needed)
    if usual:
        _refuse_batches(sizes, time / needed, length, place)
    fits = np.repeat(usual | (sizes == 1) | pairs | (time >= _ROOM[0] * needed), sizes)
    step = np.repeat(np.where(time <= _ROOM[1] * needed, time, needed) / sizes, sizes)
    ahead = np.arange(len(t)) - np.repeat(begin, sizes)  # samples of the batch before this one
    behind = np.repeat(sizes - 1, sizes) - ahead
    # Of a tick the digits behind were cut off, so samples lie in the middle of their shares of the time.
    shift = step * (ahead + 0.5 * grid if follows else -behind)
    return t + np.where(fits, shift, 0.0), fits, 0.5 * length * usual


def _refuse_batches(sizes: Rows, room: Array, length: float, place: str) -> None:
    """Refuse batches that are too long, or so unsteady that samples are missing from them.

    `room` is the time for a batch over what its samples need.
    """
    shared = float((sizes - 1).sum() / sizes.sum())
    seen = f"{place}: {shared:.0%} of the samples have the stamp of another one, {np.median(sizes):g} a stamp"
    hint = "log the time of every sample, or choose another time column"
    if length > LONGEST_BATCH * _ROUNDED:
        message = f"a stamp every {length:.3g} s, expected every {LONGEST_BATCH:g} s at least"
        raise InputError(f"{seen}, {message}", hint)
    crowded = sizes[room < 1 / _ROOM[1]].sum() / sizes.sum()
    if crowded + (room > 1.1 * _ROOM[1]).mean() > _UNSTEADY:
        message = f"from {sizes.min()} to {sizes.max()} whatever time has passed, expected a steady number"
        raise InputError(f"{seen}, {message}", hint)


def rate_by_arrival(t: Array, arrival: Array) -> float:
    """Return by how much the clock of stamps (N,) runs too slowly against their times of arrival [-].

    0 where these do not tell it to a third of `CRYSTAL`. Messages are late by chance, and never early.
    """
    parts = np.array_split(arrival - t, _PARTS)
    if len(t) < _PARTS * _FEWEST or not (span := float(t[-1] - t[0])) > 0:
        return 0.0
    late = np.array([part.min() for part in parts])
    middle = np.arange(_PARTS) / _PARTS
    (slope, _), ((variance, _), _) = np.polyfit(middle, late, 1, cov=True)
    return float(slope) / span if math.sqrt(variance) / span < CRYSTAL / 3.0 else 0.0


def ticks_too_rarely(t: Array) -> bool:
    """Say whether stamps (N,) stand still, or so many samples share each that they cannot be spread."""
    ticks = np.unique(t[np.isfinite(t)])
    if len(ticks) < _FEWEST:
        return True
    shared = bool(len(ticks) < 0.5 * np.count_nonzero(np.isfinite(t)))
    return shared and float(np.median(np.diff(ticks))) > LONGEST_BATCH


def gaps_in(t: Array, longest: float | None = None) -> list[tuple[float, float]]:
    """Return the gaps [s] of stamps (N,): steps beyond `longest` [s], or `GAP_PERIODS` median periods."""
    steps = np.diff(t)
    gaps = np.flatnonzero(steps > (GAP_PERIODS * float(np.median(steps)) if longest is None else longest))
    return [(float(t[i]), float(t[i + 1])) for i in gaps]


def doubt_gaps(t: Array, name: str) -> Doubt | None:
    """Return the doubt about the gaps in a sensor's stamps (N,), if there are any."""
    gaps = gaps_in(t)
    if not gaps:
        return None
    begin, end = max(gaps, key=lambda gap: gap[1] - gap[0])
    count = "one gap" if len(gaps) == 1 else f"{len(gaps)} gaps"
    return Doubt(f"{count}, the longest {end - begin:.3f} s at t = {begin:.3f} s", name)


def outside_gaps(at: Array, t: Array) -> Mask:
    """Say which instants (K,) lie between neighbouring stamps (N,) that are no gap apart."""
    steps = np.diff(t)
    place = np.clip(np.searchsorted(t, at) - 1, 0, len(steps) - 1)
    return np.asarray((at >= t[0]) & (at <= t[-1]) & (steps[place] <= GAP_PERIODS * np.median(steps)))
