"""One table, written as HTML and Markdown (by the templates), CSV, LaTeX, or on a terminal."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from granite_lab.estimate import Estimate
from granite_lab.reporting.rounding import NONE, percent, plus_minus, significant, with_unit
from granite_lab.reporting.words import WORDS

Raw = float | int | bool | str | None


@dataclass(frozen=True)
class Column:
    """A column: what stands above it, and the names of the plain columns it becomes in a CSV.

    Attributes:
        name: above the column, without a unit.
        unit: of the printed cells; empty where the cells state theirs or have none.
        keys: names in the CSV, with the unit behind them; one per raw value of a cell.
        number: set flush right.
    """

    name: str
    unit: str
    keys: tuple[str, ...]
    number: bool = True

    @property
    def title(self) -> str:
        """What stands above the column: the name with the unit in brackets."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass(frozen=True)
class Cell:
    """What is printed, and the plain values behind it.

    Attributes:
        text: as printed.
        raw: as in the CSV, one per key of the column.
        tone: "", "good", "fair" or "bad"; the text says the same.
    """

    text: str
    raw: tuple[Raw, ...]
    tone: str = ""


T = TypeVar("T")
Spec = tuple[str, str, Callable[[T], Cell | str | int]]
"""A column of `tabulate`."""


@dataclass(frozen=True)
class Table:
    """A table of the report.

    Attributes:
        name: stem of its CSV.
        title: what it lists.
        caption: what to see in it.
        columns, rows: its content; the first cell of a row names the row.
        virtual: its data were written by a simulator; `heading` and a column of the CSV then say so.
    """

    name: str
    title: str
    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    virtual: bool = False

    @property
    def heading(self) -> str:
        """The title, with "(virtual data)" behind it where that is so."""
        return f"{self.title} (virtual data)" if self.virtual else self.title

    def to_csv(self) -> str:
        """Return the plain values as CSV, a column "data" last where they are virtual.

        A text that a spreadsheet would run gets a leading quote.
        """
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        data = ["virtual"] if self.virtual else []
        writer.writerow([key for column in self.columns for key in column.keys] + ["data"] * len(data))
        for row in self.rows:
            writer.writerow([_plain(value) for cell in row for value in cell.raw] + data)
        return out.getvalue()


def tabulate(
    name: str,
    items: Iterable[T],
    specs: Sequence[Spec[T] | None],
    *,
    virtual: bool = False,
    **parts: object,
) -> Table:
    """Return a table with a row for each item; title and caption stand in ``words.toml``.

    Args:
        name: of the table; there it ends before "_of_".
        items: what the rows are about.
        specs: of each column its heading with the unit in brackets; its names in the CSV, none for a column
            of words; and what makes the cell, its text, or its whole number, of an item. None is no column.
        virtual: as in `Table`.
        **parts: what fills the braces of title and caption.
    """
    kept = [spec for spec in specs if spec is not None]
    columns = []
    for heading, keys, _ in kept:
        match = re.fullmatch(r"(.*) \[(.*)\]", heading)
        label, unit = match.groups() if match else (heading, "")
        plain = re.sub(r"\W+", "_", heading.lower()).strip("_")
        columns.append(Column(label, unit, tuple(keys.split()) or (plain,), bool(keys)))
    rows = tuple(tuple(_cell(make(item)) for _, _, make in kept) for item in items)
    known = WORDS["tables"].get(name.partition("_of_")[0], {"title": "", "caption": ""})
    title, caption = (str(known[part].format(**parts)) for part in ("title", "caption"))
    return Table(name.replace("_of_", "_"), title, caption, tuple(columns), rows, virtual)


def _cell(made: Cell | str | int) -> Cell:
    return made if isinstance(made, Cell) else Cell(str(made), (made,))


def words(text: str, tone: str = "") -> Cell:
    """Return a cell that holds a text."""
    return Cell(text, (text,), tone)


def number(value: float, digits: int = 3, unit: str = "", scale: float = 1.0) -> Cell:
    """Return a cell that holds a number without uncertainty; the raw value stays in the record's unit."""
    text = with_unit(significant(value * scale, digits), unit) if math.isfinite(value) else NONE
    return Cell(text, (value,))


def share(value: float) -> Cell:
    """Return a cell with a share in percent."""
    return Cell(percent(value), (value,))


def estimate(value: Estimate, scale: float = 1.0) -> Cell:
    """Return a cell with value ± std; the raw values stay in the record's unit."""
    return Cell(plus_minus(value, scale=scale), (value.value, value.std))


def _plain(value: Raw) -> str:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.9g}"
    flat = re.sub(r"[\r\n\t\v\f\x00]+", " ", str(value))
    return f"'{flat}" if isinstance(value, str) and flat.lstrip().startswith(("=", "+", "-", "@")) else flat
