"""`granite-lab study` and `granite-lab view`: the main job, and a look at its recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from granite_lab.commands.common import (
    EffectsOption,
    JobsOption,
    JsonOption,
    MapOption,
    ModelOption,
    QuietOption,
    RobotOption,
    SoilOption,
    TrialsArgument,
    console,
    print_json,
    progress,
    trial_files,
    warn,
)
from granite_lab.errors import InputError


def register(app: typer.Typer) -> None:
    """Add the commands to the app."""
    app.command("study")(study)
    app.command("view")(view)


def study(
    trials: TrialsArgument = None,
    out: Annotated[Path, typer.Option(help="Folder of the report; its name is the report's name.")] = Path(
        "reports/study"
    ),
    robot: RobotOption = None,
    soil: SoilOption = None,
    column_map: MapOption = None,
    model: ModelOption = None,
    effects: EffectsOption = None,
    recordings: Annotated[bool, typer.Option(help="Write a Rerun recording of each trial.")] = True,
    strict: Annotated[bool, typer.Option("--strict", help="End at the first trial that fails.")] = False,
    jobs: JobsOption = 0,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Run the whole chain over trials, from raw logs to a report and Rerun timelines."""
    from granite_lab.reporting import write_report
    from granite_lab.reporting.terminal import show_study
    from granite_lab.study import Options, record
    from granite_lab.study import study as run

    files = trial_files(trials)
    options = Options(robot=robot, soil=soil, column_map=column_map, model=model, effects=effects)
    with progress(quiet) as display:
        task = display.add_task("trials", total=len(files))
        result = run(files, out.name, options, jobs=jobs, done=lambda _: display.advance(task))
        for failure in result.failures:
            warn([f"{failure.trial}: left out: {failure.message}"])
        if strict and result.failures:
            raise InputError(result.failures[0].message, result.failures[0].hint)
        if recordings:
            task = display.add_task("recordings", total=len(result.trials) + 1)
            record(result, out / "recordings", done=lambda _: display.advance(task))
        task = display.add_task("report", total=1)
        page = write_report(result, out)
        display.advance(task)
    if as_json:
        print_json(
            {
                "schema": "granite-lab/study/1",
                "report": page,
                "trials": len(result.trials),
                "failures": result.failures,
                "a_theta": result.a_theta.a_theta if result.a_theta else None,
            }
        )
    else:
        show_study(result, console())
        console().print(f"report: {page}", soft_wrap=True)


def view(
    what: Annotated[Path, typer.Argument(help="A recording (.rrd), a report folder, or a log (CSV).")],
    trial: Annotated[str | None, typer.Option(help="With a report folder: the trial to open.")] = None,
    robot: RobotOption = None,
    soil: SoilOption = None,
    column_map: MapOption = None,
) -> None:
    """Open a timeline in the Rerun viewer."""
    from granite_lab.api.view import view as run

    run(what, trial=trial, robot=robot, soil=soil, column_map=column_map)
