"""Several records of one kind, which become one table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar, overload

from granite_lab.origin import NOWHERE, Origin
from granite_lab.rounding import plural
from granite_lab.shown import Shown

if TYPE_CHECKING:
    import pandas as pd


class Tabular(Protocol):
    """A record that can become a table."""

    def to_frame(self) -> pd.DataFrame:
        """Return the record as a table."""
        ...


T = TypeVar("T", bound=Tabular)

SHOWN = 3
"""Records that are shown in a line each."""


class Records(Shown, Sequence[T], Generic[T]):
    """Records in the order of the logs; `to_frame()` puts their tables below each other.

    Args:
        items: the records.
        names: of their trials, where the tables do not name them.
        origin: where they come from.
    """

    def __init__(self, items: Sequence[T], names: Sequence[str] = (), origin: Origin = NOWHERE) -> None:
        self._items, self._names, self.origin = tuple(items), tuple(names), origin

    @property
    def left_out(self) -> tuple[tuple[str, str], ...]:
        """(trial, reason) of trials that are excluded or failed."""
        return tuple((failure.trial, failure.reason) for failure in self.origin.left_out)

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> Records[T]: ...
    def __getitem__(self, index: int | slice) -> T | Records[T]:
        """Return one record, or some of them."""
        if isinstance(index, slice):
            return Records(self._items[index], self._names[index], self.origin)
        return self._items[index]

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._items)

    def __repr__(self) -> str:
        lines = [plural(len(self), "record"), *(f"{item!r:.200}" for item in self._items[:SHOWN])]
        lines += [f"and {len(self) - SHOWN} more"] * (len(self) > SHOWN)
        return "\n  ".join([*lines, *(f"left out: {trial}: {reason}" for trial, reason in self.left_out)])

    def to_frame(self) -> pd.DataFrame:
        """Return one table of all records, units in the column names."""
        import pandas as pd  # noqa: PLC0415

        frames = [item.to_frame() for item in self._items]
        for name, frame in zip(self._names, frames, strict=False):
            frame.insert(0, "trial", name)
        return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()
