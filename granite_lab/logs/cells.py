"""Columns of a table as numbers, and the rows that are left out because they are damaged."""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from granite_lab.errors import at
from granite_lab.logs.counters import Mask
from granite_lab.logs.dates import seconds
from granite_lab.logs.rows import MISSING, is_number
from granite_lab.logs.sensors.doubt import some_of
from granite_lab.logs.table import Table
from granite_lab.logs.trial import Array

# From 3.1 on pandas always reads numbers exactly and no longer wants to be asked to.
_EXACT = {} if pd.__version__ >= "3.1" else {"float_precision": "round_trip"}
# So large a share of damaged rows is left out, and two rows of a short log. Damage that turns a digit into
# another one does not show; it is about half as frequent (of the eight bits of a digit, four make another
# digit of most). Spikes are removed from up to one sample in a hundred (`sensors.imu.despike`).
_SHARE, _FEW = 0.01, 2
_SHOWN = 5  # lines that a warning lists
_BLOCK = 20_000  # rows that are read at a time
_LONGEST = 30  # characters of a cell that a message shows
_BOOLEANS = {"true": "1", "false": "0"}
_EMPTY = "leave the cell empty where the sensor has no sample"
_DATE = "write dates by ISO 8601, or leave the cell empty where the sensor has no sample"
_POINT = 'write numbers with a decimal point, or say decimal = "," under [table] in a column map'
_CELLS = (
    "a delimiter too many or too few, or a decimal comma in a comma-separated file; delimiter and decimal "
    "under [table] in a column map say how the text is laid out"
)


@dataclass(frozen=True, eq=False)
class Cells:
    """Columns of a table."""

    columns: Mapping[int, Array]  # place to values (N,), NaN where the cell is empty, says so, or is faulty
    faults: Mapping[int, Mapping[int, str]] = field(default_factory=dict)  # place to row to what it says
    dates: Collection[int] = ()  # places of dates

    def whole(self, table: Table, wanted: Collection[int]) -> tuple[Mask, list[str]]:
        """Return which rows (N,) hold no faulty cell in the wanted columns, and warnings about the others.

        A row with one is left out with all its cells, for what damaged one may have changed a digit of
        another. The warnings also say what else stands among the rows.

        Raises:
            InputError: too many rows are damaged, or the columns change their places.
        """
        rows, total = table.rows, len(next(iter(self.columns.values()), ()))
        keep, faulty = np.ones(total, dtype=bool), {line: (message, _CELLS) for line, message in rows.damaged}
        for place in wanted:
            for row, text in self.faults.get(place, {}).items():
                if keep[row]:
                    line = int(rows.lines[row]) if table.data_line else row + 1
                    message, hint = _fault(text, table.decimal, "date" if place in self.dates else "number")
                    faulty[line] = f"column '{table.names[place]}': {message}", hint
                keep[row] = False
        total += len(rows.damaged)
        damaged = sorted(faulty)
        message, hint = faulty[damaged[0]] if damaged else ("", "")
        if len(damaged) > _FEW + _SHARE * total:
            raise table.error(f"{message}; {len(damaged)} of {total} rows are damaged", hint, damaged[0])
        self._refuse_header(table, keep, wanted)
        many, out = f"{len(damaged)} damaged rows were", "left out"
        header, comments = "the header stands here again", "among the rows passed over"
        return keep, [
            *_listed(table, damaged, f"{message}: the row was {out}", f"{message}: {many} {out}"),
            *_listed(table, rows.headers, header, f"{header}, {len(rows.headers)} times"),
            *_listed(
                table, rows.comments, f"a comment {comments}", f"{len(rows.comments)} comments {comments}"
            ),
        ]

    def _refuse_header(self, table: Table, keep: Mask, wanted: Collection[int]) -> None:
        """Refuse a row of other names in the middle: the columns behind it are others."""
        for row in np.flatnonzero(~keep).tolist() if len(wanted) > 1 else ():
            names = {self.faults.get(place, {}).get(row, "") for place in wanted}
            if len(names) == len(wanted) and all(name[:1].isalpha() for name in names):
                message = f"another header in the middle: {', '.join(sorted(names)[:5])}"
                hint = "cut the file there and read the parts as separate trials"
                raise table.error(message, hint, int(table.rows.lines[row]))


def _fault(text: str, decimal: str, kind: str) -> tuple[str, str]:
    """Say what is wrong with a cell, and what to do."""
    shown = repr(text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "…")
    if kind == "date":
        return f"{shown} is not a date, expected one as 2026-03-01T12:00:00.25Z", _DATE
    if is_number(text, decimal):
        return f"{shown} is not finite, expected a number", _EMPTY
    point = decimal == "." and is_number(text, ",")
    return f"{shown} is not a number, expected one", _POINT if point else _EMPTY


def _listed(table: Table, lines: Sequence[int], single: str, several: str) -> list[str]:
    """Return a warning about some lines, none if there are none."""
    if not lines:
        return []
    message = single if len(lines) == 1 else f"{several}, lines {some_of([*map(str, lines)], _SHOWN)}"
    return [f"{at(table.path.name, lines[0])}: {message}"]


def load(table: Table, wanted: Sequence[int], dates: Sequence[int]) -> Cells:
    """Read the columns at some places as numbers, `dates` among them as [s] since 1970 (no zone: UTC).

    Raises:
        InputError: no row is whole.
    """
    if table.numbers:
        columns = {place: table.numbers[place] for place in wanted}
        infinite = {place: np.flatnonzero(np.isinf(values)).tolist() for place, values in columns.items()}
        return Cells(columns, {place: dict.fromkeys(rows, "inf") for place, rows in infinite.items() if rows})
    if len(table.rows.lines) == 0:
        raise table.error("no row is whole", _CELLS, table.data_line)
    numbers = [place for place in wanted if place not in dates]
    parts = dict[int, list[Array]]((place, []) for place in numbers)
    faults = dict[int, dict[int, str]]((place, {}) for place in wanted)
    texts: list[pd.DataFrame] = []
    for first, block in _blocks(table.rows.text):
        frame, plain = _parse(table, block, wanted, dates)
        for place in numbers:
            values, faulty = (frame[place].to_numpy(), {}) if plain else _numbers(frame[place], table.decimal)
            parts[place].append(values)
            faults[place] |= {first + row: text for row, text in faulty.items()}
        texts.append(frame[list(dates)])
    columns = {place: np.concatenate(values) for place, values in parts.items()}
    for place in dates:
        written = pd.concat([frame[place] for frame in texts], ignore_index=True)
        columns[place], faults[place] = seconds(written)
    return Cells(columns, {place: faulty for place, faulty in faults.items() if faulty}, dates)


def _blocks(text: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield rows in blocks, each with the number of its first row: damage slows down its own block alone."""
    ends = np.flatnonzero(np.frombuffer(text, dtype=np.uint8) == ord("\n"))
    begin = 0
    for first in range(0, len(ends) + 1, _BLOCK):
        end = int(ends[first + _BLOCK - 1]) if first + _BLOCK <= len(ends) else len(text)
        yield first, text[begin:end]
        begin = end + 1


def _parse(
    table: Table, block: bytes, wanted: Sequence[int], dates: Sequence[int]
) -> tuple[pd.DataFrame, bool]:
    """Return the wanted columns as numbers and dates, or as texts where one is neither; and which it is."""
    numbers = [place for place in wanted if place not in dates]
    with suppress(ValueError, OverflowError):
        frame = _read(table, block, wanted, dates)
        if not any(np.isinf(frame[place].to_numpy()).any() for place in numbers):
            return frame, True
    return _read(table, block, wanted, wanted), False


def _read(table: Table, block: bytes, wanted: Sequence[int], texts: Sequence[int]) -> pd.DataFrame:
    """Let pandas' C engine read the wanted columns, some as texts."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pd.errors.ParserWarning)
        return pd.read_csv(  # type: ignore[call-overload,no-any-return]
            io.BytesIO(block),
            sep=r"\s+" if table.delimiter == " " else table.delimiter,
            decimal=table.decimal,
            header=None,
            names=list(range(table.width)),
            usecols=sorted(set(wanted)),
            dtype={place: str if place in texts else np.float64 for place in wanted},
            index_col=False,
            na_values=list(MISSING),
            keep_default_na=False,
            skipinitialspace=True,
            skip_blank_lines=False,
            encoding_errors="replace",
            engine="c",
            **_EXACT,
        )


def _numbers(texts: pd.Series, decimal: str) -> tuple[Array, dict[int, str]]:
    """Return texts as numbers, NaN where they are none, and those by their rows."""
    values, faults = np.full(len(texts), np.nan), dict[int, str]()
    for row, text in enumerate(texts.tolist()):
        cell = text.strip() if isinstance(text, str) else ""
        cell = _BOOLEANS.get(cell.casefold(), cell)
        if cell not in MISSING:
            value = float(cell.replace(decimal, ".")) if is_number(cell, decimal) else math.inf
            if math.isfinite(value):
                values[row] = value
            else:
                faults[row] = cell
    return values, faults
