"""The folder of a report: one run at a time writes into it, and clears away what a killed one left."""

from __future__ import annotations

import errno
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from granite_lab.errors import LabError
from granite_lab.files import readable


@contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """Keep other runs out of a folder during the block, and remove what a killed one left behind.

    The folder is made; if it is still empty after the block it is removed again.

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
            _lock(lock, folder)
        sweep(folder)
        yield
    finally:
        if lock is not None:
            os.close(lock)
        with suppress(OSError):
            folder.rmdir()


def _lock(descriptor: int, folder: Path) -> None:
    import fcntl  # noqa: PLC0415, absent on Windows

    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in (errno.EWOULDBLOCK, errno.EACCES):
            raise LabError(
                f"{folder}: another run is writing into it", "wait, or choose another --out"
            ) from None
        # a file system without locks: two runs at once stay possible there


def sweep(folder: Path) -> None:
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
