"""Finished results on disk, found by the content of what they were made from: files, options and code."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.metadata
import json
import os
import platform
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from platformdirs import user_cache_path

import granite_lab
from granite_lab.errors import LabError
from granite_lab.files import sha256, write_bytes
from granite_lab.logs.named import sidecar
from granite_lab.running.codec import Arena, decode, is_effect
from granite_lab.running.options import Options

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

SHOWS = ("api", "cli.py", "commands", "hidden", "reporting", "two_studies.py")
"""Parts of the package that no cached result depends on: they only call and show."""


class Cache:
    """A folder of results; each is a file that stands whole or not at all.

    The hash of the bytes keeps a damaged file from being taken for a result. A cache that cannot be
    written costs time, nothing else: `trouble` says what was wrong.
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
            key: of `trial_key` or `digest_of`.
            data: `codec.encode` of a pair: files with their hashes that it also depends on, and the record.
        """
        try:
            write_bytes(self._path(key), data)
        except LabError as error:
            self.trouble = error

    def trim(self, largest: int = LARGEST) -> None:
        """Remove what was never finished, and what was not used for longest where the cache is too large."""
        with suppress(OSError):
            entries = [(p.stat().st_mtime, p.stat().st_size, p) for p in self.folder.glob("*/*")]
            total = 0
            for used, size, path in sorted(entries, reverse=True):
                unfinished = path.suffix == ".part"
                total += 0 if unfinished else size
                if time.time() - used > STALE if unfinished else total > largest:
                    path.unlink(missing_ok=True)

    def _path(self, key: str) -> Path:
        return self.folder / key[:2] / f"{key[2:]}.bin"


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


def trial_key(what: str, path: Path, options: Options) -> str:
    """Return the name under which the result of one trial is remembered.

    Args:
        what: the work, by name.
        path: the log.
        options: of the work.
    """
    direct = (path, *options.files())
    files = [(str(p), fingerprint(p), fingerprint(sidecar(p))) for p in direct]
    mine = dataclasses.replace(options, tolerance=0.0, latency=0.0)  # of searches
    return digest_of(code(), what, files, content(mine))


def content(record: Any) -> str:
    """Return the hash of a record; fields that are not compared do not count."""
    digest = hashlib.sha256()
    for part in _parts(record):
        digest.update(part)
    return digest.hexdigest()


def _parts(value: Any) -> Iterator[bytes]:
    if isinstance(value, np.ndarray):
        yield f"{value.dtype.str}{value.shape}".encode()
        yield value.tobytes()
    elif is_effect(value):
        yield value.id.encode()
    elif dataclasses.is_dataclass(value):
        yield type(value).__name__.encode()
        for field in dataclasses.fields(value):
            yield from _parts(getattr(value, field.name)) if field.compare else ()
    elif isinstance(value, (tuple, list, Mapping)):
        yield f"{len(value)} of".encode()
        for item in value.items() if isinstance(value, Mapping) else value:
            yield from _parts(item)
    else:
        yield f"{value!r};".encode("utf-8", errors="surrogatepass")


def digest_of(*parts: Any) -> str:
    """Return the hash of plain values."""
    return hashlib.sha256(json.dumps(parts, ensure_ascii=True).encode()).hexdigest()
