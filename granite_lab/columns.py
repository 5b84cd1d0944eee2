"""Tables of results: columns are declared beside the record that they show, and filled for all renderers.

A column names what stands above it and what it shows of a row. mypy knows the type of the row::

    TRIALS = Table[Motion](
        "trials", "Estimates",
        Column("trial", lambda m: m.trial),
        Column("distance", lambda m: m.distance, "distance_m distance_std_m", unit="m"),
        Column("slip λ_R", lambda m: m.slip_ratio, "slip_ratio slip_ratio_std", unit="%", scale=100),
        note="Value ± standard deviation.",
    )
    table = TRIALS.fill(motions, virtual=False)

`reporting.table` prints what `fill` returns on a terminal; `reporting.render` and `reporting.latex` write it
as HTML, Markdown and LaTeX; `FilledTable.to_csv` writes the plain values.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar, cast

from granite_lab.estimate import Estimate
from granite_lab.files import cell_text, csv_lines
from granite_lab.rounding import NONE, chance, percent, plus_minus, significant, with_unit

Raw = float | int | bool | str | None

R = TypeVar("R")
S = TypeVar("S")
"""The record that a row shows, and one that holds it."""


@dataclass(frozen=True)
class Cell:
    """What is printed, and the plain values behind it.

    Attributes:
        text: as printed.
        raw: as in the CSV, one per key of the column.
        tone: "", "good", "fair" or "bad"; the text has the same meaning.
    """

    text: str
    raw: tuple[Raw, ...]
    tone: str = ""


@dataclass(frozen=True)
class Heading:
    """What stands above a column, and the names of the plain columns that it becomes in a CSV.

    Attributes:
        name: without a unit.
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
        """The name with the unit in brackets."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass(frozen=True)
class Column(Generic[R]):
    """A column: what stands above it, and what it shows of a row.

    Attributes:
        name: above the column, without a unit.
        value: of a row: a text, a number, an `Estimate` (printed with its std), or a `Cell`. None and an
            empty text are printed as "–"; `words("")` is a blank cell.
        keys: names in the CSV, separated by spaces, one per raw value: a column of numbers. A column without
            keys is one of words, which the CSV calls as the heading does.
        unit: of what is printed.
        scale: from the unit of the record, in which the CSV stays, to the printed one.
        digits: significant digits of a number without std.
        form: format specification in place of `digits`, such as ".2f".
        widest: std [unit of the record] from which an estimate says nothing and is not printed.
        shown: whether the table has the column.
    """

    name: str
    value: Callable[[R], Cell | Estimate | float | str | None]
    keys: str = ""
    unit: str = ""
    scale: float = 1.0
    digits: int = 3
    form: str = ""
    widest: float = math.inf
    shown: bool = True

    @property
    def heading(self) -> Heading:
        """What stands above the column."""
        keys = self.keys.split() or [re.sub(r"\W+", "_", self.name.lower()).strip("_")]
        return Heading(self.name, self.unit, tuple(keys), bool(self.keys))

    def cell(self, row: R) -> Cell:
        """Return what the column shows of a row."""
        value = self.value(row)
        if isinstance(value, Cell):
            return value
        if isinstance(value, Estimate):
            text = NONE if value.std >= self.widest else plus_minus(value, scale=self.scale)
            return Cell(text, (value.value, value.std))
        if isinstance(value, str) or value is None:
            return Cell(value or NONE, (value,))
        if not math.isfinite(value):
            return Cell(NONE, (value,))
        if self.form:
            return Cell(format(self.scale * value, self.form).replace("-", "−"), (value,))
        if isinstance(value, int):
            return Cell(str(value), (value,))
        return number(value, self.digits, scale=self.scale)

    def of(self, part: Callable[[S], R]) -> Column[S]:
        """Return the column of a table whose rows hold the record that this one shows."""
        column: Any = self
        return cast("Column[S]", replace(column, value=lambda row: self.value(part(row))))


class Table(Generic[R]):
    """A table without its rows."""

    def __init__(self, name: str, title: str, *columns: Column[R], note: str = "") -> None:
        """Declare a table.

        Args:
            name: stem of its files.
            title: what it lists.
            *columns: from left to right; the first one names the row.
            note: what to see in it.
        """
        self.name, self.title, self.note = name, title, note
        self.columns = tuple(column for column in columns if column.shown)

    def fill(self, rows: Iterable[R], *, virtual: bool = False) -> FilledTable:
        """Return the table with its rows; `virtual` as in `FilledTable`."""
        cells = tuple(tuple(column.cell(row) for column in self.columns) for row in rows)
        headings = tuple(column.heading for column in self.columns)
        return FilledTable(self.name, self.title, headings, cells, self.note, virtual)


@dataclass(frozen=True)
class FilledTable:
    """A table as every renderer takes it; one without rows is left out of a report.

    Attributes:
        name: stem of its files.
        title: what it lists.
        columns, rows: its content; the first cell of a row names the row.
        note: what to see in it.
        virtual: its data were written by a simulator; `heading` and a column of the CSV then say so.
    """

    name: str
    title: str
    columns: tuple[Heading, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""
    virtual: bool = False

    def __bool__(self) -> bool:
        return bool(self.rows)

    @property
    def heading(self) -> str:
        """The title, with "(virtual data)" behind it where that is so."""
        return f"{self.title} (virtual data)" if self.virtual else self.title

    def to_csv(self) -> str:
        """Return the plain values as CSV, a column "data" last where they are virtual.

        A text that a spreadsheet would run gets a leading quote.
        """
        head = [key for column in self.columns for key in column.keys]
        rows = [[_plain(value) for cell in row for value in cell.raw] for row in self.rows]
        if self.virtual:
            head, rows = [*head, "data"], [[*row, "virtual"] for row in rows]
        return csv_lines([head, *rows])


def _plain(value: Raw) -> str:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.9g}"
    return cell_text(value) if isinstance(value, str) else str(value)


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


def probable(value: float) -> Cell:
    """Return a cell with a probability in percent."""
    return Cell(chance(value), (value,))


def good(is_good: bool) -> Cell:
    """Return a cell that says whether an estimate is good."""
    return words("good", "good") if is_good else words("doubtful", "bad")
