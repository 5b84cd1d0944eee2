"""Rows of a table as CSV: as pandas writes them, without its cost per cell.

An hour of log has twenty million numbers; formatted one by one by pandas they take as long as the
estimate itself.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
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
    yield _by_pandas(table.iloc[:0], header=True)
    runs = _runs(table)
    for begin in range(0, len(table), BLOCK):
        block = table.iloc[begin : begin + BLOCK]
        parts = [(block.iloc[:, places], floats) for floats, places in runs]
        cells = [_numbers(part) if floats else _texts(part) for part, floats in parts]
        if table.shape[1] > 1:  # pandas quotes the empty cell of a lone column
            yield "".join(f"{','.join(line)}\n" for line in zip(*cells, strict=True))
        else:
            yield _by_pandas(block)


def _runs(table: pd.DataFrame) -> list[tuple[bool, list[int]]]:
    """Places of neighbouring columns that all hold floating-point numbers, or all do not."""
    runs: list[tuple[bool, list[int]]] = []
    for place, kind in enumerate(table.dtypes):
        floats = str(kind) == "float64"
        if runs and runs[-1][0] == floats:
            runs[-1][1].append(place)
        else:
            runs.append((floats, [place]))
    return runs


def _numbers(part: pd.DataFrame) -> list[str]:
    """Lines of cells, formatted all at once."""
    values = part.to_numpy(dtype="float64")
    late = [
        name in STAMPS and (abs(column) >= 1000).any() for name, column in zip(part, values.T, strict=True)
    ]
    line = ",".join(STAMP_DIGITS if is_late else DIGITS for is_late in late) + "\n"
    text = line * len(values) % tuple(values.ravel().tolist())
    return text.replace("nan", "").split("\n")[:-1]


def _texts(part: pd.DataFrame) -> list[str]:
    """Lines of cells that may need quotes; only a lone column has quotes about its empty ones."""
    lines = _by_pandas(part).split("\n")[:-1]
    return ["" if line == '""' else line for line in lines] if part.shape[1] == 1 else lines


def _by_pandas(part: pd.DataFrame, *, header: bool = False) -> str:
    safe = part.map(lambda cell: cell_text(cell) if isinstance(cell, str) else cell)
    safe.columns = [cell_text(str(name)) for name in part.columns]
    return safe.to_csv(index=False, header=header, float_format=DIGITS, lineterminator="\n")
