"""What the columns of an unknown log seem to be, from their names and their values."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from granite_lab.errors import InputError
from granite_lab.logs.counters import SECONDS, unit_factor
from granite_lab.logs.dialect import Table
from granite_lab.logs.quantities import (
    ACCELERATION,
    CHANNELS,
    DATE,
    ENCODERS,
    RATE,
    SENSORS,
    WORDS,
    Unit,
    factors,
    find_unit,
    gravity_unit,
)
from granite_lab.logs.trial import Array
from granite_lab.parameters import WHEELS


@dataclass(frozen=True)
class ColumnReport:
    """What a column is, or seems to be.

    Attributes:
        name: what the file calls it.
        place: where it stands, counted from 0.
        to: the channels it feeds; none: not recognised, or of no use.
        unit: its unit.
        confidence: how sure that is, 0 to 1.
        why: in a few words.
        low, high: range of the values; NaN for texts.
        filled: share of the cells that hold a number.
        assumed: nothing in the name says the unit.
        settings: further keys of its entry in a column map.
    """

    name: str
    place: int = 0
    to: tuple[str, ...] = ()
    unit: str = ""
    confidence: float = 0.0
    why: str = "not recognised"
    low: float = math.nan
    high: float = math.nan
    filled: float = 0.0
    assumed: bool = True
    settings: tuple[tuple[str, object], ...] = ()

    def as_json(self) -> dict[str, object]:
        """Return what is told about it as plain data."""
        return {key: value for key, value in vars(self).items() if key not in ("assumed", "settings")}


Found = dict[int, ColumnReport]
"""The place of a column, and what it seems to be."""

_GLOBE = SENSORS["globe"].channels


def words(name: str) -> tuple[list[str], str]:
    """Split a column's name into words and the unit it may end in: ``gyrX (°/s)``, ``accel_x_g``."""
    unit = ""
    inside = re.search(r"[\[(]([^\])]*)[\])]\s*$", name)
    if inside and find_unit(inside.group(1)):
        unit, name = inside.group(1), name[: inside.start()]
    else:
        parts = name.split("_")
        for count in (2, 1):
            tail = "_".join(parts[-count:])
            # A single `a` is an acceleration.
            if len(parts) > count and find_unit(tail) and tail != "a":
                unit, name = tail, "_".join(parts[:-count])
                break
    spaced = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Za-z])(?=\d)|(?<=\d)(?=[A-Za-z])", " ", name)
    return [w for w in re.split(r"[^A-Za-z0-9]+", spaced.lower()) if w], unit


def wheels_named(parts: Collection[str]) -> tuple[str, ...]:
    """Return the wheels that the words of a name speak of: one, both of a side, or none."""
    said = set(re.sub(r"front|rear|back|left|right", r" \g<0> ", " ".join(parts)).split())
    if one := next((wheel for wheel in WHEELS if said & WORDS[wheel]), ""):
        return (one,)
    side = next((key[0] for key in ("left", "right") if said & WORDS[key]), "")
    axle = next((key for key in ("f", "r") if said & WORDS[key]), "")
    return tuple(wheel for wheel in WHEELS if side and wheel[1] == side and axle in ("", wheel[0]))


def by_name(name: str, place: int = 0) -> ColumnReport:
    """Guess from the name alone; a unit of the wrong quantity lowers the confidence."""
    parts, unit_text = words(name)
    unit = find_unit(unit_text) if unit_text else None
    to, confidence = _named(parts, unit)
    if not to:
        if WORDS["attitude"] & set(parts) or re.fullmatch(r"(?i).*(^|[^A-Za-z])q[wxyz0-4]", name.strip()):
            return ColumnReport(
                name, place, unit=unit.name if unit else "", why="attitude: recognised, not used"
            )
        return ColumnReport(name, place)
    if unit is not None and unit.quantity in CHANNELS[to[0]]:
        sure = min(confidence + 0.1, 0.98)
        return ColumnReport(name, place, to, unit.name, sure, "name and unit in it", assumed=False)
    usual = "deg" if to[0] in _GLOBE else next(iter(factors(CHANNELS[to[0]][0])))
    return ColumnReport(name, place, to, usual, confidence * (0.6 if unit else 0.9), "name; unit assumed")


def _named(parts: list[str], unit: Unit | None) -> tuple[tuple[str, ...], float]:
    """Return channels that the words of a name mean, and how sure that is."""
    said = set(parts)
    if said & WORDS["command"]:
        return ("v_cmd",), 0.7
    for channel in _GLOBE:
        if said & WORDS[channel]:
            return (channel,), 0.8
    if said & WORDS["reference"]:
        speed = (unit is not None and unit.quantity == "speed") or said & {"v", "vel"}
        return () if "z" in said else ("ref_v" if speed else "ref_y" if "y" in said else "ref_x",), 0.5
    sensor = _sensor(parts, unit)
    if sensor[0] and "covariance" not in said:
        return sensor
    return (("t",), 0.9) if {*parts[:1], *parts[-1:]} & WORDS["time"] else ((), 0.0)


def _sensor(parts: list[str], unit: Unit | None) -> tuple[tuple[str, ...], float]:
    """Return the same for the channels of a sensor."""
    joined = "".join(parts)
    wheels = wheels_named(parts)
    if not wheels and WORDS["numbered"] & set(parts):
        wheels = tuple(wheel for number, wheel in enumerate(WHEELS, 1) if str(number) in parts)
    for sensor in SENSORS.values():
        hints = sensor.words.split()
        # `ax`, `gyrx`, `accz`: the axis may hang on to the word.
        axis = next((a for a in "xyz" if a in parts or any(joined.endswith(h + a) for h in hints)), "")
        named = any(h in parts or (axis and h + axis in parts) or (len(h) > 2 and h in joined) for h in hints)
        if sensor.channels == RATE and not axis:
            axis = next((a for a in "xyz" if WORDS[a] & set(parts)), "")
        turning = sensor.channels == ENCODERS and unit is not None and unit.name == "rpm"
        if hints and (named or turning):
            ends = wheels if sensor.channels[0].endswith(WHEELS[0]) else tuple(axis)
            found = tuple(channel for channel in sensor.channels if ends and channel.endswith(ends))
            if found:
                return found, 0.8 if ends == wheels else 0.9
    return (), 0.0


def guess(table: Table, columns: Mapping[int, Array]) -> list[ColumnReport]:
    """Guess what the columns of a log are.

    Args:
        table: the log.
        columns: place of a column to its (N,) values, NaN where empty; dates as seconds since 1970.

    Returns:
        a guess about each of these columns.
    """
    found = {place: by_name(table.header(place), place) for place in columns}
    for place in filter(table.is_dated, columns):
        fine = bool((np.diff(columns[place]) != 0).mean() > 0.5) if len(columns[place]) > 1 else False
        _set(found, place, DATE, "dates", to=("t",), confidence=0.95 if fine else 0.3, assumed=False)
    _seconds_and_parts(found, columns)
    _first_only(found)
    _time(found, columns)
    _triples(found, columns)
    _encoders(found, columns)
    for place, one in found.items():
        if table.headers and table.headers[0].count(one.name) > 1:  # a map cannot tell them apart
            _set(found, place, one.unit, f"{one.why}; two columns have this name", to=())
    return list(found.values())


def _set(found: Found, place: int, unit: str, why: str, **more: Any) -> None:
    """Change the guess about a column."""
    found[place] = replace(found[place], unit=unit, why=why, **more)


def _seconds_and_parts(found: Found, columns: Mapping[int, Array]) -> None:
    """Find whole seconds and the parts of a second in two columns: ``stamp.secs``, ``stamp.nsecs``."""
    stems: dict[str, int] = {}
    parts: list[tuple[str, int, Unit]] = []
    for place, one in found.items():
        hit = re.fullmatch(r"((?:.*[^A-Za-z])?)([A-Za-z]+)[\])]?", one.name.strip())
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
            why = f"with '{found[part].name}': whole seconds and their parts"
            _set(found, whole, "s", why, to=("t",), **sure)
            why = f"part of a second, belongs to '{found[whole].name}'"
            _set(found, part, unit.name, why, to=("t_add",), **sure)
            return


def _first_only(found: Found) -> None:
    """Let each channel keep its surest column."""
    taken: dict[str, int] = {}
    for place, one in sorted(found.items(), key=lambda item: -item[1].confidence):
        rival = next((taken[channel] for channel in one.to if channel in taken), None)
        if rival is not None:
            _set(found, place, "", f"same quantity as '{found[rival].name}'", to=(), confidence=0.0)
        taken |= dict.fromkeys(found[place].to, place)


def _time(found: Found, columns: Mapping[int, Array]) -> None:
    """Find a clock by its values, if no name says so, and its unit by the rate."""
    clocks = [place for place, one in found.items() if one.to == ("t",)]
    for place, values in columns.items():
        steps = np.diff(values[np.isfinite(values)])
        # A clock ticks about evenly and never back.
        if not clocks and len(steps) > 5 and (steps >= 0).mean() > 0.98 and np.median(steps) > 0:
            spread = np.quantile(steps, 0.9) / np.median(steps)
            if spread < 3 and (not found[place].to or spread < 1.5):
                clocks = [place]
                _set(found, place, "s", "increases evenly", to=("t",), confidence=0.6, assumed=True)
    for place in clocks:
        one, stamps = found[place], columns[place][np.isfinite(columns[place])]
        for slowest in (4.0, 0.5) if one.assumed else ():
            with suppress(InputError):
                factor, _ = unit_factor(stamps, 1.0, slowest)
                unit = next(name for name, size in SECONDS.items() if size == factor)
                _set(found, place, unit, f"{one.why}; unit by the rate")
                break


def _triples(found: Found, columns: Mapping[int, Array]) -> None:
    """Find an accelerometer by gravity, and set its unit and the gyroscope's by the values."""
    places = {channel: place for place, one in found.items() for channel in one.to}
    free = [place for place, one in found.items() if not one.to]
    if all(channel in places for channel in ACCELERATION):
        trios = [tuple(places[channel] for channel in ACCELERATION)]
    else:
        trios = [] if set(places) & set(ACCELERATION) else [*zip(free, free[1:], free[2:], strict=False)]
    for trio in trios:
        values = np.column_stack([columns[place] for place in trio])
        whole = values[np.isfinite(values).all(axis=1)]
        size = float(np.median(np.linalg.norm(whole, axis=1))) if len(whole) >= 5 else np.nan
        unit = gravity_unit(size, 0.1)
        for place, channel in zip(trio, ACCELERATION, strict=True):
            one = found[place]
            if unit and not one.to:
                why = "three columns that add up to gravity"
                _set(found, place, unit, why, to=(channel,), confidence=0.5, assumed=True)
            elif unit and unit != one.unit and one.assumed:
                _set(found, place, unit, "name; unit by gravity")
        if unit:
            break
    for place in (places[channel] for channel in RATE if channel in places):
        one, peak = found[place], float(np.nanmax(np.abs(columns[place]), initial=0.0))
        if one.unit == "rad/s" and one.assumed and peak > 20:
            _set(found, place, "deg/s", "name; too fast for rad/s")


def _encoders(found: Found, columns: Mapping[int, Array]) -> None:
    """Tell counts, angles, rates and velocities of wheels apart by their names and values."""
    wheels = [place for place, one in found.items() if one.to and one.to[0] in ENCODERS and one.assumed]
    said = {place: set(words(found[place].name)[0]) for place in wheels}
    for rate in (True, False):  # all wheels report the same
        members = [place for place in wheels if bool(said[place] & WORDS["rates"]) == rate]
        values = [columns[place][np.isfinite(columns[place])] for place in members]
        if not members or min(map(len, values)) < 5:
            continue
        if rate:
            unit = "rad/s" if max(np.abs(v).max() for v in values) > 3 else "m/s"
        else:
            whole = all((v == np.rint(v)).all() for v in values) and max(map(np.ptp, values)) > 5
            unit = "counts" if whole or any(said[place] & WORDS["counted"] for place in members) else "rad"
        for place in members:
            sure = found[place].confidence * 0.9
            _set(found, place, unit, "name; unit by the values", confidence=sure)
