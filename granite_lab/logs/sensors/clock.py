"""The clock of a file: which column it is, and one time line where it wrapped or was set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from granite_lab.errors import InputError
from granite_lab.logs.counters import Mask, Rows, mad_std, unwrap
from granite_lab.logs.dates import RANGES
from granite_lab.logs.layouts import Binding
from granite_lab.logs.quantities import DATE, ENCODERS, SENSORS
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.sensors.stamps import (
    GAP_PERIODS,
    SECONDS,
    sampling_period,
    ticks_too_rarely,
    unit_factor,
)
from granite_lab.logs.source import Source
from granite_lab.logs.trial import Array

_WRAPS = (2.0**16, 2.0**24, 2.0**32)  # ranges of counters that loggers use as clocks
_KINDS = ("acceleration", "rate", "wheels")  # sensors that show how the clock runs
_AROUND = 50  # samples on either side of a step of the clock, by which its period is known
_DISORDER = 0.1  # where a larger share of the rows comes late, order tells nothing of the clock
_SEEN = 2  # so many samples fall where others are if a clock went back; sorting repairs a smaller step
_STOOD = 0.3  # counters that go on over a gap by less than this share of their usual rate stood meanwhile
_MOST_STEPS = 20  # a clock that is set more often is none
_BEGINNING = 1.0  # a clock that goes back to this time after the first stamp starts over [s]


def sampled(source: Source, channels: Sequence[str]) -> Mask:
    """Return which rows hold a sample of any of the channels."""
    rows = np.zeros(len(source.kept), dtype=bool)
    for binding in source.bindings(*channels):
        rows |= np.isfinite(source.columns[binding.place])
    return rows


def row_stamps(source: Source) -> Array:
    """Return the stamp of every row [s], from the first clock that ticks often enough."""
    binding = _chosen(source)
    column = f"column '{binding.name}'"
    logged, factor = source.columns[binding.place], binding.factor
    for part in source.bindings("t_add"):  # as nanoseconds beside seconds
        logged = logged * factor + source.columns[part.place] * part.factor
        factor = 1.0
    for block in _stray_rows(source, logged):
        away = f"{len(block)} stamps from here on leave the time line (to {logged[block[0]]:.10g})"
        where = f"{source.place(int(block[0]))}: {column}"
        source.doubts.append(Doubt(f"{away} and come back", where, "left out"))
        logged = logged.copy()
        logged[block] = np.nan
    raw, finite = logged.copy(), np.isfinite(logged)
    usual = RANGES if binding.unit.name == DATE else _WRAPS
    ranges = (binding.spec.wrap,) if binding.spec.wrap else usual
    raw[finite], wraps, width = unwrap(logged[finite], ranges, slack=0.0)
    if wraps:
        source.doubt(f"the clock wrapped {wraps} times at {width:.0f}", remedy="unwrapped")
    for kind in _KINDS:
        rows = sampled(source, SENSORS[kind].channels) & np.isfinite(raw)
        if np.count_nonzero(rows) < 3:
            continue
        try:
            factor, doubt = unit_factor(raw[rows], factor, SENSORS[kind].slowest)
        except InputError as error:
            raise source.refuse(f"{column}: {error.message}", error.hint) from None
        if doubt:
            source.doubt(doubt, column)
            if not source.bindings("t_add"):
                source.units["t"] = next(unit for unit, size in SECONDS.items() if size == factor)
        break
    return raw * factor


def _chosen(source: Source) -> Binding:
    """Return the first clock that ticks often enough, else the first that runs at all; refuse none."""
    clocks = source.bindings("t")
    added = sum(source.columns[part.place] * part.factor for part in source.bindings("t_add"))
    stamps = [source.columns[clock.place] * clock.factor + added for clock in clocks]
    logged = [t[np.isfinite(t)] for t in stamps]
    runs = [len(t) > 1 and bool(np.diff(t).any()) for t in logged]
    best = max(range(len(clocks)), key=lambda k: (not ticks_too_rarely(logged[k]), runs[k]))
    if not runs[best]:
        message = f"column '{clocks[0].name}' does not advance, expected time stamps"
        raise source.refuse(message, "a log needs at least two rows with stamps that increase")
    for clock, t, on in zip(clocks[:best], logged, runs, strict=False):
        if len(t):
            fault = "ticks too rarely" if on else f"is {t[0] / clock.factor:.10g} throughout"
            used = f"the stamps are those of '{clocks[best].name}'"
            source.doubt(f"column '{clock.name}' {fault}", remedy=used)
    return clocks[best]


def _stray_rows(source: Source, logged: Array) -> list[Rows]:
    """Return blocks of rows that are `stray` among the rows of their own sensor.

    Sensors whose rows take turns in a file may have clocks of their own, seconds apart.
    """
    blocks: dict[int, Rows] = {}
    sensors = [sampled(source, kind.channels) for name, kind in SENSORS.items() if name != "time"]
    for sensor in (*sensors, ~np.any(sensors, axis=0)):
        rows = np.flatnonzero(sensor)
        for block in stray(logged[rows]):
            blocks.setdefault(int(rows[block.start]), rows[block])
    return [blocks[row] for row in sorted(blocks)]


def stray(raw: Array) -> list[slice]:
    """Return blocks of rows whose stamps (N,) leave the time line and come back as if they had been in time.

    A block that was written late is none of these: where it is missing, the time line has no hole.
    """
    seen = np.flatnonzero(np.isfinite(raw))
    steps = np.diff(raw[seen])
    jumps = np.flatnonzero(np.abs(steps) > 20 * _usual(raw[seen]))
    if not 2 <= len(jumps) <= 1000:
        return []
    period = float(np.mean(np.delete(steps, jumps))) if len(jumps) < len(steps) else 0.0
    if period <= 0:
        return []
    blocks: list[slice] = []
    done = -1
    for k, i in enumerate(jumps):
        for j in jumps[k + 1 : k + 20]:
            begin, end, block = raw[seen[i]], raw[seen[j + 1]], raw[seen[i + 1 : j + 1]]
            hole, count, leaves = end - begin, int(j - i), block.min() < begin or block.max() > end
            fits = count < 0.2 * len(seen) and 0.3 < hole / ((count + 1) * period) < 3
            if i > done and leaves and fits:
                blocks.append(slice(int(seen[i + 1]), int(seen[j]) + 1))
                done = j
                break
    return blocks


def _usual(t: Array) -> float:
    """Return the median of the steps (N,) that are not 0, in either direction; 1 if there is none."""
    steps = np.abs(np.diff(t))
    return float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0


def set_back(t: Array, values: Array) -> list[int]:
    """Return the samples at which a clock went back, in the order of the file; none where rows came late.

    Late rows fit into holes that the stamps (N,) of the others leave. After a step of the clock they fall
    where others are, or before all of them, and go on from there without a hole. Rows that were written
    twice, with the same values (N, K), tell nothing.
    """
    cuts = np.flatnonzero(np.diff(t) < 0) + 1
    if not 0 < len(cuts) <= _DISORDER * len(t):
        return []
    period, highest = _usual(t), np.maximum.accumulate(t)
    block = np.searchsorted(cuts, np.arange(len(t)), side="right")
    order = np.argsort(t, kind="stable")
    x = np.nan_to_num(values[order])
    twice = (np.diff(t[order]) == 0) & (x[1:] == x[:-1]).all(axis=1)
    order = order[np.concatenate(([True], ~twice))]
    s, b = t[order], block[order]
    first = np.flatnonzero(np.concatenate(([True], np.diff(b) != 0)))  # of each run of one block
    before = np.concatenate(([-np.inf], s[first[1:] - 1]))
    after = np.concatenate((s[first[1:]], [np.inf]))
    lasts = np.concatenate((first[1:], [len(s)])) - 1
    taken = after - before <= 1.5 * period
    if after[0] - s[lasts[0]] > GAP_PERIODS * period:
        taken[0] = True  # a block before all others that does not reach to them
    wrong = np.repeat(taken, lasts - first + 1)
    within = s <= np.concatenate(([-np.inf], highest[cuts - 1]))[b]
    within[: lasts[0] + 1] &= taken[0]  # what reaches to all others from before may have been written late
    count = np.bincount(b, weights=within, minlength=len(cuts) + 1)[1:]
    count_wrong = np.bincount(b, weights=within & wrong, minlength=len(cuts) + 1)[1:]
    steps: list[int] = []
    for k in np.flatnonzero((count_wrong >= _SEEN) & (count_wrong > 0.5 * count)):
        cut, end = int(cuts[k]), int(cuts[k + 1]) if k + 1 < len(cuts) else len(t)
        past = np.flatnonzero(t[cut:end] > highest[cut - 1])
        on = cut + int(past[0]) if len(past) else end - 1
        # Rows that were written twice end in a jump to where the file was.
        back = 0.5 * float(t[cut - 1] - t[cut])
        if np.diff(t[cut : on + 1]).max(initial=0.0) <= max(GAP_PERIODS * period, back):
            steps.append(cut)
    return steps


@dataclass(frozen=True)
class Step:
    """A step of a clock between two neighbouring samples of a sensor."""

    size: float  # by which the clock went on too far, negative: back [s]
    std: float  # of the size [s]
    period: float  # of the sensor [s]


def step_at(t: Array, cut: int) -> Step:
    """Measure a step of the clock ahead of the sample `cut` by the usual time from sample to sample."""
    near = np.diff(t[max(cut - _AROUND, 0) : cut + _AROUND])
    near = near[near > 0]
    period = float(np.median(near)) if len(near) else 0.0
    std = mad_std(near, period) if len(near) else np.inf
    return Step(float(t[cut] - t[cut - 1]) - period, std, period)


def goes_on(counts: Array, cut: int) -> bool:
    """Say whether counters (N, K) go on over the sample `cut` as they do around it, NaN where not logged."""
    wheels = [wheel for wheel in counts.T if np.isfinite(wheel).all()]
    steps = [np.abs(np.diff(wheel)) for wheel in wheels]
    around = [np.delete(step[max(cut - 20, 0) : cut + 20], min(cut - 1, 19)) for step in steps]
    alike = [step[cut - 1] <= 2 * near.max(initial=0.0) for step, near in zip(steps, around, strict=True)]
    return not alike or sum(alike) > 0.5 * len(alike)


def set_forward(t: Array, counts: Array) -> list[int]:
    """Return the samples at which a clock was set forward: counters (N, K) turn, but not over the gap.

    While the counters stand, so was one over a gap that is longer than all the rest of the log.
    """
    period, steps = _usual(t), list[int]()
    scatter = mad_std(np.diff(t), period)
    for cut in (np.flatnonzero(np.diff(t) > GAP_PERIODS * max(period, 3.0 * scatter)) + 1).tolist():
        gap = float(t[cut] - t[cut - 1])
        near, at = np.abs(np.diff(counts[max(cut - 6, 0) : cut + 6], axis=0)), min(cut - 1, 5)
        if at == 0 or at == len(near) - 1:
            continue
        usual = np.minimum(np.median(near[:at], axis=0), np.median(near[at + 1 :], axis=0))
        turning = usual > 0
        if turning.any():
            stood = bool(np.median((near[at] - _STOOD * gap / period * usual)[turning]) < 0)
        else:
            stood = gap > float(np.ptp(t)) - gap and goes_on(counts, cut)
        if stood:
            steps.append(cut)
    return steps


def one_line(source: Source, t: Array) -> tuple[Array, list[Doubt]]:
    """Return the stamps of all rows (N,) [s] as if the clock had never been set, and warnings.

    A clock that was set back or forward is seen in the order of the file, sensor by sensor, before anything
    is sorted. What follows is put behind what was before by the usual time from sample to sample.

    Raises:
        InputError: the clock starts over, or counters do not go on where it was set.
    """
    t, doubts = t.copy(), list[Doubt]()
    for _ in range(_MOST_STEPS):
        series = _series(source, t)
        cuts = [(rows[cut - 1], rows[cut]) for rows, cut in _first_steps(source, t, series)]
        if not cuts:
            return t, doubts
        between = np.arange(*min(cuts)) + 1
        between = between[np.isfinite(t[between])]
        change = np.diff(t[between], prepend=t[min(cuts)[0]])
        row = int(between[np.argmax(np.abs(change))])
        steps = [
            step_at(t[rows], k) for rows in series if 0 < (k := int(np.searchsorted(rows, row))) < len(rows)
        ]
        best = min(steps, key=lambda step: step.std)
        _refuse_step(source, t, row, best, steps)
        t[row:] -= best.size
        way, place = "back" if best.size < 0 else "forward", Path(source.place(row)).name
        jump = f"the clock was set {way} by {abs(best.size):.4g} ± {best.std:.1g} s"
        doubts.append(Doubt(jump, place, "the stamps from there on are joined to those before"))
    raise source.refuse(f"the clock was set more than {_MOST_STEPS} times", "choose another time column")


def _series(source: Source, t: Array) -> list[Rows]:
    """Return the rows of each sensor that have a stamp."""
    finite = np.isfinite(t)
    return [
        rows
        for kind in _KINDS
        if len(rows := np.flatnonzero(sampled(source, SENSORS[kind].channels) & finite)) > 2
    ]


def _first_steps(source: Source, t: Array, series: Sequence[Rows]) -> list[tuple[Rows, int]]:
    """Return, for each sensor that sees one, its rows and the sample at which the clock was first set."""
    steps: list[tuple[Rows, int]] = []
    clocks = {b.place for b in source.bindings("t", "t_add")}
    measured = [source.columns[b.place] for b in source.match.bindings if b.place not in clocks]
    for rows in series:
        logged = [values[rows] for values in measured if np.isfinite(values[rows]).any()]
        values = np.reshape(logged, (len(logged), len(rows))).T
        steps += [(rows, cut) for cut in set_back(t[rows], values)[:1]]
    rows, counts = _counted(source, t)
    for cut in set_forward(t[rows], counts) if len(rows) > 2 else ():
        between = t[rows[cut - 1] : rows[cut] + 1]
        between = between[np.isfinite(between)]
        if np.diff(between).max() > 0.5 * np.ptp(between):  # else the others went on
            return [*steps, (rows, cut)]
    return steps


def _counted(source: Source, t: Array) -> tuple[Rows, Array]:
    """Return the rows (M,) in which all counters of the wheels are logged, and their values (M, K)."""
    counters = [
        b
        for b in source.bindings(*ENCODERS)
        if b.unit.quantity in ("angle", "length") and not b.spec.increment
    ]
    counters = [b for b in counters if np.isfinite(source.columns[b.place]).any()]
    if not counters:
        return np.zeros(0, dtype=np.intp), np.zeros((0, 1))
    values = np.column_stack([source.columns[b.place] for b in counters])
    rows = np.flatnonzero(np.isfinite(values).all(axis=1) & np.isfinite(t))
    return rows, values[rows]


def _refuse_step(source: Source, t: Array, row: int, best: Step, steps: Sequence[Step]) -> None:
    """Refuse a step of the clock over which time may have passed that nothing shows."""
    if best.size > 0:
        _refuse_burst(source, t, row)
    rows, counts = _counted(source, t)
    cut = int(np.searchsorted(rows, row))
    counted = 0 < cut < len(rows)
    alike = all(abs(step.size - best.size) <= step.period + best.period for step in steps)
    beginning = float(np.nanmin(t[:row])) + _BEGINNING
    clear = goes_on(counts, cut) if counted else best.size > 0 or t[row] > beginning
    if alike and clear and best.std <= 0.5 * best.period:
        return
    way = f"backwards by {-best.size:.3f} s" if best.size < 0 else f"on by {best.size:.3f} s"
    message = f"time runs {way} and starts over at {t[row]:.3f} s"
    if not alike:
        message += ", for some of the sensors only"
    elif counted and not clear:
        message += ", and the wheels' counters do not go on"
    hint = "the clock was reset: cut the file there and read the parts as separate trials"
    raise InputError(f"{source.place(row)}: {message}", hint)


def _refuse_burst(source: Source, t: Array, row: int) -> None:
    """Refuse samples that waited and were stamped at once, as they came: it looks like a step of the clock.

    Their number fits into the time without samples before them. When each was taken is not known.
    """
    for rows in _series(source, t):
        at_once = np.flatnonzero(t[rows] == t[row])
        if len(at_once) < 2 or at_once[0] == 0:
            continue
        gap = float(t[row] - t[rows[at_once[0] - 1]])
        if len(at_once) * sampling_period(t[rows]) > 0.5 * gap:
            seen = f"{len(at_once)} samples have the stamp {t[row]:.3f} s, after {gap:.3f} s without any"
            message = f"{source.place(row)}: {seen}: they were stamped when they arrived"
            raise InputError(message, "log the time at which each sample was taken, or choose that column")
