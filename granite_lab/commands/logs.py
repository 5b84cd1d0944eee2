"""`granite-lab inspect` and `granite-lab ingest`: what a log holds, and the motion in it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from granite_lab.commands.common import (
    FormatOption,
    FromOption,
    JobsOption,
    JsonOption,
    MapOption,
    QuietOption,
    RobotOption,
    ToOption,
    TopicOption,
    TrialsArgument,
    chosen,
    console,
    files_of,
    print_json,
    progress,
    refuse_missing,
    topics_of,
    warn,
    window_of,
)
from granite_lab.errors import UsageError

if TYPE_CHECKING:
    from granite_lab.estimate import Estimate
    from granite_lab.estimation.motion import Motion

ImuOption = Annotated[Path | None, typer.Option(help="File with the IMU, where sensors were logged apart.")]
EncodersOption = Annotated[
    Path | None, typer.Option(help="File with the encoders, where sensors were logged apart.")
]


def register(app: typer.Typer) -> None:
    """Add the commands to the app."""
    app.command("inspect")(inspect)
    app.command("ingest")(ingest)


def inspect(
    logs: TrialsArgument = None,
    robot: RobotOption = None,
    column_map: MapOption = None,
    topic: TopicOption = None,
    write_map: Annotated[
        Path | None, typer.Option(help="Write the column map here, to edit and to pass with --map.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw the recognised channels over time (.png, .pdf or .svg).")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Say what is recognised in unknown logs: columns, units, clocks, rates, gaps, variant."""
    from granite_lab.api.logs import inspect as run
    from granite_lab.files import write_text
    from granite_lab.reporting.terminal import show_inspection

    inspection = run(logs or [], column_map=column_map, topics=topics_of(topic), robot=robot)
    if write_map:
        write_text(write_map, inspection.to_map_toml())
    if plot:
        from granite_lab.reporting.plot_log import write_plot

        write_plot(inspection, plot)
    if as_json:
        print_json({"schema": "granite-lab/inspect/1", **inspection.as_json()})
        return
    show_inspection(inspection, console())
    if write_map:
        console().print(f"column map: {write_map}", soft_wrap=True)
    if plot:
        console().print(f"plot: {plot}", soft_wrap=True)


def ingest(
    trials: TrialsArgument = None,
    imu: ImuOption = None,
    encoders: EncodersOption = None,
    currents: Annotated[Path | None, typer.Option(help="File with the motor currents.")] = None,
    reference: Annotated[
        Path | None, typer.Option(help="File with an external reference, as GPS or motion capture.")
    ] = None,
    rows: Annotated[
        str | None, typer.Option(help="Rows to take from a log of several runs, as 'run_id = 4'.")
    ] = None,
    column_map: MapOption = None,
    topic: TopicOption = None,
    start: FromOption = None,
    end: ToOption = None,
    robot: RobotOption = None,
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
        typer.Option(help="'ref': judge the estimate by the log's reference, which the filter never sees."),
    ] = None,
    reference_std: Annotated[
        float, typer.Option(help="Std of the reference's own velocity [m/s], as 0.25 of GPS.", min=0.0)
    ] = 0.0,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the motion tables.", show_default="reports/ingest")
    ] = None,
    table_format: FormatOption = None,
    jobs: JobsOption = 0,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Estimate body velocity, slip and their uncertainty from logs."""
    refuse_missing(trials)
    from granite_lab.api.logs import ingest as run
    from granite_lab.files import ending_of, write_table
    from granite_lab.reporting.terminal import show_motions

    if against not in (None, "ref"):
        raise UsageError(f"--against {against}: not known", "use --against ref")
    ending = ending_of(None, table_format)
    choice = chosen(trials or ([imu] if imu else None), robot, None, column_map)
    files, out = choice.files, out or choice.out / "ingest"
    with progress(quiet) as display:
        task = display.add_task("ingesting", total=len(files))
        found = run(
            files,
            imu=imu if trials else None,
            encoders=encoders,
            currents=currents,
            reference=reference,
            rows=rows,
            column_map=choice.column_map,
            topics=topics_of(topic),
            window=window_of(start, end),
            robot=choice.robot,
            variant=variant,
            rests=[_interval(text) for text in rest or ()],
            distance_measured=_measured(distance_measured) if distance_measured else None,
            against_reference=against is not None,
            reference_std=reference_std,
            jobs=jobs,
            done=lambda _: display.advance(task),
        )
    documents: list[dict[str, Any]] = []
    good = []
    for item in found:
        motion = item.motion
        path = out / f"{motion.trial}{ending}"
        write_table(path, motion.to_frame(), ending)
        documents.append(_as_json(motion, path) | ({"judgement": item.judgement} if against else {}))
        good.append((motion, path, item.judgement))
        warn([f"{motion.trial}: {line}" for line in motion.warnings])
    if as_json:
        print_json({"schema": "granite-lab/ingest/1", "trials": documents} | files_of(choice))
    else:
        show_motions(good, console())


def _as_json(motion: Motion, path: Path) -> dict[str, Any]:
    return {
        "name": motion.trial,
        "virtual": motion.virtual,
        "variant_mps": motion.variant.velocity,
        "variant_source": motion.variant_source,
        "slip_ratio": motion.slip_ratio.as_json(),
        "distance_m": motion.distance.as_json(),
        "distance_wheels_m": motion.distance_wheels.as_json(),
        "steady_s": motion.steady,
        "t_start_s": motion.t_start.as_json(),
        "clock_offset_s": motion.clock_offset.as_json(),
        "noise": motion.noise,
        "health": {"verdict": motion.health.verdict, "good": motion.health.good, "nis": motion.health.nis},
        "warnings": list(motion.warnings),
        "motion": path,
    }


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
