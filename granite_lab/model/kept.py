"""What is made once for all runs, machine code and graphs, kept on disk for the next process.

Machine code runs as it stands, and a graph of CasADi may name a library that is loaded with it. Both are read
only from a folder, and from files, that belong to the user and that nobody else can write.
"""

from __future__ import annotations

import hashlib
import os
import re
import stat
from pathlib import Path

from platformdirs import user_cache_path

from granite_lab.errors import LabError
from granite_lab.files import writing

FOLDER = "GRANITE_LAB_CACHE"
"""Environment variable: folder for what is kept, as for results."""

KEPT = 1500
"""Files that stay in the folder, of about 70 kB each."""

_CHECK = hashlib.sha256().digest_size
_OWN = re.compile(r"[0-9a-f]{64}\.(o|graph)|\.[0-9a-f]{64}\.(o|graph)\.[0-9a-f]{12}\.part")
"""Names of what this module writes, the last ones while it does; it removes nothing else."""


def _folder() -> Path:
    named = os.environ.get(FOLDER)
    return (Path(named) if named else user_cache_path("granite-lab", appauthor=False)) / "machine-code"


def _private(found: os.stat_result) -> bool:
    """Say whether nobody but the user can have written a file or folder; Windows knows no such modes."""
    shared = found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return os.name == "nt" or (found.st_uid == os.geteuid() and not shared)


def doubts() -> tuple[str, ...]:
    """Return a line on why the folder is not used; nothing where it is, or where there is none yet."""
    folder = _folder()
    try:
        private = _private(folder.stat())
    except OSError:
        private = True
    line = (
        f"{folder} belongs to another user or can be written by others, so machine code is made anew each "
        f"time; remove the folder, or set {FOLDER} to a folder of your own"
    )
    return () if private else (line,)


def read(name: str) -> bytes | None:
    """Return the content of that name from the folder; None if there is none that can be trusted."""
    file = _folder() / name
    try:
        if not _private(file.parent.stat()):
            return None
        with file.open("rb") as opened:
            if not _private(os.fstat(opened.fileno())):
                return None
            content = opened.read()
        os.utime(file)  # what is used stays
    except OSError:
        return None
    check, found = content[:_CHECK], content[_CHECK:]
    return found if check == hashlib.sha256(found).digest() else None


def keep(name: str, content: bytes) -> None:
    """Put content into the folder, whole or not at all; a folder that cannot be used is no fault.

    Args:
        name: a SHA-256 in hexadecimal with the ending ``.o`` or ``.graph``.
        content: what `read` returns from then on.
    """
    folder = _folder()
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        if not _private(folder.stat()):
            return
        with writing(folder / name) as file:
            Path(file.name).chmod(0o600)  # whatever the umask allows to a group
            file.write(hashlib.sha256(content).digest() + content)
        own = [path for path in folder.iterdir() if _OWN.fullmatch(path.name)]
        for old in sorted(own, key=lambda path: path.lstat().st_mtime)[:-KEPT]:
            old.unlink(missing_ok=True)
    except (OSError, LabError):
        return
