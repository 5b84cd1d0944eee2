"""One file of a trial: its layout, its columns as numbers, the rows that were asked for."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from granite_lab.errors import InputError, UsageError, at
from granite_lab.files import sha256
from granite_lab.logs.bag import bag_layout, read_bag
from granite_lab.logs.canonical import Metadata, collect
from granite_lab.logs.dialect import Table
from granite_lab.logs.guess import by_name
from granite_lab.logs.layouts import Layout
from granite_lab.logs.matching import Binding, Match, best, match, no_match, recognise
from granite_lab.logs.named import is_bag, sidecar
from granite_lab.logs.quantities import DATE, ENCODERS
from granite_lab.logs.table import line_of, load
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


def open_source(
    path: Path,
    maps: Sequence[Layout] = (),
    rows: str | None = None,
    topics: Mapping[str, str] | None = None,
) -> Source:
    """Read a file by the layout that fits it.

    Args:
        path: the file.
        maps: column maps the user gave.
        rows: which rows to take, as ``run_id = 4``.
        topics: of a bag, ``imu``, ``joints`` and ``odom`` to the name of a topic.

    Raises:
        InputError: anything that is wrong with the file.
    """
    doubts: list[str] = []
    if is_bag(path):
        table, chosen = read_bag(path, topics or {})
        fits = [m for m in (match(layout, table) for layout in maps) if not m.missing]
        found = best(path, fits) if fits else match(bag_layout(table, chosen, doubts), table)
    else:
        table, found = recognise(path, maps)
        names = _wheels_passed_over(table, found)
        if names and found.layout not in maps:
            doubts.append(
                f"{path.name}: {', '.join(names)}: look like wheels, which layout '{found.layout.name}' does "
                "not know; inspect --write-map writes a map to which they can be added"
            )
    doubts = [*table.doubts, *doubts]
    condition, splitter = rows or found.layout.rows, _place(table, found.layout.split)
    selector = _selector(table, condition, asked=rows is not None) if condition else None
    wanted = {b.place for b in found.bindings}
    wanted |= {place for place in (selector[0] if selector else None, splitter) if place is not None}
    columns, cut = load(
        table, sorted(wanted), sorted({b.place for b in found.bindings if b.unit.name == DATE})
    )
    doubts += cut
    kept = np.arange(len(next(iter(columns.values()))), dtype=np.float64)
    if selector:
        chosen_rows = columns[selector[0]] == selector[1]
        if not chosen_rows.any():
            raise InputError(
                f"{path}: no row has {condition}", f"values there: {_values(columns[selector[0]])}"
            )
        columns = {place: values[chosen_rows] for place, values in columns.items()}
        kept = kept[chosen_rows]
    if splitter is not None and len(np.unique(columns[splitter])) > 1:
        name = found.layout.split
        raise InputError(
            f"{path}: holds several runs: {name} = {_values(columns[splitter])}",
            f"choose one, such as --rows '{name} = {np.unique(columns[splitter])[0]:g}'",
        )
    said = sidecar(path)
    beside = [said] if said != path and said.is_file() else []
    metadata = collect(table.comments, path, doubts, *beside)
    inputs = tuple(InputFile(file, sha256(file)) for file in (path, *beside))
    return Source(path, table, found, columns, kept, metadata, inputs, tuple(doubts))


def _wheels_passed_over(table: Table, found: Match) -> list[str]:
    """Name the columns that look like wheels, where the layout knows none."""
    if any(b.channel in ENCODERS for b in found.bindings):
        return []
    used = {b.place for b in found.bindings}
    names = [table.name(place) for place in range(table.width) if place not in used]
    return [name for name in names if set(by_name(name).to) & set(ENCODERS)]


def refuse_unused(sources: Sequence[Source], maps: Sequence[Layout]) -> None:
    """Refuse column maps that fit none of the files.

    Raises:
        InputError: naming the first column that is missing.
    """
    for layout in maps:
        if all(source.match.layout != layout for source in sources):
            table = sources[0].table
            raise no_match(table, [match(layout, table)], given=True)


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
        known = ", ".join(name for name in table.headers[0] if name)
        raise InputError(
            f"{table.path}: there is no column '{hit['name']}' to choose rows by", f"columns: {known}"
        )
    return None if place is None else (place, value)


def _values(values: Array) -> str:
    """List the different values of a column."""
    different = np.unique(values[np.isfinite(values)])
    return ", ".join(f"{v:g}" for v in different[:10]) + (", …" if len(different) > 10 else "")
