"""The chain itself: log, estimate, fit, simulate, compare; then over all trials, up to the missing effect."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from granite_lab import __version__, fitting, reporting
from granite_lab.comparison.compare import compare
from granite_lab.effects import library
from granite_lab.effects.model_file import load_model
from granite_lab.errors import EstimateError, LabError
from granite_lab.estimation.motion import Motion
from granite_lab.fitting.fit import AThetaFit
from granite_lab.folders import distinct, replacing
from granite_lab.logs.trial import InputFile, Trial, name_of
from granite_lab.model.effect import Active
from granite_lab.parameters import load_soil
from granite_lab.parameters.catalogue import in_force
from granite_lab.processes import shared_out
from granite_lab.results import WHOLE, Source, StudyResult, TrialResult, command_of
from granite_lab.running import Execution, Options, each_trial, sifted
from granite_lab.running.cache import code, fingerprint
from granite_lab.running.each import HERE
from granite_lab.running.options import corrected
from granite_lab.running.output import Guard
from granite_lab.running.search import save_found, search


def analyse(path: Path, options: Options) -> TrialResult:
    """Take one trial through the whole chain.

    Raises:
        LabError: any stage could not do its work; the message says which and why.
    """
    trial, robot, motion = corrected(path, options)
    name, effects = ground(trial, options)
    soil = load_soil(name)
    fit = fitting.fit_k92(motion, trial, robot, soil, effects=effects)
    return TrialResult(trial, compare(motion, trial, fit, robot, soil, effects=effects))


def ground(trial: Trial, options: Options) -> tuple[str, tuple[Active, ...]]:
    """Return the soil of a trial, by name or path, and the effects that are switched on."""
    model = load_model(options.model, options.effects) if options.model else None
    soil = options.soil or (model.soil if model else None) or trial.info.soil or "dry_sand"
    return soil, model.effects if model else ()


def study(
    paths: Sequence[Path],
    name: str,
    options: Options = Options(),  # noqa: B008, frozen
    *,
    execution: Execution = HERE,
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
        execution: where the work is done and what is remembered.
        discover: search for a missing effect in the end.
        strict: a trial or a search that fails ends the study.
        done: called with each path once it is finished.
        progress: of that search, as in `discovery.discover`.

    Raises:
        LabError: no trial went through; it is that of the first. With `strict`, one did not.
    """
    paths = sorted(paths, key=lambda path: (name_of(path), str(path)))
    outcomes = each_trial(analyse, paths, options, execution=execution, done=done)
    results, failures = sifted(paths, outcomes, strict=strict)
    trials, motions = [r.trial for r in results], [r.comparison.motion for r in results]
    source = source_of("study", paths, trials, options, discover)
    result = StudyResult(name, tuple(results), failures, over_trials(results), source)
    if not discover:
        return result
    try:
        finding = search(trials, options, motions=motions, execution=execution, progress=progress)
    except LabError as error:
        if strict:
            raise EstimateError(error.message, "--no-discover leaves the search out") from None
        return replace(result, unsearched=error.message)
    return replace(result, finding=finding)


def over_trials(trials: Sequence[TrialResult]) -> AThetaFit | None:
    """Fit a_θ over trials; None where they do not allow it."""
    try:
        return fitting.fit_a_theta([trial.comparison.fit for trial in trials])
    except EstimateError:
        return None


def source_of(
    command: str,
    paths: Sequence[Path],
    trials: Sequence[Trial],
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
    rows = in_force(options.robot or trials[0].info.robot or "granite", ground(trials[0], options)[0])
    given = options.given() + ((("discover", "no"),) if discover is False else ())
    used = [file for trial in trials for file in trial.inputs]
    known = {file.path for file in used}
    others = [*(path for path in paths if path not in known), *options.files()]
    inputs = [*used, *(InputFile(path, fingerprint(path)) for path in others)]
    return Source(
        version=__version__,
        command=command_of(command, paths, options.given()),
        inputs=tuple(dict.fromkeys(inputs)),
        parameters=tuple((f"{p.group}.{p.key}", f"{p.value:g}", p.unit, p.origin) for p in rows),
        options=given,
        code=code(),
    )


@dataclass(frozen=True)
class Written:
    """A study or a search, and what was written of it.

    Attributes:
        result: the study; of a search alone one without trials. What could not be written is among the
            `failures` of its finding.
        page: first page of the report; None where it could not be written.
        model: the model with what was found; None where nothing was searched, or it could not be written.
        failures: what could not be written, one line each.
        unchanged: the folder held all of it already, so that nothing was written.
    """

    result: StudyResult
    page: Path | None = None
    model: Path | None = None
    failures: tuple[str, ...] = ()
    unchanged: bool = False


def write(
    result: StudyResult,
    options: Options,
    folder: Path,
    searched: Sequence[tuple[Trial, Motion]] = (),
    failures: Sequence[str] = (),
    jobs: int = 1,
) -> Written:
    """Write the report of a study, and the model with what was found; what fails costs nothing of the others.

    Args:
        result: the study; of a search alone one without trials.
        options: of it.
        folder: to write into.
        searched: trials of a search alone, with their motion.
        failures: what could not be written before.
        jobs: number of processes that draw figures.
    """
    guard, model = Guard(folder), None
    library(options.effects)  # the report takes words from the user's own effects, too
    found = result.finding
    if found is not None:
        pairs = searched or [(r.trial, r.comparison.motion) for r in result.trials]
        trials, motions = [trial for trial, _ in pairs], [motion for _, motion in pairs]
        model = save_found(found, options, trials, motions, guard)
    name = model.name if model and result.trials else model

    def told() -> StudyResult:
        return replace(result, finding=found and replace(found, failures=(*found.failures, *guard.lines)))

    page = guard.run("report", lambda: reporting.write_report(told(), folder, model=name, jobs=jobs))
    if page is None and (finding := told().finding):
        guard.run("finding", lambda: reporting.write_finding(finding, folder, name))
        alone = replace(result, finding=None, unsearched="the search could not be shown; see finding.json")
        page = guard.run("rest", lambda: reporting.write_report(alone, folder)) if result.trials else None
    return Written(told(), page, model, (*failures, *guard.lines))


def record(
    result: StudyResult,
    folder: Path,
    *,
    jobs: int = 1,
    progress: Callable[[str, int], None] = lambda *_: None,
) -> list[Path]:
    """Write a Rerun recording of each trial and one of the whole study.

    Args:
        result: the study.
        folder: of the recordings.
        jobs: as in `processes.shared_out`.
        progress: told how many are written.

    Raises:
        LabError: a file cannot be written.
    """
    names = [f"{name}.rrd" for name in distinct([WHOLE, *(r.trial.name for r in result.trials)])]
    with replacing(folder, "recordings") as new:
        paths = [new / name for name in names]
        done = shared_out(_record, (result, paths), len(paths), "wrote recordings", jobs=jobs)
        for k, _ in enumerate(done, 1):
            progress("recordings", k)
    return [folder / name for name in (*names[1:], names[0])]


def _record(given: tuple[StudyResult, Sequence[Path]], k: int) -> None:
    """Write a recording: that of the study, which takes longest, or of trial number `k`."""
    result, paths = given
    if k == 0:
        reporting.recording.record_study(result, paths[0], finding=result.finding)
    else:
        one = result.trials[k - 1]
        reporting.recording.record_trial(one.trial, one.comparison, paths[k], finding=result.finding)
