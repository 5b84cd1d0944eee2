"""Rows of a text table: lines split into cells, and each row checked on its own."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

# Cells that stand for "not sampled".
MISSING = (
    "", "-", "--", "nan", "NaN", "NAN", "Nan", "-nan", "-NaN",
    "NA", "N/A", "n/a", "null", "NULL", "None", "none",
)  # fmt: skip
DELIMITERS = {";": "semicolon", "\t": "tab", "|": "bar", ",": "comma", " ": "space"}
# No two parts of it can match the same digits, or a long cell would take quadratic time.
_NUMBER = re.compile(
    r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:e[+-]?\d+)?|[+-]?(?:inf|infinity)", re.IGNORECASE | re.ASCII
)  # fmt: skip
_CELL = re.compile(r'"(?:[^"]|"")*"|\S+')
# A comment: of ROS `%time` is a name, of MATLAB `% time` is a comment.
COMMENT = re.compile(r"\s*(#+|%+(?=\s|$))")
LINES_OF_A_CELL = 50  # a quoted cell goes on for so many lines at most
_OPENS, _CLOSES = re.compile(r'(?:^|[;\t|, ])"[^"]*$'), re.compile(r'[^"]*"(?:[;\t|, ]|$)')

_BEGINS = frozenset(bytes([sign]) for sign in b"+-.0123456789")

Lines = npt.NDArray[np.int64]


def is_number(cell: str, decimal: str = ".") -> bool:
    """Say whether a cell reads as a number."""
    return bool(_NUMBER.fullmatch(cell.strip().replace(decimal, ".")))


def uncommented(line: str) -> str:
    """Return what a comment line says."""
    return COMMENT.sub("", line, count=1).strip()


def split(row: str, delimiter: str) -> list[str]:
    """Split one row into cells, with regard to quotes.

    A row with a quote that is not closed, or that the csv module cannot read, is one cell.
    """
    if '"' not in row:
        return row.split() if delimiter == " " else [cell.lstrip(" ") for cell in row.split(delimiter)]
    if delimiter == " ":
        cells = _CELL.findall(row)
        quoted = [cell for cell in cells if cell[0] == '"']
        closed = all(len(cell) > 1 and cell[-1] == '"' for cell in quoted)
        bare = [cell[1:-1].replace('""', '"') if cell[0] == '"' else cell for cell in cells]
        return bare if closed else [row]
    lines = [f"{line}\n" for line in row.split("\n")]
    for strict in (True, False):
        try:
            return next(csv.reader(lines, delimiter=delimiter, skipinitialspace=True, strict=strict), [])
        except csv.Error as error:
            if "unexpected end" in str(error):
                break
    return [row]


def joined(lines: Sequence[str]) -> int:
    """Return how many of some lines the first row takes: more than one where a quoted cell goes on.

    The quote that is open at the end of the first line stands at the beginning of a cell, and the one that
    closes it at the end of one; else it is a stray quote, and the row ends with its line.
    """
    if lines[0].count('"') % 2 == 0 or not _OPENS.search(lines[0]):
        return 1
    end = next((k for k, line in enumerate(lines[1:LINES_OF_A_CELL], 1) if line.count('"') % 2), 0)
    return end + 1 if end and _CLOSES.match(lines[end]) else 1


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of a table that have the right number of cells, and what else stands among them."""

    text: bytes = b""  # these rows alone
    lines: Lines = field(default_factory=lambda: np.zeros(0, dtype=np.int64))  # (N,) of each in the file
    damaged: tuple[tuple[int, str], ...] = ()  # lines that are no rows, and why
    headers: tuple[int, ...] = ()  # lines that repeat the header
    comments: tuple[int, ...] = ()  # comment lines


def checked(
    text: bytes,
    first: int,
    delimiter: str,
    width: int,
    *,
    headers: Collection[bytes] = (),
    open_end: bool = False,
) -> Rows:
    """Check every row of a text (UTF-8, plain line ends) from line `first` of it on.

    Blank rows are passed over. A row with a cell too many or too few is damaged, as is one with zero bytes;
    what is one too long and the next one too short cannot cancel. An empty cell more at the end of a row is
    none.

    Args:
        text: the whole file.
        first: line of the first row, counted from 1.
        delimiter: one character; a blank stands for any run of blanks.
        width: cells in a row.
        headers: lines that stand above the table.
        open_end: the last cell is always empty and may be missing.
    """
    lines, sign = text.split(b"\n"), delimiter.encode()
    rows, numbers, damaged = list[bytes](), list[int](), list[tuple[int, str]]()
    repeated, comments = list[int](), list[int]()
    begin = first - 1
    (below,) = text.split(b"\n", begin)[begin:] or (b"",)  # comments above the table may hold quotes
    plain = b'"' not in below and b"\0" not in below
    plain &= all(header[:1] not in _BEGINS for header in headers)
    for at in range(begin, len(lines)):
        line = lines[at]
        # Nearly every row begins with a digit and has its cells; the others are looked at one by one.
        cells = (len(line.split()) if sign == b" " else line.count(sign) + 1) if plain else 0
        if cells == width and line[:1] in _BEGINS:
            rows.append(line)
            numbers.append(at + 1)
        elif at < begin or not line.strip():
            continue
        elif line.strip() in headers:
            repeated.append(at + 1)
        elif COMMENT.match(line.decode(errors="replace")):
            comments.append(at + 1)
        elif b"\0" in line:
            damaged.append((at + 1, "zero bytes, expected cells of numbers"))
        else:
            texts, span = _texts(lines, at)
            row = split(texts, delimiter)
            begin = at + span
            more = len(row) - width
            if more == 0 or (more == -1 and open_end) or (more == 1 and not row[-1].strip()):
                rows.append(line if b'"' not in line and more == 0 else _written(row, delimiter, width))
                numbers.append(at + 1)
            elif any(cell.strip() for cell in row):
                damaged.append((at + 1, _fault(row, width)))
    kept = b"\n".join(rows)
    return Rows(kept, np.array(numbers, dtype=np.int64), tuple(damaged), tuple(repeated), tuple(comments))


def _texts(lines: Sequence[bytes], at: int) -> tuple[str, int]:
    """Return the row that begins in a line, and how many lines it takes."""
    if lines[at].count(b'"') % 2 == 0:
        return lines[at].decode("utf-8", "replace"), 1
    texts = [line.decode("utf-8", "replace") for line in lines[at : at + LINES_OF_A_CELL]]
    span = joined(texts)
    return "\n".join(texts[:span]), span


def _written(cells: Sequence[str], delimiter: str, width: int) -> bytes:
    """Return a row in one line, which no reader can take for another number of cells."""
    row = [cell.replace("\n", " ") for cell in [*cells, ""][:width]]
    line = io.StringIO()
    csv.writer(line, delimiter=delimiter, lineterminator="\n").writerow(row)
    return line.getvalue().removesuffix("\n").encode()


def _fault(cells: Sequence[str], width: int) -> str:
    if len(cells) == 1 and '"' in cells[0]:
        return "a quote that is not closed"
    return f"{len(cells)} cell{'s' * (len(cells) > 1)}, expected {width}"
