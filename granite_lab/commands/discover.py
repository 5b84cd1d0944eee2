"""`granite-lab discover`: where model and trials disagree, which effect is missing, and the model with it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from granite_lab.commands.common import (
    EffectsOption,
    FromOption,
    JobsOption,
    JsonOption,
    LatencyOption,
    MapOption,
    QuietOption,
    RobotOption,
    SoilOption,
    ToleranceOption,
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
from granite_lab.commands.running import (
    CacheOption,
    SchedulerOption,
    StrictOption,
    execution_of,
    good,
    tidy,
)


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command("discover")(discover)


def discover(
    trials: TrialsArgument = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder of the report, finding.json and model.toml.", show_default="reports/discover"
        ),
    ] = None,
    effects: EffectsOption = None,
    robot: RobotOption = None,
    soil: SoilOption = None,
    column_map: MapOption = None,
    topic: TopicOption = None,
    start: FromOption = None,
    end: ToOption = None,
    tolerance: ToleranceOption = 0.02,
    latency: LatencyOption = 20.0,
    strict: StrictOption = False,
    jobs: JobsOption = 0,
    scheduler: SchedulerOption = None,
    cache: CacheOption = True,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Find the physical effect that the model lacks; write the case for it and the model with it."""
    refuse_missing(trials)
    from granite_lab.api.search import with_left_out, write_found
    from granite_lab.discovery.as_json import finding_as_json
    from granite_lab.reporting.terminal import show_finding
    from granite_lab.running.folder import claimed
    from granite_lab.running.guard import tell
    from granite_lab.running.options import Options
    from granite_lab.running.reading import to_search
    from granite_lab.running.search import search

    choice = chosen(trials, robot, soil, column_map)
    files, out = choice.files, out or choice.out / "discover"
    options = Options(
        robot=choice.robot, soil=choice.soil, column_map=choice.column_map, effects=effects,
        topics=tuple(topics_of(topic).items()), tolerance=tolerance, latency=latency / 1e3,
        window=window_of(start, end),
    )  # fmt: skip
    execution = execution_of(jobs, scheduler, cache)
    read = good(files, to_search(files, options, execution), strict)
    clean, motions = [trial for trial, _ in read], [motion for _, motion in read]
    for trial in clean:
        warn([f"{trial.name}: {line}" for line in trial.warnings])
    with claimed(out), progress(quiet) as display:
        task = display.add_task("discovering", total=None)
        finding = search(
            clean,
            options,
            motions=motions,
            execution=execution,
            progress=lambda text, runs: display.update(
                task, description=f"{text}: simulations", completed=runs
            ),
        )
        finding = with_left_out(finding, choice)
        display.update(task, description="writing the report")
        found, page, model = write_found(finding, options, clean, motions, out, files, execution.jobs)
    tidy(execution)
    if as_json:
        print_json(finding_as_json(found, model) | files_of(choice))
    else:
        show_finding(found, console(), str(out), model)
        for what, path in (("report", page), ("model with what was found", model)):
            if path is not None:
                console().print(f"{what}: {path}", soft_wrap=True)
    tell(found.failures)
