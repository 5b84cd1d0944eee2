"""Several records of one kind, which become one table."""

from __future__ import annotations

import html
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar, overload

from granite_lab.errors import LabError
from granite_lab.logs.named import name_of
from granite_lab.shown import Shown

if TYPE_CHECKING:
    import pandas as pd


class Tabular(Protocol):
    """A record that can become a table."""

    def to_frame(self) -> pd.DataFrame:
        """Return the record as a table."""
        ...


T = TypeVar("T", bound=Tabular)
E = TypeVar("E")

SHOWN = 3
"""Records that are shown in a line each."""


class Records(Sequence[T], Shown, Generic[T]):
    """Records in the order of the trials; `to_frame` puts their tables below each other.

    Args:
        items: the records.
        label: returns what the first column of the table says of a record; None for no such column.
        left_out: trials that are excluded or could not be used, with the reason.
    """

    def __init__(
        self,
        items: Sequence[T],
        label: Callable[[T], str] | None = None,
        left_out: Sequence[tuple[str, str]] = (),
    ) -> None:
        self._items = tuple(items)
        self._label = label
        self.left_out = tuple(left_out)

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> Records[T]: ...
    def __getitem__(self, index: int | slice) -> T | Records[T]:
        """Return one record, or some of them."""
        if isinstance(index, slice):
            return Records(self._items[index], self._label, self.left_out)
        return self._items[index]

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._items)

    def __repr__(self) -> str:
        lines = [f"{len(self)} records", *(f"{item!r:.200}" for item in self._items[:SHOWN])]
        lines += [f"and {len(self) - SHOWN} more"] * (len(self) > SHOWN)
        return "\n  ".join([*lines, *(f"left out: {trial}: {reason}" for trial, reason in self.left_out)])

    def _repr_html_(self) -> str:
        """Return the table for a notebook, shortened."""
        said = (f"<p>left out: {html.escape(f'{trial}: {reason}')}</p>" for trial, reason in self.left_out)
        return str(self.to_frame().to_html(index=False, max_rows=20, max_cols=12)) + "".join(said)

    def to_frame(self) -> pd.DataFrame:
        """Return one table of all records, units in the column names."""
        import pandas as pd  # noqa: PLC0415

        frames = []
        for item in self._items:
            frame = item.to_frame()
            if self._label is not None and "trial" not in frame:
                frame.insert(0, "trial", self._label(item))
            frames.append(frame)
        return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()


def sifted(
    files: Sequence[Path], outcomes: Sequence[E | LabError], *, strict: bool
) -> tuple[list[E], list[tuple[str, str]]]:
    """Return the results, and the trials that failed with the reason.

    Raises:
        LabError: of the first trial that failed, if `strict` or if none went through.
    """
    results: list[Any] = [outcome for outcome in outcomes if not isinstance(outcome, LabError)]
    pairs = zip(files, outcomes, strict=True)
    failures = [(path, outcome) for path, outcome in pairs if isinstance(outcome, LabError)]
    if failures and (strict or not results):
        raise failures[0][1]
    return results, [(name_of(path), error.message) for path, error in failures]
