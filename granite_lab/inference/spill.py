"""Large arrays of fits and screens: the last used ones in memory, the others spilled to temporary files."""

from __future__ import annotations

import math
import mmap
import tempfile
import threading
import weakref
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import IO, Any, Generic, TypeVar

import numpy as np

from granite_lab.inference.constants import MEMORY
from granite_lab.logs.trial import Array

T = TypeVar("T")

ALIGNED = 64
"""Bytes to a multiple of which arrays begin in a file: the width of a line of the processor's cache."""


@dataclass(frozen=True)
class _Place:
    """Where an array stands in a file; `turned` if its columns come one after the other."""

    begin: int
    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    turned: bool


class Spillable(Generic[T]):
    """A record whose arrays need not stay in memory.

    Read back it is the same to the last bit, but its arrays cannot be written to. Where no file can be made
    it stays in memory. Another process is sent all of it. Files hold numbers only: none can run code.

    Args:
        value: records, tuples and dictionaries of arrays.
    """

    def __init__(self, value: T) -> None:
        self._value: T | None = value
        self._frame: Any = None  # the record with places for arrays, once these are in the file
        self._file: IO[bytes] | None = None
        self.size = sum(a.nbytes for a in _arrays(value))
        """Bytes of its arrays."""
        SPILL_CACHE.touch(self)

    @property
    def value(self) -> T:
        """The record."""
        value = self._value
        if value is None:
            value = self._value = self._read()
        SPILL_CACHE.touch(self)
        return value

    @property
    def in_memory(self) -> bool:
        """Whether the record is in memory."""
        return self._value is not None

    def spill(self) -> None:
        """Write the record to its file, and give its memory free."""
        if self._file is None:
            try:
                self._write()
            except OSError:
                return
        self._value = None

    def _write(self) -> None:
        file = tempfile.TemporaryFile(prefix="granite-lab-")  # noqa: SIM115, closed with this object
        weakref.finalize(self, file.close)
        places: dict[int, _Place] = {}
        for a in _arrays(self._value):
            turned = a.flags.f_contiguous and not a.flags.c_contiguous
            file.write(bytes(-file.tell() % ALIGNED))
            places[id(a)] = _Place(file.tell(), a.dtype, a.shape, turned)
            file.write(np.ascontiguousarray(a.T if turned else a).data)
        file.write(bytes(ALIGNED))  # a file that is mapped must not be empty
        file.flush()
        self._frame, self._file = _mapped(self._value, np.ndarray, lambda a: places[id(a)]), file

    def _read(self) -> T:
        assert self._file is not None
        whole = mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ)

        def read(place: _Place) -> Array:
            shape = place.shape[::-1] if place.turned else place.shape
            array = np.frombuffer(whole, place.dtype, math.prod(shape), place.begin).reshape(shape)
            return array.T if place.turned else array

        record: T = _mapped(self._frame, _Place, read)
        return record

    def __reduce__(self) -> tuple[Any, ...]:
        return Spillable, (self.value,)


def _mapped(value: Any, kind: type, change: Callable[[Any], Any]) -> Any:
    """Return a record whose parts of a kind are changed."""
    if isinstance(value, kind):
        return change(value)
    if isinstance(value, tuple):
        return tuple(_mapped(part, kind, change) for part in value)
    if isinstance(value, dict):
        return {key: _mapped(part, kind, change) for key, part in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        parts = {f.name: _mapped(getattr(value, f.name), kind, change) for f in fields(value) if f.init}
        return replace(value, **parts)
    return value


def _arrays(value: Any) -> list[Array]:
    """Return the arrays of a record, each once."""
    arrays: dict[int, Array] = {}
    _mapped(value, np.ndarray, lambda a: arrays.setdefault(id(a), a))
    return list(arrays.values())


class SpillCache:
    """Keeps of the records of a process those in memory that were asked for last.

    Args:
        most: bytes that they may take; the last one stays, however large.
    """

    def __init__(self, most: float) -> None:
        self.most = most
        self._recent: dict[int, weakref.ref[Spillable[Any]]] = {}
        self._lock = threading.RLock()  # what other processes send is read by a thread

    def touch(self, record: Spillable[Any]) -> None:
        """Note that a record was asked for, and spill those that were not asked for longest."""
        with self._lock:
            self._recent.pop(id(record), None)
            self._recent = {key: ref for key, ref in self._recent.items() if ref() is not None}
            self._recent[id(record)] = weakref.ref(record)
            loaded = [r for ref in self._recent.values() if (r := ref()) is not None and r.in_memory]
            total = sum(r.size for r in loaded)
            for oldest in loaded[:-1]:
                if total <= self.most:
                    break
                oldest.spill()
                total -= oldest.size


SPILL_CACHE = SpillCache(MEMORY / 2)
"""That of this process."""
