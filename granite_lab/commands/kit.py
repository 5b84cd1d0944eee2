"""`granite-lab kit`: an empty kit for another laboratory or simulator, to judge `discover`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from granite_lab.commands.common import JsonOption, console, print_json


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command("kit")(kit)


def kit(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="New folder of the kit.")],
    as_json: JsonOption = False,
) -> None:
    """Write an empty kit: what another laboratory fills in so that `discover` can be judged blind."""
    from granite_lab.api.kit import kit as write

    made = write(out)
    if as_json:
        print_json({"schema": "granite-lab/kit/1", "folder": made.folder, "files": made.files})
        return
    shown = console()
    for path in made.files:
        shown.print(str(path), soft_wrap=True, markup=False)
    shown.print(f"read {made.folder / 'README.md'}; python {made.folder / 'check.py'} checks and seals it",
                soft_wrap=True, markup=False)  # fmt: skip
