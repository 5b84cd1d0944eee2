"""Finished results on disk, found by the content of what they were made from: files, options and code."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.metadata
import json
import os
import platform
import re
import time
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from platformdirs import user_cache_path

import granite_lab
from granite_lab.errors import LabError
from granite_lab.files import sha256, write_bytes
from granite_lab.logs.trial import sidecar
from granite_lab.options import Options
from granite_lab.running.codec import MAGIC, Arena, content, decode

if TYPE_CHECKING:
    from granite_lab.model.effect import Effect

VARIABLE = "GRANITE_LAB_CACHE"
"""Environment variable with the folder of the cache."""

LARGEST = 5_000_000_000
"""Size [bytes] above which the results that were not used for longest are removed; a trial takes 2 MB."""

STALE = 3600.0
"""Age [s] after which a file that was never finished is removed."""

PACKAGE = Path(granite_lab.__file__).parent
LIBRARIES = ("casadi", "filterpy", "numpy", "pandas", "scipy")
DRAWING = ("jinja2", "matplotlib", "rerun-sdk")

OWN = re.compile(r"[0-9a-f]{2}/([0-9a-f]{62}\.bin|\.[0-9a-f]{62}\.bin\.[0-9a-f]{12}\.part)")
"""Paths in the folder of what is remembered, and of what is being written; nothing else is removed."""

SHOWS = ("api", "cli.py", "commands", "hidden", "reporting", "study_folder.py", "two_studies.py")
"""Parts of the package that no cached result depends on: they only call and show."""


class Cache:
    """A folder of results; each is a file that stands whole or not at all.

    A cache that cannot be written costs time, nothing else: `trouble` says what was wrong.
    """

    def __init__(self, folder: Path | None = None) -> None:
        chosen = folder or os.environ.get(VARIABLE)
        self.folder = Path(chosen) if chosen else user_cache_path("granite-lab", appauthor=False)
        self.trouble: LabError | None = None

    def get(
        self, key: str, effects: Mapping[str, Effect] | None = None, arena: Arena | None = None
    ) -> Any | None:
        """Return the record that stands under a key; None where there is none that still holds.

        Args:
            key: of `trial_key` or `digest_of`.
            effects: as in `decode`.
            arena: where the record lies from then on.
        """
        path = self._path(key)
        try:
            data = path.read_bytes()
            depends, record = decode(arena.hold(data) if arena else data, effects)
            if any(fingerprint(Path(file)) != sha for file, sha in depends):
                return None
            os.utime(path)
        except Exception:  # whatever a missing, damaged or foreign file leads to, the result is made again
            return None
        return record

    def put(self, key: str, data: bytes) -> None:
        """Remember what `encode` made of files with hashes that a record depends on, and the record."""
        try:
            write_bytes(self._path(key), data)
        except LabError as error:
            self.trouble = error

    def trim(self, largest: int = LARGEST) -> None:
        """Remove what was never finished, and what was not used for longest where the cache is too large.

        A file that `put` did not write stays, whatever its name, and counts for nothing.
        """
        with suppress(OSError):
            entries = [
                (path.stat().st_mtime, path.stat().st_size, path)
                for path in self.folder.glob("??/*")
                if OWN.fullmatch(path.relative_to(self.folder).as_posix()) and path.is_file()
            ]
            total = 0
            for used, size, path in sorted(entries, reverse=True):
                unfinished = path.suffix == ".part"
                total += 0 if unfinished else size
                if time.time() - used > STALE if unfinished else total > largest and _written(path):
                    path.unlink(missing_ok=True)

    def _path(self, key: str) -> Path:
        return self.folder / key[:2] / f"{key[2:]}.bin"


def _written(path: Path) -> bool:
    """Say whether a file begins as all that `put` writes."""
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


@lru_cache
def code(*, shows: bool = False) -> str:
    """Return the hash of the sources and the library versions behind a result, or behind a written report."""
    digest = hashlib.sha256()
    for path in sorted(PACKAGE.rglob("*")):
        place = path.relative_to(PACKAGE)
        source = path.suffix in (".py", ".toml") or (place.parts[0] == "reporting" and path.suffix != ".pyc")
        if source and path.is_file() and (shows or place.parts[0] not in SHOWS):
            digest.update(f"{place.as_posix()} {sha256(path)}\n".encode())
    for library in LIBRARIES + DRAWING * shows:
        digest.update(f"{library} {importlib.metadata.version(library)}\n".encode())
    digest.update(f"{granite_lab.__version__} {platform.machine()} {platform.python_version()}".encode())
    return digest.hexdigest()


def fingerprint(path: Path) -> str:
    """Return the hash of a file or folder; "absent" where nothing can be read."""
    try:
        return sha256(path)
    except (LabError, OSError):
        return "absent"


def trial_key(computed: str, path: Path, options: Options) -> str:
    """Return the key of the result of some work, by its name, on one trial."""
    files = [(str(p), fingerprint(p), fingerprint(sidecar(p))) for p in (path, *options.files())]
    mine = dataclasses.replace(options, tolerance=0.0, latency=0.0, exclude=())  # of all trials
    mine = dataclasses.replace(mine, info=options.known(path), of_trials=())
    return digest_of(code(), computed, files, content(mine))


def digest_of(*parts: Any) -> str:
    """Return the hash of plain values."""
    return hashlib.sha256(json.dumps(parts, ensure_ascii=True).encode()).hexdigest()
