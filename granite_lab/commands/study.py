"""`granite-lab study` and `granite-lab view`: the main job, and a look at its recordings."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
from granite_lab.commands.running import CacheOption, SchedulerOption, StrictOption, execution_of, tidy
from granite_lab.errors import EstimateError, InputError

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID


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
    discover: Annotated[bool, typer.Option(help="Search for an effect that the model lacks.")] = True,
    strict: StrictOption = False,
    jobs: JobsOption = 0,
    scheduler: SchedulerOption = None,
    cache: CacheOption = True,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Run the whole chain over trials, from raw logs to a report and Rerun timelines."""
    from granite_lab.discovery import finding_as_json
    from granite_lab.reporting import write_report
    from granite_lab.reporting.discovery import section
    from granite_lab.reporting.terminal import show_study
    from granite_lab.running.search import save_found
    from granite_lab.study import Options, record, searched
    from granite_lab.study import study as run

    files = trial_files(trials)
    options = Options(robot=robot, soil=soil, column_map=column_map, model=model, effects=effects)
    execution = execution_of(jobs, scheduler, cache)
    with progress(quiet) as display:
        task = display.add_task("trials", total=len(files))
        result = run(files, out.name, options, execution=execution, done=lambda _: display.advance(task))
        warn([f"{failure.trial}: left out: {failure.message}" for failure in result.failures])
        if strict and result.failures:
            raise InputError(result.failures[0].message, result.failures[0].hint)
        if discover:
            task = display.add_task("searching", total=None)
            result = searched(result, options, execution, partial(_tell, display, task))
            if strict and result.unsearched:
                raise EstimateError(result.unsearched, "--no-discover leaves the search out")
        if recordings:
            task = display.add_task("recordings", total=len(result.trials) + 1)
            record(result, out / "recordings", done=lambda _: display.advance(task))
        task = display.add_task("report", total=1)
        found = result.finding
        if found is not None:
            save_found(found, options, [r.trial for r in result.trials], out / "model.toml")
        page = write_report(result, out, section(found, "model.toml") if found is not None else None)
        display.advance(task)
    tidy(execution)
    if as_json:
        print_json(
            {
                "schema": "granite-lab/study/1",
                "report": page,
                "trials": len(result.trials),
                "failures": result.failures,
                "a_theta": result.a_theta.a_theta if result.a_theta else None,
                "discovery": finding_as_json(found, out / "model.toml") if found is not None else None,
            }
        )
    else:
        show_study(result, console())
        console().print(f"report: {page}", soft_wrap=True)


def _tell(display: Progress, task: TaskID, text: str, runs: int) -> None:
    display.update(task, description=f"{text}: simulations", completed=runs)


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
