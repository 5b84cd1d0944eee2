"""`granite-lab params`: every number in force and where it comes from."""

from __future__ import annotations

from typing import Annotated

import typer

from granite_lab.commands.common import JsonOption, RobotOption, SoilOption, console, print_json


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command("params")(params)


def params(
    robot: RobotOption = None,
    soil: SoilOption = None,
    grade: Annotated[str | None, typer.Option(help="IMU grade instead of the robot's.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Print the parameters in force, with unit, allowed range and origin."""
    from granite_lab.parameters import load_paper, load_variants, names
    from granite_lab.parameters.catalogue import in_force
    from granite_lab.reporting.terminal import show_parameters

    rows = in_force(robot or "granite", soil or "dry_sand", grade)
    if as_json:
        print_json(
            {
                "schema": "granite-lab/params/1",
                "parameters": rows,
                "variants": load_variants(),
                "paper": load_paper(),
                "catalogue": {kind: names(kind) for kind in ("robots", "soils", "loggers")},
            }
        )
    else:
        show_parameters(rows, load_variants(), console())
