"""The folder of a report: one run at a time writes into it, and a part that fails is reported."""

from __future__ import annotations

import os
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

from granite_lab.errors import LabError, printable
from granite_lab.files import readable, write_text
from granite_lab.folders import refuse_foreign, remove_part, remove_unfinished, replacing

T = TypeVar("T")


@contextmanager
def locked(folder: Path, names: Sequence[str] = ()) -> Iterator[None]:
    """Keep other runs out of a folder during the block, and remove what a killed one left behind.

    The lock is on the folder itself and leaves no file. A folder that is made here goes if it stays empty.

    Args:
        folder: of the results.
        names: of files that will be written.

    Raises:
        LabError: another run writes into it, it cannot be made, or files of others have these names.
    """
    made = not folder.exists()
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
        remove_unfinished(folder)
        refuse_foreign(folder, names)
        yield
    finally:
        if lock is not None:
            os.close(lock)
        if made:
            with suppress(OSError):
                folder.rmdir()


class Guard:
    """Runs the parts of an output one after the other; one that fails becomes one of `lines`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.lines: list[str] = []

    def run(self, part: str, call: Callable[[], T]) -> T | None:
        """Return what a part of that name gives; None where it fails, by a defect with its traceback."""
        name = f"failure-{part}"
        try:
            remove_part(self.folder, name)  # that of an earlier run would be wrong
            return call()
        except LabError as error:
            self.lines.append(f"{part}: {error.message}" + (f" ({error.hint})" if error.hint else ""))
        except Exception as error:  # a defect of this package
            line = f"{part}: {type(error).__name__}: {printable(str(error))}"
            try:
                with replacing(self.folder, name) as new:
                    write_text(new / f"{name}.txt", traceback.format_exc())
                line += f"; the traceback is in {self.folder / name}.txt"
            except LabError as full:
                line += f"; {full.message}"
            self.lines.append(line)
        return None


def raise_failed(lines: Sequence[str]) -> None:
    """Raise an error that names the parts of a run that failed, after everything else is written.

    Raises:
        LabError: there is a line.
    """
    if lines:
        raise LabError("; ".join(lines), "everything else was written")
