"""`granite-lab inspect` and `granite-lab ingest`: what a log holds, and the motion in it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from granite_lab.commands.common import (
    JobsOption,
    JsonOption,
    MapOption,
    QuietOption,
    RobotOption,
    TrialsArgument,
    console,
    print_json,
    progress,
    trial_files,
    warn,
)
from granite_lab.errors import LabError, UsageError

if TYPE_CHECKING:
    from granite_lab.estimate import Estimate
    from granite_lab.estimation.motion import Motion
    from granite_lab.logs.trial import Trial
    from granite_lab.parameters import Robot
    from granite_lab.study import Options

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
    write_map: Annotated[
        Path | None, typer.Option(help="Write the column map here, to edit and to pass with --map.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Say what is recognised in unknown logs: columns, units, clocks, rates, gaps, variant."""
    from granite_lab.files import write_text
    from granite_lab.logs import inspect_logs
    from granite_lab.reporting.terminal import show_inspection

    if not logs:
        raise UsageError("no log given", "name the files of one trial")
    inspection = inspect_logs(logs, map=column_map, robot=robot)
    if write_map:
        write_text(write_map, inspection.to_map_toml())
    if as_json:
        print_json({"schema": "granite-lab/inspect/1", **inspection.as_json()})
        return
    show_inspection(inspection, console())
    if write_map:
        console().print(f"column map: {write_map}", soft_wrap=True)


def _ingest(path: Path, options: Options) -> tuple[Trial, Robot, Motion]:
    from granite_lab.study import ingest as run

    return run(path, options)


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
    robot: RobotOption = None,
    variant: Annotated[
        float | None, typer.Option(help="Desired velocity [m/s], if the log lacks it.")
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
    out: Annotated[Path, typer.Option(help="Folder for the motion tables.")] = Path("reports/ingest"),
    jobs: JobsOption = 0,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Estimate body velocity, slip and their uncertainty from logs."""
    from granite_lab.estimation import judge
    from granite_lab.files import write_text
    from granite_lab.logs.trial import TrialInfo
    from granite_lab.reporting.terminal import show_motions
    from granite_lab.study import Options, each_trial

    if against not in (None, "ref"):
        raise UsageError(f"--against {against}: not known", "use --against ref")
    files = trial_files(trials or ([imu] if imu else None))
    if len(files) > 1 and (encoders or imu or currents or reference):
        raise UsageError("files of single sensors go with one trial", "ingest the trials one by one")
    options = Options(
        robot=robot,
        column_map=column_map,
        imu=imu if trials else None,
        encoders=encoders,
        currents=currents,
        reference=reference,
        rows=rows,
        info=TrialInfo(robot=robot, v_desired=variant) if variant else None,
        rests=tuple(_interval(text) for text in rest or ()),
        distance_measured=_measured(distance_measured) if distance_measured else None,
    )
    with progress(quiet) as display:
        task = display.add_task("ingesting", total=len(files))
        outcomes = each_trial(_ingest, files, options, jobs=jobs, done=lambda _: display.advance(task))
    documents: list[dict[str, Any]] = []
    good = []
    for outcome in outcomes:
        if isinstance(outcome, LabError):
            raise outcome
        trial, _, motion = outcome
        path = out / f"{motion.trial}.csv"
        write_text(path, motion.to_frame().to_csv(index=False, float_format="%.9g"))
        verdict = judge(motion, trial, reference_std) if against else None
        documents.append(_as_json(motion, path) | ({"judgement": verdict} if against else {}))
        good.append((trial, motion, path, verdict))
        warn([f"{motion.trial}: {line}" for line in motion.warnings])
    if as_json:
        print_json({"schema": "granite-lab/ingest/1", "trials": documents})
    else:
        show_motions([(motion, path, verdict) for _, motion, path, verdict in good], console())


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
