"""Records as bytes and back: a line of JSON, the arrays behind it, and a hash that says whether all is whole.

No pickle: what is read names only records of this package. Arrays are not copied when they are read, so that
a record may lie in a file that is mapped into memory (`Arena`).
"""

from __future__ import annotations

import dataclasses
import hashlib
import importlib
import json
import math
import mmap
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from granite_lab.model.effect import Active, Effect

ALIGNED = 64
"""Bytes to which text and arrays are aligned."""

DIGEST = 32
"""Bytes of the hash; the length of the text follows in the rest of the first `ALIGNED`."""

CHUNK = 16_000_000
"""Size of a file of an `Arena` [bytes]; a trial takes 2 MB."""

Buffer = bytearray | memoryview


def encode(record: Any) -> bytes:
    """Return a record of this package as bytes; equal records give equal bytes.

    Args:
        record: frozen dataclasses, tuples, lists, dictionaries, texts, numbers and NumPy arrays.

    Raises:
        TypeError: something else is in it.
    """
    arrays: list[Any] = []
    text = json.dumps(_flat(record, arrays), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return pack(text, arrays)


def decode(data: bytes | Buffer, effects: Mapping[str, Effect] | None = None) -> Any:
    """Return the record that `encode` took.

    Args:
        data: the bytes; those of an `Arena` hold the arrays of the record from then on.
        effects: by id, for records that hold effects which are switched on.

    Raises:
        ValueError, KeyError and others: the bytes are not whole or of another version.
    """
    text, arrays = unpack(data)
    return _built(json.loads(text), arrays, effects or {})


def pack(text: str, arrays: list[Any]) -> bytes:
    """Return a text with its arrays as bytes."""
    shapes = [[array.dtype.str, list(array.shape)] for array in arrays]
    head = json.dumps([text, shapes], separators=(",", ":")).encode("ascii")
    parts = [head, *(array.tobytes() for array in arrays)]
    body = b"".join(part + bytes(-len(part) % ALIGNED) for part in parts)
    start = len(head).to_bytes(ALIGNED - DIGEST, "little")
    return hashlib.blake2b(start + body, digest_size=DIGEST).digest() + start + body


def unpack(data: bytes | Buffer) -> tuple[str, list[Any]]:
    """Return text and arrays of `pack`.

    Raises:
        ValueError: the bytes are not whole.
    """
    whole = memoryview(bytearray(data) if isinstance(data, bytes) else data)
    if hashlib.blake2b(whole[DIGEST:], digest_size=DIGEST).digest() != whole[:DIGEST]:
        raise ValueError("not whole, or no record of this package")
    place = int.from_bytes(whole[DIGEST:ALIGNED], "little")
    text, shapes = json.loads(bytes(whole[ALIGNED : ALIGNED + place]))
    arrays, place = [], ALIGNED + place + -place % ALIGNED
    for kind, shape in shapes:
        dtype = np.dtype(kind)
        size = math.prod(shape) * dtype.itemsize
        arrays.append(np.frombuffer(whole[place : place + size], dtype).reshape(shape))
        place += size + -size % ALIGNED
    return text, arrays


class Arena:
    """Room for records of many trials in files without a name, which the system maps into memory as needed.

    Args:
        folder: on whose disk they are; the system's folder for temporary files where that cannot be.
    """

    def __init__(self, folder: Path | None = None) -> None:
        try:
            self._folder = folder if folder is not None and folder.is_dir() else None
        except PermissionError:  # of a folder above it
            self._folder = None
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


def _flat(value: Any, arrays: list[Any]) -> Any:  # noqa: PLR0911, one line a type
    if value is None or isinstance(value, (bool, str)):
        return value
    if isinstance(value, np.generic):
        return _flat(value.item(), arrays)
    if isinstance(value, int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else {"float": repr(value)}
    if isinstance(value, np.ndarray):
        if value.dtype.hasobject:
            raise TypeError("an array of objects cannot be stored")
        arrays.append(value)
        return {"array": len(arrays) - 1}
    if isinstance(value, (tuple, list)):
        return {type(value).__name__: [_flat(v, arrays) for v in value]}
    if isinstance(value, Mapping):
        return {"dict": [[_flat(k, arrays), _flat(v, arrays)] for k, v in value.items()]}
    if isinstance(value, Path):
        return {"path": str(value)}
    if isinstance(value, Active):
        return {"active": value.id, "values": list(value.values)}
    cls = type(value)
    if dataclasses.is_dataclass(cls) and cls.__module__.startswith("granite_lab."):
        fields = {f.name: _flat(getattr(value, f.name), arrays) for f in dataclasses.fields(cls)}
        return {"record": f"{cls.__module__}:{cls.__qualname__}", "fields": fields}
    raise TypeError(f"a {cls.__name__} cannot be stored")


def _built(tree: Any, arrays: list[Any], effects: Mapping[str, Effect]) -> Any:  # noqa: PLR0911
    if isinstance(tree, str):
        return sys.intern(tree)  # a phase stands at each sample: one text for all
    if not isinstance(tree, dict):
        return tree
    kind, held = next(iter(tree.items()))
    match kind:
        case "float":
            return float(held)
        case "array":
            return arrays[held]
        case "tuple":
            return tuple(_built(v, arrays, effects) for v in held)
        case "list":
            return [_built(v, arrays, effects) for v in held]
        case "dict":
            return {_built(k, arrays, effects): _built(v, arrays, effects) for k, v in held}
        case "path":
            return Path(held)
        case "active":
            return Active(effects[held], tuple(float(v) for v in tree["values"]))
    fields = {name: _built(v, arrays, effects) for name, v in tree["fields"].items()}
    return _class(held)(**fields)


def _class(name: str) -> Any:
    module, _, path = name.partition(":")
    if not module.startswith("granite_lab."):
        raise ValueError(f"{name} is no record of this package")
    found: Any = importlib.import_module(module)
    for part in path.split("."):
        found = getattr(found, part)
    if not dataclasses.is_dataclass(found):
        raise ValueError(f"{name} is no record")
    return found
