"""`granite-lab params`: every number in force and where it comes from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from granite_lab.commands.common import JsonOption, RobotOption, SoilOption, console, print_json


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command("params")(params)


def params(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Folder of logs whose granite-lab.toml holds.")
    ] = Path(),
    robot: RobotOption = None,
    soil: SoilOption = None,
    grade: Annotated[str | None, typer.Option(help="IMU grade instead of the robot's.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Print the parameters in force, with unit, allowed range and origin."""
    from granite_lab.api.project import FILE, project_in
    from granite_lab.parameters import load_paper, load_variants, names
    from granite_lab.parameters.catalogue import in_force
    from granite_lab.reporting.terminal import show_parameters

    project = project_in(folder)
    chosen = {}
    for key, given, default in (("robot", robot, "granite"), ("soil", soil, "dry_sand")):
        beside = getattr(project, key)
        origin = f"--{key}" if given else str(folder / FILE) if beside else "unless a log names another"
        chosen[key] = {"value": given or beside or default, "origin": origin}
    rows = in_force(chosen["robot"]["value"], chosen["soil"]["value"], grade)
    if as_json:
        print_json(
            {
                "schema": "granite-lab/params/1",
                "chosen": chosen,
                "parameters": rows,
                "variants": load_variants(),
                "paper": load_paper(),
                "catalogue": {kind: names(kind) for kind in ("robots", "soils", "loggers")},
            }
        )
    else:
        shown = console()
        for key, value in chosen.items():
            shown.print(f"{key}: {value['value']} ({value['origin']})", markup=False, soft_wrap=True)
        show_parameters(rows, load_variants(), shown)
