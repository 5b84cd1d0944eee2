"""`granite-lab check`, `inspect`, `ingest` and `view`: what a log holds, and the motion in it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from granite_lab.commands import options as o
from granite_lab.commands.printing import console, print_json, progress, show, warn_of
from granite_lab.errors import UsageError

if TYPE_CHECKING:
    from granite_lab.estimate import Estimate


@o.spread
def check(
    trial: Annotated[
        Path,
        typer.Argument(metavar="TRIAL", help="Log of one run (CSV, ROS bag, MCAP)."),
    ],
    *,
    about: o.About,
    as_json: o.Json = False,
) -> None:
    """Check whether a log is usable.

    The exit code is 3 if it cannot be used and 4 if it is poor.
    """
    from granite_lab.api.check import check as run
    from granite_lab.reporting.grid import clean, grid, row_of, say

    found = run(trial, **about.said())
    if as_json:
        document = {"virtual": found.virtual, "good": found.good, "checks": found.checks}
        print_json({"schema": "granite-lab/check/1", "log": found.log} | document)
    else:
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


def inspect(
    logs: Annotated[
        list[Path] | None, typer.Argument(metavar="TRIALS…", help=o.LOGS, show_default=False)
    ] = None,
    robot: o.Robot = None,
    column_map: o.Map = None,
    topic: o.Topic = None,
    write_map: Annotated[
        Path | None, typer.Option(help="Write the column map here, to edit and to pass with --map.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw the recognised channels over time (.png, .pdf or .svg).")
    ] = None,
    as_json: o.Json = False,
) -> None:
    """Show what is recognised in a log.

    Columns, units, clocks, rates, gaps, standstills and the variant of motion.
    """
    from granite_lab.api.logs import inspect as run
    from granite_lab.files import write_text

    inspection = run(logs or [], column_map=column_map, topics=o.topics_of(topic), robot=robot)
    if write_map:
        write_text(write_map, inspection.to_map_toml())
    if plot:
        from granite_lab.reporting.plot_log import write_plot

        write_plot(inspection, plot)
    if as_json:
        print_json({"schema": "granite-lab/inspect/1", **inspection.as_json()})
        return
    from granite_lab.reporting.terminal import show_inspection

    show_inspection(inspection, console())
    for what, path in (("column map", write_map), ("plot", plot)):
        if path:
            show(f"{what}: {path}")


@o.spread
def ingest(
    trials: o.Trials = None,
    imu: Annotated[Path | None, typer.Option(help="File with the IMU, if each sensor has its own.")] = None,
    encoders: Annotated[
        Path | None, typer.Option(help="File with the encoders, if each sensor has its own.")
    ] = None,
    currents: Annotated[Path | None, typer.Option(help="File with the motor currents.")] = None,
    reference: Annotated[
        Path | None, typer.Option(help="File with an external reference, as GPS or motion capture.")
    ] = None,
    rows: Annotated[
        str | None, typer.Option(help="Rows to take from a log of several runs, as 'run_id = 4'.")
    ] = None,
    variant: Annotated[
        float | None, typer.Option(help="Desired velocity [m/s], if the log lacks it.", min=0.01, max=5)
    ] = None,
    rest: Annotated[
        list[str] | None, typer.Option(help="Interval of standstill, as 0:1.2 [s]; may be repeated.")
    ] = None,
    distance_measured: Annotated[
        str | None, typer.Option(help="Total distance by tape [m], as 2.03 or 2.03±0.01.")
    ] = None,
    against: Annotated[
        str | None,
        typer.Option(help="'ref': judge the estimate by the log's reference, which the filter does not use."),
    ] = None,
    reference_std: Annotated[
        float, typer.Option(help="Std of the reference's own velocity [m/s], as 0.25 of GPS.", min=0.0)
    ] = 0.0,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the motion tables.", show_default="reports/ingest")
    ] = None,
    table_format: o.Format = None,
    *,
    about: o.About,
    jobs: o.Jobs = 0,
    quiet: o.Quiet = False,
    as_json: o.Json = False,
) -> None:
    """Estimate velocity and slip with their uncertainty."""
    from granite_lab.api.logs import ingest as run
    from granite_lab.api.project import choose
    from granite_lab.files import ending_of, write_table

    if against not in (None, "ref"):
        raise UsageError(f"--against {against}: not known", "use --against ref")
    ending, said = ending_of(None, table_format), about.said()
    logs = trials or ([imu] if imu else [])
    choice = choose(logs, said)
    out = out or choice.out / "ingest"
    with progress(quiet, "ingesting", len(choice.files)) as shown:
        found = run(
            logs, imu=imu if trials else None, encoders=encoders, currents=currents, reference=reference,
            rows=rows, variant=variant, rests=[_interval(text) for text in rest or ()],
            distance_measured=_measured(distance_measured) if distance_measured else None,
            against_reference=against is not None, reference_std=reference_std, jobs=jobs, done=shown.done,
            **said,
        )  # fmt: skip
    paths = [out / f"{item.name}{ending}" for item in found]
    for item, path in zip(found, paths, strict=True):
        write_table(path, item.to_frame(), ending)
    excluded = warn_of(found.origin)
    if as_json:
        from granite_lab.reporting.json_report import motion_as_json

        judged = [{"judgement": item.judgement} if against else {} for item in found]
        documents = [
            {"name": i.name, "virtual": i.motion.virtual, "warnings": i.motion.warnings, "motion": path}
            | motion_as_json(i.motion)
            | j
            for i, path, j in zip(found, paths, judged, strict=True)
        ]
        print_json({"schema": "granite-lab/ingest/2", "trials": documents} | excluded)
    else:
        from granite_lab.reporting.terminal import show_motions

        show_motions([(i.motion, path, i.judgement) for i, path in zip(found, paths, strict=True)], console())


def _interval(text: str) -> tuple[float, float]:
    start, _, end = text.partition(":")
    try:
        interval = float(start), float(end)
    except ValueError:
        raise UsageError(f"--rest {text}: not an interval", "write start:end in seconds, as 0:1.2") from None
    if not interval[0] < interval[1]:
        raise UsageError(f"--rest {text}: ends before it begins", "write start:end in seconds, as 0:1.2")
    return interval


def _measured(text: str) -> Estimate:
    from granite_lab.estimate import Estimate

    value, _, std = text.replace("+-", "±").partition("±")
    try:
        measured = Estimate(float(value), float(std) if std else 0.005)
    except ValueError:
        raise UsageError(f"--distance-measured {text}: not a number", "write 2.03 or 2.03±0.01 [m]") from None
    if not (measured.value > 0 and measured.std > 0):
        raise UsageError(f"--distance-measured {text}: must be positive", "write 2.03 or 2.03±0.01 [m]")
    return measured


def view(
    what: Annotated[
        Path,
        typer.Argument(help="A recording (.rrd), a report folder, or a log (CSV)."),
    ],
    trial: Annotated[str | None, typer.Option(help="With a report folder: the trial to open.")] = None,
    web: Annotated[bool, typer.Option("--web", help="Serve the viewer to a browser until Ctrl+C.")] = False,
    screenshot: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Save a picture instead; needs no display.")
    ] = None,
    at: Annotated[
        float | None,
        typer.Option(help="Seconds after the start of the command.", show_default="middle"),
    ] = None,
    robot: o.Robot = None,
    soil: o.Soil = None,
    column_map: o.Map = None,
) -> None:
    """Open a recording in the viewer."""
    from granite_lab.api.logs import view as run

    run(
        what, trial=trial, web=web, screenshot=screenshot, at=at, robot=robot, soil=soil,
        column_map=column_map, tell=lambda address: typer.echo(f"{address}\nCtrl+C ends it."),
    )  # fmt: skip
    if screenshot is not None:
        typer.echo(screenshot)
