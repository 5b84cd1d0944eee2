"""Text or not, and in which encoding."""

from __future__ import annotations

import codecs
from pathlib import Path
from typing import TextIO

from granite_lab.errors import InputError
from granite_lab.files import readable, refuse_special

_MAGIC = {
    b"#ROSBAG": "a ROS bag", b"\x89MCAP": "an MCAP file", b"PK\x03\x04": "a zip archive or Excel workbook",
    b"\x1f\x8b": "gzip-compressed", b"PAR1": "a Parquet file", b"\x89HDF": "an HDF5 file",
    b"MATLAB": "a MATLAB file", b"SQLite": "an SQLite database", b"%PDF": "a PDF document",
}  # fmt: skip


def open_text(path: Path, encoding: str) -> TextIO:
    """Open a log as text; characters that do not fit the encoding become U+FFFD.

    Raises:
        InputError: the file cannot be read.
    """
    try:
        return path.open(encoding=encoding, errors="replace")
    except OSError as error:
        raise readable(error, path) from None


def encoding_of(path: Path) -> tuple[str, tuple[str, ...]]:
    """Recognise the encoding from the first bytes.

    Returns:
        its name, and doubts.

    Raises:
        InputError: the file cannot be read, or is not text.
    """
    refuse_special(path)
    try:
        with path.open("rb") as file:
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
