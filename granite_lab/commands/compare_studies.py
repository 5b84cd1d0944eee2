"""`granite-lab compare-studies`: what differs between two studies, with intervals."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from granite_lab.commands.common import JsonOption, console, print_json


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command("compare-studies")(compare_studies)


def compare_studies(
    first: Annotated[Path, typer.Argument(metavar="A", help="Folder written by `study`.")],
    second: Annotated[Path, typer.Argument(metavar="B", help="Another one.")],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write a page, a figure and a table into this folder.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Compare two studies, such as sand A and B, or before and after a change."""
    from granite_lab.reporting import write_compared
    from granite_lab.reporting.grid import say
    from granite_lab.reporting.terminal import show_table
    from granite_lab.reporting.two_studies import compare_studies as run
    from granite_lab.reporting.two_studies import compared_as_json, compared_table

    found = run(first, second)
    page = write_compared(found, out) if out is not None else None
    if as_json:
        print_json(compared_as_json(found) | {"page": page})
        return
    say(console(), f"A: {found.names[0]}; B: {found.names[1]}")
    show_table(
        compared_table(found), console(), only=("quantity", "unit", "B − A, 95 %", "seen from", "verdict")
    )
    say(console(), "B − A: 95 % interval. Seen from: this difference is seen with a probability of 80 %.")
    for note in found.notes:
        say(console(), note)
    if page is not None:
        console().print(f"page: {page}", soft_wrap=True)
