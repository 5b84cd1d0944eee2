"""One file of a trial: its layout, its columns as numbers, the rows that were asked for."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from granite_lab.errors import InputError, UsageError
from granite_lab.files import sha256
from granite_lab.logs.bag import open_bag
from granite_lab.logs.dialect import Dialect, TableFormat, sniff
from granite_lab.logs.layouts import Layout, load_layout
from granite_lab.logs.matching import Match, best, choose, match, no_match
from granite_lab.logs.metadata import Metadata, collect
from granite_lab.logs.named import is_bag, sidecar
from granite_lab.logs.source import Source
from granite_lab.logs.table import is_dated, load
from granite_lab.logs.trial import Array, InputFile
from granite_lab.logs.units import DATE, find_unit

_ROWS = re.compile(r"\s*(?P<name>.+?)\s*==?\s*(?P<value>[^=]+?)\s*")


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
    path = Path(path)
    if is_bag(path):
        return open_bag(path, maps, topics)
    dialect, found = recognise(path, maps)
    found = _with_dates(dialect, found)
    doubts = list(dialect.doubts)
    condition = rows or found.layout.rows
    wanted = {b.place for b in found.bindings}
    selector = _selector(path, dialect, condition, asked=rows is not None) if condition else None
    splitter = _place(dialect, found.layout.split) if found.layout.split else None
    columns, cut = load(
        path,
        dialect,
        sorted(
            wanted
            | ({selector[0]} if selector else set())
            | ({splitter} - {None} if splitter is not None else set())
        ),
        sorted({b.place for b in found.bindings if b.unit.name == DATE}),
    )
    doubts += cut
    kept = np.arange(len(next(iter(columns.values()))), dtype=np.float64)
    if selector:
        chosen = columns[selector[0]] == selector[1]
        if not chosen.any():
            raise InputError(
                f"{path}: no row has {condition}", f"values there: {_values(columns[selector[0]])}"
            )
        columns = {place: values[chosen] for place, values in columns.items()}
        kept = kept[chosen]
    if splitter is not None and len(np.unique(columns[splitter])) > 1:
        name = found.layout.split
        raise InputError(
            f"{path}: holds several runs: {name} = {_values(columns[splitter])}",
            f"choose one, such as --rows '{name} = {np.unique(columns[splitter])[0]:g}'",
        )
    metadata, inputs = _about(path, dialect, doubts)
    return Source(path, dialect, found, columns, kept, metadata, inputs, tuple(doubts))


def recognise(path: Path, maps: Sequence[Layout] = ()) -> tuple[Dialect, Match]:
    """Find out how a file is laid out and which columns feed which channels.

    Raises:
        InputError: not a table, or of no known layout.
    """
    fits = []
    for layout in maps:
        with suppress(InputError):  # the map may be meant for another file of the trial
            dialect = sniff(path, layout.table)
            fits.append((dialect, match(layout, path, dialect)))
    fits = [(dialect, found) for dialect, found in fits if found.complete]
    if fits:
        chosen = best(path, [found for _, found in fits])
        return next(fit for fit in fits if fit[1] is chosen)
    dialect = sniff(path)
    found = choose(path, dialect, maps)
    if found.layout.table != TableFormat():
        dialect = sniff(path, found.layout.table)
        found = choose(path, dialect, [found.layout])
    return dialect, found


def _with_dates(dialect: Dialect, found: Match) -> Match:
    """Take stamps that are written as dates for dates, whatever unit the layout gives them."""
    date = find_unit(DATE)
    assert date is not None
    bindings = (
        dataclasses.replace(b, unit=date) if b.channel == "t" and is_dated(dialect, b.place) else b
        for b in found.bindings
    )
    return dataclasses.replace(found, bindings=tuple(bindings))


def given_maps(maps: str | Path | Sequence[str | Path] | None) -> tuple[Layout, ...]:
    """Load the column maps a user gave, by name or path."""
    if maps is None:
        return ()
    names = (maps,) if isinstance(maps, (str, Path)) else tuple(maps)
    return tuple(load_layout(name) for name in names)


def refuse_unused(sources: Sequence[Source], maps: Sequence[Layout]) -> None:
    """Refuse column maps that fit none of the files.

    Raises:
        InputError: naming the first column that is missing.
    """
    for layout in maps:
        if all(source.match.layout != layout for source in sources):
            first = sources[0]
            found = match(layout, first.path, first.dialect)
            raise no_match(first.path, first.dialect, [found], given=True)


def _place(dialect: Dialect, name: str) -> int | None:
    """Find a column by its name, in any of the header rows."""
    for header in dialect.headers:
        for place, text in enumerate(header):
            if text.casefold() == name.casefold():
                return place
    return None


def _selector(path: Path, dialect: Dialect, condition: str, asked: bool) -> tuple[int, float] | None:
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
    place = _place(dialect, hit["name"])
    if place is None:
        if not asked:
            return None
        known = ", ".join(name for name in dialect.headers[0] if name)
        raise InputError(f"{path}: there is no column '{hit['name']}' to choose rows by", f"columns: {known}")
    return place, value


def _values(values: Array) -> str:
    """List the different values of a column."""
    different = np.unique(values[np.isfinite(values)])
    return ", ".join(f"{v:g}" for v in different[:10]) + (", …" if len(different) > 10 else "")


def _about(path: Path, dialect: Dialect, doubts: list[str]) -> tuple[Metadata, tuple[InputFile, ...]]:
    """Read what the file and its sidecar say about the trial."""
    said = sidecar(path)
    beside = said if said != path and said.is_file() else None
    metadata = collect(dialect.comments, path, doubts, beside)
    files = [path, *([beside] if beside else [])]
    return metadata, tuple(InputFile(file, sha256(file)) for file in files)
