"""One file of a trial: its layout, its columns as numbers, the rows that were asked for."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from granite_lab.errors import InputError, UsageError, at
from granite_lab.files import sha256
from granite_lab.logs.bag import bag_layout, read_bag
from granite_lab.logs.canonical import Metadata, collect
from granite_lab.logs.dialect import Table
from granite_lab.logs.guess import by_name
from granite_lab.logs.layouts import Binding, Layout, Match, all_layouts, best, match, no_match
from granite_lab.logs.named import is_bag, sidecar
from granite_lab.logs.quantities import DATE, ENCODERS
from granite_lab.logs.table import line_of, load, open_table
from granite_lab.logs.trial import Array, InputFile

_ROWS = re.compile(r"\s*(?P<name>.+?)\s*==?\s*(?P<value>[^=]+?)\s*")


@dataclass(frozen=True, eq=False)
class Source:
    """A file that was read.

    Attributes:
        path: where it is.
        table: how it is laid out.
        match: the layout it has.
        columns: place of a column to its (N,) values, in the file's units.
        kept: (N,) the row of data each value came from.
        metadata: what the file and its sidecar say.
        inputs: the file and its sidecar.
        doubts: what the reader was not sure of.
    """

    path: Path
    table: Table
    match: Match
    columns: dict[int, Array]
    kept: Array
    metadata: Metadata
    inputs: tuple[InputFile, ...]
    doubts: tuple[str, ...]

    def bindings(self, *channels: str) -> list[Binding]:
        """Return the bindings of some channels."""
        return [b for b in self.match.bindings if b.channel in channels]

    def place(self, row: int) -> str:
        """Name the place in the file of a row of `columns`."""
        if self.table.data_line == 0:
            return f"{self.path}: sample {int(self.kept[row]) + 1}"
        return at(self.path, line_of(self.table, int(self.kept[row])) or None)


@dataclass(frozen=True)
class Choice:
    """What a user says about the files.

    Attributes:
        maps: column maps; they go before the catalogue.
        rows: which rows to take, as ``run_id = 4``.
        topics: of a bag, ``imu``, ``joints`` and ``odom`` to the name of a topic.
    """

    maps: tuple[Layout, ...] = ()
    rows: str | None = None
    topics: Mapping[str, str] = field(default_factory=dict)


def recognise(path: Path, said: Choice) -> tuple[Table, Match]:
    """Open a table or a bag and find its layout.

    Raises:
        InputError: not a table, of no known layout, or several fit equally well.
    """
    if is_bag(path):
        table, roles = read_bag(path, said.topics)
        fits = [found for layout in said.maps if not (found := match(layout, table)).missing]
        if fits:
            return table, best(path, fits)
        layout, doubts = bag_layout(table, roles)
        return _doubted(table, *doubts), match(layout, table)
    tries: list[tuple[Table, Match]] = []
    for layout in said.maps:
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
        tries = [(table, match(layout, table)) for layout in all_layouts() if layout.may_be(table)]
        if all(found.missing for _, found in tries):
            near = [match(layout, table) for layout in said.maps] or [found for _, found in tries]
            raise no_match(table, near, bool(said.maps))
    chosen = best(path, [found for _, found in tries if not found.missing])
    table = next(table for table, found in tries if found is chosen)
    if chosen.layout in said.maps or any(b.channel in ENCODERS for b in chosen.bindings):
        return table, chosen
    unused = [table.name(place) for place in set(range(table.width)) - {b.place for b in chosen.bindings}]
    names = [name for name in unused if set(by_name(name).to) & set(ENCODERS)]
    doubt = (
        f"{path.name}: {', '.join(names)}: look like wheels, which layout '{chosen.layout.name}' does "
        "not know; inspect --write-map writes a map to which they can be added"
    )
    return _doubted(table, doubt) if names else table, chosen


def _doubted(table: Table, *doubts: str) -> Table:
    return dataclasses.replace(table, doubts=(*table.doubts, *doubts))


def open_source(path: Path, said: Choice, beside: Path | None = None) -> Source:
    """Read a file by the layout that fits it.

    Args:
        path: the file.
        said: by the user.
        beside: a further TOML file with metadata, which go before the file's.

    Raises:
        InputError: anything that is wrong with the file.
    """
    return read_source(*recognise(path, said), said.rows, beside=beside)


def read_source(
    table: Table,
    found: Match,
    rows: str | None,
    held: Mapping[int, Array] | None = None,
    beside: Path | None = None,
) -> Source:
    """Read the columns that a layout binds.

    Args:
        table: the file.
        found: its layout.
        rows: which rows to take, as ``run_id = 4``.
        held: columns that were read already.
        beside: a further TOML file with metadata.

    Raises:
        InputError: anything that is wrong with the columns or the rows.
    """
    path, doubts = table.path, list(table.doubts)
    condition, splitter = rows or found.layout.rows, _place(table, found.layout.split)
    selector = _selector(table, condition, asked=rows is not None) if condition else None
    wanted = {b.place for b in found.bindings}
    wanted |= {place for place in (selector[0] if selector else None, splitter) if place is not None}
    dates = {b.place for b in found.bindings if b.unit.name == DATE}
    if held is not None and wanted <= set(held) and dates == set(filter(table.is_dated, wanted)):
        columns = {place: held[place] for place in wanted}
    else:
        columns, cut = load(table, sorted(wanted), sorted(dates))
        doubts += cut
    kept = np.arange(len(next(iter(columns.values()))), dtype=np.float64)
    if selector:
        chosen = columns[selector[0]] == selector[1]
        if not chosen.any():
            raise InputError(
                f"{path}: no row has {condition}", f"values there: {_values(columns[selector[0]])}"
            )
        columns, kept = {place: values[chosen] for place, values in columns.items()}, kept[chosen]
    if splitter is not None and len(np.unique(columns[splitter])) > 1:
        name = found.layout.split
        raise InputError(
            f"{path}: holds several runs: {name} = {_values(columns[splitter])}",
            f"choose one, such as --rows '{name} = {np.unique(columns[splitter])[0]:g}'",
        )
    sides = [side for side in (sidecar(path), beside) if side not in (None, path) and side.is_file()]
    metadata = collect(table.comments, path, doubts, sides)
    inputs = tuple(InputFile(file, sha256(file)) for file in (path, *sides))
    return Source(path, table, found, columns, kept, metadata, inputs, tuple(doubts))


def _place(table: Table, name: str) -> int | None:
    """Find a column by its name, in any of the header rows."""
    for header in table.headers if name else ():
        for place, text in enumerate(header):
            if text.casefold() == name.casefold():
                return place
    return None


def _selector(table: Table, condition: str, asked: bool) -> tuple[int, float] | None:
    """Parse ``column = value``."""
    hit = _ROWS.fullmatch(condition)
    try:
        if hit is None:
            raise ValueError
        value = float(hit["value"])
    except ValueError:
        raise UsageError(
            f"rows '{condition}' cannot be understood", "write column = number, as in --rows 'run_id = 4'"
        ) from None
    place = _place(table, hit["name"])
    if place is None and asked:
        known = ", ".join(filter(None, table.headers[0]))
        raise InputError(
            f"{table.path}: there is no column '{hit['name']}' to choose rows by", f"columns: {known}"
        )
    return None if place is None else (place, value)


def _values(values: Array) -> str:
    """List the different values of a column."""
    different = np.unique(values[np.isfinite(values)])
    return ", ".join(f"{v:g}" for v in different[:10]) + (", …" if len(different) > 10 else "")
