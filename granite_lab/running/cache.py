"""Finished results on disk, found by the content of what they were made from: files, options and code.

A record becomes a restricted pickle, the arrays behind it, and a hash of all. What is read names only records
of this package and arrays, so that a foreign file cannot run code. Arrays are not copied when they are read:
a record may lie in a file that is mapped into memory (`Arena`).
"""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.metadata
import io
import json
import mmap
import os
import pickle
import platform
import sys
import tempfile
import time
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from types import BuiltinFunctionType, FunctionType, SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from platformdirs import user_cache_path

import granite_lab
from granite_lab.errors import LabError
from granite_lab.files import is_folder, sha256, write_bytes
from granite_lab.logs.trial import sidecar
from granite_lab.running.options import Options

if TYPE_CHECKING:
    from granite_lab.model.effect import Effect

VARIABLE = "GRANITE_LAB_CACHE"
"""Environment variable with the folder of the cache."""

LARGEST = 5_000_000_000
"""Size [bytes] above which the results that were not used for longest are removed; a trial takes 2 MB."""

STALE = 3600.0
"""Age [s] after which a file that was never finished is removed."""

ALIGNED, CHUNK = 64, 16_000_000
"""Bytes to which the parts of a record are aligned (and length of the hash); size of a file of an `Arena`."""

PACKAGE = Path(granite_lab.__file__).parent
LIBRARIES = ("casadi", "filterpy", "numpy", "pandas", "scipy")
DRAWING = ("jinja2", "matplotlib", "rerun-sdk")

SHOWS = ("api", "cli.py", "commands", "hidden", "reporting", "two_studies.py")
"""Parts of the package that no cached result depends on: they only call and show."""

PLAIN = {
    "pathlib": ("Path", "PosixPath", "WindowsPath"),
    "numpy": ("dtype", "ndarray"),
    "numpy._core.numeric": ("_frombuffer",),
    "numpy._core.multiarray": ("scalar",),
}
"""What bytes may name besides records of this package: module to its names."""

NAMED = (type, FunctionType, BuiltinFunctionType, Path, np.ndarray, np.generic, np.dtype)
"""Kinds of what a record may hold besides plain values and records, or what pickle names for it."""

Buffer = bytearray | memoryview


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
        except FileNotFoundError:
            return None
        except Exception:  # whatever a damaged or foreign file leads to, the result is made again
            with suppress(OSError):
                path.unlink()
            return None
        return record

    def put(self, key: str, data: bytes) -> None:
        """Remember what `encode` made of files with hashes that a record depends on, and the record."""
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
    """Return the key of the result of some work, by its name, on one trial."""
    files = [(str(p), fingerprint(p), fingerprint(sidecar(p))) for p in (path, *options.files())]
    mine = dataclasses.replace(options, tolerance=0.0, latency=0.0)  # of searches
    return digest_of(code(), what, files, content(mine))


def content(record: Any) -> str:
    """Return the hash of a record; fields that are not compared do not count."""
    digest = hashlib.sha256()
    writer = _Writer(SimpleNamespace(write=digest.update), 5)
    writer.fast = True  # equal values give equal bytes, be they one object or several
    writer.dump(record)
    return digest.hexdigest()


def digest_of(*parts: Any) -> str:
    """Return the hash of plain values."""
    return hashlib.sha256(json.dumps(parts, ensure_ascii=True).encode()).hexdigest()


def encode(record: Any) -> bytes:
    """Return a record of this package as bytes.

    Raises:
        TypeError: it holds more than frozen dataclasses, plain values and collections, and NumPy arrays.
    """
    buffers: list[pickle.PickleBuffer] = []
    file = io.BytesIO()
    _Writer(file, 5, buffer_callback=buffers.append).dump(record)
    parts = [file.getvalue(), *(buffer.raw() for buffer in buffers)]
    sizes = np.array([len(parts), *(len(part) for part in parts)], "<i8").tobytes()
    return sealed(b"".join(bytes(part) + bytes(-len(part) % ALIGNED) for part in (sizes, *parts)))


def sealed(body: bytes) -> bytes:
    """Return the body of a record with its hash before it."""
    return hashlib.blake2b(body).digest() + body


def decode(data: bytes | Buffer, effects: Mapping[str, Effect] | None = None) -> Any:
    """Return the record that `encode` took.

    Args:
        data: the bytes; those of an `Arena` hold the arrays of the record from then on.
        effects: by id, for records that hold effects which are switched on.

    Raises:
        ValueError, KeyError and others: the bytes are not whole or of another version.
    """
    whole = memoryview(bytearray(data) if isinstance(data, bytes) else data)
    body = whole[ALIGNED:]
    if hashlib.blake2b(body).digest() != whole[:ALIGNED]:
        raise ValueError("not whole, or no record of this package")
    count = int.from_bytes(body[:8], "little")
    sizes = np.frombuffer(body[8 : 8 * (1 + count)], "<i8").tolist()
    parts, place = [], 8 * (1 + count)
    for size in sizes:
        place += -place % ALIGNED
        parts.append(body[place : place + size])
        place += size
    return _Reader(parts[0], effects or {}, parts[1:]).load()


class Arena:
    """Room for records of many trials in files without a name, which the system maps into memory as needed.

    Args:
        folder: on whose disk they are; the system's folder for temporary files where that cannot be.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder if folder is not None and is_folder(folder) else None
        self._room = memoryview(b"")

    def hold(self, data: bytes) -> Buffer:
        """Return the same bytes in a file; in memory where it cannot be written."""
        size = len(data) + -len(data) % ALIGNED
        if size > len(self._room):
            try:
                with tempfile.TemporaryFile(dir=self._folder) as file:
                    file.write(bytes(max(size, CHUNK)))  # so that a full disk is known before it is mapped
                    file.flush()
                    self._room = memoryview(mmap.mmap(file.fileno(), 0))
            except OSError:
                return bytearray(data)
        held, self._room = self._room[: len(data)], self._room[size:]
        held[:] = data
        return held


def _is_effect(value: Any) -> bool:
    """Say whether a value is an effect, without importing the model: no effect is there before that is."""
    module = sys.modules.get("granite_lab.model.effect")
    return module is not None and isinstance(value, module.Effect)


def _is_record(found: Any) -> bool:
    own = isinstance(found, type) and found.__module__.startswith("granite_lab.")
    return own and dataclasses.is_dataclass(found)


class _Writer(pickle.Pickler):
    def persistent_id(self, obj: Any) -> str | None:
        """Return the id of an effect, which comes from the library or a user's file, not from bytes."""
        return obj.id if _is_effect(obj) else None

    def reducer_override(self, obj: Any) -> Any:
        if isinstance(obj, np.ndarray) and self.fast:
            return np.ndarray, (obj.shape, obj.dtype.str, obj.tobytes())
        if isinstance(obj, np.ndarray) and not obj.flags.forc:
            return np.ascontiguousarray(obj).__reduce_ex__(5)
        if not isinstance(obj, NAMED) and not _is_record(type(obj)):
            raise TypeError(f"a {type(obj).__name__} cannot be stored")
        if self.fast and dataclasses.is_dataclass(obj) and not isinstance(obj, type):
            return type(obj), tuple(getattr(obj, f.name) for f in dataclasses.fields(obj) if f.compare)
        return NotImplemented


class _Reader(pickle.Unpickler):
    def __init__(self, data: memoryview, effects: Mapping[str, Effect], arrays: list[memoryview]) -> None:
        super().__init__(io.BytesIO(data), buffers=arrays)
        self._effects = effects

    def persistent_load(self, name: str) -> Effect:
        return self._effects[name]

    def find_class(self, module: str, name: str) -> Any:
        if name in PLAIN.get(module, ()):
            return super().find_class(module, name)
        found = super().find_class(module, name) if module.startswith("granite_lab.") else None
        if not _is_record(found):
            raise ValueError(f"{module}.{name} is no record of this package")
        return found
