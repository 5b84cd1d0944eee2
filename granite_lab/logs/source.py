"""One file of a trial: its layout, and the columns that the layout binds as numbers."""

from __future__ import annotations

import dataclasses
import io
import re
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from granite_lab.errors import InputError, UsageError, at
from granite_lab.files import sha256
from granite_lab.logs.bag import bag_layout, read_bag
from granite_lab.logs.canonical import Metadata, collect
from granite_lab.logs.counters import Mask
from granite_lab.logs.layouts import Binding, Layout, Match, all_layouts, best, match, no_match
from granite_lab.logs.quantities import DATE, ENCODERS, by_name
from granite_lab.logs.table import DATED, MISSING, Table, is_number, open_table
from granite_lab.logs.trial import Array, InputFile, is_bag, sidecar

# From 3.1 on pandas always reads numbers exactly and no longer wants to be asked to.
_EXACT = {} if pd.__version__ >= "3.1" else {"float_precision": "round_trip"}
_ROWS = re.compile(r"\s*(?P<name>.+?)\s*==?\s*(?P<value>[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?)\s*")


@dataclass(frozen=True, eq=False)
class Source:
    """A file that was read."""

    match: Match
    columns: dict[int, Array]  # place of a column to its (N,) values, in the file's units
    kept: Array  # (N,) the row of data each value came from
    metadata: Metadata  # what the file and its sidecar say
    inputs: tuple[InputFile, ...]  # the file and its sidecar
    doubts: list[str]  # warnings are added here

    @property
    def path(self) -> Path:
        """Where the file is."""
        return self.match.table.path

    def doubt(self, text: str) -> None:
        """Add a warning about the file."""
        self.doubts.append(f"{self.path.name}: {text}")

    def refuse(self, what: str, hint: str) -> InputError:
        """Return the error that names the file."""
        return InputError(f"{self.path}: {what}", hint)

    def bindings(self, *channels: str) -> list[Binding]:
        """Return the bindings of some channels."""
        return [b for b in self.match.bindings if b.channel in channels]

    def place(self, row: int) -> str:
        """Name the place in the file of a row of `columns`."""
        table, logged = self.match.table, int(self.kept[row])
        if table.data_line == 0:
            return f"{table.path}: sample {logged + 1}"
        return at(table.path, table.line_of(logged) or None)

    def only(self, rows: Mask) -> Source:
        """Return the file as if it held only some rows, flags (N,)."""
        columns = {place: values[rows] for place, values in self.columns.items()}
        return dataclasses.replace(self, columns=columns, kept=self.kept[rows])


def recognise(path: Path, maps: Sequence[Layout] = (), topics: Mapping[str, str] | None = None) -> Match:
    """Open a table or a bag and find its layout, of some column maps or else of the catalogue.

    Refuses what is no table, of no known layout, or of several that fit equally well.
    """
    tries: list[Match] = []
    if bag := is_bag(path):
        table, roles = read_bag(path, topics or {})
        tries = [match(layout, table) for layout in maps]
        if all(found.missing for found in tries):
            layout, doubts = bag_layout(table, roles)
            tries = [match(layout, table.doubted(*doubts))]
    for layout in maps if not bag else ():
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
    if bag or chosen.layout in maps or any(b.channel in ENCODERS for b in chosen.bindings):
        return chosen
    table, known = chosen.table, {b.place for b in chosen.bindings}
    names = [table.name(place) for place in range(table.width) if place not in known]
    wheels = ", ".join(name for name in names if set(by_name(name).to) & set(ENCODERS))
    unknown = f"look like wheels, which layout '{chosen.layout.name}' does not know"
    remedy = "inspect --write-map writes a map to which they can be added"
    doubted = table.doubted(f"{path.name}: {wheels}: {unknown}; {remedy}")
    return dataclasses.replace(chosen, table=doubted) if wheels else chosen


def read_source(
    found: Match,
    rows: str | None = None,
    beside: Path | None = None,
    held: Mapping[int, Array] | None = None,
) -> Source:
    """Read the columns that a layout binds, unless they are among those `held`; of some rows, if asked for.

    Metadata in a further TOML file `beside` the log go before its own.
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
    beside_it = dict.fromkeys((sidecar(table.path), beside))
    sides = [side for side in beside_it if side and side != table.path and side.is_file()]
    metadata = collect(table.comments, table.path, doubts, sides)
    inputs = tuple(InputFile(file, sha256(file)) for file in (table.path, *sides))
    kept = np.arange(len(next(iter(columns.values()))), dtype=np.float64)
    source = Source(found, columns, kept, metadata, inputs, doubts)
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
        hint = "write column = number, as in --rows 'run_id = 4'"
        raise UsageError(f"rows '{condition}' cannot be understood", hint)
    place = _place(table, hit["name"])
    if place is None and asked:
        known = ", ".join(filter(None, table.headers[0]))
        raise table.error(f"there is no column '{hit['name']}' to choose rows by", f"columns: {known}")
    return None if place is None else (place, float(hit["value"]))


def _values(values: Array) -> str:
    """List the different values of a column."""
    different = np.unique(values[np.isfinite(values)])
    return ", ".join(f"{v:g}" for v in different[:10]) + (", …" if len(different) > 10 else "")


def load(table: Table, wanted: Sequence[int], dates: Sequence[int]) -> tuple[dict[int, Array], list[str]]:
    """Read the columns at some places as numbers, `dates` among them as [s] since 1970 (no zone: UTC).

    Returns place to values (N,), NaN where the cell is empty or says so; and warnings. A cell that is no
    finite number or no date and a row of the wrong length are refused with their line.
    """
    if table.numbers:
        return {place: table.numbers[place] for place in wanted}, []
    numbers = [place for place in wanted if place not in dates]
    begin = 0
    for _ in range(table.data_line - 1):
        begin = table.text.find(b"\n", begin) + 1
    try:
        frame = _parse(table, begin, wanted, dates)
    except (ValueError, OverflowError) as error:
        line = _find_fault(table, numbers)
        raise table.error(f"not a table of numbers: {error}", "export the log again", line) from None
    doubts: list[str] = []
    # Rows of blanks are rows to pandas but hold no delimiter; they also end up in the careful count.
    delimiters = table.text.count(table.delimiter.encode(), begin)
    if table.delimiter != " " and delimiters != len(frame) * (table.width - 1):
        short = _find_fault(table, numbers)
        if short:
            frame = frame.iloc[:-1]
            doubts.append(f"{at(table.path.name, short)}: the last row is cut off and was left out")
    columns = {place: frame[place].to_numpy(dtype=np.float64) for place in numbers}
    if any(np.isinf(values).any() for values in columns.values()):
        _find_fault(table, numbers)
    return columns | {place: _seconds(table, place, frame[place]) for place in dates}, doubts


def _seconds(table: Table, place: int, texts: pd.Series) -> Array:
    """Return dates as seconds since 1970, exact to the microsecond; NaN for an empty cell."""
    written = texts.str.strip().where(texts.str.match(r"\s*\d{4}\D", na=False))
    if not written.str.contains("T", na=True).all():
        written = written.str.replace(DATED, r"\1-\2-\3T\4:\5:", regex=True).str.rstrip(":")
    written = written.str.replace(r"(?<=:\d\d:\d\d)[,_:](?=\d+\D*$)", ".", regex=True)
    stamps = pd.to_datetime(written, utc=True, format="ISO8601", errors="coerce")
    wrong = np.flatnonzero(stamps.isna() & texts.notna())
    if len(wrong):
        row = int(wrong[0])
        what = f"{str(texts.iloc[row])[:30]!r} is not a date, expected one as 2026-03-01T12:00:00.25Z"
        hint = "write dates by ISO 8601, or leave the cell empty"
        raise table.error(what, hint, table.line_of(row), place)
    since = (stamps - pd.Timestamp(0, tz="UTC")) / pd.Timedelta(seconds=1)
    return np.asarray(since, dtype=np.float64)


def _parse(table: Table, begin: int, wanted: Sequence[int], dates: Sequence[int]) -> pd.DataFrame:
    """Let pandas' C engine read the wanted columns."""
    file = io.BytesIO(table.text)
    file.seek(begin)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pd.errors.ParserWarning)  # lengths of rows are checked by count
        return pd.read_csv(  # type: ignore[call-overload,no-any-return]
            file,
            sep=r"\s+" if table.delimiter == " " else table.delimiter,
            decimal=table.decimal,
            header=None,
            names=list(range(table.width)),
            usecols=sorted(set(wanted)),
            dtype={place: str if place in dates else np.float64 for place in wanted},
            index_col=False,
            na_values=list(MISSING),
            keep_default_na=False,
            skipinitialspace=True,
            encoding_errors="replace",
            engine="c",
            **_EXACT,
        )


def _find_fault(table: Table, wanted: Sequence[int]) -> int:
    """Refuse the first cell or row that is wrong; return the line of a last row that is cut off, else 0."""
    short = cells = 0
    for line, row in table.walk():
        if short:
            hint = "a row of the log is cut off or damaged"
            raise table.error(f"{cells} cells, expected {table.width}", hint, short)
        more = len(row) - table.width
        if more < 0 and not (more == -1 and table.open_end):
            if any(cell.strip() for cell in row):
                short, cells = line, len(row)
            continue
        if more > 1 or (more == 1 and row[-1].strip()):
            hint = "a delimiter too many, or a decimal comma in a comma-separated file"
            raise table.error(f"{len(row)} cells, expected {table.width}", hint, line)
        for place in wanted:
            if place < len(row):
                _check_cell(table, line, place, row[place].strip())
    return short


def _check_cell(table: Table, line: int, place: int, text: str) -> None:
    """Refuse a cell that is neither a finite number nor empty."""
    if text in MISSING or text.casefold() in ("true", "false"):
        return
    shown = text if len(text) <= 30 else text[:27] + "…"
    if not is_number(text, table.decimal):
        hint = "leave the cell empty where the sensor has no sample"
        if table.decimal == "." and is_number(text.replace(",", ".")):
            hint = 'write numbers with a decimal point, or say decimal = "," under [table] in a column map'
        raise table.error(f"{shown!r} is not a number, expected one", hint, line, place)
    if not np.isfinite(float(text.replace(table.decimal, "."))):
        what = f"{shown} is not finite, expected a number"
        raise table.error(what, "leave the cell empty instead", line, place)
