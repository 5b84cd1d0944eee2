"""Files that are kept for the next run, machine code and results: whole, and from the user only.

Machine code runs as it stands, and results are pickles, which can run code, too. Both are read only from a
folder, and from files, that belong to the user and that only the user can write.
"""

from __future__ import annotations

import hashlib
import os
import re
import stat
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from platformdirs import user_cache_path

from granite_lab.errors import LabError
from granite_lab.files import writing

FOLDER = "GRANITE_LAB_CACHE"
"""Environment variable: folder for what is kept."""

STALE = 3600.0
"""Age [s] after which a file that was never finished is removed."""

_CHECK = hashlib.sha256().digest_size
_NAME = r"[0-9a-f]{64}\.(?:o|result)"
_OWN = re.compile(rf"{_NAME}|\.{_NAME}\.[0-9a-f]{{12}}\.part")
"""Names of what this module writes, the last ones while it does; it removes nothing else."""


def root() -> Path:
    """Return the folder for all that is kept."""
    named = os.environ.get(FOLDER)
    return Path(named) if named else user_cache_path("granite-lab", appauthor=False)


def _private(status: os.stat_result) -> bool:
    """Say whether only the user can have written a file or folder; Windows knows no such modes."""
    shared = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return os.name == "nt" or (status.st_uid == os.geteuid() and not shared)


@dataclass(frozen=True)
class Store:
    """A folder of files; each stands whole or not at all.

    Attributes:
        folder: where they are.
        largest: size of all [bytes] above which those that were not used for longest are removed.
        subject: what they are, in the plural.
    """

    folder: Path
    largest: int
    subject: str

    def doubts(self) -> tuple[str, ...]:
        """Return a line on why the folder is not used; no line where it is used or does not exist yet."""
        try:
            private = _private(self.folder.stat())
        except OSError:
            private = True
        line = (
            f"{self.folder} belongs to another user or can be written by others, so {self.subject} made anew "
            f"each time; remove the folder, or set {FOLDER} to a folder of your own"
        )
        return () if private else (line,)

    def read(self, name: str) -> bytes | None:
        """Return the content of that name; None if there is none that can be trusted."""
        file = self.folder / name
        try:
            if not _private(self.folder.stat()):
                return None
            with file.open("rb") as opened:
                if not _private(os.fstat(opened.fileno())):
                    return None
                check, content = opened.read(_CHECK), opened.read()
            os.utime(file)  # what is used stays
        except OSError:
            return None
        return content if check == hashlib.sha256(content).digest() else None

    def keep(self, name: str, content: bytes) -> str:
        """Put content into the folder, whole or not at all; return why that could not be, else "".

        Args:
            name: a SHA-256 in hexadecimal with the ending ``.o`` or ``.result``.
            content: what `read` returns from then on.
        """
        try:
            self.folder.parent.mkdir(parents=True, exist_ok=True)
            self.folder.mkdir(mode=0o700, exist_ok=True)
            if doubts := self.doubts():
                return doubts[0]
            with writing(self.folder / name) as file:
                Path(file.name).chmod(0o600)  # whatever the umask allows to a group
                file.write(hashlib.sha256(content).digest() + content)
            self._trim()
        except LabError as error:
            return error.message
        except OSError as error:
            return f"{self.folder}: cannot be written: {error.strerror}"
        return ""

    def _trim(self) -> None:
        """Remove what was never finished, and what was not used for longest where all is too large."""
        entries, total = [], 0
        for path in self.folder.iterdir():
            with suppress(FileNotFoundError):  # of another process
                status = path.lstat()
                if _OWN.fullmatch(path.name) and stat.S_ISREG(status.st_mode):
                    entries.append((status.st_mtime, status.st_size, path))
        for used, size, path in sorted(entries, reverse=True):
            unfinished = path.suffix == ".part"
            total += 0 if unfinished else size
            if time.time() - used > STALE if unfinished else total > self.largest:
                path.unlink(missing_ok=True)


def machine_code() -> Store:
    """Return where machine code is kept, about 70 kB a graph."""
    return Store(root() / "machine-code", 100_000_000, "machine code is")
