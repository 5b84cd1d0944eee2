"""A table in a file: a text, whose layout is found out, or the vectors of a MATLAB file."""

from __future__ import annotations

import codecs
import gzip
import re
import zipfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from granite_lab.errors import InputError, LabError, at
from granite_lab.files import readable, refuse_special
from granite_lab.logs.dialect import PLAIN, Dialect, TableFormat, find_dialect
from granite_lab.logs.rows import DELIMITERS, MISSING, Rows, checked, is_number
from granite_lab.logs.sensors.doubt import some_of
from granite_lab.logs.trial import Array

_LARGEST = 2 << 30  # a compressed log may hold this much [bytes]
_LOOKED_AT = 4 << 20  # the layout of a text is found from so many bytes
_LOST = 64  # so many zero bytes in a row are a block of the memory card that was not written, no binary data
_FEWEST = 10  # vectors of a MATLAB file with fewer values are no samples; matrices have at most as many
_MAGIC = {
    b"#ROSBAG": "a ROS bag", b"\x89MCAP": "an MCAP file", b"PK\x03\x04": "a zip archive or Excel workbook",
    b"\x1f\x8b": "gzip-compressed", b"PAR1": "a Parquet file", b"\x89HDF": "an HDF5 file",
    b"MATLAB": "a MATLAB file", b"SQLite": "an SQLite database", b"%PDF": "a PDF document",
}  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class Table(Dialect):
    """A table, understood as far as its first rows tell."""

    path: Path
    encoding: str = ""
    doubts: tuple[str, ...] = ()  # what the reader was not sure of
    text: bytes = field(default=b"", repr=False)  # the whole file in UTF-8 with plain line ends
    numbers: tuple[Array, ...] = field(default=(), repr=False)  # columns (N,) of a table that is not text

    @property
    def delimiter_name(self) -> str:
        """The delimiter in words."""
        return DELIMITERS[self.delimiter]

    @cached_property
    def rows(self) -> Rows:
        """The rows of data, each checked on its own; none if the table is not text."""
        if not self.data_line:
            return Rows()
        above = self.text.split(b"\n", self.data_line - 1)[:-1][self.header_line - 1 :]
        headers = frozenset(line.strip() for line in above if self.header_line and line.strip())
        return checked(
            self.text, self.data_line, self.delimiter, self.width, headers=headers, open_end=self.open_end
        )

    @cached_property
    def names(self) -> tuple[str, ...]:
        """What maps and messages call the columns: the first header row, `numbered`."""
        return numbered(self.headers[0] if self.headers else ("",) * self.width)

    @property
    def repeated(self) -> list[tuple[str, list[int]]]:
        """Names of the first header row that occur more than once, with the places of their columns."""
        places: dict[str, list[int]] = {}
        for place, name in enumerate(self.headers[0] if self.headers else ()):
            places.setdefault(name.casefold(), []).append(place)
        return [(self.headers[0][same[0]], same) for name, same in places.items() if name and len(same) > 1]

    def is_dated(self, place: int) -> bool:
        """Say whether the first cells of a column are dates or times of day."""
        from granite_lab.logs.dates import are_dates  # noqa: PLC0415, heavy

        return are_dates(self.filled(place))

    def filled(self, place: int) -> list[str]:
        """Return the first cells of a column that are not empty."""
        return [cell for row in self.sample if (cell := row[place].strip()) not in MISSING]

    def is_numeric(self, place: int) -> bool:
        """Say whether more than half of a column's first filled cells are numbers."""
        cells = [row[place].strip() for row in self.sample if row[place].strip()]
        numbers = sum(is_number(cell, self.decimal) for cell in cells)
        return not self.data_line or numbers > 0.5 * len(cells)

    def doubted(self, *doubts: str) -> Table:
        """Return the table with further doubts."""
        return replace(self, doubts=(*self.doubts, *doubts))

    def where(self, row: int) -> str:
        """Name the place in the file of a row of data, counted from 0."""
        if not self.data_line:
            return f"{self.path}: sample {row + 1}"
        return at(self.path, int(self.rows.lines[row]))

    def error(self, message: str, hint: str, line: int = 0) -> InputError:
        """Return an error that names the file, and the line if it is known."""
        return InputError(f"{at(self.path, line or None)}: {message}", hint)


@lru_cache(maxsize=64)  # for all layouts that are tried
def numbered(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return names of columns as a map can tell them apart: ``x#1`` and ``x#2`` where there are two `x`.

    Upper and lower case count as one. The third column is called ``column 3`` if it has no name.
    """
    counts, seen = Counter(name.casefold() for name in names), Counter[str]()
    unique: list[str] = []
    for place, name in enumerate(names, 1):
        seen[name.casefold()] += 1
        alone = counts[name.casefold()] == 1
        unique.append((name if alone else f"{name}#{seen[name.casefold()]}") if name else f"column {place}")
    return tuple(unique)


def open_table(path: Path, stated: TableFormat | None = None) -> Table:
    """Open a table: a MATLAB file, or a text, of which a column map may say something.

    Raises:
        InputError: missing, unreadable, empty, binary, without a table or without rows of data.
    """
    if path.suffix.lower() == ".mat":
        return _matlab(path)
    text, encoding, doubts = _read(path)
    lines = text[:_LOOKED_AT].decode("utf-8", "replace").split("\n")
    lines = lines[:-1] if len(text) > _LOOKED_AT else lines
    dialect = find_dialect(path, lines, stated or TableFormat())
    return Table(path=path, text=text, encoding=encoding, doubts=doubts, **vars(dialect))


def _read(path: Path) -> tuple[bytes, str, tuple[str, ...]]:
    """Return a text file's content in UTF-8 with plain line ends, its encoding, and doubts."""
    refuse_special(path)
    data = _unpacked(path)
    for magic, kind in _MAGIC.items():
        if data.startswith(magic):
            raise InputError(f"{path}: is not text but {kind}", "export the log as CSV")
    encoding = _encoding(path, data[: 1 << 16])
    guessed = f"read as {encoding.upper()}, which the file does not say" if encoding[:7] == "utf-16-" else ""
    guessed = "not UTF-8, read as Windows-1252" if encoding == "cp1252" else guessed
    if encoding == "utf-8-sig":
        data = data.removeprefix(codecs.BOM_UTF8)
    else:
        data = data.decode(encoding, "replace").encode()
    data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    doubts = [f"{path.name}: {guessed}"] if guessed else []
    if zeros := len(data) - len(data := data.rstrip(b"\0")):
        lost = f"{zeros} zero bytes at the end were passed over: was the log closed?"
        doubts.append(f"{path.name}: {lost}")
    if 1 < data.count(b";") == data.count(b";\n") + data.endswith(b";"):
        data = data.replace(b";\n", b"\n").removesuffix(b";")  # rows that end as in MATLAB
    return data, encoding, tuple(doubts)


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
    except LabError:
        raise
    except Exception as error:  # each way of packing has errors of its own
        if isinstance(error, OSError) and error.errno is not None:
            raise readable(error, path) from None
        hint = "copy the file again, or unpack it and name the table"
        raise InputError(f"{path}: cannot be unpacked: {error or type(error).__name__}", hint) from None
    if len(data) > _LARGEST:
        raise InputError(f"{path}: holds more than {_LARGEST >> 30} GB", "unpack it and name the table")
    return data


def _only_table(path: Path, archive: zipfile.ZipFile) -> str:
    """Return the name of the one table in an archive; what macOS adds does not count."""
    inside = [name for name in archive.namelist() if not name.startswith("__MACOSX/")]
    tables = [name for name in inside if name.lower().endswith((".csv", ".txt", ".tsv"))]
    if len(tables) != 1:
        found = some_of(tables, 5) or "none"
        message = f"{path}: expected one table (.csv, .txt, .tsv) in the archive, found {found}"
        raise InputError(message, "unpack it and name the tables" if tables else PLAIN)
    return tables[0]


def _encoding(path: Path, head: bytes) -> str:
    """Recognise the encoding from the first bytes, which are refused if they are not text."""
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    for name, zeros in (("utf-16-le", head[1::2]), ("utf-16-be", head[0::2])):
        if b"\0" in head and zeros.count(0) > 0.9 * len(zeros) and head.count(0) < 0.6 * len(head):
            return name
    head = re.sub(rb"\0{%d,}" % _LOST, b"", head)
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


def _matlab(path: Path) -> Table:
    """Take the vectors of a MATLAB file, single or in structs, as columns; they must be of one length.

    A vector that is alone in its length is no column: a column needs its times beside it.
    """
    from scipy.io import loadmat  # noqa: PLC0415, only where a log is one

    refuse_special(path)
    again = "in MATLAB: s = table2struct(T, 'ToScalar', true); save('log.mat', '-struct', 's', '-v7')"
    try:
        content = loadmat(path, simplify_cells=True)
    except OSError as error:
        raise readable(error, path) from None
    except NotImplementedError:
        raise InputError(f"{path}: is a MATLAB file of version 7.3", f"save it with -v7; {again}") from None
    except Exception as error:  # the parser raises whatever a damaged file makes it stumble over
        message = " ".join(str(error).split())[:120] or type(error).__name__
        message = f"{path}: cannot be read as a MATLAB file: {message}"
        raise InputError(message, "copy or save it again") from None
    vectors = dict(_vectors({key: value for key, value in content.items() if not key.startswith("__")}, ""))
    for name, value in content.items() if not vectors else ():
        if isinstance(value, list) and value and all(isinstance(run, dict) for run in value):
            each = (
                f"for k = 1:{len(value)}, s = {name}(k); save(sprintf('run_%d.mat', k), '-struct', 's'); end"
            )
            message = f"{path}: '{name}' is an array of {len(value)} structs, expected a file for each run"
            raise InputError(message, f"in MATLAB: {each}")
    counts = Counter(map(len, vectors.values()))
    lengths = sorted(k for k, n in counts.items() if n > 1) or sorted(counts)
    if len(lengths) != 1:
        examples = [f"{next(n for n, v in vectors.items() if len(v) == k)} ({k})" for k in lengths[:4]]
        message = (
            f"vectors of different lengths: {', '.join(examples)}" if lengths else "no vectors of numbers"
        )
        raise InputError(f"{path}: {message}, expected a column a quantity, all of one length", again)
    vectors = {name: values for name, values in vectors.items() if len(values) == lengths[0]}
    short = [name.rpartition(".")[2] for name in vectors]
    names = tuple(short if len(set(short)) == len(short) else vectors)
    columns = tuple(vectors.values())
    return Table(path=path, headers=(names,), width=len(names), encoding="MATLAB", numbers=columns)


def _vectors(content: dict[str, Any], prefix: str) -> Iterator[tuple[str, Array]]:
    """Yield the vectors in a MATLAB file or struct; a matrix is several, along its longer side."""
    for key, value in content.items():
        if isinstance(value, dict):
            yield from _vectors(value, f"{prefix}{key}.")
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and max(value.shape) >= _FEWEST:
            rows = np.atleast_2d(value.T if value.ndim == 2 and value.shape[0] >= value.shape[1] else value)
            if rows.ndim == 2 and len(rows) <= _FEWEST:
                usual = {1: [""], 3: ["_x", "_y", "_z"]}
                ends = usual.get(len(rows), [f"_{k + 1}" for k in range(len(rows))])
                yield from zip((f"{prefix}{key}{end}" for end in ends), rows.astype(np.float64), strict=True)
