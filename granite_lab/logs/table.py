"""Columns of numbers out of a text table: fast when all is well, exact about the place when not."""

from __future__ import annotations

import csv
import re
import warnings
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np
import pandas as pd

from granite_lab.errors import InputError, at
from granite_lab.files import readable
from granite_lab.logs.dialect import MISSING, Dialect, is_number, split_rows
from granite_lab.logs.encoding import open_text
from granite_lab.logs.trial import Array

# From 3.1 on pandas always reads numbers exactly and no longer wants to be asked to.
_EXACT = {} if pd.__version__ >= "3.1" else {"float_precision": "round_trip"}

_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d")


class _Counting:
    """A text file that counts the delimiters it hands out, to notice rows that are too long or short."""

    def __init__(self, file: TextIO, delimiter: str) -> None:
        self._file = file
        self._delimiter = delimiter
        self.delimiters = 0
        self.last = "\n"

    def read(self, size: int = -1) -> str:
        text = self._file.read(size)
        self.delimiters += text.count(self._delimiter)
        self.last = text[-1:] or self.last
        return text

    def __iter__(self) -> Iterator[str]:
        return iter(self._file)


def load(
    path: Path, dialect: Dialect, wanted: Sequence[int], dates: Sequence[int] = ()
) -> tuple[dict[int, Array], list[str]]:
    """Read some columns of a table as numbers.

    Args:
        path: the file.
        dialect: its layout, from `sniff`.
        wanted: places of the columns, counted from 0.
        dates: those of them that hold dates (ISO 8601; without a zone: UTC).

    Returns:
        place to (N,) values, NaN where the cell is empty or says so, dates as seconds since 1970;
        and warnings.

    Raises:
        InputError: a cell that is no finite number or no date, or a row of the wrong length, with its line.
    """
    numbers = [place for place in wanted if place not in dates]
    with open_text(path, dialect.encoding) as file:
        for _ in islice(file, dialect.data_line - 1):
            pass
        counting = _Counting(file, dialect.delimiter)
        try:
            frame = _parse(counting, dialect, wanted, dates)
        except OSError as error:
            raise readable(error, path) from None
        except (ValueError, OverflowError, pd.errors.ParserError) as error:
            short = find_fault(path, dialect, numbers)
            place = at(path, short) if short else str(path)
            raise InputError(f"{place}: not a table of numbers: {error}", "export the log again") from None
    doubts: list[str] = []
    # Rows of blanks are rows to pandas but hold no delimiter; they also end up in the careful count.
    if dialect.delimiter != " " and counting.delimiters != len(frame) * (dialect.width - 1):
        short = find_fault(path, dialect, numbers)
        if short:
            frame = frame.iloc[:-1]
            doubts.append(f"{at(path.name, short)}: the last row is cut off and was left out")
    columns = {place: frame[place].to_numpy(dtype=np.float64) for place in numbers}
    for values in columns.values():
        if np.isinf(values).any():
            find_fault(path, dialect, numbers)
    return columns | {place: _seconds(path, dialect, place, frame[place]) for place in dates}, doubts


def is_dated(dialect: Dialect, place: int) -> bool:
    """Say whether the first cells of a column are dates as ISO 8601 writes them."""
    cells = [row[place].strip() for row in dialect.sample if row[place].strip() not in MISSING]
    return bool(cells) and all(_DATE.match(cell) for cell in cells)


def _seconds(path: Path, dialect: Dialect, place: int, texts: pd.Series) -> Array:
    """Return dates as seconds since 1970, exact to the microsecond; NaN for an empty cell.

    Raises:
        InputError: a cell is no date, with its line.
    """
    written = texts.str.strip().str.replace(",", ".", regex=False)
    stamps = pd.to_datetime(written, utc=True, format="ISO8601", errors="coerce")
    wrong = np.flatnonzero(stamps.isna() & texts.notna())
    if len(wrong):
        row = int(wrong[0])
        raise InputError(
            f"{at(path, line_of(path, dialect, row) or None)}: column '{dialect.name(place)}': "
            f"{str(texts.iloc[row])[:30]!r} is not a date, expected one as 2026-03-01T12:00:00.25Z",
            "write dates by ISO 8601, or leave the cell empty",
        )
    since = (stamps - pd.Timestamp(0, tz="UTC")) / pd.Timedelta(seconds=1)
    return np.asarray(since, dtype=np.float64)


def _parse(file: _Counting, dialect: Dialect, wanted: Sequence[int], dates: Sequence[int]) -> pd.DataFrame:
    """Let pandas' C engine read the wanted columns."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pd.errors.ParserWarning)  # lengths of rows are checked by count
        return pd.read_csv(  # type: ignore[call-overload,no-any-return]
            file,
            sep=r"\s+" if dialect.delimiter == " " else dialect.delimiter,
            decimal=dialect.decimal,
            header=None,
            names=list(range(dialect.width)),
            usecols=sorted(set(wanted)),
            dtype={place: str if place in dates else np.float64 for place in wanted},
            index_col=False,
            na_values=list(MISSING),
            keep_default_na=False,
            skipinitialspace=True,
            engine="c",
            **_EXACT,
        )


def walk(path: Path, dialect: Dialect) -> Iterator[tuple[int, list[str]]]:
    """Yield every row of data with the line it ends on, slowly and exactly.

    Raises:
        InputError: the file is not a table.
    """
    with open_text(path, dialect.encoding) as file:
        rows = split_rows(islice(file, dialect.data_line - 1, None), dialect.delimiter)
        count = 0
        try:
            for count, row in enumerate(rows, 1):
                lines = getattr(rows, "line_num", count)
                if row:
                    yield dialect.data_line - 1 + lines, row
        except csv.Error as error:
            place = at(path, dialect.data_line + count)
            raise InputError(f"{place}: not a row of a table: {error}", "export the log again") from None


def find_fault(path: Path, dialect: Dialect, wanted: Sequence[int]) -> int:
    """Go through the table row by row and refuse the first cell or row that is wrong.

    Returns:
        the line of the last row if it is merely cut off, else 0.

    Raises:
        InputError: with file, line and column.
    """
    short = 0
    for line, row in walk(path, dialect):
        if short:
            break
        extra = len(row) == dialect.width + 1 and not row[-1].strip()
        if len(row) < dialect.width and not (len(row) == dialect.width - 1 and dialect.open_end):
            if any(cell.strip() for cell in row):
                short = line
                cells = len(row)
            continue
        if len(row) > dialect.width and not extra:
            raise InputError(
                f"{at(path, line)}: {len(row)} cells, expected {dialect.width}",
                "a delimiter too many, or a decimal comma in a comma-separated file",
            )
        for place in wanted:
            if place < len(row):
                check_cell(path, line, dialect, place, row[place])
    else:
        return short
    raise InputError(
        f"{at(path, short)}: {cells} cells, expected {dialect.width}",
        "a row of the log is cut off or damaged",
    )


def check_cell(path: Path, line: int, dialect: Dialect, place: int, cell: str) -> None:
    """Refuse a cell that is neither a finite number nor empty.

    Raises:
        InputError: with file, line and column.
    """
    text = cell.strip()
    if text in MISSING or text.casefold() in ("true", "false"):
        return
    where = f"{at(path, line)}: column '{dialect.name(place)}'"
    shown = text if len(text) <= 30 else text[:27] + "…"
    if not is_number(text, dialect.decimal):
        comma = dialect.decimal == "." and is_number(text.replace(",", "."))
        hint = (
            'write numbers with a decimal point, or say decimal = "," under [table] in a column map'
            if comma
            else "leave the cell empty where the sensor has no sample"
        )
        raise InputError(f"{where}: {shown!r} is not a number, expected one", hint)
    if not np.isfinite(float(text.replace(dialect.decimal, "."))):
        raise InputError(f"{where}: {shown} is not finite, expected a number", "leave the cell empty instead")


def line_of(path: Path, dialect: Dialect, row: int) -> int:
    """Return the line in the file of a row of data, counted from 0."""
    return next((line for line, _ in islice(walk(path, dialect), row, None)), 0)
