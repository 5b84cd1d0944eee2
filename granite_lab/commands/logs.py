"""`granite-lab check`, `inspect`, `ingest` and `view`: what a log holds, and the motion in it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from granite_lab import reporting
from granite_lab.api import check as checks
from granite_lab.api import logs as api
from granite_lab.api.records import Records
from granite_lab.commands.command import Call, command, warn_of, write_picture
from granite_lab.commands.options import Flag, Format, picture
from granite_lab.files import ending_of, write_table, write_text

if TYPE_CHECKING:
    from granite_lab.logs import Inspection


@command(checks.check, log=Flag(metavar="TRIAL", help="Log of one run (CSV, ROS bag, MCAP)."))
def check(call: Call[checks.Checked]) -> None:
    """The exit code is 3 if the log cannot be used and 4 if it is poor."""
    found, words = call(), reporting.table.words
    document = {"log": found.log, "virtual": found.virtual, "good": found.good, "checks": found.checks}
    call.json("check/1", document)
    cells = {
        "mark": lambda c: words("good", "good") if c.good else words("BAD", "bad"),
        "found": lambda c: c.found if c.good else f"{c.found}. {reporting.names.capital(c.advice)}.",
    }
    call.rows("checks", found.checks, cells)
    if found.virtual:
        call.say("virtual data: written by a simulator.", "yellow")
    if found.error is not None:
        raise found.error
    call.say("The run is good.", "bold green")


@command(api.inspect)
def inspect(
    call: Call[Inspection],
    write_map: Annotated[
        Path | None, typer.Option(help="Write the column map here, to edit and to pass with --map.")
    ] = None,
    plot: Annotated[Path | None, picture("Draw the recognised channels over time")] = None,
) -> None:
    """Columns that are not used are listed, too."""
    found = call()
    if write_map:
        write_text(write_map, found.to_map_toml())
    if plot:
        write_picture(plot, reporting.pictures.inspection_figure(found))
    call.json("inspect/1", found.as_json())
    reporting.terminal.show_inspection(found, call.shown)
    for what, path in (("column map", write_map), ("plot", plot)):
        if path:
            call.line(f"{what}: {path}")


@command(api.ingest, busy="ingesting")
def ingest(
    call: Call[Records[api.Ingested]],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the motion tables.", show_default="reports/ingest")
    ] = None,
    table_format: Format = None,
) -> None:
    """The motion of each log is written as a table, a row for each IMU sample."""
    ending, folder = ending_of(None, table_format), out or call.folder("ingest")
    found = call()
    rows = [(item.motion, folder / f"{item.name}{ending}", item.judgement) for item in found]
    for motion, path, _ in rows:
        write_table(path, motion.to_frame(), ending)
    documents = [
        {"name": m.trial, "virtual": m.virtual, "warnings": m.warnings, "motion": path}
        | reporting.json_report.motion_as_json(m)
        | ({"judgement": judged} if judged is not None else {})
        for m, path, judged in rows
    ]
    call.json("ingest/2", {"trials": documents} | warn_of(found.origin))
    reporting.terminal.show_motions(rows, call.shown)


@command(
    api.view,
    json=False,
    what=Flag(metavar="WHAT", help="A recording (.rrd), a report folder, or a log (CSV, ROS bag, MCAP)."),
    screenshot=Flag(help="Save a picture of the viewer (.png) instead; needs no display."),
)
def view(call: Call[None]) -> None:
    """A log is analysed first."""
    call(tell=lambda address: call.line(f"{address}\nCtrl+C ends it."))
    if "screenshot" in call.said:
        call.line(call.said["screenshot"])
