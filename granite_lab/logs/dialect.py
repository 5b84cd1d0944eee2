"""How a text holds its table: delimiter, decimal sign, header rows, found from its first lines."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from statistics import median

from granite_lab.errors import InputError, at
from granite_lab.logs.rows import (
    COMMENT,
    DELIMITERS,
    LINES_OF_A_CELL,
    MISSING,
    is_number,
    joined,
    split,
    uncommented,
)

_COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_QUOTED, _BRACKETS = re.compile(r'"([^"]*)"'), re.compile(r"\[[^\[\]]*\]|\([^()]*\)|\{[^{}]*\}")
_NESTED = 4  # depth of lists in a cell
_LINES, _SAMPLE_ROWS, _TAIL = 300, 100, 50  # lines that are looked at, rows that are kept, lines that decide
_LONGEST = 1 << 20  # characters of a line that are looked at
_WIDEST = 1 << 14  # no spreadsheet holds more columns
PLAIN = "a log is a CSV file with a header line"

NumberedLines = list[tuple[int, str]]
NumberedRows = list[tuple[int, list[str]]]


@dataclass(frozen=True, kw_only=True)
class TableFormat:
    """What a column map may say about the text; what it leaves out is found from the text.

    The delimiter is one character, "tab" or "space" (any run of blanks); names are those of the columns, for
    a file without a header line, or in place of its names.
    """

    delimiter: str = field(default="", metadata={"choices": ("", *DELIMITERS, *DELIMITERS.values())})
    decimal: str = field(default="", metadata={"choices": ("", ".", ",")})
    names: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """How a text holds its table."""

    headers: tuple[tuple[str, ...], ...]  # the header rows, top first, each as wide as the table
    width: int  # cells in a row of data
    open_end: bool = False  # the rows end in a delimiter, so that their last cell is always empty
    delimiter: str = ","  # one character; a blank stands for any run of blanks
    decimal: str = "."
    header_line: int = 0  # line of the first header row (0: none)
    data_line: int = 0  # line of the first row of data (0: the table is not text)
    sample: tuple[tuple[str, ...], ...] = ()  # the first rows of data
    comments: tuple[tuple[int, str], ...] = ()  # comment lines before the data, numbered
    preamble: tuple[str, ...] = ()  # other lines above the data
    unnamed: tuple[int, str, str] = (0, "", "")  # without headers: line, what is wrong, and a hint


def find_dialect(path: Path, lines: Sequence[str], stated: TableFormat) -> Dialect:
    """Find out how the lines of a text hold its table, of which a column map may say something.

    Raises:
        InputError: empty, without a table or without rows of data.
    """

    def fault(line: int | None, message: str, hint: str = PLAIN) -> InputError:
        return InputError(f"{at(path, line)}: {message}", hint)

    comments, records, separator = _head(lines)
    if not records and not comments:
        raise fault(None, "the file is empty", f"{PLAIN} and rows of numbers")
    if not records:
        hint = "the header names the columns, such as t_s,imu_ax_mps2,…"
        raise fault(None, "no header line, only comments", hint)
    named = {name: sign for sign, name in DELIMITERS.items()}
    delimiter = named.get(stated.delimiter, stated.delimiter) or separator or _delimiter(records)
    rows = [(number, split(line, delimiter)) for number, line in records]
    decimal = stated.decimal or _decimal([row for _, row in rows], delimiter)
    data = _data(rows, decimal)
    if not data and all(len(row) <= 1 for _, row in rows):
        raise fault(rows[0][0], "no table here")
    if not data:
        hint = "the log holds no samples; record it again"
        raise fault(rows[-1][0], "no row of numbers below the header", hint)
    width = Counter(len(row) for _, row in data).most_common(1)[0][0]
    if width > _WIDEST:
        raise fault(data[0][0], f"{width} columns, expected at most {_WIDEST}", PLAIN)
    below = [(number, row) for number, row in data if len(row) == width]
    data_line = below[0][0]
    numbers = {number for number, _ in data}
    above = [(number, row) for number, row in rows if number < data_line and number not in numbers]
    first = [comment for comment in comments if comment[0] < data_line]
    if first and not above:  # the header may be the last comment line, as in EuRoC
        line, comment = first[-1]
        row = split(uncommented(comment), delimiter)
        above = [(line, row)] if len(row) == width and not any(map(is_number, row)) else []
    sample = [row for _, row in below[:_SAMPLE_ROWS]]
    open_end = all(not row[-1].strip() for row in sample)
    headers, header_line = _headers(above, width, open_end)
    unnamed = (0, "", "")
    if stated.names:
        headers, header_line = (stated.names,), 0
        if len(stated.names) != width:
            message = f"{width} columns, but the column map names {len(stated.names)}"
            raise fault(data_line, message, "correct 'names' under [table] in the map")
    elif not headers:
        unnamed = _unnamed(above, data_line, width)
    text_above = [line for number, line in records if number < data_line]
    return Dialect(
        headers=headers, width=width, open_end=open_end, delimiter=delimiter, decimal=decimal,
        header_line=header_line, data_line=data_line, sample=tuple(map(tuple, sample)), unnamed=unnamed,
        comments=tuple(comment for comment in first if comment[0] != header_line),
        preamble=(*text_above, *([f"sep={separator}"] if separator else [])),
    )  # fmt: skip


def _unnamed(above: NumberedRows, data_line: int, width: int) -> tuple[int, str, str]:
    """Say why a table has no names: line, what is wrong, and a hint."""
    names = "names = […] under [table] in a column map; granite-lab inspect LOG --write-map FILE drafts one"
    if not above or len(above[-1][1]) <= 1:
        hint = f"add one, or give {names}"
        return data_line, "no header line, expected the names of the columns", hint
    line, row = above[-1]
    message = f"the header names {len(row)} columns, the rows below have {width}"
    hint = f"one name a column: quote names that hold the delimiter, or give {names}"
    return line, message, f"{hint}; a decimal comma needs another delimiter"


def _head(lines: Sequence[str]) -> tuple[NumberedLines, NumberedLines, str]:
    """Return comment lines, the first other rows that are not blank, and a delimiter said by ``sep=``."""
    comments, records, separator = NumberedLines(), NumberedLines(), ""
    number = 0
    while number < len(lines) and len(records) < _LINES:
        text, span = lines[number][:_LONGEST].lstrip("\ufeff"), 1
        number += 1
        if not text.strip():
            continue
        if COMMENT.match(text):
            comments.append((number, text.lstrip()))
        elif not records and not separator and (match := re.fullmatch(r'"?sep=(.)"?\s*', text[:20])):
            separator = match.group(1)
        else:
            if '"' in text:
                span = joined([text, *islice(lines, number, number + LINES_OF_A_CELL)])
            records.append((number, "\n".join([text, *lines[number : number + span - 1]])))
            number += span - 1
    return comments, records, separator


def _delimiter(lines: NumberedLines) -> str:
    """Choose the delimiter outside quotes and brackets that splits the last lines into the most numbers.

    Most of the lines must have equally many cells. Where two are as good, the comma is the decimal sign or
    stands before blanks.
    """
    tail = [_without_lists(line) for _, line in lines[-_TAIL:]]
    best, most = ",", 0
    for delimiter in DELIMITERS:
        rows = [line.split(None if delimiter == " " else delimiter) for line in tail]
        width, count = Counter(map(len, rows)).most_common(1)[0]
        if width > 1 and count >= 0.6 * len(rows):
            cells = (cell for row in rows if len(row) == width for cell in row)
            numbers = sum(is_number(cell) or is_number(cell, ",") for cell in cells)
            if numbers > most:
                best, most = delimiter, numbers
    return best


def _without_lists(line: str) -> str:
    """Return a line with a plain cell for each quoted one and each list in brackets, which is a text."""
    line = _QUOTED.sub(lambda quoted: "0" if is_number(quoted[1], ",") or is_number(quoted[1]) else "x", line)
    for _ in range(_NESTED):
        line = _BRACKETS.sub("x", line)
    return line


def _decimal(rows: list[list[str]], delimiter: str) -> str:
    """Find the decimal sign: a comma inside cells, where no cell has a point."""
    commas = sum(bool(_COMMA_NUMBER.fullmatch(cell.strip())) for row in rows for cell in row if "," in cell)
    points = sum("." in cell and is_number(cell) for row in rows for cell in row) if commas else 0
    return "," if commas > points and (delimiter != "," or commas > 1) else "."


def _data(rows: NumberedRows, decimal: str) -> NumberedRows:
    """Return the rows of data: half of their filled cells are numbers, or half as many as is usual."""
    counts = [sum(is_number(cell, decimal) for cell in row) for _, row in rows]
    usual = median(filled) if (filled := [count for count in counts[-_TAIL:] if count]) else 1
    few = [0.5 * min(sum(cell.strip() not in MISSING for cell in row), usual) for _, row in rows]
    return [row for row, count, least in zip(rows, counts, few, strict=True) if count and count >= least]


def _headers(above: NumberedRows, width: int, open_end: bool) -> tuple[tuple[tuple[str, ...], ...], int]:
    """Return the header rows as wide as the data, and the line of the first."""
    headers: list[tuple[str, ...]] = []
    line = 0
    for number, row in reversed(above):
        # A delimiter behind the last cell may stand in the header only, or in the data only.
        cells = row[:-1] if len(row) == width + 1 and not row[-1].strip() else row
        cells = [*cells, ""] if len(cells) == width - 1 and open_end else cells
        if len(cells) != width:
            break
        headers.insert(0, tuple(cell.strip().replace("\n", " ") for cell in cells))
        line = number
    return tuple(headers), line
