"""Columns of numbers out of a table: fast when all is well, exact about the place when not."""

from __future__ import annotations

import csv
import io
import warnings
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from granite_lab.errors import InputError, at
from granite_lab.files import readable, refuse_special
from granite_lab.logs.dialect import (
    DATED,
    MISSING,
    Table,
    TableFormat,
    is_number,
    lines_of,
    sniff,
    split_rows,
)
from granite_lab.logs.trial import Array

# From 3.1 on pandas always reads numbers exactly and no longer wants to be asked to.
_EXACT = {} if pd.__version__ >= "3.1" else {"float_precision": "round_trip"}

_SHORTEST = 10
"""Vectors of a MATLAB file with fewer values are parameters, not samples; matrices have at most as many."""


def open_table(path: Path, said: TableFormat | None = None) -> Table:
    """Open a table: a text file, or a MATLAB file.

    Raises:
        InputError: it cannot be read as a table.
    """
    return _matlab(path) if path.suffix.lower() == ".mat" else sniff(path, said)


def load(
    table: Table, wanted: Sequence[int], dates: Sequence[int] = ()
) -> tuple[dict[int, Array], list[str]]:
    """Read some columns of a table as numbers.

    Args:
        table: from `open_table`.
        wanted: places of the columns, counted from 0.
        dates: those of them that hold dates (ISO 8601; without a zone: UTC).

    Returns:
        place to (N,) values, NaN where the cell is empty or says so, dates as seconds since 1970;
        and warnings.

    Raises:
        InputError: a cell that is no finite number or no date, or a row of the wrong length, with its line.
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


def line_of(table: Table, row: int) -> int:
    """Return the line in the file of a row of data, counted from 0."""
    return next((line for line, _ in islice(_walk(table), row, None)), 0)


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
        raise table.error(what, hint, line_of(table, row), place)
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


def _walk(table: Table) -> Iterator[tuple[int, list[str]]]:
    """Yield every row of data with the line it ends on, slowly and exactly."""
    rows = split_rows(islice(lines_of(table.text), table.data_line - 1, None), table.delimiter)
    count = 0
    try:
        for count, row in enumerate(rows, 1):
            if row:
                yield table.data_line - 1 + getattr(rows, "line_num", count), row
    except csv.Error as error:
        line = table.data_line + count
        raise table.error(f"not a row of a table: {error}", "export the log again", line) from None


def _find_fault(table: Table, wanted: Sequence[int]) -> int:
    """Go through the table row by row and refuse the first cell or row that is wrong.

    Returns:
        the line of the last row if it is merely cut off, else 0.
    """
    short = cells = 0
    for line, row in _walk(table):
        if short:
            raise table.error(
                f"{cells} cells, expected {table.width}", "a row of the log is cut off or damaged", short
            )
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


def _matlab(path: Path) -> Table:
    """Take the vectors of a MATLAB file, single or in structs, as columns; they must be of one length.

    Raises:
        InputError: the file cannot be read, or its vectors make no table.
    """
    from scipy.io import loadmat  # noqa: PLC0415, only where a log is one

    refuse_special(path)
    again = "in MATLAB: s = table2struct(T, 'ToScalar', true); save('log.mat', '-struct', 's', '-v7')"
    try:
        held = loadmat(path, simplify_cells=True)
    except OSError as error:
        raise readable(error, path) from None
    except NotImplementedError:
        raise InputError(f"{path}: is a MATLAB file of version 7.3", f"save it with -v7; {again}") from None
    except Exception as error:  # the parser raises whatever a damaged file makes it stumble over
        what = " ".join(str(error).split())[:120] or type(error).__name__
        raise InputError(
            f"{path}: cannot be read as a MATLAB file: {what}", "copy or save it again"
        ) from None
    found = dict(_vectors({key: value for key, value in held.items() if not key.startswith("__")}, ""))
    lengths = sorted({len(values) for values in found.values()})
    if len(lengths) != 1:
        one_each = [f"{next(n for n, v in found.items() if len(v) == k)} ({k})" for k in lengths[:4]]
        what = f"vectors of different lengths: {', '.join(one_each)}" if lengths else "no vectors of numbers"
        raise InputError(f"{path}: {what}, expected a column a quantity, all of one length", again)
    short = [name.rpartition(".")[2] for name in found]
    names = tuple(short if len(set(short)) == len(short) else found)
    return Table(path, (names,), len(names), "MATLAB", numbers=tuple(found.values()))


def _vectors(held: dict[str, Any], prefix: str) -> Iterator[tuple[str, Array]]:
    """Yield the vectors in a MATLAB file or struct; a matrix is several, along its longer side."""
    for key, value in held.items():
        if isinstance(value, dict):
            yield from _vectors(value, f"{prefix}{key}.")
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and max(value.shape) >= _SHORTEST:
            rows = np.atleast_2d(value.T if value.ndim == 2 and value.shape[0] >= value.shape[1] else value)
            if rows.ndim == 2 and len(rows) <= _SHORTEST:
                ends = {1: [""], 3: ["_x", "_y", "_z"]}.get(
                    len(rows), [f"_{k + 1}" for k in range(len(rows))]
                )
                yield from zip((f"{prefix}{key}{end}" for end in ends), rows.astype(np.float64), strict=True)
