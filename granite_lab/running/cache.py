"""Finished results on disk, found by the content of what they were made from."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from granite_lab.errors import LabError
from granite_lab.files import write_bytes
from granite_lab.model.effect import Effect
from granite_lab.running.codec import Arena, decode
from granite_lab.running.fingerprint import fingerprint

VARIABLE = "GRANITE_LAB_CACHE"
"""Environment variable with the folder of the cache."""

LARGEST = 5_000_000_000
"""Size [bytes] above which the results that were not used for longest are removed; a trial takes 2 MB."""

STALE = 3600.0
"""Age [s] after which a file that was never finished is removed."""


def default_folder() -> Path:
    """Return the folder that the system means for caches, or what the environment says."""
    if chosen := os.environ.get(VARIABLE):
        return Path(chosen)
    from platformdirs import user_cache_path  # noqa: PLC0415, only for the commands that need it

    return user_cache_path("granite-lab", appauthor=False)


class Cache:
    """A folder of results; each is a file that stands whole or not at all.

    The hash of the bytes keeps a damaged file from being taken for a result. A cache that cannot be
    written costs time, nothing else: `trouble` says what was wrong.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self.folder = folder or default_folder()
        self.trouble: LabError | None = None

    def get(
        self, key: str, effects: Mapping[str, Effect] | None = None, arena: Arena | None = None
    ) -> Any | None:
        """Return the record that stands under a key; None where there is none that still holds.

        Args:
            key: of `fingerprint`.
            effects: as in `codec.decode`.
            arena: where the record lies from then on.
        """
        path = self._path(key)
        try:
            data = path.read_bytes()
            depends, record = decode(arena.hold(data) if arena else data, effects)
            if any(fingerprint(Path(file)) != sha for file, sha in depends):
                return None
            os.utime(path)
        except FileNotFoundError:
            return None
        except Exception:  # whatever a damaged or foreign file leads to, the result is made again
            with suppress(OSError):
                path.unlink()
            return None
        return record

    def put(self, key: str, data: bytes) -> None:
        """Remember a result.

        Args:
            key: of `fingerprint`.
            data: `codec.encode` of a pair: files with their hashes that it also depends on, and the record.
        """
        try:
            write_bytes(self._path(key), data)
        except LabError as error:
            self.trouble = error

    def trim(self, largest: int = LARGEST) -> None:
        """Remove what was never finished, and what was not used for longest where the cache is too large."""
        with suppress(OSError):
            entries = []
            for path in self.folder.glob("*/*"):
                stat = path.stat()
                if path.suffix == ".part":
                    if time.time() - stat.st_mtime > STALE:
                        path.unlink(missing_ok=True)
                else:
                    entries.append((stat.st_mtime, stat.st_size, path))
            total = sum(size for _, size, _ in entries)
            for _, size, path in sorted(entries):
                if total <= largest:
                    break
                path.unlink(missing_ok=True)
                total -= size

    def _path(self, key: str) -> Path:
        return self.folder / key[:2] / f"{key[2:]}.bin"
