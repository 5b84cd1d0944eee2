"""What a result depends on, as hashes: files, options, this package's sources and its libraries."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import platform
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import granite_lab
from granite_lab.errors import LabError
from granite_lab.files import sha256
from granite_lab.logs.named import sidecar
from granite_lab.running.codec import encode
from granite_lab.running.options import NOTHING_SAID, Options

PACKAGE = Path(granite_lab.__file__).parent
LIBRARIES = ("casadi", "filterpy", "numpy", "pandas", "scipy")

SHOWS = ("api", "cli.py", "commands", "hidden", "reporting")
"""Parts of the package that no cached result depends on: they only call and show."""

SEARCHES = ("discovery",)
"""Parts that only the search for a missing effect depends on."""


@lru_cache
def code(*, search: bool = False) -> str:
    """Return the hash of the sources and the library versions behind a result.

    Args:
        search: the result is that of the search for a missing effect.
    """
    left_out = SHOWS if search else SHOWS + SEARCHES
    digest = hashlib.sha256()
    for path in sorted(PACKAGE.rglob("*")):
        place = path.relative_to(PACKAGE)
        if path.suffix in (".py", ".toml") and place.parts[0] not in left_out:
            digest.update(f"{place.as_posix()} {sha256(path)}\n".encode())
    for library in LIBRARIES:
        digest.update(f"{library} {importlib.metadata.version(library)}\n".encode())
    digest.update(f"{granite_lab.__version__} {platform.machine()} {platform.python_version()}".encode())
    return digest.hexdigest()


def fingerprint(path: Path) -> str:
    """Return the hash of a file, or of all files of a folder; "absent" where nothing can be read."""
    try:
        if not path.is_dir():
            return sha256(path)
        inside = sorted(p for p in path.rglob("*") if p.is_file())
        lines = "".join(f"{p.relative_to(path).as_posix()} {sha256(p)}\n" for p in inside)
        return hashlib.sha256(lines.encode()).hexdigest()
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
    mine = replace(options, tolerance=NOTHING_SAID.tolerance, latency=NOTHING_SAID.latency)  # of searches
    return digest_of(code(), what, files, hashlib.sha256(encode(mine)).hexdigest())


def search_key(inputs: Sequence[bytes], options: Options) -> str:
    """Return the name under which a finding is remembered.

    Args:
        inputs: everything the search works on, encoded.
        options: of the search: the user's own effect file, tolerance and latency.
    """
    own = fingerprint(options.effects) if options.effects else None
    hashes = [hashlib.sha256(data).hexdigest() for data in inputs]
    return digest_of(code(search=True), hashes, own, options.tolerance, options.latency)


def digest_of(*parts: Any) -> str:
    """Return the hash of plain values."""
    return hashlib.sha256(json.dumps(parts, ensure_ascii=True).encode()).hexdigest()
