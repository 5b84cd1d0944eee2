"""Values of wheel encoders to angles and rates: units, ranges, resets, wild readings, resolution."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from granite_lab.errors import InputError
from granite_lab.logs.counters import Mask, flagged, integral, powers, quantum, runs, unwrap
from granite_lab.logs.layouts import Column
from granite_lab.logs.quantities import Unit
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.sensors.repeats import between_readings
from granite_lab.logs.sensors.stamps import GAP_PERIODS
from granite_lab.logs.trial import Array
from granite_lab.parameters import Robot

_TURN = 2 * math.pi
_FASTEST_WHEEL = 300.0  # largest rate of a ground robot's wheel [rad/s]; a step that needs more is a fault
_DOWNHILL = 3.0  # largest rate of a wheel over that at the highest voltage of its motor
_TREAD = 15.0  # largest acceleration of a tread [m/s^2]: 1.5 g, by a tyre's friction with a margin
_LOST = 0.5  # wild readings and zeros for lost samples last no longer than this [s]
# A rate that is repeated for this time [s] and number of samples was not measured, if that is this many times
# as long as its usual repetitions.
_STUCK, _OFTEN = (0.1, 10), 5
_ROUNDING = 1e-3  # scatter of the levels of a grid, as a share of the largest
_MANY = 0.2  # share of jumps up to which they are faults
_SELDOM = 0.1  # levels of a coarse rate change in fewer samples than this share
_RETURNS = 6  # fewest changes of direction of values on a grid; a ramp of equal steps has none
_NEAR = 0.02  # a grid of rates is one of counts per period where it is so close to it
_CLEAR = 0.4  # steps up to this share of a range are read the short way round without a doubt


class Decoded(NamedTuple):
    """Signal of one encoder, decoded.

    Attributes:
        angle: (N,) [rad].
        rate: (N,) [rad/s] where that is logged, NaN where a reading is no measurement.
        resolution: smallest step of what is logged [rad] or [rad/s]; 0: not known.
        span: after which the angle starts again [rad]; 0: it does not.
    """

    angle: Array
    rate: Array | None
    resolution: float
    span: float = 0.0


@dataclass(frozen=True)
class Wheel:
    """What the units and limits of an encoder depend on."""

    per_rev: float = 0.0  # counts per wheel revolution; 0: not known
    radius: float = 1.0  # [m]
    fastest: float = _FASTEST_WHEEL  # [rad/s]

    @classmethod
    def of(cls, robot: Robot, per_rev: float) -> Wheel:
        """Return the wheel of a robot, which its motors limit where they are known."""
        return cls(per_rev, robot.wheels.radius, min(_DOWNHILL * top_rate(robot), _FASTEST_WHEEL))


def top_rate(robot: Robot) -> float:
    """Return the rate of a wheel at the highest voltage of its motor [rad/s], infinite if it is not known."""
    drive = robot.drive
    return drive.voltage_max / (drive.emf_constant * drive.gear_ratio) if drive else math.inf


def convert(t: Array, raw: Array, unit: Unit, spec: Column, wheel: Wheel, doubts: list[Doubt]) -> Decoded:
    """Turn one encoder's values (N,), finite, at increasing stamps [s] into wheel angle and rate.

    The unit says what kind of value they are; scale, wrap and increment are those of the column map.

    Raises:
        InputError: a rate whose overflows cannot be undone.
    """
    counted, is_angle = unit.name in ("counts", "counts/s"), unit.quantity in ("angle", "length")
    ranges = wrap_ranges(raw, unit, spec.wrap, wheel.per_rev)
    values, wraps, width = unwrap(raw, ranges, stated=spec.wrap > 0)
    if wraps:
        kind = "rate overflowed" if not is_angle else "counter wrapped"
        doubts.append(Doubt(f"the {kind} {wraps} times at {width:g}", remedy="unwrapped"))
    if wraps and not is_angle:
        values = _anchored(raw, values, width)
    factor = spec.scale * ((_TURN / wheel.per_rev if wheel.per_rev else math.nan) if counted else unit.factor)
    if unit.quantity in ("length", "speed"):
        factor /= wheel.radius
    size, whole = abs(factor), counted and bool((raw == np.rint(raw)).all())
    if is_angle:
        step = size * max(quantum(raw) or lattice(np.diff(raw)), 1.0 if whole else 0.0)
        if spec.increment:
            return Decoded(_without_jumps(t, np.cumsum(values) * factor, step, wheel, doubts), None, step)
        span = (width or spec.wrap) * size
        # A step that may be read in two ways is no jump.
        limit = max(wheel.fastest, span / float(np.median(np.diff(t))) if span and len(t) > 1 else 0.0)
        angle = _without_jumps(t, values * factor, step, replace(wheel, fastest=limit), doubts)
        return Decoded(angle, None, step, span)
    counts = _counts_per_period(t, values, wheel.per_rev * size / _TURN)
    coarse = quantum(raw) or lattice(raw) or few_levels(raw)
    step = size * (counts.rate if counts else max(coarse, 1.0 if whole else 0.0))
    rate = _measured(t, values * factor, step, wheel, doubts)
    finite = np.isfinite(rate)
    if counts and finite.all():
        return Decoded(counts.angle * factor, None, counts.step * size)
    return Decoded(integral(t, np.interp(t, t[finite], rate[finite]) if finite.any() else rate), rate, step)


class _Periods(NamedTuple):
    """Rates that are counts over the time in which they came, in the logged unit."""

    angle: Array  # (N,) the counts, added up
    step: float  # one count
    rate: float  # one count in a period


def _counts_per_period(t: Array, raw: Array, per_unit: float) -> _Periods | None:
    """Return the counter (N,) of which the logger made rates by dividing its steps by their time, if it did.

    The time was the one between two stamps, or always the same; `per_unit` counts make one unit of the angle
    (0: not known). Such rates lie on a grid, which is one count in a period. Where the counts are not known,
    rates that are on a grid by themselves may be readings of another device, and stay rates.
    """
    dt = np.diff(t)
    if len(t) < 20 or dt.max() > GAP_PERIODS * (period := float(np.median(dt))):
        return None
    times = np.append(period, dt)
    for passed in (times, np.full(len(t), period)):
        steps = raw * passed
        step = lattice(steps)
        by_count = per_unit > 0 and abs(step * per_unit - 1) < _NEAR
        if step > 0 and (by_count or lattice(raw) == 0.0):
            whole = np.rint(steps / step)
            return _Periods(np.cumsum(whole) * step, step, step / period)
    return None


def lattice(values: Array) -> float:
    """Return the step of a coarse grid on which values (N,) lie within their rounding; 0: they do not.

    Unlike `quantum` it finds grids of few levels, and of levels that scatter as stamps do.
    """
    if not values.size:
        return 0.0
    size = np.sort(np.abs(values))
    near = _ROUNDING * size[-1]
    cuts = np.flatnonzero(np.diff(size) > near) + 1
    levels = np.split(size, cuts)
    changes = np.diff(np.abs(values))
    changes = np.sign(changes[np.abs(changes) > near])
    returns = np.count_nonzero(changes[1:] != changes[:-1])
    few = returns < _RETURNS or not 2 <= len(levels) <= 0.1 / _ROUNDING
    if few or any(np.ptp(level) > 3 * near for level in levels):
        return 0.0
    middles, weights = np.array([level.mean() for level in levels]), np.array([len(x) for x in levels])
    middles = middles - middles[0] * (middles[0] <= near)
    whole = np.rint(middles / np.diff(middles).min())
    step = float(np.sum(weights * whole * middles) / max(np.sum(weights * whole**2), 1.0))
    return step if step > 0 and np.abs(middles / step - whole).max() < 0.05 else 0.0


def few_levels(values: Array) -> float:
    """Return the smallest step of values (N,) nine tenths of which repeat the last one; 0: fewer do.

    A rate that is rounded coarsely has too few levels for a grid to be recognised.
    """
    changes = np.abs(np.diff(values))
    changes = changes[changes > 0.0]
    return float(changes.min()) if 0 < changes.size < _SELDOM * values.size else 0.0


def wrap_ranges(raw: Array, unit: Unit, given: float, per_rev: float) -> list[float]:
    """List the ranges that a counter in this unit may have; `given` is the column map's (0: none)."""
    if given:
        return [given]
    if unit.name in ("counts", "counts/s"):
        # what reads whole numbers starts again after a whole number of them
        of_turn = [per_rev] if unit.name == "counts" and per_rev > 0 and per_rev == round(per_rev) else []
        return sorted([*powers(), *of_turn]) if (raw == np.rint(raw)).all() else []
    if unit.quantity not in ("angle", "angular rate"):
        return []
    turn, counts = _TURN / unit.factor, list[float]()
    if per_rev:  # a counter that the logger has turned into an angle, which may be rounded
        count = turn / per_rev
        whole = np.abs(raw / count - np.rint(raw / count)).max(initial=0.0) < _NEAR
        counts = powers(count) if whole else [size * count for size in (2.0**16, 2.0**32)]
    return sorted([turn, *counts]) if unit.quantity == "angle" else counts


def _anchored(raw: Array, rate: Array, width: float) -> Array:
    """Return rates (N,) that overflowed, 0 where the logged ones rest at 0; refuse what cannot be read.

    The first reading may have overflowed already; a change of nearly half the range may be one by the rest.
    """
    step = float(np.abs(np.diff(rate)).max(initial=0.0))
    calm = np.abs(raw) <= 1e-3 * width
    rests = [(a, b) for a, b in runs(calm) if b - a >= 5]
    turns = {round(float(rate[k] - raw[k]) / width) for a, b in rests for k in range(a, b)}
    if step > _CLEAR * width or len(turns) != 1:
        why = f"by up to {step / width:.0%} of its range" if turns else "and never rests at 0"
        message = f"the rate overflows at {width:g} and changes from sample to sample {why}"
        raise InputError(f"{message}: not to be read", "log it in wider numbers, or log the counter itself")
    return rate - turns.pop() * width


def caught_up(t: Array, angle: Array) -> Mask:
    """(N,) True where the last value was logged again, as a bus that hangs does, and the counter went on.

    A turning wheel's counter then stands much longer than it usually does, and makes up for it in one step.
    """
    lost, after = np.zeros(len(angle), dtype=bool), np.flatnonzero(np.diff(angle) != 0) + 1
    if len(after) < 4 * _OFTEN:
        return lost
    lengths, sizes = np.diff(after), np.abs(np.diff(angle)[after - 1])
    usual = float(np.quantile(lengths, 0.95))
    for k in np.flatnonzero(lengths >= max(_OFTEN, _OFTEN * usual)):
        if not _OFTEN <= k < len(after) - 1 - _OFTEN:
            continue
        a, b = int(after[k]), int(after[k + 1])  # the first sample of the value, and of the next one
        behind, ahead = int(after[k - _OFTEN]), int(after[k + 1 + _OFTEN])
        rates = (angle[a] - angle[behind]) / (t[a] - t[behind]), (angle[ahead] - angle[b]) / (t[ahead] - t[b])
        low, high = np.sort(np.array(rates) * (t[b] - t[a]))
        step = angle[b] - angle[a]
        made_up = min(abs(low), abs(high)) < 2 * abs(step) < 4 * max(abs(low), abs(high))
        # a wheel that stops and sets off makes no larger steps than before and after
        beside = float(np.delete(sizes[k - _OFTEN : k + 2 + _OFTEN], _OFTEN + 1).max())
        if low * high > 0 and step * low > 0 and made_up and abs(step) > 2 * beside:
            lost[a + 1 : b] = True
    return lost


def _without_jumps(t: Array, angle: Array, step: float, wheel: Wheel, doubts: list[Doubt]) -> Array:
    """Take out steps that no wheel can make: the counter was reset, lost counts, or a sample is wrong.

    What was logged again while the wheel turned on is NaN.
    """
    lost, repeats = caught_up(t, angle), between_readings(t, angle, step)
    doubts += flagged(lost, t, "reading", "that repeat the last one", "left out")
    if repeats.any():
        seen = f"{repeats.mean():.0%} of the rows repeat the reading before: the log is faster than it"
        doubts.append(Doubt(seen, remedy="the first row of each is used"))
        lost |= repeats
    known, kept = np.full(len(angle), np.nan), ~lost
    known[kept] = _joined(t[kept], _counted_on(t[kept], angle[kept], step, wheel, doubts), wheel, doubts)
    return known


def _counted_on(t: Array, angle: Array, step: float, wheel: Wheel, doubts: list[Doubt]) -> Array:
    """Return a counter (N,) as if it had lost no counts: it stands, and turns again, within a sample."""
    if len(angle) < 4 * _OFTEN:
        return angle
    dt, steps = np.diff(t), np.diff(angle)
    rates = np.append(steps[:1] / dt[:1], steps / dt)
    stops = _strayed(t, rates, step / float(np.median(dt)), wheel.radius)[1:] & (steps == 0.0)
    for a, b in runs(stops):
        beside = np.sign(np.concatenate([steps[max(a - _OFTEN, 0) : a], steps[b : b + _OFTEN]]))
        stops[a:b] = abs(beside.sum()) == 2 * _OFTEN  # it turns on, the same way
    if not stops.any():
        return angle
    seen = "without a count between two at full speed"
    doubts += flagged(stops, t[1:], "reading", seen, "taken to turn on meanwhile", grade="fair")
    return _at_usual_rate(t, angle, stops)


def _at_usual_rate(t: Array, angle: Array, steps: Mask) -> Array:
    """Return a counter (N,) whose flagged steps (N-1,) are made at the rate between those beside them."""
    middle, times, made = (t[1:] + t[:-1]) / 2, np.diff(t), np.diff(angle)
    rate = uniform_filter1d((made / times)[~steps], _OFTEN, mode="nearest")  # whole counts scatter
    usual = np.interp(middle, middle[~steps], rate) * times
    return np.asarray(angle[0] + np.concatenate(([0.0], np.cumsum(np.where(steps, usual, made)))))


def _joined(t: Array, angle: Array, wheel: Wheel, doubts: list[Doubt]) -> Array:
    """Return a counter without steps that no wheel can make.

    A single sample from which the next one returns is replaced by the line between its neighbours. After a
    reset the wheel goes on at the rate between those before and after it.
    """

    def too_fast(step: Array, time: Array) -> np.ndarray:
        return np.abs(step) > wheel.fastest * time

    wild = too_fast(np.diff(angle), np.diff(t))
    if not wild.any() or wild.all() or np.count_nonzero(wild) > 0.01 * len(wild) + 2:
        return angle
    single = np.zeros(len(angle), dtype=bool)
    single[1:-1] = wild[:-1] & wild[1:] & ~too_fast(angle[2:] - angle[:-2], t[2:] - t[:-2])
    angle = np.interp(t, t[~single], angle[~single])
    wild = too_fast(np.diff(angle), np.diff(t))
    doubts += flagged(single, t, "reading", "thrown off", "replaced by their neighbours")
    anew = "from which the counter starts anew"
    doubts += flagged(wild, t[1:], "reading", anew, "joined to what was before")
    return _at_usual_rate(t, angle, wild)


def _measured(t: Array, rate: Array, step: float, wheel: Wheel, doubts: list[Doubt]) -> Array:
    """Return rates (N,) [rad/s], NaN where a reading is none of the wheel's, which is reported.

    Such readings are beyond what the wheel can do, leave their neighbours and return faster than a wheel can
    (thrown off, or 0 for a lost sample), or repeat the one before for longer than the resolution explains.
    """
    if len(t) < 5:
        return rate
    wild = np.abs(rate) > wheel.fastest
    if np.count_nonzero(wild) > 0.05 * len(wild):  # then it is the unit, which is judged later
        return rate
    wild |= _strayed(t, np.where(wild, np.interp(t, t[~wild], rate[~wild]), rate), step, wheel.radius)
    stuck = _repeated(t, rate, step) & ~wild
    doubts += flagged(wild, t, "reading", "thrown off or 0 for a lost sample", "left out")
    doubts += flagged(stuck, t, "reading", "that repeat the last one", "left out")
    return np.where(wild | stuck, np.nan, rate)


def _strayed(t: Array, rate: Array, step: float, radius: float) -> Mask:
    """(N,) True from a jump that no wheel makes to the one by which the rate returns."""
    change, dt = np.diff(rate), np.diff(t)
    top = float(np.quantile(np.abs(rate), 0.95))
    limit = np.maximum(_TREAD / radius * dt, max(3 * step, 0.3 * top))
    jumps = np.flatnonzero(np.abs(change) > limit)
    strays, k = np.zeros(len(rate), dtype=bool), 0
    if len(jumps) > _MANY * len(rate):  # then jumps are the rule
        return strays
    while k < len(jumps):
        i = jumps[k]
        # The first jump within reach after which the rate is again what it was before.
        back = [
            j for j in jumps[k + 1 : k + 50]
            if t[j + 1] - t[i] <= _LOST + dt[i] and abs(rate[j + 1] - rate[i]) < 0.5 * abs(change[i])
        ]  # fmt: skip
        k += 1
        if back:
            strays[i + 1 : back[0] + 1] = True
            k = int(np.searchsorted(jumps, back[0])) + 1
    return strays


def _repeated(t: Array, rate: Array, step: float) -> Mask:
    """(N,) True where a turning wheel's rate repeats the last one much longer than it usually does."""
    edges = np.concatenate(([0], np.flatnonzero(np.diff(rate) != 0) + 1, [len(rate)]))
    lengths, repeats = np.diff(edges), np.zeros(len(rate), dtype=bool)
    moving, changes = rate[edges[:-1]] != 0, np.abs(np.diff(rate))
    # A rate of coarse steps repeats itself while the wheel turns steadily.
    if np.count_nonzero(moving) < 20 or float(np.median(changes[changes > 0])) < 3 * step:
        return repeats
    usual = float(np.quantile(lengths[moving], 0.95))
    for a, b in zip(edges[:-1][moving], edges[1:][moving], strict=True):
        if b - a >= max(_STUCK[1], _OFTEN * usual) and t[b - 1] - t[a] >= _STUCK[0]:
            repeats[a + 1 : b] = True
    return repeats
