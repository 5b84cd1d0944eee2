"""The chain itself: log, estimate, fit, simulate, compare; then over all trials, up to the missing effect."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from granite_lab import __version__
from granite_lab.comparison.compare import compare
from granite_lab.effects import library, load_effects
from granite_lab.effects.model_file import load_model
from granite_lab.errors import EstimateError, LabError
from granite_lab.fitting import fit_a_theta, fit_k92
from granite_lab.fitting.fit import AThetaFit
from granite_lab.logs.named import name_of
from granite_lab.logs.trial import InputFile, Trial
from granite_lab.model.effect import Active
from granite_lab.parameters import Soil, load_soil
from granite_lab.parameters.catalogue import in_force
from granite_lab.reporting.content import Failure, Source, StudyResult, TrialResult, command_of
from granite_lab.running import Execution, Options, each_trial
from granite_lab.running.fingerprint import code, fingerprint
from granite_lab.running.guard import Guard, tell
from granite_lab.running.options import NOTHING_SAID
from granite_lab.running.reading import ingest
from granite_lab.running.search import save_found, search

EXCLUDED = "excluded: "
"""How the reason of a trial that `granite-lab.toml` excludes begins in a report."""

__all__ = [
    "EXCLUDED",
    "Options",
    "analyse",
    "each_trial",
    "ground",
    "over_trials",
    "record",
    "study",
    "write",
]


def analyse(path: Path, options: Options) -> TrialResult:
    """Take one trial through the whole chain.

    Raises:
        LabError: any stage could not do its work; the message says which and why.
    """
    trial, robot, motion = ingest(path, options)
    soil, effects = ground(trial, options)
    fit = fit_k92(motion, trial, robot, soil, effects=effects)
    return TrialResult(trial, compare(motion, trial, fit, robot, soil, effects=effects))


def ground(trial: Trial, options: Options) -> tuple[Soil, tuple[Active, ...]]:
    """Return the soil of a trial and the effects that are switched on."""
    model = load_model(options.model, options.effects) if options.model else None
    soil = options.soil or (model.soil if model else None) or trial.info.soil or "dry_sand"
    return load_soil(soil), model.effects if model else ()


def study(
    paths: Sequence[Path],
    name: str,
    options: Options = NOTHING_SAID,
    *,
    jobs: int = 0,
    execution: Execution | None = None,
    discover: bool = False,
    strict: bool = False,
    done: Callable[[Path], None] = lambda _: None,
    progress: Callable[[str, int], None] = lambda *_: None,
) -> StudyResult:
    """Run the chain over trials; the order in which they are given does not matter.

    Args:
        paths: the logs.
        name: of the report.
        options: for all of them.
        jobs: number of processes; 0 means one per core.
        execution: where the work is done and what is remembered, in place of `jobs`.
        discover: search for a missing effect in the end.
        strict: a trial or a search that fails ends the study.
        done: called with each path once it is finished.
        progress: of that search, as in `discovery.discover`.

    Raises:
        LabError: no trial went through; it is that of the first. With `strict`, one did not.
    """
    paths = sorted(paths, key=lambda path: (name_of(path), str(path)))
    how = execution or Execution(jobs)
    outcomes = each_trial(analyse, paths, options, execution=how, done=done)
    trials = tuple(o for o in outcomes if isinstance(o, TrialResult))
    errors = [(path, o) for path, o in zip(paths, outcomes, strict=True) if isinstance(o, LabError)]
    if errors and (strict or not trials):
        raise errors[0][1]
    failures = tuple(Failure(name_of(path), error.message, error.hint) for path, error in errors)
    source = source_of("study", paths, trials, options, discover)
    result = StudyResult(name, trials, failures, over_trials(trials), source)
    if not discover:
        return result
    result = _searched(result, options, how, progress)
    if strict and result.unsearched:
        raise EstimateError(result.unsearched, "--no-discover leaves the search out")
    return result


def _searched(
    result: StudyResult,
    options: Options,
    execution: Execution,
    progress: Callable[[str, int], None] = lambda *_: None,
) -> StudyResult:
    """Return the study with what a search for a missing effect found, or with the reason why not."""
    trials = [r.trial for r in result.trials]
    motions = [r.comparison.motion for r in result.trials]
    try:
        finding = search(trials, options, motions=motions, execution=execution, progress=progress)
    except LabError as error:
        return replace(result, unsearched=error.message)
    return replace(result, finding=finding)


def over_trials(trials: Sequence[TrialResult]) -> AThetaFit | None:
    """Fit a_θ over trials; None where they do not allow it."""
    try:
        return fit_a_theta([trial.comparison.fit for trial in trials])
    except EstimateError:
        return None


def source_of(
    command: str,
    paths: Sequence[Path],
    trials: Sequence[TrialResult],
    options: Options,
    discover: bool | None = None,
) -> Source:
    """Return where results come from.

    Args:
        command: of the command line.
        paths: all logs, those that failed too.
        trials: those that went through.
        options: that were in force.
        discover: whether a search for a missing effect was asked for; None where that is no question.
    """
    first = trials[0]
    rows = in_force(
        options.robot or first.trial.info.robot or "granite", options.soil or first.comparison.run.soil.name
    )
    given = options.given() + ((("discover", "no"),) if discover is False else ())
    used = [file for trial in trials for file in trial.trial.inputs]
    known = {file.path for file in used}
    others = [*(path for path in paths if path not in known), *options.files()]
    inputs = [*used, *(InputFile(path, fingerprint(path)) for path in others)]
    return Source(
        version=__version__,
        command=command_of(command, paths, options.given()),
        inputs=tuple(dict.fromkeys(inputs)),
        parameters=tuple((f"{p.group}.{p.key}", f"{p.value:g}", p.unit, p.origin) for p in rows),
        options=given,
        code=code(search=True),
    )


def write(
    result: StudyResult, options: Options, folder: Path, jobs: int = 1, guard: Guard | None = None
) -> Path | None:
    """Write the report of a study, and the model with what was found.

    Args:
        result: the study.
        options: of it.
        folder: to write into.
        jobs: number of processes that draw.
        guard: told what fails; without one that is an error in the end.

    Returns:
        the report's first page, None where it could not be written.

    Raises:
        LabError: without a guard, something could not be written.
    """
    from granite_lab.reporting import write_finding, write_report  # noqa: PLC0415, heavy

    own = guard or Guard(folder)
    finding, known, model = result.finding, None, None
    if finding is not None:
        trials = [r.trial for r in result.trials]
        motions = [r.comparison.motion for r in result.trials]
        known = library() | (load_effects(options.effects) if options.effects else {})
        saved = save_found(finding, options, trials, motions, own)
        model = saved.name if saved else None
        finding = replace(finding, failures=(*finding.failures, *own.lines))
        result = replace(result, finding=finding)
    page = own.run("report", partial(write_report, result, folder, model=model, effects=known, jobs=jobs))
    if page is None and finding is not None:
        own.run("finding", partial(write_finding, finding, folder, model))
        alone = replace(result, finding=None, unsearched="the search could not be shown; see finding.json")
        page = own.run("rest", partial(write_report, alone, folder, jobs=jobs))
    if guard is None:
        tell(own.lines)
    return page


def record(result: StudyResult, folder: Path, *, done: Callable[[str], None] = lambda _: None) -> list[Path]:
    """Write a Rerun recording of each trial and one of the whole study.

    Raises:
        LabError: a file cannot be written.
    """
    from granite_lab.reporting.recording import record_study, record_trial  # noqa: PLC0415, heavy

    paths = []
    for trial in result.trials:
        path = folder / f"{trial.trial.name}.rrd"
        paths.append(record_trial(trial.trial, trial.comparison, path, finding=result.finding))
        done(trial.trial.name)
    for path in set(folder.glob("*.rrd")) - {folder / "study.rrd", *paths}:
        path.unlink()  # of a trial that is no longer in the study
    paths.append(record_study(result, folder / "study.rrd", finding=result.finding))
    done("study")
    return paths
