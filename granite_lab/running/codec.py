"""Records of this package as bytes: a JSON document that names them, then their arrays.

The bytes name classes of this package and types of numbers, nothing else, so that a foreign file cannot run
code, and another Python or NumPy reads what one has written. The arrays are not copied when they are read: a
record may lie in a file that is mapped into memory (`Arena`).

In the document a plain value stands for itself; anything else is a list that begins with its kind::

    ["list", values]  ["tuple", values]  ["dict", keys and values]  ["path", text]  ["effect", id]
    ["record", number of the class, values of the fields]  ["array", type, order, place, shape]
    ["scalar", type, value]  ["again", number of an earlier record or array]
"""

from __future__ import annotations

import dataclasses
import hashlib
import importlib
import json
import math
import mmap
import re
import struct
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import numpy.typing as npt

from granite_lab.files import is_folder

if TYPE_CHECKING:
    from granite_lab.model.effect import Effect

HEAD, MAGIC = struct.Struct("<16s32sQ8x"), b"granite-lab rec2"
"""What stands before all: `MAGIC`, the hash of what follows, length of the document [bytes]."""

ALIGNED, CHUNK = HEAD.size, 16_000_000
"""Bytes to which the parts of a record are aligned; size of a file of an `Arena`."""

NUMBERS, SCALARS = "biufcU", "biufU"
"""Kinds of NumPy types whose values are their bytes; those whose single values JSON can hold."""

Buffer = bytearray | memoryview
Node = Any
"""A part of the document."""

_PLAIN = frozenset((type(None), bool, int, float, str))
_CLASS = re.compile(r"(granite_lab(?:\.[a-z]\w*)+)\.([A-Z_]\w*)", re.ASCII)


def encode(record: Any) -> bytes:
    """Return a record of this package as bytes.

    Raises:
        TypeError: it holds more than dataclasses of this package, plain values, lists, tuples,
            dictionaries, paths, effects and NumPy arrays.
    """
    writer = _Writer()
    node = writer.node(record)
    classes = [(_name(kind), _fields(kind)) for kind in writer.classes]
    document = json.dumps([classes, node], separators=(",", ":")).encode()
    body = b"".join(
        part for data in (document, *writer.arrays) for part in (data, bytes(-len(data) % ALIGNED))
    )
    return b"".join((HEAD.pack(MAGIC, _hash(len(document), body), len(document)), body))


def decode(data: bytes | Buffer, effects: Mapping[str, Effect] | None = None) -> Any:
    """Return the record that `encode` took.

    Args:
        data: the bytes; those of an `Arena` hold the arrays of the record from then on.
        effects: by id, for records that hold effects which are switched on.

    Raises:
        ValueError, KeyError and others: the bytes are not whole or of another version.
    """
    whole = memoryview(bytearray(data) if isinstance(data, bytes) else data)
    magic, digest, length = HEAD.unpack_from(whole) if len(whole) >= HEAD.size else (b"", b"", 0)
    body = whole[HEAD.size :]
    if magic != MAGIC or digest != _hash(length, body):
        raise ValueError("not whole, or no record of this package")
    classes, node = json.loads(bytes(body[:length]))
    kinds = [_class(name, tuple(fields)) for name, fields in classes]
    return _value(node, _makers(kinds, body[length + -length % ALIGNED :], effects or {}))


def content(record: Any) -> str:
    """Return the hash of a record; fields that are not compared do not count."""
    return hashlib.sha256(json.dumps(_Hasher().node(record)).encode()).hexdigest()


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


def _hash(length: int, body: bytes | memoryview) -> bytes:
    digest = hashlib.blake2b(length.to_bytes(8, "little"), digest_size=32)
    digest.update(body)
    return digest.digest()


def _is_effect(value: Any) -> bool:
    """Say whether a value is an effect, without importing the model: no effect is there before that is."""
    module = sys.modules.get("granite_lab.model.effect")
    return module is not None and isinstance(value, module.Effect)


def _is_record(kind: Any) -> bool:
    ours = isinstance(kind, type) and _CLASS.fullmatch(_name(kind)) is not None
    return ours and dataclasses.is_dataclass(kind) and not hasattr(kind, "__slots__")


def _name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"


@cache
def _fields(kind: Any) -> tuple[str, ...]:
    return tuple(field.name for field in dataclasses.fields(kind))


@cache
def _class(name: str, fields: tuple[str, ...]) -> type:
    """Return a class of records.

    Raises:
        ValueError: the name is not that of one, or its fields are others.
    """
    match = _CLASS.fullmatch(name)
    kind: Any = getattr(importlib.import_module(match[1]), match[2], None) if match else None
    if not _is_record(kind) or _name(kind) != name or _fields(kind) != fields:
        raise ValueError(f"{name} is no record of this package, or one with other fields")
    return cast(type, kind)


def _type(name: str) -> np.dtype[Any]:
    """Return a type of numbers or texts.

    Raises:
        ValueError: the name is that of another type, such as objects.
    """
    kind = np.dtype(name)
    if kind.kind not in NUMBERS:
        raise ValueError(f"{name} is no type of numbers")
    return kind


class _Writer:
    """Makes the document; an object that occurs again is written once."""

    def __init__(self) -> None:
        self.classes: dict[type, int] = {}
        self.arrays: list[bytes] = []
        self._size = 0  # of the arrays so far [bytes]
        self._numbers: dict[int, int] = {}  # of the records and arrays so far, by id

    def node(self, value: Any) -> Node:
        """Return the part of the document that stands for a value.

        Raises:
            TypeError: it is of no kind that can be stored.
        """
        kind = type(value)
        if kind in _PLAIN:
            return value
        if kind is tuple or kind is list:
            return [kind.__name__, *[v if type(v) in _PLAIN else self.node(v) for v in value]]
        if kind is dict:
            return ["dict", *[self.node(part) for item in value.items() for part in item]]
        if isinstance(value, Path):
            return ["path", str(value)]
        if isinstance(value, np.generic) and value.dtype.kind in SCALARS:
            return ["scalar", value.dtype.str, value.item()]
        if _is_effect(value):
            return ["effect", value.id]
        if (number := self._numbers.get(id(value))) is not None:
            return ["again", number]
        if kind is np.ndarray and value.dtype.kind in NUMBERS:
            node = self.array(value)
        elif _is_record(kind):
            node = self.record(value, kind)
        else:
            raise TypeError(f"a {kind.__name__} cannot be stored")
        self._numbers[id(value)] = len(self._numbers)
        return node

    def record(self, value: Any, kind: type) -> Node:
        held = vars(value)
        nodes = [self.node(held[name]) for name in _fields(kind)]
        return ["record", self.classes.setdefault(kind, len(self.classes)), *nodes]

    def array(self, value: npt.NDArray[Any]) -> Node:
        order, place = "F" if value.flags.fnc else "C", self._size
        data = value.tobytes("A")
        self.arrays.append(data)
        self._size += len(data) + -len(data) % ALIGNED
        return ["array", value.dtype.str, order, place, *value.shape]


class _Hasher(_Writer):
    """Makes a document that is the same for equal records, be their parts one object or several."""

    def node(self, value: Any) -> Node:
        self._numbers.clear()
        return super().node(value)

    def record(self, value: Any, kind: type) -> Node:
        compared = (field.name for field in dataclasses.fields(kind) if field.compare)
        return ["record", _name(kind), *[self.node(getattr(value, name)) for name in compared]]

    def array(self, value: npt.NDArray[Any]) -> Node:
        return ["array", value.dtype.str, hashlib.sha256(value.tobytes()).hexdigest(), *value.shape]


def _value(node: Node, kinds: Mapping[str, Callable[..., Any]]) -> Any:
    """Return what a part of the document stands for.

    Raises:
        ValueError, LookupError, TypeError: it stands for nothing.
    """
    if type(node) is not list:
        return node
    parts = [_value(part, kinds) if type(part) is list else part for part in node[1:]]
    return kinds[node[0]](*parts)


def _makers(
    classes: Sequence[type], arrays: memoryview, effects: Mapping[str, Effect]
) -> dict[str, Callable[..., Any]]:
    """Return what makes a value of each kind from its parts."""
    so_far: list[Any] = []

    def record(number: int, *values: Any) -> Any:
        kind = classes[number]
        made: Any = object.__new__(kind)
        vars(made).update(zip(_fields(kind), values, strict=True))
        so_far.append(made)
        return made

    def array(name: str, order: str, place: int, *shape: int) -> npt.NDArray[Any]:
        kind = _type(name)
        # NumPy takes negative numbers, and would read what lies before the buffer
        if min((place, *shape)) < 0 or place + math.prod(shape) * kind.itemsize > len(arrays):
            raise ValueError("an array reaches beyond its bytes")
        made = np.ndarray(shape, kind, arrays, place, order="F" if order == "F" else "C")
        so_far.append(made)
        return made

    return {
        "list": lambda *values: list(values),
        "tuple": lambda *values: values,
        "dict": lambda *parts: dict(zip(parts[::2], parts[1::2], strict=True)),
        "path": Path,
        "effect": effects.__getitem__,
        "scalar": lambda name, value: _type(name).type(value),
        "record": record,
        "array": array,
        "again": so_far.__getitem__,
    }
