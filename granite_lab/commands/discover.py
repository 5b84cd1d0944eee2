"""`granite-lab discover`: where model and trials disagree, which effect is missing, and the model with it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from granite_lab.commands.common import (
    EffectsOption,
    JobsOption,
    JsonOption,
    MapOption,
    QuietOption,
    RobotOption,
    SoilOption,
    TrialsArgument,
    console,
    jsonable,
    print_json,
    progress,
    trial_files,
    warn,
)
from granite_lab.errors import LabError

if TYPE_CHECKING:
    from granite_lab.discovery import Finding
    from granite_lab.logs.trial import Trial
    from granite_lab.model.effect import Effect
    from granite_lab.study import Options


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command("discover")(discover)


def _read(path: Path, options: Options) -> Trial:
    from granite_lab.logs import read_trial

    return read_trial(path, map=options.column_map, robot=options.robot)


def discover(
    trials: TrialsArgument = None,
    out: Annotated[Path, typer.Option(help="Folder for finding.json and model.toml.")] = Path(
        "reports/discover"
    ),
    effects: EffectsOption = None,
    robot: RobotOption = None,
    soil: SoilOption = None,
    column_map: MapOption = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the thresholds' bootstrap.")] = 0,
    jobs: JobsOption = 0,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Find the physical effect that the model lacks, and write the model with it."""
    import json
    import os

    from granite_lab.discovery import discover as search
    from granite_lab.discovery import finding_as_json
    from granite_lab.effects import library, load_effects
    from granite_lab.files import write_text
    from granite_lab.parameters import load_robot, load_soil
    from granite_lab.reporting.findings import show_finding
    from granite_lab.study import Options, each_trial

    candidates: dict[str, Effect] = library() | (load_effects(effects) if effects else {})
    options = Options(robot=robot, soil=soil, column_map=column_map)
    read: list[Trial] = []
    for outcome in each_trial(_read, trial_files(trials), options, jobs=1):
        if isinstance(outcome, LabError):
            raise outcome
        read.append(outcome)
        warn([f"{outcome.name}: {line}" for line in outcome.warnings])
    names = robot or read[0].info.robot or "granite", soil or read[0].info.soil or "dry_sand"
    with progress(quiet) as display:
        task = display.add_task("discovering", total=None)
        finding = search(
            read,
            load_robot(names[0]),
            load_soil(names[1]),
            effects=candidates,
            seed=seed,
            jobs=jobs or os.cpu_count() or 1,
            progress=lambda text, runs: display.update(
                task, description=f"{text}: simulations", completed=runs
            ),
        )
    model = out / "model.toml"
    _save(finding, names, read, model)
    document = jsonable(finding_as_json(finding, model))
    write_text(out / "finding.json", json.dumps(document, indent=2, ensure_ascii=False) + "\n")
    if as_json:
        print_json(document)
    else:
        show_finding(finding, console())
        console().print(f"model with what was found: {model}", soft_wrap=True)


def _save(finding: Finding, names: tuple[str, str], trials: list[Trial], path: Path) -> None:
    """Write the baseline with the physical effects that were named."""
    from granite_lab import __version__
    from granite_lab.effects.model_file import FittedEffect, ModelFile, save_model
    from granite_lab.estimate import Estimate
    from granite_lab.parameters import load_paper

    active = {item.id: item for item in finding.active}
    fitted = []
    for found in finding.effects:
        if found.empirical:
            continue
        item = active[found.id]
        std = {p.name: p.estimate.std for p in found.parameters}
        values = {name: Estimate(v, std.get(name, 0.0)) for name, v in item.as_dict().items()}
        fitted.append(FittedEffect(item.effect, values, found.twins))
    provenance: dict[str, Any] = {
        "version": __version__,
        "seed": finding.seed,
        "verdict": finding.verdict,
        "virtual": finding.virtual,
        "inputs": [f"{file.path.name} sha256 {file.sha256}" for t in trials for file in t.inputs],
    }
    law = Estimate(load_paper().a_theta)
    save_model(ModelFile(names[0], names[1], "exponential", law, tuple(fitted), provenance), path)
