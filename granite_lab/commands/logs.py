"""Commands on logs: whether they are usable, what they hold, the motion in them, a look at it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

import granite_lab as gl
from granite_lab import reporting
from granite_lab.columns import Column, Table, words
from granite_lab.commands.options import (
    BodyRests,
    Changes,
    ColumnMap,
    Format,
    From,
    Jobs,
    Json,
    Logs,
    LogsAtHand,
    Quiet,
    RefVStd,
    RefXStd,
    RestTexts,
    Robot,
    Soil,
    Strict,
    Tape,
    To,
    Topics,
    UseReference,
    at_hand,
    count_of,
    keywords_of,
    picture,
    topics_of,
)
from granite_lab.commands.printer import Printer, progress, warn_of, write_picture
from granite_lab.errors import EstimateError, InputError, UsageError, printable
from granite_lab.files import ending_of, write_table, write_text
from granite_lab.logs.trial import name_of
from granite_lab.shown import picked

if TYPE_CHECKING:
    from granite_lab.api.records import Records
    from granite_lab.api.run_checks import Check, Checked


def check(
    logs: LogsAtHand = None,
    jobs: Jobs = 0,
    robot: Robot = None, soil: Soil = None, column_map: ColumnMap = None, topics: Topics = None,
    begin: From = None, end: To = None, changes: Changes = None,
    rests: RestTexts = None, body_rests: BodyRests = None, distance_measured: Tape = None,
    use_reference: UseReference = False, ref_v_std: RefVStd = None, ref_x_std: RefXStd = None,
    quiet: Quiet = False, as_json: Json = False,
) -> None:  # fmt: skip
    """Check logs after runs in the field: readable, sensors, standstills, speed, slip, estimate.

    A log that cannot be used is reported as a failed check.

    Of several logs one line each is shown. The exit code is 3 if one cannot be used, 4 if one is poor.
    """
    given = at_hand(locals())
    with progress("checking", quiet=quiet, total=count_of(given["logs"])) as watch:
        checked = gl.check(**given, done=watch.done)
    printer = Printer(as_json)
    if len(checked) == 1:
        _show_checks(printer, checked[0])
    else:
        _show_sheet(printer, checked)


def _check_as_json(checked: Checked) -> dict[str, Any]:
    return picked(checked, "log", "virtual", "good", "checks") | {"health": {"grade": checked.grade or None}}


def _show_sheet(printer: Printer, checked: Records[Checked]) -> None:
    """Print one line a run, and end with the exit code of the worst."""
    errors = [run.error for run in checked if run.error is not None]
    printer.json("check/2", {"good": not errors, "runs": [_check_as_json(run) for run in checked]})
    width = max(len(printable(name_of(run.log))) for run in checked)
    for run in checked:
        mark, style = ("good", "green") if run.good else ("BAD ", "red")
        virtual = " (virtual)" if run.virtual else ""
        name = printable(name_of(run.log))
        printer.line(f"{mark}  {name:<{width}}  {printable(run.reason)}{virtual}", style)
    if errors:
        kind = InputError if any(isinstance(error, InputError) for error in errors) else EstimateError
        hint = "check one of them alone to see all of its checks and what to do"
        raise kind(f"{len(errors)} of {len(checked)} runs are bad", hint)
    printer.say(f"All {len(checked)} runs are good.", "bold green")


CHECKS: Table[Check] = Table(
    "checks",
    "Checks of a run",
    Column("", lambda c: words("good", "good") if c.good else words("BAD", "bad")),
    Column("check", lambda c: c.name),
    Column(
        "found",
        lambda c: words(c.found if c.good else f"{c.found}. {reporting.names.capital(c.advice)}."),
    ),
)


def _show_checks(printer: Printer, checked: Checked) -> None:
    """Print each check of one run."""
    printer.json("check/1", _check_as_json(checked))
    printer.rows(CHECKS, checked.checks, virtual=checked.virtual)
    if checked.error is not None:
        raise checked.error
    printer.say("The run is good.", "bold green")


def inspect(
    logs: Logs = None,
    column_map: ColumnMap = None,
    topics: Topics = None,
    robot: Robot = None,
    write_map: Annotated[Path | None, Option(
        help="Write the column map here, to edit and to pass with --map.")] = None,
    plot: Annotated[Path | None, picture("Draw the recognised channels over time")] = None,
    as_json: Json = False,
) -> None:  # fmt: skip
    """Show what is recognised in logs: columns, units, clocks, rates, gaps, variant.

    A log that is not understood is reported as a problem, not as an error.

    Columns that are not used are listed, too.
    """
    inspection = gl.inspect(logs or (), column_map=column_map, topics=topics_of(topics), robot=robot)
    if write_map:
        write_text(write_map, inspection.to_map_toml())
    if plot:
        write_picture(plot, reporting.pictures.inspection_figure(inspection))
    printer = Printer(as_json)
    printer.json("inspect/1", inspection.as_json())
    reporting.terminal.show_inspection(inspection, printer.shown)
    for kind, path in (("column map", write_map), ("plot", plot)):
        if path:
            printer.line(f"{kind}: {path}")


def ingest(
    logs: Logs = None,
    imu: Annotated[Path | None, Option(
        help="File with the IMU, if each sensor of a trial has its own file.")] = None,
    encoders: Annotated[Path | None, Option(help="File with the encoders of that trial.")] = None,
    currents: Annotated[Path | None, Option(help="File with the motor currents of that trial.")] = None,
    reference: Annotated[Path | None, Option(
        help="File with an external reference of that trial, as GPS or motion capture.")] = None,
    rows: Annotated[str | None, Option(
        help="Rows to take from a log of several runs, as run_id = 4.")] = None,
    variant: Annotated[float | None, Option(
        help="Desired velocity [m/s], if the log lacks it (0.01 to 5).")] = None,
    against_reference: Annotated[str | None, Option("--against",
        help="'ref': compare the estimate with the log's reference, which the filter does not use.")] = None,
    strict: Strict = False,
    jobs: Jobs = 0,
    robot: Robot = None, soil: Soil = None, column_map: ColumnMap = None, topics: Topics = None,
    begin: From = None, end: To = None, changes: Changes = None,
    rests: RestTexts = None, body_rests: BodyRests = None, distance_measured: Tape = None,
    use_reference: UseReference = False, ref_v_std: RefVStd = None, ref_x_std: RefXStd = None,
    out: Annotated[Path | None, Option(
        help="Folder for the motion tables.", show_default="reports/ingest")] = None,
    table_format: Format = None,
    quiet: Quiet = False, as_json: Json = False,
) -> None:  # fmt: skip
    """Estimate body velocity, slip and their uncertainty from logs.

    A log that cannot be used is left out and listed with the reason.

    The motion of each log is written as a table, a row for each IMU sample.

    Other commands take these logs where none are named.
    """
    from granite_lab.api.at_hand import refuse_others, remember
    from granite_lab.api.project import results_folder

    if against_reference not in (None, "ref"):
        raise UsageError(f"--against {against_reference}: cannot be understood", "use --against ref")
    given = keywords_of(locals())
    given |= {"imu": imu, "encoders": encoders, "currents": currents, "reference": reference, "rows": rows}
    given |= {"variant": variant}
    ending = ending_of(None, table_format)
    folder = out or results_folder(given["logs"] or [file for file in (imu,) if file], "ingest")
    with progress("ingesting", quiet=quiet, total=count_of(given["logs"])) as watch:
        ingested = gl.ingest(**given, against_reference=bool(against_reference), done=watch.done)
    written = [(item.motion, folder / f"{item.name}{ending}", item.judgement) for item in ingested]
    tables = {item.log: path for item, (_, path, _) in zip(ingested, written, strict=True)}
    refuse_others(folder, tables.values())
    for motion, path, _ in written:
        write_table(path, motion.to_frame(), ending)
    remember(folder, tables, given)
    referred = {item.motion.trial for item in ingested if item.trial.info.use_reference}
    documents = [
        {"name": m.trial, "virtual": m.virtual, "warnings": m.warnings, "motion": path}
        | reporting.json_report.motion_as_json(m)
        | ({} if judged is None else {"judgement": judged, "judged_without_reference": m.trial in referred})
        for m, path, judged in written
    ]
    failures = [failure for failure in ingested.origin.left_out if not failure.excluded]
    printer = Printer(as_json)
    printer.json("ingest/2", {"trials": documents, "failures": failures} | warn_of(ingested.origin))
    reporting.terminal.show_motions(written, printer.shown, referred)
    for failure in failures:
        printer.say(f"left out: {failure.trial}: {failure.message}", "red")


def view(
    path: Annotated[Path, Argument(
        metavar="PATH", help="A recording (.rrd), a report folder, or a log (CSV, ROS bag, MCAP).")],
    trial: Annotated[str | None, Option(
        help="With a report folder, the trial to open; all by default.")] = None,
    robot: Robot = None, soil: Soil = None, column_map: ColumnMap = None,
) -> None:  # fmt: skip
    """Open a recording in the Rerun viewer, which stays open.

    A log is analysed first.
    """
    gl.view(path, trial=trial, robot=robot, soil=soil, column_map=column_map)
