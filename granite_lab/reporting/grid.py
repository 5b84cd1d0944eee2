"""Tables on a terminal; what comes from a log is printed as it is, never read as markup."""

from __future__ import annotations

import re
from collections.abc import Sequence

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

TONES = {"good": "green", "fair": "yellow", "bad": "red"}
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]+")


def grid(*titles: str, words: Sequence[int] = ()) -> Table:
    """Return an empty table.

    Args:
        *titles: of the columns.
        words: places of columns that are flush left and may be wrapped; the others are flush right
            and stay on one line.
    """
    table = Table(
        box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), show_edge=False, header_style="bold"
    )
    for i, title in enumerate(titles):
        left = i in words
        table.add_column(Text(title), justify="left" if left else "right", overflow="fold", no_wrap=not left)
    return table


def row_of(*cells: str | Text) -> list[Text]:
    """Return cells that hold texts as they are."""
    return [cell if isinstance(cell, Text) else clean(cell) for cell in cells]


def clean(text: str, style: str = "") -> Text:
    """Return a text without control characters, so that no log can steer the terminal."""
    return Text(_CONTROL.sub(" ", text), style)


def say(console: Console, text: str, style: str = "") -> None:
    """Print a sentence."""
    console.print(clean(text, style))
