"""One type of table: its columns stand in ``words.toml``, its cells are printed, or written as plain CSV.

What comes from a log is printed on a terminal as it is, never read as markup.
"""

from __future__ import annotations

import csv
import io
import math
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from granite_lab.csv_rows import cell_text
from granite_lab.estimate import Estimate
from granite_lab.reporting.rounding import (
    NONE,
    chance,
    kept,
    percent,
    plus_minus,
    significant,
    tidy_unit,
    with_unit,
)
from granite_lab.reporting.words import WORDS

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table as Grid
    from rich.text import Text

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


@dataclass(frozen=True)
class Table:
    """A table of the report; one without rows is left out there.

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
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        data = ["virtual"] if self.virtual else []
        writer.writerow([key for column in self.columns for key in column.keys] + ["data"] * len(data))
        for row in self.rows:
            writer.writerow([_plain(value) for cell in row for value in cell.raw] + data)
        return out.getvalue()


Cells = Mapping[str, Callable[[Any], "Cell | str | int"]]
"""What makes the cells of a column, its text, or its whole number, of an item or of an attribute."""


def tabulate(
    name: str,
    items: Iterable[Any],
    cells: Cells | None = None,
    *,
    virtual: bool = False,
    skip: Sequence[str] = (),
    **parts: object,
) -> Table:
    """Return a table with a row for each item; title, caption and columns stand in ``words.toml``.

    Args:
        name: of the table; there it ends before "_of_".
        items: what the rows are about.
        cells: functions that make cells, by the names that columns give them.
        virtual: as in `Table`.
        skip: functions, or attributes, whose columns are left out.
        **parts: what fills the braces of words.
    """
    known, own = WORDS["tables"][name.partition("_of_")[0]], cells or {}
    columns, made = [], []
    for heading, keys, how in WORDS["tables"][known.get("as", name.partition("_of_")[0])]["columns"]:
        if how in skip:
            continue
        full = heading.format(**parts)
        match = re.fullmatch(r"(.*) \[(.*)\]", full)
        label, unit = match.groups() if match else (full, "")
        plain = re.sub(r"\W+", "_", full.lower()).strip("_")
        columns.append(Column(label, unit, tuple(keys.split()) or (plain,), bool(keys)))
        made.append(own.get(how) or partial(_by_attribute, how, own))
    rows = tuple(tuple(_cell(make(item)) for make in made) for item in items)
    title, caption = (str(known.get(part, "").format(**parts)) for part in ("title", "caption"))
    return Table(name.replace("_of_", "_"), title, caption, tuple(columns), rows, virtual)


def _cell(made: Cell | str | int) -> Cell:
    return made if isinstance(made, Cell) else Cell(str(made), (made,))


def _by_attribute(how: str, own: Cells, item: Any) -> Cell:
    """Return the cell "attribute:format" of an item; a number as attribute is a place, none the item."""
    path, _, form = how.partition(":")
    value = item
    for part in filter(None, path.split(".")):
        value = value[int(part)] if part.isdigit() else getattr(value, part)
    form, _, factor = form.partition("*")
    scale = float(factor or 1)
    if isinstance(value, Cell):
        return value
    if make := own.get(form) or FORMS.get(form):
        return _cell(make(value))
    if form == "±":
        return estimate(value, scale)
    if form.isdigit():
        return number(value, int(form), scale=scale)
    if value in (None, "") or (isinstance(value, float) and math.isnan(value)):
        return Cell(NONE, (value,))
    text = format(scale * value if factor else value, form)
    return Cell(text if isinstance(value, str) else text.replace("-", "−"), (value,))


def words(text: str, tone: str = "") -> Cell:
    """Return a cell that holds a text."""
    return Cell(text, (text,), tone)


def number(value: float, digits: int = 3, unit: str = "", scale: float = 1.0) -> Cell:
    """Return a cell that holds a number without uncertainty; the raw value stays in the record's unit."""
    text = with_unit(significant(value * scale, digits), unit) if math.isfinite(value) else NONE
    return Cell(text, (value,))


def probable(value: float) -> Cell:
    """Return a cell with a probability in percent."""
    return Cell(chance(value), (value,))


def share(value: float) -> Cell:
    """Return a cell with a share in percent."""
    return Cell(percent(value), (value,))


def estimate(value: Estimate, scale: float = 1.0) -> Cell:
    """Return a cell with value ± std; the raw values stay in the record's unit."""
    return Cell(plus_minus(value, scale=scale), (value.value, value.std))


FORMS: Cells = {
    "%": share,
    "good": lambda is_good: words("good", "good") if is_good else words("doubtful", "bad"),
    "spaced": lambda name: name.replace("_", " "),
    "unit": tidy_unit,
}
"""Formats that every table may use."""


def _plain(value: Raw) -> str:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.9g}"
    return cell_text(value) if isinstance(value, str) else str(value)


TONES = {"good": "green", "fair": "yellow", "bad": "red", "faint": "dim"}
"""Tone of a cell to its colour on a terminal."""

VIRTUAL = "virtual data: written by a simulator"
SHORT, WHOLE = 9, 27
"""Lengths up to which a heading stays on one line where there is room, and no word or number is broken."""

_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]+")


def clean(text: str, style: str = "") -> Text:
    """Return a text without control characters, so that no log can steer the terminal."""
    from rich.text import Text  # noqa: PLC0415, for terminals alone

    return Text(_CONTROL.sub(" ", text), style)


def say(console: Console, sentence: str | Text, style: str = "") -> None:
    """Print a sentence; no line ends between a number and its unit, or inside a path."""
    text = clean(sentence, style) if isinstance(sentence, str) else sentence
    plain, starts, place = kept(text.plain), [], 0
    for part in textwrap.wrap(plain, console.width, break_long_words=False, break_on_hyphens=False):
        place = plain.index(part, place)
        starts.append(place)
    for line in text.divide(starts[1:]):
        line.rstrip()
        console.print(line, soft_wrap=True)


def show_table(table: Table, console: Console, *, only: Sequence[str] = ()) -> None:
    """Print a table, or `only` the columns of some names; words may be wrapped, numbers are not."""
    from rich.measure import Measurement  # noqa: PLC0415, for terminals alone

    grid, anyhow = _grid(table, only, SHORT), console.options.update(width=1000)
    if Measurement.get(console, anyhow, grid).minimum > console.width:
        grid = _grid(table, only, 1)
    console.print(grid)
    if table.virtual:
        say(console, f"{VIRTUAL}.", "yellow")


def _grid(table: Table, only: Sequence[str], short: int) -> Grid:
    """Lay out a table; a heading longer than its column and than `short` is wrapped."""
    from rich import box  # noqa: PLC0415
    from rich import table as rich  # noqa: PLC0415
    from rich.text import Text  # noqa: PLC0415

    # padding at the right would cut the last column by its width
    grid = rich.Table(
        box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 0, 0, 1), show_edge=False, header_style="bold"
    )
    kept = [(k, c) for k, c in enumerate(table.columns) if not only or c.name in only]
    for k, column in kept:
        texts = [row[k].text for row in table.rows]
        longest = max(map(len, texts), default=0)
        head = [column.title.replace(" %", "\u00a0%")]
        if len(head[0]) > max(short, longest):
            width = max(short, longest, len(column.name) // 2)
            head = textwrap.wrap(column.name.replace(" %", "\u00a0%"), width, break_long_words=False)
            head += [f"[{column.unit}]"] * bool(column.unit)
        fixed = column.number and longest <= WHOLE
        words = [
            w for text in (*head, *texts) for w in ([text] if fixed else text.split()) if len(w) <= WHOLE
        ]
        grid.add_column(
            Text("\n".join(head)), justify="right" if column.number else "left", overflow="fold",
            no_wrap=fixed, min_width=max(map(len, words), default=0),
        )  # fmt: skip
    for row in table.rows:
        grid.add_row(*(clean(row[k].text, TONES.get(row[k].tone, "")) for k, _ in kept))
    return grid


def show_rows(
    name: str,
    items: Iterable[Any],
    console: Console,
    cells: Cells | None = None,
    *,
    skip: Sequence[str] = (),
    **parts: str,
) -> None:
    """Print a table that a terminal alone shows; arguments as in `tabulate`."""
    show_table(tabulate(name, items, cells, skip=skip, virtual=False, **parts), console)
