"""`granite-lab check`, `inspect`, `ingest` and `view`: what a log holds, and the motion in it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from granite_lab import reporting
from granite_lab.api import check as checks
from granite_lab.api import logs as api
from granite_lab.api.records import Records
from granite_lab.commands.command import Call, Output, command, show, warn_of, write_picture
from granite_lab.commands.options import Flag, Format, picture
from granite_lab.files import ending_of, write_table, write_text

if TYPE_CHECKING:
    from rich.console import Console

    from granite_lab.logs import Inspection


@command(checks.check, log=Flag(metavar="TRIAL", help="Log of one run (CSV, ROS bag, MCAP)."))
def check(call: Call[checks.Checked]) -> Output:
    """The exit code is 3 if the log cannot be used and 4 if it is poor."""
    found = call()

    def text(shown: Console) -> None:
        table = reporting.table
        cells = {
            "mark": lambda c: table.words(*(("good", "good") if c.good else ("BAD", "bad"))),
            "found": lambda c: c.found if c.good else f"{c.found}. {reporting.names.capital(c.advice)}.",
        }
        table.show_rows("checks", found.checks, shown, cells)
        if found.virtual:
            table.say(shown, "virtual data: written by a simulator.", "yellow")
        if found.good:
            table.say(shown, "The run is good.", "bold green")

    document = {"log": found.log, "virtual": found.virtual, "good": found.good, "checks": found.checks}
    return Output("check/1", document, text, found.error)


@command(api.inspect)
def inspect(
    call: Call[Inspection],
    write_map: Annotated[
        Path | None, typer.Option(help="Write the column map here, to edit and to pass with --map.")
    ] = None,
    plot: Annotated[Path | None, picture("Draw the recognised channels over time")] = None,
) -> Output:
    """Columns that are not used are listed, too."""
    found = call()
    if write_map:
        write_text(write_map, found.to_map_toml())
    if plot:
        write_picture(plot, reporting.pictures.inspection_figure(found))

    def text(shown: Console) -> None:
        reporting.terminal.show_inspection(found, shown)
        for what, path in (("column map", write_map), ("plot", plot)):
            if path:
                show(f"{what}: {path}")

    return Output("inspect/1", found.as_json(), text)


@command(api.ingest, busy="ingesting")
def ingest(
    call: Call[Records[api.Ingested]],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the motion tables.", show_default="reports/ingest")
    ] = None,
    table_format: Format = None,
) -> Output:
    """The motion of each log is written as a table, a row for each IMU sample."""
    ending, folder = ending_of(None, table_format), out or call.folder("ingest")
    found = call()
    paths = [folder / f"{item.name}{ending}" for item in found]
    for item, path in zip(found, paths, strict=True):
        write_table(path, item.to_frame(), ending)
    documents = [
        {"name": i.name, "virtual": i.motion.virtual, "warnings": i.motion.warnings, "motion": path}
        | reporting.json_report.motion_as_json(i.motion)
        | ({"judgement": i.judgement} if i.judgement is not None else {})
        for i, path in zip(found, paths, strict=True)
    ]
    rows = [(i.motion, path, i.judgement) for i, path in zip(found, paths, strict=True)]
    document = {"trials": documents} | warn_of(found.origin)
    return Output("ingest/2", document, lambda shown: reporting.terminal.show_motions(rows, shown))


@command(
    api.view,
    json=False,
    what=Flag(metavar="WHAT", help="A recording (.rrd), a report folder, or a log (CSV, ROS bag, MCAP)."),
    screenshot=Flag(help="Save a picture of the viewer (.png) instead; needs no display."),
)
def view(call: Call[None]) -> None:
    """A log is analysed first."""
    call(tell=lambda address: typer.echo(f"{address}\nCtrl+C ends it."))
    if "screenshot" in call.said:
        typer.echo(call.said["screenshot"])
