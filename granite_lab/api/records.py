"""Several records of one kind, which become one table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar, overload

from granite_lab.errors import LabError

if TYPE_CHECKING:
    import pandas as pd


class Tabular(Protocol):
    """A record that can become a table."""

    def to_frame(self) -> pd.DataFrame:
        """Return the record as a table."""
        ...


T = TypeVar("T", bound=Tabular)
E = TypeVar("E")


class Records(Sequence[T], Generic[T]):
    """Records in the order of the trials; `to_frame` puts their tables below each other.

    Args:
        items: the records.
        label: returns what the first column of the table says of a record; None for no such column.
        column: name of that first column.
    """

    def __init__(
        self, items: Sequence[T], label: Callable[[T], str] | None = None, column: str = "trial"
    ) -> None:
        self._items = tuple(items)
        self._label = label
        self._column = column

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> Records[T]: ...
    def __getitem__(self, index: int | slice) -> T | Records[T]:
        """Return one record, or some of them."""
        if isinstance(index, slice):
            return Records(self._items[index], self._label, self._column)
        return self._items[index]

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._items)

    def __repr__(self) -> str:
        names = ", ".join(self._label(item) if self._label else type(item).__name__ for item in self._items)
        return f"<{len(self)} records: {names}>"

    def to_frame(self) -> pd.DataFrame:
        """Return one table of all records, units in the column names."""
        import pandas as pd  # noqa: PLC0415

        frames = []
        for item in self._items:
            frame = item.to_frame()
            if self._label is not None and self._column not in frame:
                frame.insert(0, self._column, self._label(item))
            frames.append(frame)
        return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()


def all_good(outcomes: Sequence[E | LabError]) -> list[E]:
    """Return the results if there is no error among them.

    Raises:
        LabError: the first one.
    """
    good: list[Any] = []
    for outcome in outcomes:
        if isinstance(outcome, LabError):
            raise outcome
        good.append(outcome)
    return good
