"""Which layout a file has, and which of its columns feeds which channel."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from granite_lab.errors import InputError, at
from granite_lab.logs.dialect import Dialect
from granite_lab.logs.layouts import CHANNELS, Column, Layout, all_layouts, check_unit
from granite_lab.logs.units import Unit, find_unit


@dataclass(frozen=True)
class Binding:
    """One column of a file bound to a channel.

    Attributes:
        place: the column, counted from 0.
        name: its name in the file.
        channel: what it feeds.
        unit: its unit.
        spec: the entry of the map.
    """

    place: int
    name: str
    channel: str
    unit: Unit
    spec: Column


@dataclass(frozen=True)
class Match:
    """How well a layout fits a file.

    Attributes:
        layout: the column map.
        bindings: the columns it knows, in the order of the map.
        missing: what it needs and the file lacks.
        columns: number of columns of the file that it knows.
    """

    layout: Layout
    bindings: tuple[Binding, ...]
    missing: tuple[str, ...]
    columns: int

    @property
    def complete(self) -> bool:
        """Nothing needed is missing."""
        return not self.missing


def match(layout: Layout, path: Path, dialect: Dialect) -> Match:
    """Try a layout on a file; of several header rows the best fitting one gives the names.

    Raises:
        InputError: a needed column stands there twice, or its name carries an unknown unit.
    """
    tries = [_match_row(layout, path, dialect, row) for row in dialect.headers]
    return max(tries, key=lambda m: (m.complete, m.columns), default=Match(layout, (), ("a header line",), 0))


def _match_row(layout: Layout, path: Path, dialect: Dialect, names: Sequence[str]) -> Match:
    """Try a layout with one row of names."""
    found: dict[int, list[int]] = {}
    for index, spec in enumerate(layout.column):
        places = [place for place, name in enumerate(names) if spec.matches(name)]
        if places:
            found[index] = places
    missing = _missing(layout, found)
    columns = len({place for places in found.values() for place in places})
    if missing:
        return Match(layout, (), missing, columns)
    bindings: list[Binding] = []
    for index, places in found.items():
        spec = layout.column[index]
        place = _one(path, dialect, spec, places, names)
        hit = spec.matches(names[place])
        unit_text = (hit.groupdict().get("unit") if hit else "") or spec.unit
        where = f"{at(path, dialect.header_line)}: column '{names[place]}'"
        for channel in spec.to:
            check_unit(unit_text, channel, where)
            unit = find_unit(unit_text)
            if unit is not None and (channel == "t" or all(b.channel != channel for b in bindings)):
                bindings.append(Binding(place, names[place], channel, unit, spec))
    return Match(layout, tuple(bindings), (), columns)


def _missing(layout: Layout, found: dict[int, list[int]]) -> tuple[str, ...]:
    """List the columns that keep a layout from being complete."""
    touched = {layout.column[i].group for i in found} - {""}
    grouped = any(c.group for c in layout.column)
    needed = [
        (i, c)
        for i, c in enumerate(layout.column)
        if not c.optional and c.to != ("t",) and (not c.group or c.group in touched)
    ]
    missing = [c.label for i, c in needed if i not in found]
    # Of several clocks one is enough.
    clocks = [i for i, c in enumerate(layout.column) if "t" in c.to]
    strict = [i for i in clocks if not layout.column[i].optional]
    if any(i not in found for i in strict) or not any(i in found for i in clocks):
        missing.insert(0, layout.column[(strict or clocks)[0]].label)
    if grouped and not touched and not missing:
        missing = [next(c.label for c in layout.column if c.group)]
    return tuple(missing)


def _one(path: Path, dialect: Dialect, spec: Column, places: list[int], names: Sequence[str]) -> int:
    """Choose between several columns that fit one entry: only an angle beside its own rate is clear."""
    if len(places) == 1 or not spec.to:
        return places[0]
    if spec.to[0].startswith("enc_") and len({names[p] for p in places}) == len(places):
        hits = {p: spec.matches(names[p]) for p in places}
        units = {p: find_unit(hit.groupdict().get("unit", "")) for p, hit in hits.items() if hit}
        angles = [p for p, unit in units.items() if unit is not None and unit.quantity == "angle"]
        if len(angles) == 1:
            return angles[0]
    listed = " and ".join(f"'{names[p]}' (column {p + 1})" for p in places)
    raise InputError(
        f"{at(path, dialect.header_line)}: {listed} both are {spec.to[0]}, expected one column for it",
        "rename or remove the other one",
    )


def choose(path: Path, dialect: Dialect, maps: Sequence[Layout] = ()) -> Match:
    """Find the layout of a file.

    Args:
        path: the file.
        dialect: how it is laid out.
        maps: column maps the user gave; they go before the catalogue.

    Raises:
        InputError: no layout fits, or several fit equally well.
    """
    if not dialect.headers:
        raise InputError(
            f"{at(path, dialect.data_line)}: no header line, expected the names of the columns",
            "add one, or name the columns with names = […] under [table] in a column map",
        )
    catalogue = tuple(layout for layout in all_layouts() if _eligible(layout, path, dialect))
    for group in (maps, catalogue):
        fits = [m for m in (match(layout, path, dialect) for layout in group) if m.complete]
        if fits:
            return best(path, fits)
    raise no_match(path, dialect, [match(layout, path, dialect) for layout in maps or catalogue], bool(maps))


def _eligible(layout: Layout, path: Path, dialect: Dialect) -> bool:
    """Say whether a layout may be tried on a file of this name and preamble."""
    named = not layout.file or re.search(layout.file, path.name) is not None
    return named and (not layout.preamble or any(re.search(layout.preamble, s) for s in dialect.preamble))


def best(path: Path, fits: list[Match]) -> Match:
    """Take the layout that explains most of the file, if there is one."""

    def rank(m: Match) -> tuple[int, bool]:
        return m.columns, bool(m.layout.file or m.layout.preamble)

    def meaning(m: Match) -> set[tuple[int, str, Unit, float]]:
        return {(b.place, b.channel, b.unit, b.spec.scale) for b in m.bindings}

    first, *others = sorted(fits, key=rank, reverse=True)
    rivals = [m.layout.name for m in others if rank(m) == rank(first) and meaning(m) != meaning(first)]
    if rivals:
        raise InputError(
            f"{path}: could be of layout '{first.layout.name}' or '{rivals[0]}'",
            f"say which: --map {first.layout.name} or --map {rivals[0]}",
        )
    return first


def no_match(path: Path, dialect: Dialect, tries: list[Match], given: bool) -> InputError:
    """Say what is missing from the layout that comes closest."""
    names = [name for name in dialect.headers[0] if name]
    shown = ", ".join(names[:12]) + (", …" if len(names) > 12 else "")
    where = at(path, dialect.header_line or None)
    near = max(tries, key=lambda m: m.columns / (m.columns + len(m.missing)), default=None)
    if near is None or (near.columns < 2 and not given):
        return InputError(
            f"{where}: the layout is not known: {shown}",
            "granite-lab inspect shows what the columns seem to be and writes a column map for --map",
        )
    lacking = near.missing[0]
    unused = [name for name in names if not any(spec.matches(name) for spec in near.layout.column)]
    close = difflib.get_close_matches(lacking, unused, n=1, cutoff=0.6)
    hint = f"there is '{close[0]}'; " if close and close[0] != lacking else ""
    if near.layout.name == "canonical":
        hint += "names are channel_unit, such as imu_gy_radps or enc_fl_rad"
    else:
        hint += f"columns here: {shown}"
    more = f" (and {len(near.missing) - 1} more)" if len(near.missing) > 1 else ""
    return InputError(
        f"{where}: column '{lacking}' is missing{more}, expected by layout '{near.layout.name}'", hint
    )


def channels_of(bindings: Sequence[Binding]) -> list[str]:
    """List the channels that are bound, in the order of `CHANNELS`."""
    bound = {b.channel for b in bindings}
    return [channel for channel in CHANNELS if channel in bound]
