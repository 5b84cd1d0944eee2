"""Records of many trials in little memory: their arrays wait in a file until somebody looks at them."""

from __future__ import annotations

import dataclasses
import os
import tempfile
import threading
import weakref
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

R = TypeVar("R")

SMALL = 2000
"""Size [bytes] up to which the arrays of a field stay in memory."""


class Shelf:
    """A file without a name, of which nothing is left however the process ends.

    Args:
        folder: on whose disk it shall be; the system's folder for temporary files where that cannot be.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder
        self._file: _File | None = None

    def lay(self, record: R) -> R:
        """Return a record whose larger arrays wait in the file.

        It is an instance of the same class and is encoded as before; each look at one of its fields
        reads the arrays anew. Where the file cannot be written, the record stays in memory.

        Args:
            record: a dataclass of this package, or a tuple or list of them.
        """
        try:
            return self._laid(record)  # type: ignore[no-any-return]
        except OSError:
            return record

    def _laid(self, value: Any) -> Any:
        if type(value) in (tuple, list) and any(dataclasses.is_dataclass(v) for v in value):
            return type(value)([self._laid(v) for v in value])
        if not dataclasses.is_dataclass(value) or isinstance(value, type):
            return value
        before = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
        apart = tuple(name for name, held in before.items() if _size(held) > SMALL)
        after = {
            name: self._write(held) if name in apart else self._laid(held) for name, held in before.items()
        }
        if all(after[name] is held for name, held in before.items()):
            return value
        new: Any = object.__new__(_reading(type(value), apart))
        vars(new).update(after)
        return new

    def _write(self, held: Any) -> _Array | _Arrays:
        """Write arrays; return where they are, in the same dictionary or sequence."""
        if isinstance(held, np.ndarray):
            if self._file is None:
                self._file = _File(self._folder)
            return _Array(self._file, self._file.append(held.tobytes()), held.dtype, held.shape)
        if isinstance(held, Mapping):
            return _Arrays({name: self._write(array) for name, array in held.items()})
        return _Arrays(type(held)([self._write(array) for array in held]))


def _size(held: Any) -> int:
    """Return the size of an array, or of several in a dictionary or sequence; 0 for anything else."""
    if isinstance(held, np.ndarray):
        return 0 if held.dtype.hasobject else held.nbytes
    if type(held) not in (dict, tuple, list):
        return 0
    inside = list(held.values()) if isinstance(held, dict) else held
    known = all(isinstance(array, np.ndarray) and not array.dtype.hasobject for array in inside)
    return sum(array.nbytes for array in inside) if known else 0


class _File:
    """Bytes that are appended and read; any thread, and a forked process, may read."""

    def __init__(self, folder: Path | None) -> None:
        self._lock = threading.Lock()
        self._end = 0
        with _nameless(folder) as file:
            self._descriptor = os.dup(file.fileno())
        # when the last record is gone; not __del__, which may come after the modules are gone
        weakref.finalize(self, os.close, self._descriptor)

    def append(self, data: bytes) -> int:
        """Return the place at which the bytes stand."""
        with self._lock:
            place, rest = self._end, memoryview(data)
            os.lseek(self._descriptor, place, os.SEEK_SET)
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
            self._end += len(data)
            return place

    def read(self, place: int, size: int) -> bytearray:
        """Return bytes that were appended."""
        if hasattr(os, "pread"):
            data = bytearray(os.pread(self._descriptor, size, place))
        else:
            with self._lock:
                os.lseek(self._descriptor, place, os.SEEK_SET)
                data = bytearray(os.read(self._descriptor, size))
        if len(data) < size:
            raise OSError("a temporary file was cut")
        return data


def _nameless(folder: Path | None) -> Any:
    if folder is not None:
        with suppress(OSError):
            return tempfile.TemporaryFile(dir=folder)
    return tempfile.TemporaryFile()


@dataclass(frozen=True, eq=False)
class _Array:
    """Where an array stands."""

    file: _File
    place: int
    dtype: np.dtype[Any]
    shape: tuple[int, ...]

    def read(self) -> npt.NDArray[Any]:
        size = int(np.prod(self.shape)) * self.dtype.itemsize
        data = self.file.read(self.place, size) if size else bytearray()
        return np.frombuffer(data, self.dtype).reshape(self.shape)


@dataclass(frozen=True, eq=False)
class _Arrays:
    """Where the arrays of a dictionary or sequence stand."""

    inside: Any

    def read(self) -> Any:
        if isinstance(self.inside, dict):
            return {name: array.read() for name, array in self.inside.items()}
        return type(self.inside)([array.read() for array in self.inside])


class _Field:
    """A field of a record that may wait in a file."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __get__(self, record: Any, owner: type) -> Any:
        if record is None:
            raise AttributeError(self._name)
        held = vars(record)[self._name]
        return held.read() if isinstance(held, (_Array, _Arrays)) else held

    def __set__(self, record: Any, value: Any) -> None:
        vars(record)[self._name] = value


@lru_cache
def _reading(cls: type, names: tuple[str, ...]) -> type:
    """Return the class with fields that are read from a file; it goes by the same name."""
    if not names:
        return cls
    own = {"__module__": cls.__module__, "__qualname__": cls.__qualname__, "__doc__": cls.__doc__}
    return type(cls.__name__, (cls,), own | {"__reduce__": _whole} | {name: _Field(name) for name in names})


def _whole(record: Any) -> tuple[Any, tuple[()]]:
    """Say how another process or a copy gets the record: whole, of the plain class."""
    plain = type(record).__mro__[1]
    return partial(plain, **{f.name: getattr(record, f.name) for f in dataclasses.fields(plain)}), ()
