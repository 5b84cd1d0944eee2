"""Rows of a table as CSV: as pandas writes them, without its cost per cell.

An hour of log has twenty million numbers; formatted one by one by pandas they take as long as the
estimate itself.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

DIGITS = "%.9g"
"""How a number is written."""

STAMPS, STAMP_DIGITS = ("t", "t_s"), "%.16g"
"""Columns of stamps; those beyond 1000 s, as seconds since 1970, are written to the microsecond."""

BLOCK = 20_000
"""Rows that are formatted at a time."""


def cell_text(text: str) -> str:
    """Return a text as the cell of a CSV table: on one line, and quoted where a spreadsheet would run it."""
    flat = re.sub(r"[\r\n\t\v\f\x00]+", " ", text)
    return f"'{flat}" if flat.lstrip().startswith(("=", "+", "-", "@")) else flat


def csv_blocks(table: pd.DataFrame) -> Iterator[str]:
    r"""Yield the text of ``table.to_csv(index=False, float_format=DIGITS)`` in parts, safe in a spreadsheet.

    Args:
        table: of floating-point numbers and anything else; NaN becomes an empty cell, a text what
            `cell_text` makes of it.

    Yields:
        whole lines ending in ``\n``, the header first.
    """
    yield _lines([[cell_text(str(name))] for name in table.columns])
    for begin in range(0, len(table), BLOCK):
        block = table.iloc[begin : begin + BLOCK]
        yield _lines([_cells(block.iloc[:, place]) for place in range(block.shape[1])])


def _lines(columns: Sequence[Sequence[str]]) -> str:
    """Return the lines of columns of cells, those in quotes that need them."""
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(zip(*columns, strict=True) if columns else [()])
    return out.getvalue()


def _cells(column: pd.Series) -> list[str]:
    """Return the cells of a column, numbers formatted, empty where nothing is known."""
    values = column.tolist()
    if column.dtype.kind == "f":
        late = column.name in STAMPS and bool((column.abs() >= 1000).any())
        form = STAMP_DIGITS if late else DIGITS
        return ["" if math.isnan(value) else form % value for value in values]
    missing = column.isna().tolist()
    texts = (cell_text(value) if isinstance(value, str) else str(value) for value in values)
    return ["" if nothing else text for text, nothing in zip(texts, missing, strict=True)]
