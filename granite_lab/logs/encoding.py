"""Text or not, in which encoding, and unpacked where it is compressed."""

from __future__ import annotations

import codecs
import gzip
import io
import zipfile
import zlib
from pathlib import Path
from typing import BinaryIO, TextIO

from granite_lab.errors import InputError
from granite_lab.files import readable, refuse_special

_MAGIC = {
    b"#ROSBAG": "a ROS bag", b"\x89MCAP": "an MCAP file", b"PK\x03\x04": "a zip archive or Excel workbook",
    b"\x1f\x8b": "gzip-compressed", b"PAR1": "a Parquet file", b"\x89HDF": "an HDF5 file",
    b"MATLAB": "a MATLAB file", b"SQLite": "an SQLite database", b"%PDF": "a PDF document",
}  # fmt: skip

_LARGEST = 2 << 30
"""A compressed log may hold this much [bytes]."""


def open_text(path: Path, encoding: str) -> TextIO:
    """Open a log as text; characters that do not fit the encoding become U+FFFD.

    Raises:
        InputError: the file cannot be read.
    """
    return io.TextIOWrapper(_opened(path), encoding=encoding, errors="replace")


def _opened(path: Path) -> BinaryIO:
    """Open a log; one that is compressed (``.csv.gz``, or one table in a ``.zip``) is unpacked in memory.

    Raises:
        InputError: the file cannot be read or unpacked, or the archive does not hold just one table.
    """
    kind = path.suffix.lower()
    try:
        if kind not in (".gz", ".zip"):
            return path.open("rb")
        if kind == ".gz":
            with gzip.open(path) as packed:
                data = packed.read(_LARGEST + 1)
        else:
            with zipfile.ZipFile(path) as archive, archive.open(_only_table(path, archive)) as member:
                data = member.read(_LARGEST + 1)
    except (gzip.BadGzipFile, zipfile.BadZipFile, zlib.error, EOFError, RuntimeError) as error:
        raise InputError(
            f"{path}: cannot be unpacked: {error}", "copy the file again, or unpack it and name the table"
        ) from None
    except OSError as error:
        raise readable(error, path) from None
    if len(data) > _LARGEST:
        raise InputError(f"{path}: holds more than {_LARGEST >> 30} GB", "unpack it and name the table")
    return io.BytesIO(data)


def _only_table(path: Path, archive: zipfile.ZipFile) -> str:
    """Return the name of the one table in an archive; what macOS adds does not count.

    Raises:
        InputError: there are none, or several.
    """
    inside = [name for name in archive.namelist() if not name.startswith("__MACOSX/")]
    tables = [name for name in inside if name.lower().endswith((".csv", ".txt", ".tsv"))]
    if len(tables) != 1:
        found = ", ".join(tables[:5]) + (", …" if len(tables) > 5 else "") if tables else "none"
        raise InputError(
            f"{path}: expected one table (.csv, .txt, .tsv) in the archive, found {found}",
            "unpack it and name the tables" if tables else "a log is a CSV file with a header line",
        )
    return tables[0]


def encoding_of(path: Path) -> tuple[str, tuple[str, ...]]:
    """Recognise the encoding from the first bytes.

    Returns:
        its name, and doubts.

    Raises:
        InputError: the file cannot be read, or is not text.
    """
    refuse_special(path)
    try:
        with _opened(path) as file:
            head = file.read(1 << 16)
    except OSError as error:
        raise readable(error, path) from None
    for magic, what in _MAGIC.items():
        if head.startswith(magic):
            raise InputError(f"{path}: is not text but {what}", "export the log as CSV")
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16", ()
    if b"\0" in head:
        for name, zeros in (("utf-16-le", head[1::2]), ("utf-16-be", head[0::2])):
            if zeros.count(0) > 0.9 * len(zeros) and head.count(0) < 0.6 * len(head):
                return name, (f"{path.name}: read as {name.upper()}, which the file does not say",)
        if 0 in head[:512] or head.count(0) > 0.01 * len(head):
            raise InputError(f"{path}: is binary, not text", "export the log as CSV")
    try:
        codecs.getincrementaldecoder("utf-8-sig")().decode(head)
    except UnicodeDecodeError:
        odd = sum(byte < 32 and byte not in b"\t\r\n\f" for byte in head)
        if odd > 0.01 * len(head):
            raise InputError(f"{path}: is binary, not text", "export the log as CSV") from None
        return "cp1252", (f"{path.name}: not UTF-8, read as Windows-1252",)
    return "utf-8-sig", ()
