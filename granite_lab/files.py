"""Files: whole or not at all when written, readable trouble when they cannot be used."""

from __future__ import annotations

import csv
import errno
import hashlib
import importlib.util
import io
import json
import math
import os
import re
import secrets
import stat
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from granite_lab.errors import InputError, LabError, UsageError

if TYPE_CHECKING:
    import pandas as pd

_REASONS = {
    errno.ENOENT: ("does not exist", "check the path"),
    errno.EISDIR: ("is a directory", "give the path of a file inside it"),
    errno.EEXIST: ("a part of its path is not a directory", "check the path"),
    errno.ENOTDIR: ("a part of its path is not a directory", "check the path"),
    errno.EACCES: ("permission denied", "check the permissions of the file and its folder"),
    errno.EPERM: ("permission denied", "check the permissions of the file and its folder"),
    errno.EROFS: ("the file system is read-only", "choose another folder"),
    errno.ENOSPC: ("no space left on the device", "free some space or choose another folder"),
    errno.EDQUOT: ("disk quota exceeded", "free some space or choose another folder"),
    errno.ELOOP: ("its symbolic links form a loop", "give the path of the file itself"),
    errno.ENAMETOOLONG: ("the file name is too long", "choose a shorter one"),
}


def readable(error: OSError, path: Path | str, doing: str = "read") -> LabError:
    """Return the user's version of an operating system error.

    Args:
        error: of the operating system.
        path: the file it is about.
        doing: "read" gives an `InputError` (exit 3), anything else a plain `LabError` (exit 1).
    """
    reason, hint = _REASONS.get(error.errno or 0, (error.strerror or type(error).__name__, ""))
    kind = InputError if doing == "read" else LabError
    return kind(f"{path}: cannot be {'read' if doing == 'read' else 'written'}: {reason}", hint)


def is_folder(path: Path) -> bool:
    """Return whether a path is a folder; False without permission, so that reading it raises the error."""
    try:
        return path.is_dir()
    except OSError:
        return False


def refuse_special(path: Path) -> None:
    """Refuse a pipe, a device or a socket, whose content may never end.

    Raises:
        InputError: the path is one of these, or nothing can be found there.
    """
    try:
        mode = path.stat().st_mode
    except OSError as error:
        raise readable(error, path) from None
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise InputError(
            f"{path}: cannot be read: is not a regular file", "write the data to a file and give its path"
        )


def sha256(path: Path) -> str:
    """Return the SHA-256 in hexadecimal of a file's content, or of the files of a folder with their names.

    Raises:
        InputError: the file cannot be read.
    """
    refuse_special(path)
    try:
        if path.is_dir():
            files = sorted(file for file in path.rglob("*") if file.is_file())
            inside = "".join(f"{file.relative_to(path).as_posix()} {sha256(file)}\n" for file in files)
            return hashlib.sha256(inside.encode()).hexdigest()
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise readable(error, path) from None


def read_json(path: Path, hint: str, schema: str = "") -> dict[str, Any]:
    """Return the JSON object in a file.

    Args:
        path: of the file.
        hint: what to do where it holds none.
        schema: that the object must name; any by default.

    Raises:
        InputError: the file cannot be read, or holds another document.
    """
    try:
        document = json.loads(path.read_bytes())
    except OSError as error:
        raise readable(error, path) from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not JSON: {error}", hint) from None
    if not isinstance(document, dict) or (schema and document.get("schema") != schema):
        expected = f"schema '{schema}'" if schema else "an object"
        raise InputError(f"{path}: expected {expected}", hint)
    return document


@contextmanager
def writing(path: Path) -> Iterator[BinaryIO]:
    """Open a new file beside `path` and rename it to `path` once the block has ended well.

    Readers see the old content or the new one, never a part. Missing folders are made; the mode
    follows the umask; a symbolic link keeps pointing where it did.

    Raises:
        LabError: the file cannot be written; nothing is left behind then.
    """
    try:
        target = Path(os.path.realpath(path))
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        target.parent.mkdir(parents=True, exist_ok=True)
        # The name is cut so that the temporary one is never longer than the file system allows.
        temporary = target.with_name(f".{target.name[:200]}.{secrets.token_hex(6)}.part")
        try:
            with temporary.open("xb") as file:
                yield file
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise readable(error, path, "write") from error


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file whole or not at all.

    Raises:
        LabError: the file cannot be written.
    """
    with writing(path) as file:
        file.write(data)


def write_text(path: Path, text: str) -> None:
    r"""Write a UTF-8 text file, lines ending in ``\n``, whole or not at all.

    Raises:
        LabError: the file cannot be written.
    """
    write_bytes(path, text.encode("utf-8", errors="replace"))


FORMATS = {"csv": ".csv", "parquet": ".parquet"}
"""What a table can be stored as, and the ending of its file."""


def ending_of(path: Path | None, table_format: str | None) -> str:
    """Return the ending that says how a table is stored: as asked for, else as its file is called, else CSV.

    Raises:
        UsageError: unknown format, or one that the file's name contradicts.
        LabError: Parquet is asked for and pyarrow is not installed.
    """
    if table_format is not None and table_format not in FORMATS:
        raise UsageError(f"--format {table_format}: not known", f"one of: {', '.join(FORMATS)}")
    named = path.suffix.lower() if path is not None and path.suffix.lower() in FORMATS.values() else None
    ending = FORMATS[table_format] if table_format else named or ".csv"
    if named and named != ending:
        raise UsageError(f"{path}: the name does not fit --format {table_format}", "leave out one of the two")
    if ending == ".parquet" and importlib.util.find_spec("pyarrow") is None:
        raise LabError("Parquet needs pyarrow, which is not installed", "pip install 'granite-lab[parquet]'")
    return ending


def write_table(path: Path, table: pd.DataFrame, ending: str = ".csv") -> None:
    """Write a table as CSV (9 digits) or Parquet (to the last bit), whole or not at all.

    Raises:
        LabError: the file cannot be written.
    """
    if ending == ".parquet":
        with writing(path) as file:
            table.to_parquet(file, index=False, engine="pyarrow")
    else:
        with writing(path) as file:
            for block in csv_blocks(table):
                file.write(block.encode("utf-8", errors="replace"))


DIGITS = "%.9g"
"""How a number is written.

An hour of log has twenty million numbers; formatted one by one by pandas they take as long as the estimate
itself.
"""

STAMPS, STAMP_DIGITS = ("t", "t_s"), "%.16g"
"""Columns of stamps; those beyond 1000 s, as seconds since 1970, are written to the microsecond."""

BLOCK = 20_000
"""Rows that are formatted at a time."""


def cell_text(text: str) -> str:
    """Return a text as the cell of a CSV table: on one line, and quoted where a spreadsheet would run it."""
    flat = re.sub(r"[\r\n\t\v\f\x00]+", " ", text)
    return f"'{flat}" if flat.lstrip().startswith(("=", "+", "-", "@")) else flat


def csv_blocks(table: pd.DataFrame) -> Iterator[str]:
    r"""Yield the text of ``table.to_csv(index=False, float_format=DIGITS)`` in parts, safe in a spreadsheet.

    Args:
        table: of floating-point numbers and anything else; NaN becomes an empty cell, a text what
            `cell_text` makes of it.

    Yields:
        whole lines ending in ``\n``, the header first.
    """
    yield csv_lines([[cell_text(str(name)) for name in table.columns]])
    for begin in range(0, len(table), BLOCK):
        block = table.iloc[begin : begin + BLOCK]
        columns = [_cells(block.iloc[:, place]) for place in range(block.shape[1])]
        yield csv_lines(zip(*columns, strict=True))


def csv_lines(rows: Iterable[Sequence[str]]) -> str:
    """Return rows of cells as lines of a CSV, cells in quotes where they need them."""
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(rows)
    return out.getvalue()


def _cells(column: pd.Series) -> list[str]:
    """Return the cells of a column, numbers formatted, empty where nothing is known."""
    values = column.tolist()
    if column.dtype.kind == "f":
        late = column.name in STAMPS and bool((column.abs() >= 1000).any())
        form = STAMP_DIGITS if late else DIGITS
        return ["" if math.isnan(value) else form % value for value in values]
    missing = column.isna().tolist()
    texts = (cell_text(value) if isinstance(value, str) else str(value) for value in values)
    return ["" if nothing else text for text, nothing in zip(texts, missing, strict=True)]
