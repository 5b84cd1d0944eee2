"""Records as bytes and back, and their hashes.

The bytes are a pickle and, behind it, the arrays of the record, which are not copied when they are read: a
record may lie in a file that is mapped into memory (`Arena`). A pickle can run code. `decode` takes only what
this run made, or what `Store.read` gives, which only the user can have written.
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import mmap
import pickle
import struct
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from granite_lab.files import is_folder

if TYPE_CHECKING:
    from granite_lab.model.effect import Effect

ALIGNED, CHUNK = 64, 16_000_000
"""Bytes to which the parts of a record are aligned; size of a file of an `Arena`."""

Buffer = bytearray | memoryview


class _Pickler(pickle.Pickler):
    """Writes an effect by its id, and a path as text.

    An effect of a user's file can be imported nowhere else, and Python has moved its classes of paths.
    """

    def persistent_id(self, obj: Any) -> tuple[str, str] | None:
        if isinstance(obj, Path):
            return "path", str(obj)
        return ("effect", obj.id) if _is_effect(obj) else None


class _Unpickler(pickle.Unpickler):
    """Reads what `_Pickler` wrote, with the effects that it names."""

    def __init__(self, data: memoryview, arrays: list[memoryview], effects: Mapping[str, Effect]) -> None:
        super().__init__(io.BytesIO(data), buffers=arrays)
        self._effects = effects

    def persistent_load(self, pid: tuple[str, str]) -> Effect | Path:
        kind, name = pid
        return Path(name) if kind == "path" else self._effects[name]


def encode(record: Any) -> bytes:
    """Return a record as bytes; an object that occurs again in it is written once."""
    stream, arrays = io.BytesIO(), list[pickle.PickleBuffer]()
    _Pickler(stream, protocol=5, buffer_callback=arrays.append).dump(record)
    parts = [stream.getvalue(), *(array.raw().tobytes() for array in arrays)]
    head = struct.pack(f"<{len(parts) + 1}Q", len(parts), *map(len, parts))
    return b"".join(part + bytes(-len(part) % ALIGNED) for part in (head, *parts))


def decode(data: bytes | Buffer, effects: Mapping[str, Effect] | None = None) -> Any:
    """Return the record that `encode` took.

    Args:
        data: the bytes; those of an `Arena` hold the arrays of the record from then on.
        effects: by id, for records that hold effects which are switched on.

    Raises:
        KeyError: an effect is none of these.
    """
    whole = memoryview(bytearray(data) if isinstance(data, bytes) else data)
    (count,) = struct.unpack_from("<Q", whole)
    sizes = struct.unpack_from(f"<{count}Q", whole, 8)
    place, parts = 8 * (count + 1), list[memoryview]()
    for size in sizes:
        place += -place % ALIGNED
        parts.append(whole[place : place + size])
        place += size
    return _Unpickler(parts[0], parts[1:], effects or {}).load()


def content(record: Any) -> str:
    """Return the hash of a record of this package; fields that are not compared do not count."""
    return hashlib.sha256(json.dumps(_plain(record)).encode()).hexdigest()


def _plain(value: Any) -> Any:
    """Return lists of plain values, the same for equal records.

    Raises:
        TypeError: the value holds more than dataclasses, plain values, lists, tuples, dictionaries, paths,
            effects and NumPy arrays.
    """
    kind = type(value)
    if value is None or kind in (bool, int, float, str):
        return value
    if kind in (tuple, list):
        return [kind.__name__, *map(_plain, value)]
    if kind is dict:
        return ["dict", *(_plain(part) for item in value.items() for part in item)]
    if isinstance(value, Path):
        return ["path", str(value)]
    if isinstance(value, (np.ndarray, np.generic)):
        return ["array", value.dtype.str, hashlib.sha256(value.tobytes()).hexdigest(), *value.shape]
    if _is_effect(value):
        return ["effect", value.id]
    if not dataclasses.is_dataclass(value):
        raise TypeError(f"a {kind.__name__} has no hash that tells it from others")
    compared = (_plain(getattr(value, field.name)) for field in dataclasses.fields(value) if field.compare)
    return ["record", f"{kind.__module__}.{kind.__qualname__}", *compared]


def _is_effect(value: Any) -> bool:
    """Say whether a value is an effect; before the model is imported, which is slow, none exists."""
    module = sys.modules.get("granite_lab.model.effect")
    return module is not None and isinstance(value, module.Effect)


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
