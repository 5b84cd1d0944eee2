"""Column maps: which column of a log is which channel, and how a map fits a table.

A map is a TOML file of `granite_lab/catalogue/loggers/` or one of the user's own (`docs/how-to-logger.md`).
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

from granite_lab.errors import InputError, at, nearest
from granite_lab.files import is_folder
from granite_lab.logs.dialect import TableFormat
from granite_lab.logs.quantities import (
    CHANNELS,
    DATE,
    ENCODERS,
    Unit,
    by_name,
    factors,
    find_unit,
    spellings,
    words,
)
from granite_lab.logs.sensors.doubt import Doubt, some_of
from granite_lab.logs.table import Table, numbered
from granite_lab.parameters import CATALOGUE, Robot
from granite_lab.parameters import names as catalogued
from granite_lab.parameters.catalogue import find
from granite_lab.parameters.quantity import build, quantity, read_toml

Hit = tuple[int, re.Match[str]]  # the place of a column and how its name fits an entry of a map
Maps = str | Path | Sequence[str | Path] | None  # column maps as a user gives them


@dataclass(frozen=True, kw_only=True)
class Column:
    """One column of a map.

    An encoder's unit says what it reports: an angle (rad, deg, rev, counts), a rate (rad/s, rpm, …), a
    circumferential velocity (m/s) or a cumulated distance (m); "date" says that stamps are dates (ISO 8601).
    """

    to: tuple[str, ...]  # the channels it feeds; none: the column only helps to recognise the layout
    name: str = ""  # upper and lower case count as one; the second of two columns called x is x#2
    pattern: str = ""  # or a regular expression for the whole name; a group called `unit` gives the unit
    unit: str = ""  # unless the name gives it
    scale: float = quantity("", -1e12, 1e12, "factor on the value", default=1.0)  # a wrong sign is -1
    wrap: float = quantity("", 0, 1e20, "range after which the value starts again", default=0.0)  # 0: found
    counts_per_rev: float = quantity("", 0, 1e9, "counts per wheel revolution", default=0.0)  # 0: robot's
    increment: bool = False  # the value is the step since the last row
    optional: bool = False  # the layout is recognised without it
    group: str = ""  # columns of a group come together; one group of a layout is enough

    @cached_property
    def regex(self) -> re.Pattern[str]:
        """What the whole name of a column of a file must match."""
        return re.compile(self.pattern or re.escape(self.name), re.IGNORECASE)

    @cached_property
    def label(self) -> str:
        """The name to ask for in a message."""
        plain = re.match(r"\(?(?:\?:)?([\w. %]+)", self.pattern.replace("\\", ""))
        return self.name or (plain[1].rstrip("_") if plain else self.pattern)


@dataclass(frozen=True, kw_only=True)
class Layout:
    """A column map."""

    name: str
    title: str = ""  # what it is for
    source: str = ""  # where that is known from
    robot: str = ""  # where the log names none
    file: str = ""  # regular expression for the file's name, for layouts that share their column names
    preamble: str = ""  # regular expression for a line above the header, for the same purpose
    rows: str = ""  # which rows to take, as run_id = 4
    split: str = ""  # the column that tells several runs in one file apart; one must be chosen
    gravity_removed: bool = False  # the logger takes gravity out of the acceleration
    table: TableFormat = field(default=TableFormat())  # how the text is laid out, where that cannot be seen
    column: tuple[Column, ...]

    def may_be(self, table: Table) -> bool:
        """Say whether the layout may be tried on a file of this name and preamble."""
        if self.file and not re.search(self.file, table.path.name):
            return False
        return not self.preamble or any(re.search(self.preamble, line) for line in table.preamble)


@dataclass(frozen=True)
class Binding:
    """One column of a file, its place counted from 0, bound to a channel by an entry of a map."""

    place: int
    name: str
    channel: str
    unit: Unit
    spec: Column

    @property
    def factor(self) -> float:
        """From a logged value to SI units."""
        return self.unit.factor * self.spec.scale


@dataclass(frozen=True)
class Match:
    """How well a layout fits a table."""

    table: Table
    layout: Layout
    bindings: tuple[Binding, ...]  # the columns it knows, in the order of the map
    missing: tuple[str, ...]  # what it needs and the table lacks
    columns: int  # how many columns of the table it knows


OUT = "to = [] in a column map (inspect --write-map) leaves it out"


@dataclass(frozen=True)
class Log:
    """A log under examination; warnings are added to its doubts."""

    robot: Robot  # its wheels, motors, IMU and how that is mounted
    where: str  # the file, for messages
    columns: Mapping[str, Binding]  # channel to the column that feeds it
    doubts: list[Doubt]
    units: dict[str, str] = field(default_factory=dict)  # of channels whose column has another than it said

    def name(self, channel: str) -> str:
        """Return what the file calls the column of a channel."""
        return self.columns[channel].name if channel in self.columns else channel

    def column(self, *channels: str) -> str:
        """Name the column of a channel, or the columns of several."""
        names = " ".join(f"'{self.name(channel)}'" for channel in channels)
        return f"column{'s' * (len(channels) > 1)} {names}"

    def unit(self, *channels: str) -> str:
        """Return the unit that the first logged of some channels was said to have."""
        return next((self.columns[channel].unit.name for channel in channels if channel in self.columns), "")

    def convert(self, channels: Sequence[str], unit: str, why: str, *, unsure: bool = False) -> None:
        """Keep the unit that the columns of some channels turned out to have, and warn of it.

        Where it is `unsure`, another one fits as well, and no estimate is more than poor.
        """
        self.units.update((channel, unit) for channel in channels if channel in self.columns)
        self.doubt(why, remedy="converted", grade="poor" if unsure else "good")

    def doubt(self, what: str, where: str = "", remedy: str = "", **limits: Any) -> None:
        """Add a `Doubt`, of a column or sensor, with what to do about it and how it limits an estimate."""
        self.doubts.append(Doubt(what, where, remedy, **limits))

    def refuse(self, channels: str | tuple[str, ...], message: str, hint: str = OUT) -> InputError:
        """Return the error that names the columns of some channels."""
        named = self.column(*([channels] if isinstance(channels, str) else channels))
        return InputError(f"{self.where}: {named}{message}", hint)


def load_layout(name: str | Path) -> Layout:
    """Read a column map, by name or path; raise UsageError if it is unknown, InputError if it is wrong."""
    path = find("loggers", name)
    layout = build(Layout, read_toml(path), str(path))
    patterns = {"file": layout.file, "preamble": layout.preamble}
    patterns |= {f"[[column]] {n} pattern": column.pattern for n, column in enumerate(layout.column, 1)}
    for key, pattern in patterns.items():
        try:
            re.compile(pattern)
        except re.error as error:
            message = f"{path}: {key} = {pattern!r} is not a regular expression: {error}"
            raise InputError(message, "write it in 'single quotes', and \\( for a bracket") from None
    for number, column in enumerate(layout.column, 1):
        _check(f"{path}: [[column]] {number}", column)
    if not any("t" in column.to for column in layout.column):
        raise InputError(f"{path}: no column feeds 't'", 'add a [[column]] with to = ["t"] and its unit')
    return layout


def given_maps(maps: Maps, *, folders: bool = True) -> tuple[Layout, ...]:
    """Load the column maps a user gave, names, files, or folders of maps; raise errors as `load_layout`.

    Without `folders`, only those that were given one by one: each of them is meant for a file of the trial.
    """
    layouts: list[Layout] = []
    for entry in [maps] if isinstance(maps, (str, Path)) else maps or ():
        folder = is_folder(Path(entry))
        if folder and not folders:
            continue
        files: list[str | Path] = [*sorted(Path(entry).glob("*.toml"))] if folder else [entry]
        if not files:
            raise InputError(f"{entry}: is a directory without column maps (.toml)", "give the path of a map")
        layouts += [load_layout(file) for file in files]
    return tuple(layouts)


@lru_cache
def all_layouts() -> tuple[Layout, ...]:
    """Read every column map of the catalogue."""
    return tuple(load_layout(CATALOGUE / "loggers" / f"{name}.toml") for name in catalogued("loggers"))


def _check(where: str, column: Column) -> None:
    """Refuse a column entry that cannot be meant."""
    if bool(column.name) == bool(column.pattern):
        hint = "one of the two says which column is meant"
        raise InputError(f"{where}: needs either 'name' or 'pattern'", hint)
    for channel in column.to:
        if channel not in CHANNELS:
            raise InputError(f"{where}: unknown channel '{channel}'", f"channels: {', '.join(CHANNELS)}")
        if column.unit or "unit" not in column.regex.groupindex:
            check_unit(column.unit, channel, where)
    if column.scale == 0:
        hint = "leave it out, or give the factor"
        raise InputError(f"{where}: scale = 0 would make every sample zero", hint)


def check_unit(text: str, channel: str, where: str) -> Unit:
    """Return the unit that a text names; one that is unknown or does not fit the channel is refused."""
    unit = find_unit(text)
    allowed = CHANNELS[channel]
    expected = f"expected one of {', '.join(name for kind in allowed for name in factors(kind))}"
    if unit is None:
        message = f"unit '{text}' is not known" if text else "the unit is missing"
        rename = "rename it, or convert with scale = … in a column map"
        hint = nearest(text, spellings(*allowed), 0.5) or rename
        raise InputError(f"{where}: {message}, {expected}", hint)
    if unit.quantity not in allowed:
        message = f"unit '{text}' is one of {unit.quantity}, but {channel} is {' or '.join(allowed)}"
        raise InputError(f"{where}: {message}", expected)
    return unit


def match(layout: Layout, table: Table, *, partly: bool = False) -> Match:
    """Try a layout on a table; of several header rows the best fitting one gives the names.

    With `partly`, one column of a group is enough: a robot may have fewer sensors. Refuses a needed column
    that occurs twice, or whose name carries an unknown unit.
    """
    rows = table.headers or (("",) * table.width,)
    tries = [_match_row(layout, table, names, partly) for names in rows]
    return max(tries, key=lambda m: (not m.missing, m.columns))


def _match_row(layout: Layout, table: Table, names: Sequence[str], partly: bool) -> Match:
    """Try a layout with one row of names; each column may be named as it stands or `numbered`."""
    bare = tuple(name.strip() for name in names)
    unique = numbered(bare)
    either = [tuple(dict.fromkeys(both)) for both in zip(bare, unique, strict=True)]
    entries: dict[int, list[Hit]] = {}
    for index, spec in enumerate(layout.column):
        fits = spec.regex.fullmatch
        tried = ((place, next(filter(None, map(fits, names)), None)) for place, names in enumerate(either))
        if hits := [(place, hit) for place, hit in tried if hit]:
            entries[index] = hits
    used = {place for hits in entries.values() for place, _ in hits}
    missing = _missing(layout, set(entries), partly)
    if partly and not missing:
        missing = _misnamed(layout, set(entries), [name for k, name in enumerate(bare) if k not in used])
    bindings: list[Binding] = []
    for index, hits in entries.items() if not missing else ():
        spec = layout.column[index]
        place, hit = _only(table, spec, hits, bare, unique)
        where = f"{at(table.path, table.header_line or None)}: column '{unique[place]}'"
        for channel in spec.to:
            unit = check_unit(hit.groupdict().get("unit") or spec.unit, channel, where)
            if channel == "t" and table.is_dated(place):
                unit = find_unit(DATE) or unit
            if channel == "t" or all(b.channel != channel for b in bindings):
                bindings.append(Binding(place, unique[place], channel, unit, spec))
    return Match(table, layout, tuple(bindings), missing, len(used))


def _misnamed(layout: Layout, present: set[int], others: Sequence[str]) -> tuple[str, ...]:
    """List the columns that are not found but seem to stand in the table by other names."""
    absent = [c for i, c in enumerate(layout.column) if i not in present and c.group]
    meant = {channel for name in others for channel in by_name(name).to}
    plain = ["".join(words(name)[0]) for name in others]

    def resembled(label: str) -> bool:
        return bool(difflib.get_close_matches("".join(words(label)[0]), plain, 1, 0.85))

    return tuple(c.label for c in absent if meant & set(c.to) or resembled(c.label))


def _missing(layout: Layout, present: set[int], partly: bool) -> tuple[str, ...]:
    """List the columns that keep a layout from being complete, or `partly` from being of use."""
    touched = {layout.column[i].group for i in present} - {""}
    missing = [
        c.label
        for i, c in enumerate(layout.column)
        if i not in present
        and not c.optional
        and c.to != ("t",)
        and (not c.group or (c.group in touched and not partly))
    ]
    # Of several clocks one is enough.
    clocks = [i for i, c in enumerate(layout.column) if "t" in c.to]
    strict = [i for i in clocks if not layout.column[i].optional]
    if not present.issuperset(strict) or present.isdisjoint(clocks):
        missing.insert(0, layout.column[(strict or clocks)[0]].label)
    groups = [c.label for c in layout.column if c.group]
    return tuple(missing if missing or touched else groups[:1])


def _only(table: Table, spec: Column, hits: list[Hit], bare: Sequence[str], names: Sequence[str]) -> Hit:
    """Choose between several columns that fit one entry: only an angle beside its own rate is clear."""
    if len(hits) == 1 or not spec.to:
        return hits[0]
    if spec.to[0] in ENCODERS:
        units = [find_unit(hit.groupdict().get("unit") or "") for _, hit in hits]
        angles = [
            candidate
            for candidate, unit in zip(hits, units, strict=True)
            if unit and unit.quantity == "angle"
        ]
        if len(angles) == 1:
            return angles[0]
    listed = " and ".join(f"'{names[place]}' (column {place + 1})" for place, _ in hits)
    message = f"{listed} both are {spec.to[0]}, expected one column for it"
    last, hint = hits[-1][0], "rename or remove the other one"
    if names[last] != bare[last]:
        hint += f'; or write name = "{names[last]}" in a column map, or names = […] under its [table]'
    raise table.error(message, hint, table.header_line)


def best(fits: list[Match]) -> Match:
    """Take the layout that explains most of the file, if there is one."""

    def rank(m: Match) -> tuple[int, bool]:
        return m.columns, bool(m.layout.file or m.layout.preamble)

    def meaning(m: Match) -> set[tuple[int, str, Unit, float]]:
        return {(b.place, b.channel, b.unit, b.spec.scale) for b in m.bindings}

    first, *others = sorted(fits, key=rank, reverse=True)
    rivals = [m.layout.name for m in others if rank(m) == rank(first) and meaning(m) != meaning(first)]
    if rivals:
        name, other = first.layout.name, rivals[0]
        hint = f"say which: --map {name} or --map {other}"
        raise InputError(f"{first.table.path}: could be of layout '{name}' or '{other}'", hint)
    return first


def not_used(layout: Layout, read: Sequence[Match]) -> InputError:
    """Say why no file of a trial is read by a map that was given for one of them."""
    tries = [match(layout, taken.table) for taken in read]
    near = max(tries, key=lambda m: (not m.missing, m.columns))
    if near.missing:
        return no_match([near], given=True)
    other = read[tries.index(near)].layout.name
    message = f"column maps '{other}' and '{layout.name}' both fit; '{other}' is used"
    return near.table.error(
        message, "--encoders, --currents or --reference before a file says what it is for"
    )


def no_match(tries: list[Match], given: bool) -> InputError:
    """Say what is missing from the layout that comes closest, of those tried on one table."""
    table = tries[0].table
    names, (line, message, hint) = table.names, table.unnamed
    if line:
        return table.error(message, hint, line)
    shown = some_of(names, 12)
    near = max(tries, key=lambda m: m.columns / (m.columns + len(m.missing)))
    numbered_ones = ""
    if table.repeated:
        first, other = (table.names[place] for place in table.repeated[0][1][:2])
        numbered_ones = f"; in a column map two columns of one name are '{first}' and '{other}'"
    if near.columns <= len(near.missing) and not given:
        hint = "granite-lab inspect shows what the columns seem to be and writes a column map for --map"
        return table.error(f"the layout is not known: {shown}", hint + numbered_ones, table.header_line)
    lacking = near.missing[0]
    unused = [name for name in names if not any(c.regex.fullmatch(name.strip()) for c in near.layout.column)]
    close = difflib.get_close_matches(lacking, unused, n=1, cutoff=0.6)
    hint = f"there is '{close[0]}'; " if close and close[0] != lacking else ""
    canonical = near.layout.name == "canonical"
    hint += (
        "names are channel_unit, such as imu_gy_radps or enc_fl_rad"
        if canonical
        else f"columns here: {shown}"
    )
    if not given and not canonical:  # the layout that comes closest need not be the file's
        hint += "; granite-lab inspect LOG --write-map FILE drafts a map of them"
    more = f" (and {len(near.missing) - 1} more)" if len(near.missing) > 1 else ""
    message = f"column '{lacking}' is missing{more}, expected by layout '{near.layout.name}'"
    return table.error(message, hint + numbered_ones, table.header_line)
