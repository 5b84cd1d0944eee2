"""What is made once for all runs, machine code and graphs, kept on disk for the next process."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from platformdirs import user_cache_path

FOLDER = "GRANITE_LAB_CACHE"
"""Environment variable: folder for what is kept, as for results."""

KEPT = 1500
"""Files that stay in the folder, of about 70 kB each."""

_CHECK = hashlib.sha256().digest_size


def _folder() -> Path:
    named = os.environ.get(FOLDER)
    return (Path(named) if named else user_cache_path("granite-lab", appauthor=False)) / "machine-code"


def read(name: str) -> bytes | None:
    """Return the content of that name from the folder; None if there is none, or if it is damaged."""
    file = _folder() / name
    try:
        content = file.read_bytes()
        os.utime(file)  # what is used stays
    except OSError:
        return None
    check, found = content[:_CHECK], content[_CHECK:]
    return found if check == hashlib.sha256(found).digest() else None


def keep(name: str, content: bytes) -> None:
    """Put content into the folder, whole or not at all; a folder that cannot be written is no fault."""
    folder = _folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        part = folder / f"{name}.{os.getpid()}"
        part.write_bytes(hashlib.sha256(content).digest() + content)
        part.replace(folder / name)
        files = sorted(folder.iterdir(), key=lambda file: file.stat().st_mtime)
        for old in files[:-KEPT]:
            old.unlink(missing_ok=True)
    except OSError:
        return
