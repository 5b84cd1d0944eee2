"""Which layout a table has, and which of its columns feeds which channel."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from granite_lab.errors import InputError, at
from granite_lab.logs.dialect import Table
from granite_lab.logs.layouts import Column, Layout, all_layouts, check_unit
from granite_lab.logs.quantities import DATE, Unit, find_unit
from granite_lab.logs.table import is_dated, open_table


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
    """How well a layout fits a table.

    Attributes:
        layout: the column map.
        bindings: the columns it knows, in the order of the map.
        missing: what it needs and the table lacks.
        columns: number of columns of the table that it knows.
    """

    layout: Layout
    bindings: tuple[Binding, ...]
    missing: tuple[str, ...]
    columns: int


def recognise(path: Path, maps: Sequence[Layout] = ()) -> tuple[Table, Match]:
    """Open a table and find its layout.

    Args:
        path: the file.
        maps: column maps the user gave; they go before the catalogue.

    Raises:
        InputError: not a table, of no known layout, or several fit equally well.
    """
    tries: list[tuple[Table, Match]] = []
    for layout in maps:
        with suppress(InputError):  # the map may be meant for another file of the trial
            table = open_table(path, layout.table)
            tries.append((table, match(layout, table)))
    if not any(not found.missing for _, found in tries):
        table = open_table(path)
        if not table.headers:
            raise InputError(
                f"{at(path, table.data_line)}: no header line, expected the names of the columns",
                "add one, or name the columns with names = […] under [table] in a column map",
            )
        catalogue = [layout for layout in all_layouts() if _eligible(layout, table)]
        tries = [(table, match(layout, table)) for layout in catalogue]
        if all(found.missing for _, found in tries):
            near = [match(layout, table) for layout in maps] or [found for _, found in tries]
            raise no_match(table, near, bool(maps))
    chosen = best(path, [found for _, found in tries if not found.missing])
    return next(one for one in tries if one[1] is chosen)


def match(layout: Layout, table: Table) -> Match:
    """Try a layout on a table; of several header rows the best fitting one gives the names.

    Raises:
        InputError: a needed column occurs twice, or its name carries an unknown unit.
    """
    tries = [_match_row(layout, table, names) for names in table.headers]
    nothing = Match(layout, (), ("a header line",), 0)
    return max(tries, key=lambda m: (not m.missing, m.columns), default=nothing)


def _match_row(layout: Layout, table: Table, names: Sequence[str]) -> Match:
    """Try a layout with one row of names."""
    found: dict[int, list[int]] = {}
    for index, spec in enumerate(layout.column):
        places = [place for place, name in enumerate(names) if spec.matches(name)]
        if places:
            found[index] = places
    missing = _missing(layout, set(found))
    columns = len({place for places in found.values() for place in places})
    if missing:
        return Match(layout, (), missing, columns)
    bindings: list[Binding] = []
    for index, places in found.items():
        spec = layout.column[index]
        place = _one(table, spec, places, names)
        hit = spec.matches(names[place])
        text = (hit.groupdict().get("unit") if hit else "") or spec.unit
        where = f"{at(table.path, table.header_line)}: column '{names[place]}'"
        for channel in spec.to:
            unit = check_unit(text, channel, where)
            if channel == "t" and is_dated(table, place):
                unit = find_unit(DATE) or unit
            if channel == "t" or all(b.channel != channel for b in bindings):
                bindings.append(Binding(place, names[place], channel, unit, spec))
    return Match(layout, tuple(bindings), (), columns)


def _missing(layout: Layout, found: set[int]) -> tuple[str, ...]:
    """List the columns that keep a layout from being complete."""
    touched = {layout.column[i].group for i in found} - {""}
    missing = [
        c.label
        for i, c in enumerate(layout.column)
        if i not in found and not c.optional and c.to != ("t",) and (not c.group or c.group in touched)
    ]
    # Of several clocks one is enough.
    clocks = [i for i, c in enumerate(layout.column) if "t" in c.to]
    strict = [i for i in clocks if not layout.column[i].optional]
    if not found.issuperset(strict) or found.isdisjoint(clocks):
        missing.insert(0, layout.column[(strict or clocks)[0]].label)
    groups = [c.label for c in layout.column if c.group]
    if groups and not touched and not missing:
        missing = groups[:1]
    return tuple(missing)


def _one(table: Table, spec: Column, places: list[int], names: Sequence[str]) -> int:
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
        f"{at(table.path, table.header_line)}: {listed} both are {spec.to[0]}, expected one column for it",
        "rename or remove the other one",
    )


def _eligible(layout: Layout, table: Table) -> bool:
    """Say whether a layout may be tried on a file of this name and preamble."""
    named = not layout.file or re.search(layout.file, table.path.name) is not None
    return named and (not layout.preamble or any(re.search(layout.preamble, s) for s in table.preamble))


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


def no_match(table: Table, tries: list[Match], given: bool) -> InputError:
    """Say what is missing from the layout that comes closest."""
    names = [name for name in table.headers[0] if name]
    shown = ", ".join(names[:12]) + (", …" if len(names) > 12 else "")
    where = at(table.path, table.header_line or None)
    near = max(tries, key=lambda m: m.columns / (m.columns + len(m.missing)), default=None)
    if near is None or (near.columns <= len(near.missing) and not given):
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
