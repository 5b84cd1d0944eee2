"""`granite-lab check`: green or red after a run in the field."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from granite_lab.commands.common import (
    FromOption,
    JsonOption,
    MapOption,
    RobotOption,
    ToOption,
    TopicOption,
    console,
    print_json,
    topics_of,
    window_of,
)


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command("check")(check)


def check(
    trial: Annotated[Path, typer.Argument(metavar="TRIAL", help="Log of one run (CSV, ROS bag, MCAP).")],
    robot: RobotOption = None,
    column_map: MapOption = None,
    topic: TopicOption = None,
    start: FromOption = None,
    end: ToOption = None,
    as_json: JsonOption = False,
) -> None:
    """Say after a run in the field whether the log is good: exit code 3 if it cannot be used, 4 if poor."""
    from granite_lab.api.check import check as run

    found = run(
        trial, robot=robot, column_map=column_map, topics=topics_of(topic), window=window_of(start, end)
    )
    if as_json:
        document = {"virtual": found.virtual, "good": found.good, "checks": found.checks}
        print_json({"schema": "granite-lab/check/1", "log": found.log} | document)
    else:
        from granite_lab.reporting.grid import clean, grid, row_of, say

        shown = console()
        table = grid("", "check", "found", words=(0, 1, 2))
        for one in found.checks:
            mark = clean("good", "green") if one.good else clean("BAD", "bold red")
            table.add_row(*row_of(mark, one.name, one.found if one.good else f"{one.found}. {one.advice}."))
        shown.print(table)
        if found.virtual:
            say(shown, "virtual data: written by a simulator.", "yellow")
        if found.good:
            say(shown, "The run is good.", "bold green")
    if found.error is not None:
        raise found.error
