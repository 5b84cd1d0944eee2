"""Tables on a terminal; what comes from a log is printed as it is, never read as markup."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Literal

from rich import box
from rich.console import Console
from rich.table import Table as Grid
from rich.text import Text

if TYPE_CHECKING:
    from granite_lab.reporting.tables import Table

TONES = {"good": "green", "fair": "yellow", "bad": "red"}
VIRTUAL = "virtual data: written by a simulator"
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]+")


def grid(*titles: str, words: Sequence[int] = (), rows: Iterable[Sequence[str | Text]] = ()) -> Grid:
    """Return a table.

    Args:
        *titles: of the columns.
        words: places of columns that are flush left and may be wrapped; the others are flush right
            and stay on one line.
        rows: its cells, as they are.
    """
    table = Grid(
        box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), show_edge=False, header_style="bold"
    )
    for i, title in enumerate(titles):
        left = i in words
        least = max(map(len, title.split()), default=0)  # no heading is cut inside a word
        justify: Literal["left", "right"] = "left" if left else "right"
        table.add_column(Text(title), justify=justify, overflow="fold", no_wrap=not left, min_width=least)
    for row in rows:
        table.add_row(*(cell if isinstance(cell, Text) else clean(cell) for cell in row))
    return table


def clean(text: str, style: str = "") -> Text:
    """Return a text without control characters, so that no log can steer the terminal."""
    return Text(_CONTROL.sub(" ", text), style)


def say(console: Console, text: str, style: str = "") -> None:
    """Print a sentence."""
    console.print(clean(text, style))


def show_table(table: Table, console: Console, *, only: Sequence[str] = ()) -> None:
    """Print a table of the report.

    Args:
        table: the table.
        console: where to print.
        only: names of the columns to print, in the order of the table; all by default.
    """
    kept = [i for i, c in enumerate(table.columns) if not only or c.name in only]
    heads = []
    for name, unit in ((table.columns[i].name.replace(" %", "\u00a0%"), table.columns[i].unit) for i in kept):
        lines = textwrap.wrap(name, max(9, len(name) // 2), break_long_words=False)
        heads.append("\n".join([*lines, f"[{unit}]"] if unit else lines))
    words = [k for k, i in enumerate(kept) if not table.columns[i].number]
    rows = ([clean(row[i].text, TONES.get(row[i].tone, "")) for i in kept] for row in table.rows)
    console.print(grid(*heads, words=words, rows=rows))
    if table.virtual:
        say(console, f"{VIRTUAL}.", "yellow")
