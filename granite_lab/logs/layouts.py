"""Column maps: which column of a log is which channel. One TOML file a layout.

A map is a file of `granite_lab/catalogue/loggers/` or one of the user's own::

    name = "my_logger"
    robot = "husky"                 # used where the log names none

    [[column]]
    name = "time"                   # or pattern = "…", a regular expression
    to = ["t"]
    unit = "ms"

    [[column]]
    name = "left_encoder"
    to = ["enc_fl", "enc_rl"]       # one encoder for both wheels of a side
    unit = "counts"
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from granite_lab.errors import InputError
from granite_lab.files import is_folder
from granite_lab.logs.dialect import TableFormat
from granite_lab.logs.quantities import CHANNELS, Unit, find_unit, resembling, spellings
from granite_lab.parameters import CATALOGUE, names
from granite_lab.parameters.catalogue import find
from granite_lab.parameters.quantity import build, quantity, read_toml

Maps = str | Path | Sequence[str | Path] | None
"""Column maps as a user gives them."""


@dataclass(frozen=True, kw_only=True)
class Column:
    """One column of a map.

    Attributes:
        to: the channels it feeds; none for a column that only belongs to the picture.
        name: its name; upper and lower case count as one.
        pattern: or a regular expression for the whole name; a group called `unit` gives the unit.
        unit: its unit, unless the name gives it; an encoder's unit says what it reports: an angle
            (rad, deg, rev, counts), a rate (rad/s, rpm, …), a circumferential velocity (m/s) or a
            cumulated distance (m); "date" says that stamps are written as dates (ISO 8601).
        scale: factor on the value; a wrong sign is -1.
        wrap: range after which the raw value starts again (0: found out).
        counts_per_rev: counts per wheel revolution (0: the robot's).
        increment: the value is the step since the last row.
        optional: the layout is recognised without it.
        group: columns of a group come together; one group of a layout is enough.
    """

    to: tuple[str, ...]
    name: str = ""
    pattern: str = ""
    unit: str = ""
    scale: float = quantity("", -1e12, 1e12, "factor on the value", default=1.0)
    wrap: float = quantity("", 0, 1e20, "range after which the value starts again", default=0.0)
    counts_per_rev: float = quantity("", 0, 1e9, "counts per wheel revolution", default=0.0)
    increment: bool = False
    optional: bool = False
    group: str = ""

    def matches(self, text: str) -> re.Match[str] | None:
        """Match the name of a column of a file."""
        pattern = self.pattern or re.escape(self.name)
        return re.fullmatch(pattern, text.strip(), re.IGNORECASE)

    @property
    def label(self) -> str:
        """The name to ask for in a message."""
        plain = re.match(r"\(?([\w. %]+)", self.pattern.replace("\\", ""))
        return self.name or (plain[1].rstrip("_") if plain else self.pattern)


@dataclass(frozen=True, kw_only=True)
class Layout:
    """A column map.

    Attributes:
        name, title, source: what it is for and where that is known from.
        robot: the robot, where the log names none.
        file: regular expression for the file's name, for layouts that share their column names.
        preamble: regular expression for a line above the header, for the same purpose.
        rows: which rows to take, as ``run_id = 4``.
        split: the column that tells several runs in one file apart; one must be chosen.
        gravity_removed: the logger takes gravity out of the acceleration.
        table: how the text is laid out, as far as that cannot be seen.
        column: the columns.
    """

    name: str
    title: str = ""
    source: str = ""
    robot: str = ""
    file: str = ""
    preamble: str = ""
    rows: str = ""
    split: str = ""
    gravity_removed: bool = False
    table: TableFormat = field(default=TableFormat())
    column: tuple[Column, ...]


def load_layout(name: str | Path) -> Layout:
    """Read a column map, by name or path.

    Raises:
        UsageError: unknown name.
        InputError: the map is wrong.
    """
    path = find("loggers", name)
    layout = build(Layout, read_toml(path), str(path))
    _regex(path, "file", layout.file)
    _regex(path, "preamble", layout.preamble)
    for number, column in enumerate(layout.column, 1):
        _check(path, number, column)
    if not any("t" in column.to for column in layout.column):
        raise InputError(f"{path}: no column feeds 't'", 'add a [[column]] with to = ["t"] and its unit')
    return layout


def given_maps(maps: Maps) -> tuple[Layout, ...]:
    """Load the column maps a user gave: names, files, or folders of maps.

    Raises:
        UsageError: unknown name.
        InputError: a map is wrong, or a folder holds none.
    """
    found: list[Layout] = []
    for one in [maps] if isinstance(maps, (str, Path)) else maps or ():
        folder = is_folder(Path(one))
        files: list[str | Path] = [*sorted(Path(one).glob("*.toml"))] if folder else [one]
        if not files:
            raise InputError(f"{one}: is a directory without column maps (.toml)", "give the path of a map")
        found += [load_layout(file) for file in files]
    return tuple(found)


@lru_cache
def all_layouts() -> tuple[Layout, ...]:
    """Read every column map of the catalogue."""
    return tuple(load_layout(CATALOGUE / "loggers" / f"{name}.toml") for name in names("loggers"))


def _regex(path: Path, what: str, pattern: str) -> re.Pattern[str]:
    """Compile a pattern of a map."""
    try:
        return re.compile(pattern)
    except re.error as error:
        raise InputError(
            f"{path}: {what} = {pattern!r} is not a regular expression: {error}",
            "write it in 'single quotes', and \\( for a bracket",
        ) from None


def _check(path: Path, number: int, column: Column) -> None:
    """Refuse a column entry that cannot be meant."""
    where = f"{path}: [[column]] {number}"
    if bool(column.name) == bool(column.pattern):
        raise InputError(
            f"{where}: needs either 'name' or 'pattern'", "one of the two says which column is meant"
        )
    groups = _regex(path, f"[[column]] {number} pattern", column.pattern).groupindex
    for channel in column.to:
        if channel not in CHANNELS:
            raise InputError(f"{where}: unknown channel '{channel}'", f"channels: {', '.join(CHANNELS)}")
        if column.unit or "unit" not in groups:
            check_unit(column.unit, channel, where)
    if column.scale == 0:
        raise InputError(
            f"{where}: scale = 0 would make every sample zero", "leave it out, or give the factor"
        )


def check_unit(text: str, channel: str, where: str) -> Unit:
    """Return the unit that a text names.

    Raises:
        InputError: unknown, or of a quantity that does not fit the channel.
    """
    unit = find_unit(text)
    allowed = CHANNELS[channel]
    if unit is None:
        close = resembling(text, *allowed)
        what = f"unit '{text}' is not known" if text else "the unit is missing"
        raise InputError(
            f"{where}: {what}, expected one of {spellings(*allowed)}",
            f"did you mean '{close}'?" if close else "rename it, or convert with scale = … in a column map",
        )
    if unit.quantity not in allowed:
        raise InputError(
            f"{where}: unit '{text}' is one of {unit.quantity}, but {channel} is {' or '.join(allowed)}",
            f"expected one of {spellings(*allowed)}",
        )
    return unit
