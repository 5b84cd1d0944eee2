"""Tables and sentences on a terminal.

Text from a log is printed literally; markup in it has no effect.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

from granite_lab.columns import FilledTable
from granite_lab.rounding import unbroken

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table as Grid
    from rich.text import Text

TONES = {"good": "green", "fair": "yellow", "bad": "red", "faint": "dim"}
"""Tone of a cell to its colour on a terminal."""

VIRTUAL = "virtual data: written by a simulator"
SHORT, WHOLE, NARROW = 9, 27, 18
"""Longest heading on one line where there is room; longest word or number that is not broken; longest number
that is not broken where there is no room, so that "0.104 (not converged)" takes two lines [characters]."""

_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]+")


def clean(text: str, style: str = "") -> Text:
    """Return a text without control characters, so that no log can steer the terminal."""
    from rich.text import Text  # noqa: PLC0415, for terminals alone

    return Text(_CONTROL.sub(" ", text), style)


def say(console: Console, sentence: str | Text, style: str = "") -> None:
    """Print a sentence; no line ends between a number and its unit, or inside a path."""
    text = clean(sentence, style) if isinstance(sentence, str) else sentence
    plain, starts, place = unbroken(text.plain), [], 0
    for part in textwrap.wrap(plain, console.width, break_long_words=False, break_on_hyphens=False):
        place = plain.index(part, place)
        starts.append(place)
    for line in text.divide(starts[1:]):
        line.rstrip()
        console.print(line, soft_wrap=True)


def show_table(table: FilledTable, console: Console, *, only: Sequence[str] = ()) -> None:
    """Print a table, or `only` the columns of some names; words may be wrapped, short numbers are not."""
    from rich.measure import Measurement  # noqa: PLC0415, for terminals alone

    anyhow = console.options.update(width=1000)
    for short, whole in ((SHORT, WHOLE), (1, WHOLE), (1, NARROW)):
        grid = _grid(table, only, short, whole)
        if Measurement.get(console, anyhow, grid).minimum <= console.width:
            break
    console.print(grid)
    if table.virtual:
        say(console, f"{VIRTUAL}.", "yellow")


def _grid(table: FilledTable, only: Sequence[str], short: int, whole: int) -> Grid:
    """Lay out a table; a heading longer than its column and than `short` is wrapped, and so is a number
    longer than `whole`."""
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
        fixed = column.number and longest <= whole
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
