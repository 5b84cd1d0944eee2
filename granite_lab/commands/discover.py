"""`granite-lab discover`: where model and trials disagree, which effect is missing, and the model with it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from granite_lab.commands.common import (
    EffectsOption,
    JobsOption,
    JsonOption,
    MapOption,
    QuietOption,
    RobotOption,
    SoilOption,
    TopicOption,
    TrialsArgument,
    console,
    print_json,
    progress,
    topics_of,
    trial_files,
    warn,
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
    out: Annotated[Path, typer.Option(help="Folder of the report, finding.json and model.toml.")] = Path(
        "reports/discover"
    ),
    effects: EffectsOption = None,
    robot: RobotOption = None,
    soil: SoilOption = None,
    column_map: MapOption = None,
    topic: TopicOption = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the thresholds' bootstrap.")] = 0,
    strict: StrictOption = False,
    jobs: JobsOption = 0,
    scheduler: SchedulerOption = None,
    cache: CacheOption = True,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Find the physical effect that the model lacks; write the case for it and the model with it."""
    from granite_lab.api.search import source_of, split
    from granite_lab.discovery import finding_as_json
    from granite_lab.effects import library, load_effects
    from granite_lab.reporting import write_discovery
    from granite_lab.reporting.findings import show_finding
    from granite_lab.running.folder import claimed
    from granite_lab.running.options import Options
    from granite_lab.running.reading import to_search
    from granite_lab.running.search import save_found, search

    options = Options(
        robot=robot, soil=soil, column_map=column_map, effects=effects,
        topics=tuple(topics_of(topic).items()),
    )  # fmt: skip
    execution = execution_of(jobs, scheduler, cache)
    files = trial_files(trials)
    known = library() | (load_effects(effects) if effects is not None else {})
    read, motions = split(good(files, to_search(files, options, execution), strict))
    for trial in read:
        warn([f"{trial.name}: {line}" for line in trial.warnings])
    model = out / "model.toml"
    with claimed(out), progress(quiet) as display:
        task = display.add_task("discovering", total=None)
        finding = search(
            read,
            options,
            motions=motions,
            seed=seed,
            execution=execution,
            progress=lambda text, runs: display.update(
                task, description=f"{text}: simulations", completed=runs
            ),
        )
        display.update(task, description="writing the report")
        save_found(finding, options, read, model, motions)
        source = source_of(files, read, options, seed)
        page = write_discovery(finding, out, source, model=model, effects=known, jobs=execution.jobs)
    tidy(execution)
    if as_json:
        print_json(finding_as_json(finding, model))
    else:
        show_finding(finding, console())
        console().print(f"report: {page}", soft_wrap=True)
        console().print(f"model with what was found: {model}", soft_wrap=True)
