"""How records show themselves: as JSON, and in a notebook as a table."""

from __future__ import annotations

import dataclasses
import html
import math
from collections.abc import Mapping, Sequence
from functools import singledispatch
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd


class Shown:
    """A record with a short `repr` and a table, shown in a notebook as both or as `as_html` has it."""

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        return as_html(self)


@singledispatch
def as_html(record: Any) -> str:
    """Return line and table of a record, the table shortened; a later stage can register another form."""
    table = record.to_frame().to_html(index=False, max_rows=10, max_cols=12)
    return f"<p>{html.escape(repr(record))}</p>{table}"


def frame(rows: Sequence[Mapping[str, Any]], columns: list[str] | None = None) -> pd.DataFrame:
    """Return rows as a table.

    Args:
        rows: values by column.
        columns: of the table, in their order; those of the rows by default.
    """
    import pandas as pd  # noqa: PLC0415, heavy

    return pd.DataFrame(rows, columns=columns)


def picked(record: object, *names: str) -> dict[str, Any]:
    """Return some attributes of a record by their names."""
    return {name: getattr(record, name) for name in names}


def jsonable(value: Any) -> Any:
    """Return the value as JSON can hold it: NaN and infinity become null, records become objects."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: jsonable(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(k): jsonable(v) for k, v in value.items()}
    if isinstance(value, str) or value is None or isinstance(value, bool):
        return value
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Sequence):
        return [jsonable(v) for v in value]
    if hasattr(value, "tolist"):
        return jsonable(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
