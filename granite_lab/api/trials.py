"""`fit_k92`, `fit_a_theta`, `compare`, `study`, `record`, `report`: the model held against trials."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from granite_lab.api.calls import checked
from granite_lab.api.options import execution_of, options_of
from granite_lab.api.project import Chosen, choose
from granite_lab.api.records import Records, sifted
from granite_lab.comparison.record import Comparison
from granite_lab.errors import UsageError
from granite_lab.fitting import fit_a_theta as fit_over_trials
from granite_lab.fitting import published_fit
from granite_lab.fitting.fit import AThetaFit, K92Fit
from granite_lab.inference.constants import LATENCY_LIMIT, TOLERANCE
from granite_lab.reporting.content import Failure, StudyResult, TrialResult
from granite_lab.running import Execution
from granite_lab.study import EXCLUDED, Options, analyse, each_trial, write
from granite_lab.study import record as record_all
from granite_lab.study import study as run

Logs = str | Path | Sequence[str | Path]


def _analysed(
    choice: Chosen, options: Options, execution: Execution, strict: bool, done: Callable[[Path], None]
) -> tuple[list[TrialResult], list[tuple[str, str]]]:
    """Return the results, and the trials that are left out with the reason."""
    outcomes = each_trial(analyse, choice.files, options, execution=execution, done=done)
    results, failures = sifted(choice.files, outcomes, strict=strict)
    return results, [*((item.trial, item.reason) for item in choice.left_out), *failures]


def with_excluded(result: StudyResult, choice: Chosen) -> StudyResult:
    """Return a study that also lists the trials that `granite-lab.toml` excludes, with the reason."""
    excluded = (Failure(item.trial, f"{EXCLUDED}{item.reason}", "") for item in choice.left_out)
    return replace(result, failures=(*result.failures, *excluded))


@checked
def fit_k92(
    logs: Logs,
    *,
    robot: str | Path | None = None,
    soil: str | Path | None = None,
    column_map: str | Path | None = None,
    topics: Mapping[str, str] | None = None,
    window: tuple[float, float] | None = None,
    model: str | Path | None = None,
    effects: str | Path | None = None,
    strict: bool = False,
    jobs: int = 0,
    scheduler: str | None = None,
    cache: bool = True,
    done: Callable[[Path], None] = lambda _: None,
) -> Records[K92Fit]:
    """Fit k_92 of each trial: by the steady slip ratio, as in the paper, and by the whole trajectory.

    Args:
        logs: paths of logs, or of folders with logs.
        robot, soil: names or files; without them the log says which.
        column_map: name or file of a column map.
        topics: of bags, ``imu``, ``joints`` and ``odom`` to the name of a topic.
        window: begin and end of what is taken of every log [s of the log], infinite where open.
        model: model.toml, the paper's model with effects switched on.
        effects: your own effect file (.py) that the model needs. It is run: use only code you trust.
        strict: a trial that fails is an error; else it is left out and stands in `left_out`.
        jobs: number of processes; 0 means one per core.
        scheduler: address of a Dask scheduler that does the work.
        cache: remember results, and take those that still hold.
        done: called with each path once it is finished.

    Returns:
        one fit a trial; the table has a row for each.

    Raises:
        InputError: a log or file cannot be used.
        EstimateError: an estimate or fit cannot be had.
    """
    choice = choose(logs, robot, soil, column_map)
    options = options_of(
        robot=choice.robot, soil=choice.soil, column_map=choice.column_map, topics=topics, model=model,
        effects=effects, window=window,
    )  # fmt: skip
    found, left_out = _analysed(choice, options, execution_of(jobs, scheduler, cache), strict, done)
    return Records([result.comparison.fit for result in found], None, left_out)


@checked
def fit_a_theta(
    logs: Logs | Sequence[K92Fit] | None = None,
    *,
    published: bool = False,
    robot: str | Path | None = None,
    soil: str | Path | None = None,
    column_map: str | Path | None = None,
    topics: Mapping[str, str] | None = None,
    window: tuple[float, float] | None = None,
    model: str | Path | None = None,
    effects: str | Path | None = None,
    strict: bool = False,
    jobs: int = 0,
    scheduler: str | None = None,
    cache: bool = True,
    done: Callable[[Path], None] = lambda _: None,
) -> AThetaFit:
    """Estimate a_θ of k_92 = exp(-a_θ v) over trials, beside the paper's 4.919 and rival laws.

    Args:
        logs: paths of logs or of folders, or the fits of `fit_k92`.
        published: use Table 3 of the paper instead of trials.
        robot, soil, column_map, topics, window, model, effects, strict, jobs, scheduler,
            cache, done: as in `fit_k92`.

    Returns:
        the fit; its table has a row for each trial.

    Raises:
        UsageError: both or neither of `logs` and `published`.
        InputError, EstimateError: as in `fit_k92`, or the trials do not allow the fit.
    """
    if published == (logs is not None):
        raise UsageError("fit_a_theta takes trials or published=True", "give one of the two")
    if logs is None:
        return published_fit()
    if not isinstance(logs, (str, Path)) and all(isinstance(item, K92Fit) for item in logs) and len(logs):
        return fit_over_trials([item for item in logs if isinstance(item, K92Fit)])
    paths = logs if isinstance(logs, (str, Path)) else [x for x in logs if isinstance(x, (str, Path))]
    fits = fit_k92(
        paths, robot=robot, soil=soil, column_map=column_map, topics=topics, model=model, effects=effects,
        strict=strict, jobs=jobs, scheduler=scheduler, cache=cache, done=done, window=window,
    )  # fmt: skip
    fit = fit_over_trials(list(fits))
    left_out = (f"{trial} left out: {reason}" for trial, reason in fits.left_out)
    return replace(fit, notes=(*fit.notes, *left_out))


@checked
def compare(
    logs: Logs,
    *,
    out: str | Path | None = None,
    robot: str | Path | None = None,
    soil: str | Path | None = None,
    column_map: str | Path | None = None,
    topics: Mapping[str, str] | None = None,
    window: tuple[float, float] | None = None,
    model: str | Path | None = None,
    effects: str | Path | None = None,
    strict: bool = False,
    jobs: int = 0,
    scheduler: str | None = None,
    cache: bool = True,
    done: Callable[[Path], None] = lambda _: None,
) -> Records[Comparison]:
    """Hold measurement against simulation: velocity, wheel speed, slip, torques and pitch.

    Args:
        logs: paths of logs, or of folders with logs.
        out: folder for tables and figures; without it nothing is written.
        robot, soil, column_map, topics, window, model, effects, strict, jobs, scheduler,
            cache, done: as in `fit_k92`.

    Returns:
        one comparison a trial; the table has a row for each trial, channel and phase.

    Raises:
        InputError, EstimateError: as in `fit_k92`.
        LabError: a file cannot be written.
    """
    choice = choose(logs, robot, soil, column_map)
    options = options_of(
        robot=choice.robot, soil=choice.soil, column_map=choice.column_map, topics=topics, model=model,
        effects=effects, window=window,
    )  # fmt: skip
    results, left_out = _analysed(choice, options, execution_of(jobs, scheduler, cache), strict, done)
    found = [result.comparison for result in results]
    if out is not None:
        from granite_lab.reporting import write_comparison  # noqa: PLC0415, heavy

        write_comparison(found, Path(out))
    return Records(found, lambda item: item.motion.trial, left_out)


@checked
def study(
    logs: Logs,
    *,
    out: str | Path | None = None,
    name: str = "study",
    discover: bool = True,
    recordings: bool = True,
    robot: str | Path | None = None,
    soil: str | Path | None = None,
    column_map: str | Path | None = None,
    topics: Mapping[str, str] | None = None,
    window: tuple[float, float] | None = None,
    model: str | Path | None = None,
    effects: str | Path | None = None,
    tolerance: float = TOLERANCE,
    latency: float = LATENCY_LIMIT,
    strict: bool = False,
    jobs: int = 0,
    scheduler: str | None = None,
    cache: bool = True,
    done: Callable[[Path], None] = lambda _: None,
) -> StudyResult:
    """Run the whole chain over trials: estimate, fit, simulate, compare, a_θ, and the missing effect.

    A trial that cannot be used stands in `failures` and does not end the study.

    Args:
        logs: paths of logs, or of folders with logs.
        out: folder for the report; without it nothing is written.
        name: of the report, unless `out` gives it.
        discover: search for an effect that the model lacks.
        recordings: with `out`, also write a Rerun recording of each trial.
        robot, soil, column_map, topics, window, model, effects, strict, jobs, scheduler,
            cache, done: as in `fit_k92`.
        tolerance, latency: of that search, as in `discover`.

    Returns:
        the results; the table has a row for each trial.

    Raises:
        LabError: no trial went through, or a file cannot be written.
    """
    choice = choose(logs, robot, soil, column_map)
    options = options_of(
        robot=choice.robot, soil=choice.soil, column_map=choice.column_map, topics=topics, model=model,
        effects=effects, tolerance=tolerance, latency=latency, window=window,
    )  # fmt: skip
    folder = None if out is None else Path(out)
    execution = execution_of(jobs, scheduler, cache)
    result = run(
        choice.files, folder.name if folder else name, options, execution=execution, discover=discover,
        strict=strict, done=done,
    )  # fmt: skip
    result = with_excluded(result, choice)
    if folder is not None:
        if recordings:
            record(result, folder / "recordings")
        write(result, options, folder, jobs)
    return result


@checked
def record(result: StudyResult, folder: str | Path) -> tuple[Path, ...]:
    """Write a Rerun recording of each trial of a study, and one of the whole; return their paths.

    Raises:
        LabError: a file cannot be written.
    """
    return tuple(record_all(result, Path(folder)))


@checked
def report(result: StudyResult, folder: str | Path) -> Path:
    """Write the report of a study; return its first page.

    Raises:
        LabError: a file cannot be written.
    """
    from granite_lab.reporting import write_report  # noqa: PLC0415, heavy

    return write_report(result, Path(folder), model="model.toml" if result.finding is not None else None)
