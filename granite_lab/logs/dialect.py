"""How a text file is laid out: encoding, delimiter, decimal sign, header rows, comments."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import TextIO

from granite_lab.errors import InputError, at
from granite_lab.logs.encoding import encoding_of, open_text

MISSING = ("", "nan", "NaN", "NAN", "Nan", "-nan", "-NaN", "NA", "N/A", "n/a", "null", "NULL", "None", "none")
"""Cells that stand for "not sampled"."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(inf|infinity)", re.IGNORECASE)
_COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_DELIMITERS = (",", ";", "\t", "|")
_SAMPLE_ROWS = 100
_PREAMBLE_ROWS = 200
_DELIMITER_NAMES = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar", " ": "space"}


@dataclass(frozen=True, kw_only=True)
class TableFormat:
    """What a column map may say about the text; what it leaves out is found from the text.

    Attributes:
        delimiter: one character, "tab" or "space" (any run of blanks).
        decimal: decimal sign, "." or ",".
        skip_rows: lines before the header that are not part of the table.
        names: names of the columns, for a file without a header line.
    """

    delimiter: str = field(
        default="",
        metadata={"choices": ("", ",", ";", "|", "\t", "tab", "space", "comma", "semicolon", "bar")},
    )
    decimal: str = field(default="", metadata={"choices": ("", ".", ",")})
    skip_rows: float = field(
        default=0.0, metadata={"unit": "", "low": 0, "high": 1e6, "meaning": "lines to skip"}
    )
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Dialect:
    """A text table, understood as far as its first rows tell.

    Attributes:
        encoding: name of the text encoding.
        delimiter: one character; a blank stands for any run of blanks.
        decimal: the decimal sign.
        headers: the header rows, top first, each as wide as the table.
        header_line: line of the first header row (0: none).
        data_line: line of the first row of data.
        width: cells in a row of data.
        sample: the first rows of data.
        comments: lines before the header that begin with ``#``, with their line numbers.
        preamble: other lines above the header.
        doubts: what the reader was not sure of.
    """

    encoding: str
    delimiter: str
    decimal: str
    headers: tuple[tuple[str, ...], ...]
    header_line: int
    data_line: int
    width: int
    sample: tuple[tuple[str, ...], ...]
    comments: tuple[tuple[int, str], ...]
    preamble: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    @property
    def open_end(self) -> bool:
        """The rows end in a delimiter, so that their last cell is always empty."""
        return all(not row[-1].strip() for row in self.sample)

    def name(self, place: int) -> str:
        """Return what the first header row calls a column, counted from 0."""
        text = self.headers[0][place] if self.headers else ""
        return text or f"column {place + 1}"

    @property
    def delimiter_name(self) -> str:
        """The delimiter in words."""
        return _DELIMITER_NAMES[self.delimiter]


def is_number(cell: str, decimal: str = ".") -> bool:
    """Say whether a cell reads as a number."""
    return bool(_NUMBER.fullmatch(cell.strip().replace(decimal, ".")))


def split_rows(lines: Iterator[str], delimiter: str) -> Iterator[list[str]]:
    """Split lines into cells; quotes are honoured."""
    if delimiter == " ":
        return (line.split() for line in lines)
    return csv.reader(lines, delimiter=delimiter, skipinitialspace=True)


def sniff(path: Path, table: TableFormat | None = None) -> Dialect:
    """Find out how a file is laid out.

    Args:
        path: the file.
        table: what a column map says about it.

    Raises:
        InputError: missing, unreadable, empty, binary, without a table or without rows of data.
    """
    table = table or TableFormat()
    encoding, doubts = encoding_of(path)
    with open_text(path, encoding) as file:
        comments, lines, said = _head(file, int(table.skip_rows))
    if not lines and not comments:
        raise InputError(
            f"{path}: the file is empty", "a log is a CSV file with a header line and rows of numbers"
        )
    if not lines:
        raise InputError(
            f"{path}: no header line, only comments",
            "the header names the columns, such as t_s,imu_ax_mps2,…",
        )
    named = {name: sign for sign, name in _DELIMITER_NAMES.items()}
    delimiter = named.get(table.delimiter, table.delimiter) or said or _delimiter([text for _, text in lines])
    rows = list(zip((n for n, _ in lines), _cells(path, [t for _, t in lines], delimiter), strict=False))
    decimal = table.decimal or _decimal([row for _, row in rows], delimiter)
    first = next((i for i, (_, row) in enumerate(rows) if _is_data(row, decimal)), None)
    if first is None:
        _refuse_without_data(path, rows)
        raise InputError(
            f"{at(path, rows[-1][0])}: no row of numbers below the header",
            "the log holds no samples; record it again",
        )
    width = Counter(len(row) for _, row in rows[first : first + 20]).most_common(1)[0][0]
    preamble = tuple(text for _, text in lines[:first]) + ((f"sep={said}",) if said else ())
    below = [row for _, row in rows[first:] if len(row) == width]
    headers, header_line = _headers(path, rows[:first], below, comments, delimiter, table, rows[first][0])
    if headers and header_line < 0:  # the header is the last comment line, as in EuRoC
        header_line, comments = comments[-1][0], comments[:-1]
    return Dialect(
        encoding, delimiter, decimal, headers, header_line, rows[first][0], width,
        tuple(tuple(row) for row in below[:_SAMPLE_ROWS]),
        tuple(comments), preamble, doubts,
    )  # fmt: skip


def _head(file: TextIO, skip: int) -> tuple[list[tuple[int, str]], list[tuple[int, str]], str]:
    """Return comment lines, the first other lines that are not blank, and a delimiter said by ``sep=``."""
    comments: list[tuple[int, str]] = []
    lines: list[tuple[int, str]] = []
    said = ""
    for number, raw in enumerate(islice(file, skip, None), skip + 1):
        text = raw.rstrip("\n").lstrip("\ufeff")
        if not text.strip():
            continue
        if not lines and text.lstrip().startswith("#"):
            comments.append((number, text.lstrip()))
        elif not lines and not said and (match := re.fullmatch(r'"?sep=(.)"?\s*', text)):
            said = match.group(1)
        else:
            lines.append((number, text))
            if len(lines) >= _PREAMBLE_ROWS + _SAMPLE_ROWS:
                break
    return comments, lines, said


def _cells(path: Path, lines: list[str], delimiter: str) -> Iterator[list[str]]:
    """Split each line on its own, so that a stray quote cannot swallow what follows."""
    for line in lines:
        try:
            yield next(split_rows(iter([line]), delimiter), [])
        except csv.Error as error:
            raise InputError(f"{path}: not a table: {error}", "a log is a CSV file") from None


def _delimiter(lines: list[str]) -> str:
    """Choose the delimiter that splits the last sampled lines into the most, equally many cells."""
    tail = lines[-min(len(lines), 50) :]
    best, most = ",", 1
    for delimiter in (*_DELIMITERS, " "):
        widths = Counter(len(next(split_rows(iter([line]), delimiter), [])) for line in tail)
        width, count = widths.most_common(1)[0]
        # Where another delimiter fits as well, the comma is the decimal sign.
        in_header = delimiter == " " or any(delimiter in line for line in lines[:-1] or lines)
        stronger = width > most or (best == "," and delimiter in ";\t|" and width > 1)
        if delimiter == " " and best != ",":
            continue
        if in_header and width > 1 and count >= 0.6 * len(tail) and stronger:
            best, most = delimiter, width
    return best


def _decimal(rows: list[list[str]], delimiter: str) -> str:
    """Find the decimal sign: a comma inside cells, where no cell has a point."""
    cells = [cell.strip() for row in rows for cell in row]
    commas = sum(bool(_COMMA_NUMBER.fullmatch(cell)) for cell in cells)
    points = sum("." in cell and is_number(cell) for cell in cells)
    return "," if commas > points and (delimiter != "," or commas > 1) else "."


def _is_data(row: list[str], decimal: str) -> bool:
    """Say whether at least half of the filled cells are numbers."""
    filled = [cell for cell in row if cell.strip() not in MISSING]
    numbers = sum(is_number(cell, decimal) for cell in filled)
    return numbers > 0 and numbers >= 0.5 * len(filled)


def _headers(
    path: Path,
    above: list[tuple[int, list[str]]],
    below: list[list[str]],
    comments: list[tuple[int, str]],
    delimiter: str,
    table: TableFormat,
    data_line: int,
) -> tuple[tuple[tuple[str, ...], ...], int]:
    """Return the header rows as wide as the data, and the line of the first (-1: the last comment)."""
    width = len(below[0])
    if table.names:
        if len(table.names) != width:
            raise InputError(
                f"{at(path, data_line)}: {width} columns, but the column map names {len(table.names)}",
                "correct 'names' under [table] in the map",
            )
        return (table.names,), 0
    # A delimiter behind the last cell may stand in the header only, or in the data only.
    open_end = all(not row[-1].strip() for row in below)
    rows: list[tuple[str, ...]] = []
    line = 0
    for number, row in reversed(above):
        cells = row[:-1] if len(row) == width + 1 and not row[-1].strip() else row
        cells = [*cells, ""] if len(cells) == width - 1 and open_end else cells
        if len(cells) != width:
            break
        rows.insert(0, tuple(cell.strip() for cell in cells))
        line = number
    if rows:
        return tuple(rows), line
    if not above and comments:
        cells = next(split_rows(iter([comments[-1][1].lstrip("#").strip()]), delimiter), [])
        if len(cells) == width and not any(is_number(cell) for cell in cells):
            return (tuple(cell.strip() for cell in cells),), -1
    if above:
        raise InputError(
            f"{at(path, above[-1][0])}: the header names {len(above[-1][1])} columns, "
            f"the rows below have {width}",
            "one name a column: quote names that hold the delimiter; a decimal comma needs another delimiter",
        )
    return (), 0


def _refuse_without_data(path: Path, rows: list[tuple[int, list[str]]]) -> None:
    """Refuse a text that is no table at all."""
    if all(len(row) <= 1 for _, row in rows):
        raise InputError(f"{at(path, rows[0][0])}: no table here", "a log is a CSV file with a header line")
