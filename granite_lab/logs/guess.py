"""What the columns of a log seem to be, by their names, places and values."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from granite_lab.errors import InputError
from granite_lab.logs.dates import are_times_of_day
from granite_lab.logs.quantities import (
    ACCELERATION,
    DATE,
    ENCODERS,
    RATE,
    WORDS,
    ColumnReport,
    Unit,
    by_name,
    find_unit,
    gravity_unit,
    words,
)
from granite_lab.logs.sensors.stamps import SECONDS, ticks_too_rarely, unit_factor
from granite_lab.logs.table import Table
from granite_lab.logs.trial import Array

# The length of a direction scatters by less than this share, written with four decimals; and gravity in m/s²,
# the larger of two units of which whole numbers are too coarse.
_UNIT_LENGTH, _WHOLE_NUMBERS = 1e-3, 10.0

Guesses = dict[int, ColumnReport]  # the place of a column, and what it seems to be


def guess(table: Table, columns: Mapping[int, Array]) -> list[ColumnReport]:
    """Guess what columns (N,) of a log are, from their places and values, dates as seconds since 1970."""
    guesses = {place: called(table, place) for place in columns}
    _dates(guesses, table, columns)
    _seconds_and_parts(guesses, columns)
    _running(guesses, columns)
    _first_only(guesses)
    _time(guesses, columns)
    _triples(guesses, columns)
    _encoders(guesses, columns)
    return list(guesses.values())


def _dates(guesses: Guesses, table: Table, columns: Mapping[int, Array]) -> None:
    """Find dates and times of day, which may stand in two columns."""
    dated = [place for place in columns if table.is_dated(place)]
    times = [place for place in dated if are_times_of_day(table.filled(place))]
    days = [place for place in dated if not (columns[place] % 86400.0).any()]
    if times and days:
        day, time, sure = days[0], times[0], {"confidence": 0.95, "assumed": False}
        _set(guesses, day, DATE, f"day, with the time in '{guesses[time].name}'", to=("t",), **sure)
        _set(guesses, time, DATE, f"time of day, with '{guesses[day].name}'", to=("t_add",), **sure)
        dated = [place for place in dated if place not in (day, time)]
    for place in dated:
        fine = bool((np.diff(columns[place]) != 0).mean() > 0.5) if len(columns[place]) > 1 else False
        _set(guesses, place, DATE, "dates", to=("t",), confidence=0.95 if fine else 0.3, assumed=False)


def _running(guesses: Guesses, columns: Mapping[int, Array]) -> None:
    """Leave out a clock that stands still or ticks too rarely, where another one runs."""
    clocks = [place for place, column in guesses.items() if column.to == ("t",)]
    apart = any(column.to == ("t_add",) for column in guesses.values())
    idle = [] if apart else [place for place in clocks if ticks_too_rarely(columns[place])]
    for place in idle if len(idle) < len(clocks) else ():
        _set(guesses, place, "", "a clock that ticks too rarely", to=(), confidence=0.0)


def called(table: Table, place: int) -> ColumnReport:
    """Guess what a column is from its name alone."""
    return replace(by_name(table.headers[0][place] if table.headers else "", place), name=table.names[place])


def _set(guesses: Guesses, place: int, unit: str, why: str, **more: Any) -> None:
    """Change the guess about a column."""
    guesses[place] = replace(guesses[place], unit=unit, why=why, **more)


def _seconds_and_parts(guesses: Guesses, columns: Mapping[int, Array]) -> None:
    """Find whole seconds and the parts of a second in two columns: ``stamp.secs``, ``stamp.nsecs``."""
    stems: dict[str, int] = {}
    parts: list[tuple[str, int, Unit]] = []
    for place, column in guesses.items():
        hit = re.fullmatch(r"((?:.*[^A-Za-z])?)([A-Za-z]+)[\])]?", column.name.strip())
        unit = find_unit(hit[2]) if hit else None
        if hit and unit and unit.name == "s":
            stems.setdefault(hit[1].lower(), place)
        elif hit and unit and unit.quantity == "time" and unit.name != DATE:
            parts.append((hit[1].lower(), place, unit))
    for stem, part, unit in parts:
        whole = stems.get(stem, part)
        seen = np.isfinite(columns[part]) & np.isfinite(columns[whole])
        s, p = columns[whole][seen], columns[part][seen] * unit.factor
        if whole == part or len(s) < 6 or (s != np.rint(s)).any() or (p < 0).any() or (p >= 1).any():
            continue
        # The parts start again just where the seconds go on, and only there.
        if (np.diff(s + p) >= 0).mean() > 0.98 and (np.diff(s) > 0).any() and np.ptp(p) > 0.5:
            sure = {"confidence": 0.98, "assumed": False}
            why = f"with '{guesses[part].name}': whole seconds and their parts"
            _set(guesses, whole, "s", why, to=("t",), **sure)
            why = f"part of a second, belongs to '{guesses[whole].name}'"
            _set(guesses, part, unit.name, why, to=("t_add",), **sure)
            return


def _first_only(guesses: Guesses) -> None:
    """Let each channel keep its surest column."""
    taken: dict[str, int] = {}
    for place, column in sorted(guesses.items(), key=lambda item: -item[1].confidence):
        rival = next((taken[channel] for channel in column.to if channel in taken), None)
        if rival is not None:
            _set(guesses, place, "", f"same quantity as '{guesses[rival].name}'", to=(), confidence=0.0)
        taken |= dict.fromkeys(guesses[place].to, place)


def _time(guesses: Guesses, columns: Mapping[int, Array]) -> None:
    """Find a clock by its values, if no name says so, and its unit by the rate."""
    clocks = [place for place, column in guesses.items() if column.to == ("t",)]
    for place, values in columns.items():
        steps = np.diff(values[np.isfinite(values)])
        # A clock ticks about evenly and never back.
        if not clocks and len(steps) > 5 and (steps >= 0).mean() > 0.98 and np.median(steps) > 0:
            unevenness = np.quantile(steps, 0.9) / np.median(steps)
            if unevenness < 3 and (not guesses[place].to or unevenness < 1.5):
                clocks = [place]
                _set(guesses, place, "s", "increases evenly", to=("t",), confidence=0.6, assumed=True)
    for place in clocks:
        column, stamps = guesses[place], columns[place][np.isfinite(columns[place])]
        for slowest in (4.0, 0.5) if column.assumed else ():
            with suppress(InputError):
                factor, _ = unit_factor(stamps, 1.0, slowest)
                unit = next(name for name, size in SECONDS.items() if size == factor)
                _set(guesses, place, unit, f"{column.why}; unit by the rate")
                break


def _triples(guesses: Guesses, columns: Mapping[int, Array]) -> None:
    """Find an accelerometer by gravity, and set its unit and the gyroscope's by the values."""
    places = {channel: place for place, column in guesses.items() for channel in column.to}
    free = [place for place, column in guesses.items() if not column.to]
    if all(channel in places for channel in ACCELERATION):
        trios = [tuple(places[channel] for channel in ACCELERATION)]
    else:
        trios = [] if set(places) & set(ACCELERATION) else [*zip(free, free[1:], free[2:], strict=False)]
    for trio in trios:
        values = np.column_stack([columns[place] for place in trio])
        whole = values[np.isfinite(values).all(axis=1)]
        size = float(np.median(np.linalg.norm(whole, axis=1))) if len(whole) >= 5 else np.nan
        sure = bool(guesses[trio[0]].to) or (len(whole) >= 5 and _resolves_gravity(whole, size))
        unit = gravity_unit(size, 0.1) if sure else ""
        for place, channel in zip(trio, ACCELERATION, strict=True):
            column = guesses[place]
            if unit and not column.to:
                why = "three columns that add up to gravity"
                _set(guesses, place, unit, why, to=(channel,), confidence=0.5, assumed=True)
            elif unit and unit != column.unit and column.assumed:
                _set(guesses, place, unit, "name; unit by gravity")
        if unit:
            break
    for place in (places[channel] for channel in RATE if channel in places):
        column, peak = guesses[place], float(np.nanmax(np.abs(columns[place]), initial=0.0))
        if column.unit == "rad/s" and column.assumed and peak > 20:
            _set(guesses, place, "deg/s", "name; too fast for rad/s")


def _resolves_gravity(values: Array, size: float) -> bool:
    """Say whether vectors (N, 3) of unknown meaning, of gravity's usual `size`, may be of an accelerometer.

    A direction, as of an attitude, has one length throughout; flags and small whole numbers are no readings.
    """
    coarse = size < _WHOLE_NUMBERS and (values == np.rint(values)).all(axis=0).any()
    lengths = np.linalg.norm(values, axis=1)
    return not coarse and bool(np.ptp(lengths) > _UNIT_LENGTH * size)


def _encoders(guesses: Guesses, columns: Mapping[int, Array]) -> None:
    """Tell counts, angles, rates and velocities of wheels apart by their names and values."""
    wheels = [
        place
        for place, column in guesses.items()
        if column.to and column.to[0] in ENCODERS and column.assumed
    ]
    parts = {place: set(words(guesses[place].name)[0]) for place in wheels}
    for rate in (True, False):  # all wheels report the same
        members = [place for place in wheels if bool(parts[place] & WORDS["rates"]) == rate]
        values = [columns[place][np.isfinite(columns[place])] for place in members]
        if not members or min(map(len, values)) < 5:
            continue
        if rate:
            unit = "rad/s" if max(np.abs(v).max() for v in values) > 3 else "m/s"
        else:
            whole = all((v == np.rint(v)).all() for v in values) and max(map(np.ptp, values)) > 5
            unit = "counts" if whole or any(parts[place] & WORDS["counted"] for place in members) else "rad"
        for place in members:
            sure = guesses[place].confidence * 0.9
            _set(guesses, place, unit, "name; unit by the values", confidence=sure)
