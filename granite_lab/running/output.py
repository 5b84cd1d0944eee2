"""The folder of a report: one run at a time writes into it, and a part that fails is told."""

from __future__ import annotations

import os
import re
import shutil
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

from granite_lab.errors import LabError, printable
from granite_lab.files import readable, write_text

T = TypeVar("T")


@contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """Keep other runs out of a folder during the block, and remove what a killed one left behind.

    The lock is on the folder itself and leaves no file. The folder is made, and removed if it stays empty.

    Raises:
        LabError: another run writes into it, or it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = os.open(folder, os.O_RDONLY) if os.name == "posix" else None
    except OSError as error:
        raise readable(error, folder, "write") from None
    try:
        if lock is not None:
            import fcntl  # noqa: PLC0415, absent on Windows

            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except (BlockingIOError, PermissionError):
                hint = "wait, or choose another --out"
                raise LabError(f"{folder}: another run is writing into it", hint) from None
            except OSError:  # a file system without locks: two runs at once stay possible there
                pass
        _sweep(folder)
        yield
    finally:
        if lock is not None:
            os.close(lock)
        with suppress(OSError):
            folder.rmdir()


def _sweep(folder: Path) -> None:
    """Remove unfinished files in a folder, and unfinished folders beside it, that nobody writes any more."""
    with suppress(OSError):
        for path in folder.rglob(".*.part"):
            if re.search(r"\.[0-9a-f]{12}\.part$", path.name):
                path.unlink(missing_ok=True)
        beside = re.compile(re.escape(f".{folder.name[:100]}.") + r"[a-z0-9_]{8}")
        for path in folder.parent.iterdir():
            unfinished = beside.fullmatch(path.name) and path.is_dir() and not path.is_symlink()
            if unfinished and {p.name for p in path.iterdir()} <= {"new", "old"}:
                shutil.rmtree(path, ignore_errors=True)


class Guard:
    """Runs the parts of an output one after the other; one that fails becomes one of `lines`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.lines: list[str] = []

    def run(self, part: str, call: Callable[[], T]) -> T | None:
        """Return what a part of that name gives; None where it fails, by a defect with its traceback."""
        path = self.folder / f"failure-{part}.txt"
        with suppress(OSError):
            path.unlink(missing_ok=True)  # that of an earlier run would be wrong
        try:
            return call()
        except LabError as error:
            self.lines.append(f"{part}: {error.message}" + (f" ({error.hint})" if error.hint else ""))
        except Exception as error:  # a defect of this package
            line = f"{part}: {type(error).__name__}: {printable(str(error))}"
            try:
                write_text(path, traceback.format_exc())
                line += f"; the traceback is in {path}"
            except LabError as full:
                line += f"; {full.message}"
            self.lines.append(line)
        return None


def tell(lines: Sequence[str]) -> None:
    """Tell which parts of a run failed, now that everything else is written.

    Raises:
        LabError: there is a line.
    """
    if lines:
        raise LabError("; ".join(lines), "everything else was written")
