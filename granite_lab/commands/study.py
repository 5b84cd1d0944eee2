"""`granite-lab study` and `granite-lab view`: the main job, and a look at its recordings."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from granite_lab.commands.common import (
    EffectsOption,
    FromOption,
    JobsOption,
    JsonOption,
    LatencyOption,
    MapOption,
    ModelOption,
    QuietOption,
    RobotOption,
    SoilOption,
    ToleranceOption,
    ToOption,
    TopicOption,
    TrialsArgument,
    chosen,
    console,
    jsonable,
    print_json,
    progress,
    refuse_missing,
    topics_of,
    warn,
    window_of,
)
from granite_lab.commands.running import CacheOption, SchedulerOption, StrictOption, execution_of, tidy
from granite_lab.errors import LabError

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from granite_lab.running import Execution


MOST = 20
"""Differences that are printed."""


def register(app: typer.Typer) -> None:
    """Add the commands to the app."""
    app.command("study")(study)
    app.command("view")(view)


def study(
    trials: TrialsArgument = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder of the report; its name is the report's name.", show_default="reports/study"
        ),
    ] = None,
    robot: RobotOption = None,
    soil: SoilOption = None,
    column_map: MapOption = None,
    topic: TopicOption = None,
    start: FromOption = None,
    end: ToOption = None,
    model: ModelOption = None,
    effects: EffectsOption = None,
    recordings: Annotated[bool, typer.Option(help="Write a Rerun recording of each trial.")] = True,
    discover: Annotated[bool, typer.Option(help="Search for an effect that the model lacks.")] = True,
    check: Annotated[
        Path | None,
        typer.Option("--verify", metavar="REPORT", help="Compute a report again and say what differs."),
    ] = None,
    tolerance: ToleranceOption = 0.02,
    latency: LatencyOption = 20.0,
    strict: StrictOption = False,
    jobs: JobsOption = 0,
    scheduler: SchedulerOption = None,
    cache: CacheOption = True,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Run the whole chain over trials, from raw logs to a report and Rerun timelines."""
    refuse_missing(trials)
    from granite_lab.api.trials import with_excluded
    from granite_lab.discovery.as_json import finding_as_json
    from granite_lab.reporting.terminal import show_study
    from granite_lab.running.folder import claimed
    from granite_lab.running.guard import Guard, tell
    from granite_lab.running.search import MODEL
    from granite_lab.study import Options, record, write
    from granite_lab.study import study as run

    execution = execution_of(jobs, scheduler, cache)
    if check is not None:
        _verify(check, trials or [], execution, quiet=quiet, as_json=as_json)
        return
    choice = chosen(trials, robot, soil, column_map)
    files, out = choice.files, out or choice.out / "study"
    options = Options(
        robot=choice.robot, soil=choice.soil, column_map=choice.column_map, model=model, effects=effects,
        topics=tuple(topics_of(topic).items()), tolerance=tolerance, latency=latency / 1e3,
        window=window_of(start, end),
    )  # fmt: skip
    with claimed(out), progress(quiet) as display:
        task = display.add_task("trials", total=len(files))
        searching = display.add_task("searching", total=None, visible=False)
        result = run(
            files,
            out.name,
            options,
            execution=execution,
            discover=discover,
            strict=strict,
            done=lambda _: display.advance(task),
            progress=partial(_tell, display, searching),
        )
        display.remove_task(searching)
        warn([f"{failure.trial}: left out: {failure.message}" for failure in result.failures])
        result = with_excluded(result, choice)
        guard = Guard(out)
        if recordings:
            task = display.add_task("recordings", total=len(result.trials) + 1)
            guard.run(
                "recordings", lambda: record(result, out / "recordings", done=lambda _: display.advance(task))
            )
        task = display.add_task("report", total=1)
        page = write(result, options, out, execution.jobs, guard)
        display.advance(task)
    tidy(execution)
    found = result.finding
    if as_json:
        model = out / MODEL if (out / MODEL).exists() else None
        print_json(
            {
                "schema": "granite-lab/study/1",
                "report": page,
                "trials": len(result.trials),
                "failures": result.failures,
                "a_theta": result.a_theta.a_theta if result.a_theta else None,
                "discovery": finding_as_json(found, model) if found is not None else None,
            }
        )
    else:
        show_study(result, console(), str(out), MODEL if (out / MODEL).exists() else None)
        if page is not None:
            console().print(f"report: {page}", soft_wrap=True)
    tell([*(found.failures if found is not None else ()), *guard.lines])


def _tell(display: Progress, task: TaskID, text: str, runs: int) -> None:
    display.update(task, description=f"{text}: simulations", completed=runs, visible=True)


def _verify(report: Path, logs: list[Path], execution: Execution, *, quiet: bool, as_json: bool) -> None:
    from granite_lab.verify import verify

    with progress(quiet) as display:
        task = display.add_task("computing again", total=None)
        found = verify(
            report,
            logs,
            execution=execution,
            done=lambda _: display.advance(task),
            progress=partial(_tell, display, task),
        )
    warn(found.notes)
    same = not found.differences
    if as_json:
        print_json({"schema": "granite-lab/verify/1", "same": same} | jsonable(found))
    elif same:
        count = f"{found.trials} log{'s' if found.trials > 1 else ''}"
        console().print(f"{found.report}: the same again, from {count}", soft_wrap=True)
    else:
        for line in found.differences[:MOST]:
            console().print(line, soft_wrap=True, markup=False)
        if len(found.differences) > MOST:
            console().print(f"and {len(found.differences) - MOST} more differences; --json lists all")
    if not same:
        raise LabError(
            f"{found.report}: differs in {len(found.differences)} places when computed again",
            "an input, the version or a library has changed, or the report was edited",
        )


def view(
    what: Annotated[Path, typer.Argument(help="A recording (.rrd), a report folder, or a log (CSV).")],
    trial: Annotated[str | None, typer.Option(help="With a report folder: the trial to open.")] = None,
    web: Annotated[bool, typer.Option("--web", help="Serve the viewer to a browser until Ctrl+C.")] = False,
    screenshot: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Save a picture instead; needs no display.")
    ] = None,
    at: Annotated[
        float | None,
        typer.Option(help="Seconds after the start of the command.", show_default="middle"),
    ] = None,
    robot: RobotOption = None,
    soil: SoilOption = None,
    column_map: MapOption = None,
) -> None:
    """Open a timeline in the Rerun viewer, in a browser, or as a picture."""
    from granite_lab.api.view import view as run

    run(
        what, trial=trial, web=web, screenshot=screenshot, at=at, robot=robot, soil=soil,
        column_map=column_map, tell=lambda address: typer.echo(f"{address}\nCtrl+C ends it."),
    )  # fmt: skip
    if screenshot is not None:
        typer.echo(screenshot)
