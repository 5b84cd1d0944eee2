"""`granite-lab fit-k92`, `fit-atheta` and `compare`: the model held against trials."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
from granite_lab.errors import LabError, UsageError

if TYPE_CHECKING:
    from granite_lab.fitting.fit import AThetaFit, K92Fit
    from granite_lab.reporting.content import TrialResult

SAMPLES = Path("data/samples")


def register(app: typer.Typer) -> None:
    """Add the commands to the app."""
    app.command("fit-k92")(fit_k92)
    app.command("fit-atheta")(fit_atheta)
    app.command("compare")(compare)


def analysed(
    files: list[Path],
    *,
    robot: str | None,
    soil: str | None,
    column_map: str | None,
    model: Path | None,
    effects: Path | None,
    jobs: int,
    quiet: bool,
) -> list[TrialResult]:
    """Take trials through the chain, with progress; the first trouble ends it.

    Raises:
        LabError: of the first trial that could not be used.
    """
    from granite_lab.study import Options, analyse, each_trial

    options = Options(robot=robot, soil=soil, column_map=column_map, model=model, effects=effects)
    with progress(quiet) as display:
        task = display.add_task("fitting", total=len(files))
        outcomes = each_trial(analyse, files, options, jobs=jobs, done=lambda _: display.advance(task))
    results = []
    for outcome in outcomes:
        if isinstance(outcome, LabError):
            raise outcome
        warn([f"{outcome.trial.name}: {line}" for line in outcome.comparison.motion.warnings])
        results.append(outcome)
    return results


def fit_k92(
    trials: TrialsArgument = None,
    robot: RobotOption = None,
    soil: SoilOption = None,
    column_map: MapOption = None,
    model: ModelOption = None,
    effects: EffectsOption = None,
    jobs: JobsOption = 0,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Fit k_92 of each trial: by the steady slip ratio, as in the paper, and by the whole trajectory."""
    from granite_lab.reporting.terminal import show_k92_fits

    results = analysed(
        trial_files(trials), robot=robot, soil=soil, column_map=column_map, model=model, effects=effects,
        jobs=jobs, quiet=quiet,
    )  # fmt: skip
    fits = [result.comparison.fit for result in results]
    if as_json:
        print_json({"schema": "granite-lab/fit-k92/1", "fits": [fit_as_json(fit) for fit in fits]})
    else:
        show_k92_fits(fits, console())


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
    model: ModelOption = None,
    effects: EffectsOption = None,
    jobs: JobsOption = 0,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Estimate a_θ of k_92 = exp(-a_θ v) over trials, beside the paper's 4.919 and rival laws."""
    from granite_lab.fitting import fit_a_theta, published_fit
    from granite_lab.reporting.terminal import show_a_theta

    if published and trials:
        raise UsageError("--published takes no trials", "leave out one of the two")
    if published:
        fit = published_fit()
    else:
        files = trial_files(trials, SAMPLES)
        results = analysed(
            files, robot=robot, soil=soil, column_map=column_map, model=model, effects=effects,
            jobs=jobs, quiet=quiet,
        )  # fmt: skip
        fit = fit_a_theta([result.comparison.fit for result in results])
    if as_json:
        print_json(a_theta_as_json(fit))
    else:
        show_a_theta(fit, console())


def a_theta_as_json(fit: AThetaFit) -> dict[str, Any]:
    """Return a fit of a_θ as it stands in JSON."""
    return {
        "schema": "granite-lab/fit-atheta/1",
        "a_theta": fit.a_theta.as_json() | {"ci95": fit.ci95},
        "log_linear": fit.log_linear,
        "ordinary": fit.ordinary,
        "scatter": fit.scatter,
        "published": fit.published,
        "agrees": fit.agrees,
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
    model: ModelOption = None,
    effects: EffectsOption = None,
    out: Annotated[Path, typer.Option(help="Folder for tables and figures.")] = Path("reports/compare"),
    jobs: JobsOption = 0,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Hold measurement against simulation: velocity, wheel speed, slip, torques and pitch."""
    from granite_lab.reporting import write_comparison
    from granite_lab.reporting.terminal import show_misfits

    results = analysed(
        trial_files(trials), robot=robot, soil=soil, column_map=column_map, model=model, effects=effects,
        jobs=jobs, quiet=quiet,
    )  # fmt: skip
    comparisons = [result.comparison for result in results]
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
            }
        )
    else:
        show_misfits(comparisons, console())
        console().print(f"figures and tables: {out}", soft_wrap=True)
