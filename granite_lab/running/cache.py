"""Finished results on disk, found by the content of what they were made from: files, options and code."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.metadata
import json
import platform
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import granite_lab
from granite_lab.errors import LabError
from granite_lab.files import sha256
from granite_lab.logs.trial import sidecar
from granite_lab.options import Options
from granite_lab.running.codec import Arena, content, decode
from granite_lab.stored import Store, root

if TYPE_CHECKING:
    from granite_lab.model.effect import Effect

LARGEST = 5_000_000_000
"""Size of all results [bytes]; a trial takes 2 MB."""

PACKAGE = Path(granite_lab.__file__).parent
LIBRARIES = ("casadi", "filterpy", "numpy", "pandas", "scipy")
DRAWING = ("jinja2", "matplotlib", "rerun-sdk")

SHOWS = ("api", "cli.py", "commands", "hidden", "reporting", "study_folder.py", "two_studies.py")
"""Parts of the package that no cached result depends on: they only call and show."""


class Cache:
    """A folder of results.

    A cache that cannot be written costs time, nothing else; `trouble` holds the reason.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._store = Store((folder or root()) / "results", LARGEST, "results are")
        self.folder, self.trouble = self._store.folder, ""

    def get(
        self, key: str, effects: Mapping[str, Effect] | None = None, arena: Arena | None = None
    ) -> Any | None:
        """Return the record that stands under a key; None where there is none that still holds.

        Args:
            key: of `trial_key` or `digest_of`.
            effects: as in `decode`.
            arena: where the record lies from then on.
        """
        data = self._store.read(f"{key}.result")
        if data is None:
            return None
        depends, record = decode(arena.hold(data) if arena else data, effects)
        return None if any(fingerprint(Path(file)) != sha for file, sha in depends) else record

    def put(self, key: str, data: bytes) -> None:
        """Remember what `encode` made of files with hashes that a record depends on, and the record."""
        self.trouble = self._store.keep(f"{key}.result", data) or self.trouble


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
    of_trial = dataclasses.replace(options, tolerance=0.0, latency=0.0, exclude=())  # of all trials
    of_trial = dataclasses.replace(of_trial, info=options.info_of(path), of_trials=())
    return digest_of(code(), computed, files, content(of_trial))


def digest_of(*parts: Any) -> str:
    """Return the hash of plain values."""
    return hashlib.sha256(json.dumps(parts, ensure_ascii=True).encode()).hexdigest()
