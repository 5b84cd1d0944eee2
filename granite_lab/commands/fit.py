"""`granite-lab fit-k92`, `fit-atheta` and `compare`: the model held against trials."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from granite_lab.commands.common import (
    EffectsOption,
    FromOption,
    JobsOption,
    JsonOption,
    MapOption,
    ModelOption,
    QuietOption,
    RobotOption,
    SoilOption,
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
from granite_lab.errors import UsageError

if TYPE_CHECKING:
    from granite_lab.api.project import Chosen
    from granite_lab.fitting.fit import AThetaFit, K92Fit
    from granite_lab.reporting.content import TrialResult
    from granite_lab.running import Execution, Options

TableOption = Annotated[Path | None, typer.Option(help="Write the table here, too (CSV).")]


def register(app: typer.Typer) -> None:
    """Add the commands to the app."""
    app.command("fit-k92")(fit_k92)
    app.command("fit-atheta")(fit_atheta)
    app.command("compare")(compare)


def analysed(
    files: Sequence[Path], options: Options, execution: Execution, *, strict: bool, quiet: bool
) -> list[TrialResult]:
    """Take trials through the chain, with progress; one that fails is told and left out.

    Raises:
        LabError: of the first trial that could not be used, if `strict` or if none could.
    """
    from granite_lab.study import analyse, each_trial

    with progress(quiet) as display:
        task = display.add_task("fitting", total=len(files))
        outcomes = each_trial(
            analyse, files, options, execution=execution, done=lambda _: display.advance(task)
        )
    tidy(execution)
    results: list[TrialResult] = good(files, outcomes, strict)
    for result in results:
        warn([f"{result.trial.name}: {line}" for line in result.comparison.motion.warnings])
    return results


def options_of(
    choice: Chosen,
    topic: list[str] | None,
    model: Path | None,
    effects: Path | None,
    window: tuple[float, float] | None,
) -> Options:
    """Return what the options of a command, and the file beside the logs, say about the trials."""
    from granite_lab.study import Options

    topics = tuple(topics_of(topic).items())
    return Options(
        robot=choice.robot, soil=choice.soil, column_map=choice.column_map, topics=topics, model=model,
        effects=effects, window=window,
    )  # fmt: skip


def provenance(
    command: str, files: Sequence[Path], results: list[TrialResult], options: Options
) -> dict[str, Any]:
    """Return where results come from, as it stands in JSON."""
    from granite_lab.reporting.json_report import provenance_as_json
    from granite_lab.study import source_of

    return provenance_as_json(source_of(command, files, results, options))


def fit_k92(
    trials: TrialsArgument = None,
    robot: RobotOption = None,
    soil: SoilOption = None,
    column_map: MapOption = None,
    topic: TopicOption = None,
    start: FromOption = None,
    end: ToOption = None,
    model: ModelOption = None,
    effects: EffectsOption = None,
    strict: StrictOption = False,
    jobs: JobsOption = 0,
    scheduler: SchedulerOption = None,
    cache: CacheOption = True,
    out: TableOption = None,
    verbose: Annotated[bool, typer.Option("--verbose", help="Print the notes of the fits.")] = False,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Fit k_92 of each trial: by the steady slip ratio, as in the paper, and by the whole trajectory."""
    refuse_missing(trials)
    from granite_lab.files import write_text
    from granite_lab.reporting.tables import k92_table
    from granite_lab.reporting.terminal import show_k92_fits

    choice = chosen(trials, robot, soil, column_map)
    files, options = choice.files, options_of(choice, topic, model, effects, window_of(start, end))
    execution = execution_of(jobs, scheduler, cache)
    results = analysed(files, options, execution, strict=strict, quiet=quiet)
    fits = [result.comparison.fit for result in results]
    if out is not None:
        write_text(out, k92_table(fits).to_csv())
    if as_json:
        print_json(
            {
                "schema": "granite-lab/fit-k92/1",
                "fits": [fit_as_json(fit) for fit in fits],
                "provenance": provenance("fit-k92", files, results, options),
            }
            | files_of(choice)
        )
    else:
        show_k92_fits(fits, console(), notes=verbose)


def fit_as_json(fit: K92Fit) -> dict[str, Any]:
    """Return a fit as it stands in JSON."""
    return {
        "trial": fit.trial,
        "virtual": fit.virtual,
        "variant_mps": fit.variant.velocity,
        "k92": fit.k92.as_json(),
        "k92_trajectory": fit.k92_trajectory.as_json(),
        "slip_ratio": {
            "measured": fit.slip_measured.value,
            "measured_std": fit.slip_measured.std,
            "simulated": fit.slip_simulated,
        },
        "status": fit.status,
        "status_trajectory": fit.status_trajectory,
        "notes": list(fit.notes),
    }


def fit_atheta(
    trials: TrialsArgument = None,
    published: Annotated[bool, typer.Option("--published", help="Use Table 3 of the paper.")] = False,
    robot: RobotOption = None,
    soil: SoilOption = None,
    column_map: MapOption = None,
    topic: TopicOption = None,
    start: FromOption = None,
    end: ToOption = None,
    model: ModelOption = None,
    effects: EffectsOption = None,
    strict: StrictOption = False,
    jobs: JobsOption = 0,
    scheduler: SchedulerOption = None,
    cache: CacheOption = True,
    out: TableOption = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Estimate a_θ of k_92 = exp(-a_θ v) over trials, beside the paper's 4.919 and rival laws."""
    refuse_missing(trials)
    from granite_lab.files import write_table
    from granite_lab.fitting import fit_a_theta, published_fit
    from granite_lab.reporting.answers import a_theta_of
    from granite_lab.reporting.grid import say
    from granite_lab.reporting.terminal import show_a_theta

    if published and trials:
        raise UsageError("--published takes no trials", "leave out one of the two")
    origin: dict[str, Any] = {"provenance": None}
    virtual = False
    if published:
        fit = published_fit()
    else:
        choice = chosen(trials, robot, soil, column_map)
        files, options = choice.files, options_of(choice, topic, model, effects, window_of(start, end))
        execution = execution_of(jobs, scheduler, cache)
        results = analysed(files, options, execution, strict=strict, quiet=quiet)
        origin = {"provenance": provenance("fit-atheta", files, results, options)} | files_of(choice)
        fit = fit_a_theta([result.comparison.fit for result in results])
        virtual = any(result.trial.info.virtual for result in results)
    if out is not None:
        table = fit.to_frame()
        write_table(out, table.assign(data="virtual") if virtual else table)
    if as_json:
        print_json(a_theta_as_json(fit) | {"agrees": a_theta_of(fit)[1]} | origin)
    else:
        shown = console()
        show_a_theta(fit, shown)
        what = "Rows of Table 3" if published else "Virtual trials" if virtual else "Trials"
        say(shown, f"{what}: {', '.join(point[0] for point in fit.points)}.")


def a_theta_as_json(fit: AThetaFit) -> dict[str, Any]:
    """Return a fit of a_θ as it stands in JSON."""
    return {
        "schema": "granite-lab/fit-atheta/1",
        "a_theta": fit.a_theta.as_json() | {"ci95": fit.ci95},
        "log_linear": fit.log_linear,
        "ordinary": fit.ordinary,
        "scatter": fit.scatter,
        "published": fit.published,
        "laws": fit.laws,
        "points": [
            {"trial": trial, "variant_mps": v, "k92": k.as_json(), "slip_ratio": slip.as_json()}
            for trial, v, k, slip in fit.points
        ],
        "notes": fit.notes,
    }


def compare(
    trials: TrialsArgument = None,
    robot: RobotOption = None,
    soil: SoilOption = None,
    column_map: MapOption = None,
    topic: TopicOption = None,
    start: FromOption = None,
    end: ToOption = None,
    model: ModelOption = None,
    effects: EffectsOption = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for tables and figures.", show_default="reports/compare")
    ] = None,
    strict: StrictOption = False,
    jobs: JobsOption = 0,
    scheduler: SchedulerOption = None,
    cache: CacheOption = True,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Hold measurement against simulation: velocity, wheel speed, slip, torques and pitch."""
    refuse_missing(trials)
    from granite_lab.reporting import write_comparison
    from granite_lab.reporting.terminal import show_misfits

    choice = chosen(trials, robot, soil, column_map)
    files, options = choice.files, options_of(choice, topic, model, effects, window_of(start, end))
    execution = execution_of(jobs, scheduler, cache)
    results = analysed(files, options, execution, strict=strict, quiet=quiet)
    comparisons = [result.comparison for result in results]
    out = out or choice.out / "compare"
    written = write_comparison(comparisons, out)
    if as_json:
        print_json(
            {
                "schema": "granite-lab/compare/1",
                "trials": [
                    {
                        "trial": c.motion.trial,
                        "virtual": c.motion.virtual,
                        "variant_mps": c.fit.variant.velocity,
                        "misfits": c.misfits,
                    }
                    for c in comparisons
                ],
                "files": written,
                "provenance": provenance("compare", files, results, options),
            }
            | files_of(choice)
        )
    else:
        show_misfits(comparisons, console())
        console().print(f"figures and tables: {out}", soft_wrap=True)
