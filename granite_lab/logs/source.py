"""One file of a trial: its layout, and the columns that the layout binds as numbers."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from granite_lab.errors import InputError, UsageError
from granite_lab.files import sha256
from granite_lab.logs.bag import bag_layout, read_bag
from granite_lab.logs.canonical import Metadata, collect
from granite_lab.logs.cells import Cells, load
from granite_lab.logs.counters import Mask
from granite_lab.logs.layouts import Binding, Layout, Match, all_layouts, best, match, no_match
from granite_lab.logs.quantities import ACCELERATION, DATE, ENCODERS, RATE, by_name
from granite_lab.logs.rows import is_number
from granite_lab.logs.sensors.doubt import Doubt, some_of
from granite_lab.logs.table import Table, open_table
from granite_lab.logs.trial import Array, InputFile, is_bag, sidecar


@dataclass(frozen=True, eq=False)
class Source:
    """A file that was read."""

    match: Match
    columns: dict[int, Array]  # place of a column to its (N,) values, in the file's units
    kept: Array  # (N,) the row of data each value came from
    metadata: Metadata  # what the file and its sidecar say
    inputs: tuple[InputFile, ...]  # the file and its sidecar
    doubts: list[Doubt]  # warnings are added here
    units: dict[str, str] = field(
        default_factory=dict
    )  # channels to units found right, where another was said

    @property
    def path(self) -> Path:
        """Where the file is."""
        return self.match.table.path

    def doubt(self, what: str, where: str = "", remedy: str = "", *, dead: bool = False) -> None:
        """Add a warning about the file, or a place in it, with what to do about it."""
        self.doubts.append(Doubt(what, where, remedy, dead=dead).of(self.path.name))

    def refuse(self, message: str, hint: str) -> InputError:
        """Return the error that names the file."""
        return InputError(f"{self.path}: {message}", hint)

    def bindings(self, *channels: str) -> list[Binding]:
        """Return the bindings of some channels."""
        return [b for b in self.match.bindings if b.channel in channels]

    def place(self, row: int) -> str:
        """Name the place in the file of a row of `columns`."""
        return self.match.table.where(int(self.kept[row]))

    def only(self, rows: Mask) -> Source:
        """Return the file as if it held only some rows, flags (N,)."""
        columns = {place: values[rows] for place, values in self.columns.items()}
        return dataclasses.replace(self, columns=columns, kept=self.kept[rows])


def recognise(
    path: Path,
    maps: Sequence[Layout] = (),
    topics: Mapping[str, str] | None = None,
    channels: Collection[str] = (),
) -> Match:
    """Open a table or a bag and find its layout, of some column maps or else of the catalogue.

    Of several that fit, one that feeds one of the `channels`, for which the file was given, goes first.
    Refuses what is no table, of no known layout, or of several that fit equally well.
    """
    tries: list[Match] = []
    if bag := is_bag(path):
        named = [column.name for layout in maps for column in layout.column]
        table, roles = read_bag(path, topics or {}, named)
        tries = [match(layout, table) for layout in maps]
        if all(fit.missing for fit in tries):
            layout, doubts = bag_layout(table, roles)
            tries = [match(layout, table.doubted(*doubts))]
    misfits: list[InputError] = []
    meant = [layout for layout in maps if not layout.file or re.search(layout.file, path.name)]
    for layout in (meant or maps) if not bag else ():
        try:  # the map may be meant for another file of the trial
            tries.append(match(layout, open_table(path, layout.table)))
        except InputError as error:
            misfits.append(error)
    if all(fit.missing for fit in tries):
        tries = _of_catalogue(path, maps, tries, misfits)
    fits = [fit for fit in tries if not fit.missing]
    chosen = best([fit for fit in fits if any(b.channel in channels for b in fit.bindings)] or fits)
    if bag or chosen.layout in maps:
        return chosen
    lost = ", ".join(_lost(chosen))
    unknown = f"not used, because layout '{chosen.layout.name}' does not know the name or its unit"
    remedy = "inspect --write-map writes a map to which it can be added"
    doubted = chosen.table.doubted(f"{path.name}: {lost}: {unknown}; {remedy}")
    return dataclasses.replace(chosen, table=doubted) if lost else chosen


def _lost(chosen: Match) -> list[str]:
    """Return the columns that a layout does not bind, and that by their names complete what it binds.

    These are wheels where it binds none, and axes of a sensor of which it binds others.
    """
    table, bound = chosen.table, {b.channel for b in chosen.bindings}
    used = {b.place for b in chosen.bindings}
    wanted = set() if bound & set(ENCODERS) else set(ENCODERS)
    for axes in (set(ACCELERATION), set(RATE)):
        wanted |= axes - bound if axes & bound else set()
    names = [table.names[place] for place in range(table.width) if place not in used]
    bare = [re.split(r"\s*[\[(]", name)[0] for name in names]  # without an unknown unit
    return [n for n, b in zip(names, bare, strict=True) if {*by_name(n).to, *by_name(b).to} & wanted]


def _of_catalogue(
    path: Path, maps: Sequence[Layout], tries: list[Match], misfits: Sequence[InputError]
) -> list[Match]:
    """Try the catalogue on a text that no given map fits; where it fails, say why the maps do."""
    try:
        table = open_table(path)
    except InputError as error:
        raise (no_match(tries, given=True) if tries else next(iter(misfits), error)) from None
    fits = [match(layout, table) for layout in all_layouts() if layout.may_be(table)]
    if not maps:  # a robot may have fewer sensors
        least = max([table.width / 2, *(attempt.columns for attempt in fits if not attempt.missing)])
        partly = [match(attempt.layout, table, partly=True) for attempt in fits if attempt.missing]
        fits += [fit for fit in partly if not fit.missing and fit.columns > least]
    if all(attempt.missing for attempt in fits):
        raise misfits[0] if misfits else no_match(tries or fits, bool(maps))
    return fits


def read_source(
    fit: Match,
    rows: str | None = None,
    beside: Path | None = None,
    cells: Cells | None = None,
) -> Source:
    """Read the columns that a layout binds, unless `cells` holds them; of some rows, if asked for.

    Metadata in a further TOML file `beside` the log go before its own.
    """
    table, layout, doubts = fit.table, fit.layout, list(fit.table.doubts)
    condition, splitter = rows or layout.rows, _place(table, layout.split)
    selector = _selector(table, condition, asked=rows is not None) if condition else None
    wanted = {b.place for b in fit.bindings}
    wanted |= {place for place in (selector[0] if selector else None, splitter) if place is not None}
    dates = {b.place for b in fit.bindings if b.unit.name == DATE}
    if cells is None or not wanted <= set(cells.columns) or dates != set(filter(table.is_dated, wanted)):
        cells = load(table, sorted(wanted), sorted(dates))
    columns = {place: cells.columns[place] for place in wanted}
    whole, damaged = cells.whole(table, wanted)
    doubts += damaged
    beside_it = dict.fromkeys((sidecar(table.path), beside))
    sides = [side for side in beside_it if side and side != table.path and side.is_file()]
    metadata = collect(table.comments, table.path, doubts, sides)
    inputs = tuple(InputFile(file, sha256(file)) for file in (table.path, *sides))
    kept = np.arange(len(next(iter(columns.values()))), dtype=np.float64)
    source = Source(fit, columns, kept, metadata, inputs, [Doubt(text) for text in doubts])
    source = source if whole.all() else source.only(whole)
    if selector:
        chosen = source.columns[selector[0]] == selector[1]
        if not chosen.any():
            there = _values(source.columns[selector[0]])
            raise table.error(f"no row has {condition}", f"values there: {there}")
        source = source.only(chosen)
    if splitter is not None and len(runs := np.unique(source.columns[splitter])) > 1:
        message = f"holds several runs: {layout.split} = {_values(runs)}"
        raise table.error(message, f"choose one, such as --rows '{layout.split} = {runs[0]:g}'")
    return source


def _place(table: Table, name: str) -> int | None:
    """Find a column by its name, in any of the header rows."""
    for header in (*table.headers, table.names) if name else ():
        if name.casefold() in (folded := [text.casefold() for text in header]):
            return folded.index(name.casefold())
    return None


def _selector(table: Table, condition: str, asked: bool) -> tuple[int, float] | None:
    """Parse ``column = value``."""
    name, _, value = condition.rpartition("=")
    name = name.rstrip("= ").strip()
    if not name or not is_number(value):
        hint = "write column = number, as in --rows 'run_id = 4'"
        raise UsageError(f"rows '{condition}' cannot be understood", hint)
    place = _place(table, name)
    if place is None and asked:
        listed = ", ".join(table.names)
        raise table.error(f"there is no column '{name}' to choose rows by", f"columns: {listed}")
    return None if place is None else (place, float(value))


def _values(values: Array) -> str:
    """List the different values of a column."""
    return some_of([f"{v:g}" for v in np.unique(values[np.isfinite(values)])], 10)
