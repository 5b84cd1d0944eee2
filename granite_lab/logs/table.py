"""A table in a file: a text, whose layout is found out, or the vectors of a MATLAB file."""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import re
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from granite_lab.errors import InputError, at
from granite_lab.files import readable, refuse_special
from granite_lab.logs.trial import Array

# Cells that stand for "not sampled".
MISSING = ("", "nan", "NaN", "NAN", "Nan", "-nan", "-NaN", "NA", "N/A", "n/a", "null", "NULL", "None", "none")
# The beginning of a date: ISO 8601, or with other signs in between, as 2026_03_01_12_00_00_250.
DATED = re.compile(r"(\d{4})[-/_.](\d\d)[-/_.](\d\d)[T _-](\d\d)[:_.-](\d\d)(?:[:_.-](?=\d\d))?")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(inf|infinity)", re.IGNORECASE)
_COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_DELIMITERS = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar", " ": "space"}
_SAMPLE_ROWS, _PREAMBLE_ROWS = 100, 200
_LARGEST = 2 << 30  # a compressed log may hold this much [bytes]
_SHORTEST = 10  # vectors of a MATLAB file with fewer values are no samples; matrices have at most as many
_PLAIN = "a log is a CSV file with a header line"
_MAGIC = {
    b"#ROSBAG": "a ROS bag", b"\x89MCAP": "an MCAP file", b"PK\x03\x04": "a zip archive or Excel workbook",
    b"\x1f\x8b": "gzip-compressed", b"PAR1": "a Parquet file", b"\x89HDF": "an HDF5 file",
    b"MATLAB": "a MATLAB file", b"SQLite": "an SQLite database", b"%PDF": "a PDF document",
}  # fmt: skip

NumberedLines = list[tuple[int, str]]
NumberedRows = list[tuple[int, list[str]]]


@dataclass(frozen=True, kw_only=True)
class TableFormat:
    """What a column map may say about the text; what it leaves out is found from the text.

    The delimiter is one character, "tab" or "space" (any run of blanks); names are those of the columns, for
    a file without a header line.
    """

    delimiter: str = field(default="", metadata={"choices": ("", *_DELIMITERS, *_DELIMITERS.values())})
    decimal: str = field(default="", metadata={"choices": ("", ".", ",")})
    names: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Table:
    """A table, understood as far as its first rows tell."""

    path: Path
    headers: tuple[tuple[str, ...], ...]  # the header rows, top first, each as wide as the table
    width: int  # cells in a row of data
    encoding: str = ""
    delimiter: str = ","  # one character; a blank stands for any run of blanks
    decimal: str = "."
    header_line: int = 0  # line of the first header row (0: none)
    data_line: int = 0  # line of the first row of data (0: the table is not text)
    sample: tuple[tuple[str, ...], ...] = ()  # the first rows of data
    comments: tuple[tuple[int, str], ...] = ()  # lines before the header that begin with #, numbered
    preamble: tuple[str, ...] = ()  # other lines above the header
    doubts: tuple[str, ...] = ()  # what the reader was not sure of
    text: bytes = field(default=b"", repr=False)  # the whole file in UTF-8 with plain line ends
    numbers: tuple[Array, ...] = field(default=(), repr=False)  # columns (N,) of a table that is not text

    @property
    def open_end(self) -> bool:
        """The rows end in a delimiter, so that their last cell is always empty."""
        return all(not row[-1].strip() for row in self.sample)

    @property
    def delimiter_name(self) -> str:
        """The delimiter in words."""
        return _DELIMITERS[self.delimiter]

    def is_dated(self, place: int) -> bool:
        """Say whether the first cells of a column are dates, the year first."""
        cells = [row[place].strip() for row in self.sample if row[place].strip() not in MISSING]
        return bool(cells) and all(DATED.match(cell) for cell in cells)

    def is_numeric(self, place: int) -> bool:
        """Say whether more than half of a column's first filled cells are numbers."""
        cells = [row[place].strip() for row in self.sample if row[place].strip()]
        numbers = sum(is_number(cell, self.decimal) for cell in cells)
        return not self.data_line or numbers > 0.5 * len(cells)

    def header(self, place: int) -> str:
        """Return a column's name as it stands in the first header row; a map needs it so."""
        return self.headers[0][place] if self.headers else f"column {place + 1}"

    def name(self, place: int) -> str:
        """Return what a message calls a column, counted from 0."""
        return self.header(place) or f"column {place + 1}"

    def walk(self) -> Iterator[tuple[int, list[str]]]:
        """Yield every row of data with the line it ends on, slowly and exactly."""
        rows = _split(islice(_lines(self.text), self.data_line - 1, None), self.delimiter)
        count = 0
        try:
            for count, row in enumerate(rows, 1):
                if row:
                    yield self.data_line - 1 + getattr(rows, "line_num", count), row
        except csv.Error as error:
            line = self.data_line + count
            raise self.error(f"not a row of a table: {error}", "export the log again", line) from None

    def line_of(self, row: int) -> int:
        """Return the line in the file of a row of data, counted from 0."""
        return next((line for line, _ in islice(self.walk(), row, None)), 0)

    def doubted(self, *doubts: str) -> Table:
        """Return the table with further doubts."""
        return replace(self, doubts=(*self.doubts, *doubts))

    def error(self, what: str, hint: str, line: int = 0, place: int | None = None) -> InputError:
        """Return an error that names the file, and the line and the column if they are known."""
        column = "" if place is None else f" column '{self.name(place)}':"
        return InputError(f"{at(self.path, line or None)}:{column} {what}", hint)


def is_number(cell: str, decimal: str = ".") -> bool:
    """Say whether a cell reads as a number."""
    return bool(_NUMBER.fullmatch(cell.strip().replace(decimal, ".")))


def open_table(path: Path, said: TableFormat | None = None) -> Table:
    """Open a table: a MATLAB file, or a text, of which a column map may say something.

    Raises:
        InputError: missing, unreadable, empty, binary, without a table or without rows of data.
    """
    return _matlab(path) if path.suffix.lower() == ".mat" else _sniff(path, said or TableFormat())


def _sniff(path: Path, said: TableFormat) -> Table:
    """Find out how a text file is laid out."""

    def fault(line: int | None, what: str, hint: str = _PLAIN) -> InputError:
        return InputError(f"{at(path, line)}: {what}", hint)

    text, encoding, doubts = _read(path)
    comments, lines, separator = _head(_lines(text))
    if not lines and not comments:
        raise fault(None, "the file is empty", f"{_PLAIN} and rows of numbers")
    if not lines:
        hint = "the header names the columns, such as t_s,imu_ax_mps2,…"
        raise fault(None, "no header line, only comments", hint)
    named = {name: sign for sign, name in _DELIMITERS.items()}
    delimiter = named.get(said.delimiter, said.delimiter) or separator or _delimiter(path, lines)
    rows = [(number, _cells(path, number, line, delimiter)) for number, line in lines]
    decimal = said.decimal or _decimal([row for _, row in rows], delimiter)
    first = next((i for i, (_, row) in enumerate(rows) if _is_data(row, decimal)), None)
    if first is None and all(len(row) <= 1 for _, row in rows):
        raise fault(rows[0][0], "no table here")
    if first is None:
        hint = "the log holds no samples; record it again"
        raise fault(rows[-1][0], "no row of numbers below the header", hint)
    data_line = rows[first][0]
    width = Counter(len(row) for _, row in rows[first : first + 20]).most_common(1)[0][0]
    below = [row for _, row in rows[first:] if len(row) == width]
    above = rows[:first]
    if comments and not above:  # the header may be the last comment line, as in EuRoC
        line, comment = comments[-1]
        row = _cells(path, line, comment.lstrip("#").strip(), delimiter)
        above = [(line, row)] if len(row) == width and not any(map(is_number, row)) else []
    headers, header_line = ((said.names,), 0) if said.names else _headers(above, below)
    if said.names and len(said.names) != width:
        what = f"{width} columns, but the column map names {len(said.names)}"
        raise fault(data_line, what, "correct 'names' under [table] in the map")
    if above and not headers:
        what = f"the header names {len(above[-1][1])} columns, the rows below have {width}"
        hint = "one name a column: quote names that hold the delimiter"
        raise fault(above[-1][0], what, f"{hint}; a decimal comma needs another delimiter")
    sample = tuple(tuple(row) for row in below[:_SAMPLE_ROWS])
    comments = [comment for comment in comments if comment[0] != header_line]
    preamble = (*(line for _, line in lines[:first]), *([f"sep={separator}"] if separator else []))
    return Table(
        path, headers, width, encoding, delimiter, decimal, header_line, data_line,
        sample, tuple(comments), preamble, doubts, text,
    )  # fmt: skip


def _read(path: Path) -> tuple[bytes, str, tuple[str, ...]]:
    """Return a text file's content in UTF-8 with plain line ends, its encoding, and doubts."""
    refuse_special(path)
    data = _unpacked(path)
    for magic, what in _MAGIC.items():
        if data.startswith(magic):
            raise InputError(f"{path}: is not text but {what}", "export the log as CSV")
    encoding = _encoding(path, data[: 1 << 16])
    guessed = f"read as {encoding.upper()}, which the file does not say" if encoding[:7] == "utf-16-" else ""
    guessed = "not UTF-8, read as Windows-1252" if encoding == "cp1252" else guessed
    if encoding == "utf-8-sig":
        data = data.removeprefix(codecs.BOM_UTF8)
    else:
        data = data.decode(encoding, "replace").encode()
    data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if 1 < data.count(b";") == data.count(b";\n") + data.endswith(b";"):
        data = data.replace(b";\n", b"\n").removesuffix(b";")  # rows that end as in MATLAB
    return data, encoding, (f"{path.name}: {guessed}",) if guessed else ()


def _unpacked(path: Path) -> bytes:
    """Return a file's content; ``.csv.gz``, or the one table in a ``.zip``, is unpacked."""
    kind = path.suffix.lower()
    try:
        if kind == ".gz":
            with gzip.open(path) as packed:
                data = packed.read(_LARGEST + 1)
        elif kind == ".zip":
            with zipfile.ZipFile(path) as archive, archive.open(_only_table(path, archive)) as member:
                data = member.read(_LARGEST + 1)
        else:
            return path.read_bytes()
    except (gzip.BadGzipFile, zipfile.BadZipFile, zlib.error, EOFError, RuntimeError) as error:
        hint = "copy the file again, or unpack it and name the table"
        raise InputError(f"{path}: cannot be unpacked: {error}", hint) from None
    except OSError as error:
        raise readable(error, path) from None
    if len(data) > _LARGEST:
        raise InputError(f"{path}: holds more than {_LARGEST >> 30} GB", "unpack it and name the table")
    return data


def _only_table(path: Path, archive: zipfile.ZipFile) -> str:
    """Return the name of the one table in an archive; what macOS adds does not count."""
    inside = [name for name in archive.namelist() if not name.startswith("__MACOSX/")]
    tables = [name for name in inside if name.lower().endswith((".csv", ".txt", ".tsv"))]
    if len(tables) != 1:
        found = ", ".join(tables[:5]) + (", …" if len(tables) > 5 else "") if tables else "none"
        what = f"{path}: expected one table (.csv, .txt, .tsv) in the archive, found {found}"
        raise InputError(what, "unpack it and name the tables" if tables else _PLAIN)
    return tables[0]


def _encoding(path: Path, head: bytes) -> str:
    """Recognise the encoding from the first bytes, which are refused if they are not text."""
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    for name, zeros in (("utf-16-le", head[1::2]), ("utf-16-be", head[0::2])):
        if b"\0" in head and zeros.count(0) > 0.9 * len(zeros) and head.count(0) < 0.6 * len(head):
            return name
    binary = 0 in head[:512] or head.count(0) > 0.01 * len(head)
    try:
        codecs.getincrementaldecoder("utf-8-sig")().decode(head)
        encoding = "utf-8-sig"
    except UnicodeDecodeError:
        encoding = "cp1252"
        binary |= sum(byte < 32 and byte not in b"\t\r\n\f" for byte in head) > 0.01 * len(head)
    if binary:
        raise InputError(f"{path}: is binary, not text", "export the log as CSV")
    return encoding


def _lines(text: bytes) -> TextIO:
    """Return text as lines; bytes that are no UTF-8 become U+FFFD."""
    return io.TextIOWrapper(io.BytesIO(text), encoding="utf-8", errors="replace", newline="\n")


def _head(file: TextIO) -> tuple[NumberedLines, NumberedLines, str]:
    """Return comment lines, the first other lines that are not blank, and a delimiter said by ``sep=``."""
    comments, lines, said = NumberedLines(), NumberedLines(), ""
    for number, raw in enumerate(file, 1):
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


def _split(lines: Iterator[str], delimiter: str) -> Iterator[list[str]]:
    """Split lines into cells; quotes are honoured."""
    if delimiter == " ":
        return (line.split() for line in lines)
    return csv.reader(lines, delimiter=delimiter, skipinitialspace=True)


def _cells(path: Path, number: int, line: str, delimiter: str) -> list[str]:
    """Split a line on its own, so that a stray quote cannot swallow what follows."""
    try:
        return next(_split(iter([line]), delimiter), [])
    except csv.Error as error:  # a cell beyond csv.field_size_limit()
        what = f"{at(path, number)}: not a row of a table: {error}, expected cells of numbers"
        raise InputError(what, _PLAIN) from None


def _delimiter(path: Path, lines: NumberedLines) -> str:
    """Choose the delimiter that splits the last sampled lines into the most, equally many cells."""
    tail = lines[-50:]
    best, most = ",", 1
    for delimiter in _DELIMITERS:
        widths = Counter(len(_cells(path, number, line, delimiter)) for number, line in tail)
        width, count = widths.most_common(1)[0]
        # Where another delimiter fits as well, the comma is the decimal sign.
        in_header = delimiter == " " or any(delimiter in line for _, line in lines[:-1] or lines)
        stronger = width > most or (best == "," and delimiter in ";\t|" and width > 1)
        if delimiter == " " and best != ",":
            continue
        if in_header and width > 1 and count >= 0.6 * len(tail) and stronger:
            best, most = delimiter, width
    return best


def _decimal(rows: list[list[str]], delimiter: str) -> str:
    """Find the decimal sign: a comma inside cells, where no cell has a point."""
    commas = sum(bool(_COMMA_NUMBER.fullmatch(cell.strip())) for row in rows for cell in row if "," in cell)
    points = sum("." in cell and is_number(cell) for row in rows for cell in row) if commas else 0
    return "," if commas > points and (delimiter != "," or commas > 1) else "."


def _is_data(row: list[str], decimal: str) -> bool:
    """Say whether at least half of the filled cells are numbers."""
    filled = [cell for cell in row if cell.strip() not in MISSING]
    numbers = sum(is_number(cell, decimal) for cell in filled)
    return numbers > 0 and numbers >= 0.5 * len(filled)


def _headers(above: NumberedRows, below: list[list[str]]) -> tuple[tuple[tuple[str, ...], ...], int]:
    """Return the header rows as wide as the data, and the line of the first."""
    width, open_end = len(below[0]), all(not row[-1].strip() for row in below)
    headers: list[tuple[str, ...]] = []
    line = 0
    for number, row in reversed(above):
        # A delimiter behind the last cell may stand in the header only, or in the data only.
        cells = row[:-1] if len(row) == width + 1 and not row[-1].strip() else row
        cells = [*cells, ""] if len(cells) == width - 1 and open_end else cells
        if len(cells) != width:
            break
        headers.insert(0, tuple(cell.strip() for cell in cells))
        line = number
    return tuple(headers), line


def _matlab(path: Path) -> Table:
    """Take the vectors of a MATLAB file, single or in structs, as columns; they must be of one length."""
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
        what = f"{path}: cannot be read as a MATLAB file: {what}"
        raise InputError(what, "copy or save it again") from None
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
                usual = {1: [""], 3: ["_x", "_y", "_z"]}
                ends = usual.get(len(rows), [f"_{k + 1}" for k in range(len(rows))])
                yield from zip((f"{prefix}{key}{end}" for end in ends), rows.astype(np.float64), strict=True)
