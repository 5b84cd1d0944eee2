"""One file of a trial: its layout, its columns as numbers, the rows that were asked for."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from granite_lab.errors import InputError, UsageError, at
from granite_lab.files import sha256
from granite_lab.logs.bag import bag_layout, read_bag
from granite_lab.logs.canonical import Metadata, collect
from granite_lab.logs.counters import Mask
from granite_lab.logs.dialect import Table
from granite_lab.logs.guess import by_name
from granite_lab.logs.layouts import Binding, Layout, Match, all_layouts, best, match, no_match
from granite_lab.logs.named import is_bag, sidecar
from granite_lab.logs.quantities import DATE, ENCODERS
from granite_lab.logs.table import line_of, load, open_table
from granite_lab.logs.trial import Array, InputFile

_ROWS = re.compile(r"\s*(?P<name>.+?)\s*==?\s*(?P<value>[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?)\s*")


@dataclass(frozen=True, eq=False)
class Source:
    """A file that was read.

    Attributes:
        match: the file and the layout it has.
        columns: place of a column to its (N,) values, in the file's units.
        kept: (N,) the row of data each value came from.
        metadata: what the file and its sidecar say.
        inputs: the file and its sidecar.
        doubts: what the reader was not sure of.
    """

    match: Match
    columns: dict[int, Array]
    kept: Array
    metadata: Metadata
    inputs: tuple[InputFile, ...]
    doubts: tuple[str, ...]

    @property
    def path(self) -> Path:
        """Where the file is."""
        return self.match.table.path

    def bindings(self, *channels: str) -> list[Binding]:
        """Return the bindings of some channels."""
        return [b for b in self.match.bindings if b.channel in channels]

    def place(self, row: int) -> str:
        """Name the place in the file of a row of `columns`."""
        table = self.match.table
        if table.data_line == 0:
            return f"{table.path}: sample {int(self.kept[row]) + 1}"
        return at(table.path, line_of(table, int(self.kept[row])) or None)

    def only(self, rows: Mask) -> Source:
        """Return the file as if it held only some rows, flags (N,)."""
        columns = {place: values[rows] for place, values in self.columns.items()}
        return dataclasses.replace(self, columns=columns, kept=self.kept[rows])


def recognise(path: Path, maps: Sequence[Layout] = (), topics: Mapping[str, str] | None = None) -> Match:
    """Open a table or a bag and find its layout.

    Args:
        path: the file.
        maps: column maps; they go before the catalogue.
        topics: of a bag, ``imu``, ``joints`` and ``odom`` to the name of a topic.

    Raises:
        InputError: not a table, of no known layout, or several fit equally well.
    """
    tries: list[Match] = []
    if is_bag(path):
        table, roles = read_bag(path, topics or {})
        tries = [match(layout, table) for layout in maps]
        if all(found.missing for found in tries):
            layout, doubts = bag_layout(table, roles)
            tries = [match(layout, _doubted(table, *doubts))]
    for layout in maps if not is_bag(path) else ():
        with suppress(InputError):  # the map may be meant for another file of the trial
            tries.append(match(layout, open_table(path, layout.table)))
    if all(found.missing for found in tries):
        table = open_table(path)
        if not table.headers:
            hint = "add one, or name the columns with names = […] under [table] in a column map"
            raise table.error("no header line, expected the names of the columns", hint, table.data_line)
        tries = [match(layout, table) for layout in all_layouts() if layout.may_be(table)]
        if all(found.missing for found in tries):
            near = [match(layout, table) for layout in maps] or tries
            raise no_match(near, bool(maps))
    chosen = best([found for found in tries if not found.missing])
    if is_bag(path) or chosen.layout in maps or any(b.channel in ENCODERS for b in chosen.bindings):
        return chosen
    table, known = chosen.table, {b.place for b in chosen.bindings}
    names = [table.name(place) for place in range(table.width) if place not in known]
    wheels = ", ".join(name for name in names if set(by_name(name).to) & set(ENCODERS))
    doubt = (
        f"{path.name}: {wheels}: look like wheels, which layout '{chosen.layout.name}' does "
        "not know; inspect --write-map writes a map to which they can be added"
    )
    return dataclasses.replace(chosen, table=_doubted(table, doubt)) if wheels else chosen


def _doubted(table: Table, *doubts: str) -> Table:
    return dataclasses.replace(table, doubts=(*table.doubts, *doubts))


def read_source(
    found: Match, rows: str | None, beside: Path | None = None, held: Mapping[int, Array] | None = None
) -> Source:
    """Read the columns that a layout binds.

    Args:
        found: the file and its layout.
        rows: which rows to take, as ``run_id = 4``.
        beside: a further TOML file with metadata, which go before the file's.
        held: columns that were read already.

    Raises:
        InputError: anything that is wrong with the columns or the rows.
    """
    table, layout, doubts = found.table, found.layout, list(found.table.doubts)
    condition, splitter = rows or layout.rows, _place(table, layout.split)
    selector = _selector(table, condition, asked=rows is not None) if condition else None
    wanted = {b.place for b in found.bindings}
    wanted |= {place for place in (selector[0] if selector else None, splitter) if place is not None}
    dates = {b.place for b in found.bindings if b.unit.name == DATE}
    if held is not None and wanted <= set(held) and dates == set(filter(table.is_dated, wanted)):
        columns = {place: held[place] for place in wanted}
    else:
        columns, cut = load(table, sorted(wanted), sorted(dates))
        doubts += cut
    beside_it = dict.fromkeys(
        side for side in (sidecar(table.path), beside) if side not in (None, table.path)
    )
    sides = [side for side in beside_it if side is not None and side.is_file()]
    metadata = collect(table.comments, table.path, doubts, sides)
    inputs = tuple(InputFile(file, sha256(file)) for file in (table.path, *sides))
    kept = np.arange(len(next(iter(columns.values()))), dtype=np.float64)
    source = Source(found, columns, kept, metadata, inputs, tuple(doubts))
    if selector:
        chosen = columns[selector[0]] == selector[1]
        if not chosen.any():
            raise table.error(f"no row has {condition}", f"values there: {_values(columns[selector[0]])}")
        source = source.only(chosen)
    if splitter is not None and len(runs := np.unique(source.columns[splitter])) > 1:
        what = f"holds several runs: {layout.split} = {_values(runs)}"
        raise table.error(what, f"choose one, such as --rows '{layout.split} = {runs[0]:g}'")
    return source


def _place(table: Table, name: str) -> int | None:
    """Find a column by its name, in any of the header rows."""
    for header in table.headers if name else ():
        if name.casefold() in (folded := [text.casefold() for text in header]):
            return folded.index(name.casefold())
    return None


def _selector(table: Table, condition: str, asked: bool) -> tuple[int, float] | None:
    """Parse ``column = value``."""
    hit = _ROWS.fullmatch(condition)
    if hit is None:
        raise UsageError(
            f"rows '{condition}' cannot be understood", "write column = number, as in --rows 'run_id = 4'"
        )
    place = _place(table, hit["name"])
    if place is None and asked:
        known = ", ".join(filter(None, table.headers[0]))
        raise table.error(f"there is no column '{hit['name']}' to choose rows by", f"columns: {known}")
    return None if place is None else (place, float(hit["value"]))


def _values(values: Array) -> str:
    """List the different values of a column."""
    different = np.unique(values[np.isfinite(values)])
    return ", ".join(f"{v:g}" for v in different[:10]) + (", …" if len(different) > 10 else "")
