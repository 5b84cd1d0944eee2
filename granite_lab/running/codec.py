"""Records as bytes and back: a restricted pickle, the arrays behind it, and a hash of all.

What is read names only records of this package and arrays, so that a foreign file cannot run code. Arrays are
not copied when they are read, so that a record may lie in a file that is mapped into memory (`Arena`).
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
import mmap
import pickle
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import BuiltinFunctionType, FunctionType
from typing import TYPE_CHECKING, Any

import numpy as np

from granite_lab.files import is_folder

if TYPE_CHECKING:
    from granite_lab.model.effect import Effect

ALIGNED = 64
"""Bytes to which the parts are aligned, and length of the hash."""

CHUNK = 16_000_000
"""Size of a file of an `Arena` [bytes]; a trial takes 2 MB."""

PLAIN = {
    "pathlib": ("Path", "PosixPath", "WindowsPath"),
    "numpy": ("dtype", "ndarray"),
    "numpy._core.numeric": ("_frombuffer",),
    "numpy._core.multiarray": ("scalar",),
}
"""What may be named besides records of this package: module to its names."""

NAMED = (type, FunctionType, BuiltinFunctionType, Path, np.ndarray, np.generic, np.dtype)
"""Kinds of what a record may hold besides plain values and records, or what pickle names for it."""

Buffer = bytearray | memoryview


def encode(record: Any) -> bytes:
    """Return a record of this package as bytes.

    Args:
        record: frozen dataclasses, tuples, lists, dictionaries, texts, numbers and NumPy arrays.

    Raises:
        TypeError: something else is in it.
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


def is_effect(value: Any) -> bool:
    """Say whether a value is an effect, without importing the model: no effect is there before that is."""
    module = sys.modules.get("granite_lab.model.effect")
    return module is not None and isinstance(value, module.Effect)


class _Writer(pickle.Pickler):
    def persistent_id(self, obj: Any) -> str | None:
        """Return the id of an effect, which comes from the library or a user's file, not from bytes."""
        return obj.id if is_effect(obj) else None

    def reducer_override(self, obj: Any) -> Any:
        if isinstance(obj, np.ndarray) and not obj.flags.forc:
            return np.ascontiguousarray(obj).__reduce_ex__(5)
        if not isinstance(obj, NAMED) and not _is_record(type(obj)):
            raise TypeError(f"a {type(obj).__name__} cannot be stored")
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


def _is_record(found: Any) -> bool:
    own = isinstance(found, type) and found.__module__.startswith("granite_lab.")
    return own and dataclasses.is_dataclass(found)
