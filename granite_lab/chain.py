"""The chain of stages: log, estimate, fit, simulate, compare; over all trials, and to the missing effect."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from granite_lab import __version__, estimation, fitting, logs
from granite_lab.comparison.compare import Comparison, compare
from granite_lab.discovery.finding import Finding
from granite_lab.effects import library
from granite_lab.effects.model_file import ModelFile, load_model
from granite_lab.errors import EstimateError, LabError, UsageError
from granite_lab.estimation.motion import Motion, no_slip_is_known
from granite_lab.fitting.fit import AThetaFit, K92Fit
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.trial import InputFile, Trial, name_of
from granite_lab.model import simulate
from granite_lab.model.effect import Active, activate
from granite_lab.options import Options
from granite_lab.origin import Source
from granite_lab.parameters import Robot, Soil, load_robot, load_soil, load_variants
from granite_lab.parameters.catalogue import in_force
from granite_lab.parameters.changes import changed
from granite_lab.processes import Progress
from granite_lab.results import StudyResult, command_of
from granite_lab.running import Execution, each_trial, split_failures
from granite_lab.running.cache import code, digest_of, fingerprint
from granite_lab.running.codec import content, decode, encode
from granite_lab.running.each import LOCAL


def read(path: Path, options: Options) -> tuple[Trial, Robot]:
    """Return the trial of a log as it was logged, and its robot; raise an InputError if it cannot be used."""
    trial = logs.read_trial(
        path, dict(options.beside), map=options.column_map, robot=options.robot, info=options.info_of(path),
        topics=dict(options.topics), excerpt=logs.Excerpt(options.rows, options.window),
    )  # fmt: skip
    robot = load_robot(options.robot or trial.info.robot or "granite", changes=trial.info.changes)
    trial = estimation.as_built(trial, robot)
    if (doubt := soil_doubt(trial, robot, options)) is not None:
        trial = replace(trial, doubts=(*trial.doubts, Doubt(doubt)))
    return trial, robot


def soil_doubt(trial: Trial, robot: Robot, options: Options) -> str | None:
    """Return a warning where the soil is not named, or where another one is used in its place."""
    named = trial.info.soil
    if options.soil is not None or (named is None and robot.name == "granite"):
        return None
    if named is None:
        return "no soil is named: dry sand is assumed (soil = … in the log, its sidecar, or --soil)"
    try:
        load_soil(named)
    except UsageError:
        return f"the soil '{named}' of the log is not known: dry sand is assumed for the estimate"
    return None


def soil_of(trial: Trial, named: str | None) -> Soil:
    """Return the soil of that name, or else the one that the log names if it is known; dry sand by default.

    Raises:
        UsageError: the soil is not known.
        InputError: its file is wrong.
    """
    if named is None and trial.info.soil is not None:
        with suppress(UsageError):
            return load_soil(trial.info.soil, trial.info.changes)
    return load_soil(named or "dry_sand", trial.info.changes)


def corrected(path: Path, options: Options) -> tuple[Trial, Robot, Motion]:
    """Return the trial of a log as estimation corrected it, its robot and its motion.

    Raises:
        InputError: the log cannot be used.
        EstimateError: the motion cannot be estimated from it.
    """
    logged, robot = read(path, options)
    trial, motion = estimation.correct(logged, robot, soil=soil_of(logged, options.soil))
    return trial, robot, motion


def corrected_without_reference(path: Path, options: Options) -> Motion:
    """Return the motion of a trial whose reference is not used; errors as of `corrected`."""
    logged, robot = read(path, options)
    logged = replace(logged, info=replace(logged.info, use_reference=False))
    return estimation.correct(logged, robot, soil=soil_of(logged, options.soil))[1]


def with_simulation_input(path: Path, options: Options) -> tuple[Trial, Robot, Motion]:
    """Return `corrected` trial, robot and motion, in it the command or wheels that drive a simulation.

    Raises:
        InputError, EstimateError: as `corrected`, or the wheels are to drive and are not known.
    """
    trial, robot, motion = corrected(path, options)
    motion = fitting.with_drive_input(motion, robot, options.drive, soil_of(trial, options.soil))
    return trial, robot, fitting.with_towed_load(motion, trial, robot)


def analyse(path: Path, options: Options) -> Comparison:
    """Take one trial through the whole chain.

    Raises:
        LabError: a stage failed; the message names it and the reason.
    """
    logged, robot = read(path, options)
    trial, motion = estimation.correct(logged, robot, soil=soil_of(logged, options.soil))
    model, effects = model_of(options), slope_effects(trial)
    soil = modelled_soil(trial, options, model)
    motion = fitting.with_towed_load(
        fitting.with_drive_input(motion, robot, options.drive, soil), trial, robot
    )
    if model is not None:
        robot = changed(model.with_lugs(robot), "robot", trial.info.changes)
        effects = (*model.effects, *effects)
    fit = fitting.fit_k92(motion, trial, robot, soil, effects=effects)
    run = fitting.simulate_k92(fit.variant, robot, soil, fit.k92.value, effects=effects)
    return compare(motion, trial, fit, run)


def slope_effects(trial: Trial) -> tuple[Active, ...]:
    """Return the slope of the ground that a log states, as an effect; nothing on level ground."""
    from granite_lab.inference.conditions import conditions_of  # noqa: PLC0415, heavy

    slope = conditions_of(trial).slope
    return (activate(library()["ground_slope"], {"slope": slope}),) if slope else ()


def model_of(options: Options) -> ModelFile | None:
    """Return the model file that was given."""
    return load_model(options.model, options.effects) if options.model else None


def modelled_soil(trial: Trial, options: Options, model: ModelFile | None) -> Soil:
    """Return the soil of a trial, as the model file has it fitted unless another is given."""
    changes = trial.info.changes
    if model is not None and options.soil is None:
        return changed(model.ground, "soil", changes)
    return load_soil(options.soil or trial.info.soil or "dry_sand", changes)


NO_SLIP = "no trial has a slip ratio that is known to 5 points, so nothing is searched"
"""Why a search is left out: without known motions no gap of the model can be determined."""

NAME = "study"
"""Name of a study that is not written; a report has the name of its folder."""


def over_trials(
    paths: Sequence[Path],
    options: Options,
    *,
    execution: Execution = LOCAL,
    discover: bool = False,
    strict: bool = False,
    done: Callable[[Path], None] = lambda _: None,
    progress: Progress = lambda *_: None,
) -> StudyResult:
    """Run the chain over trials; the order in which they are given does not matter.

    Args:
        paths: the logs.
        options: for all of them.
        execution: processes, cluster and stored results.
        discover: search for a missing effect in the end.
        strict: a trial or a search that fails ends the study.
        done: called with each path once it is finished.
        progress: of that search, as in `discovery.discover`.

    Raises:
        LabError: no trial went through; it is that of the first. With `strict`, one did not.
    """
    paths = sorted(paths, key=lambda path: (name_of(path), str(path)))
    outcomes = each_trial(analyse, paths, options, execution=execution, done=done)
    results, failures = split_failures(paths, outcomes, strict=strict)
    trials, motions = [r.trial for r in results], [r.motion for r in results]
    source = source_of("study", paths, trials, options, discover)
    result = StudyResult(NAME, tuple(results), failures, law_of([r.fit for r in results]), source)
    if not discover:
        return result
    if no_slip_is_known(motions):
        return replace(result, unsearched=NO_SLIP)
    try:
        finding = find_effect(
            trials, options, motions=motions, law=result.a_theta, execution=execution, progress=progress
        )
    except LabError as error:
        if strict:
            raise EstimateError(error.message, "--no-discover leaves the search out") from None
        return replace(result, unsearched=error.message)
    return replace(result, finding=finding)


def find_effect(
    trials: Sequence[Trial],
    options: Options,
    *,
    motions: Sequence[Motion],
    law: AThetaFit | None = None,
    execution: Execution = LOCAL,
    progress: Progress = lambda *_: None,
) -> Finding:
    """Find the effect that the model lacks, or return the stored finding of the same trials.

    Args:
        trials: of one robot on one soil, as estimation corrected them.
        motions: estimates of the trials.
        law: a_θ by their steady slip, where it was fitted before.
        progress: as in `discovery.discover`.

    Raises:
        UsageError: trials of several robots or soils, or options that cannot be used.
        LabError: of `discovery.discover`.
    """
    if no_slip_is_known(motions):
        raise EstimateError(
            NO_SLIP, "granite-lab ingest shows how well the slip ratio of each trial is known"
        )
    from granite_lab.discovery.assemble import a_theta_views  # noqa: PLC0415, heavy
    from granite_lab.discovery.discover import SimulationOptions, discover  # noqa: PLC0415, heavy
    from granite_lab.discovery.finding import Limits  # noqa: PLC0415, heavy
    from granite_lab.running.simulations import effects_of_search, on_cluster  # noqa: PLC0415, heavy

    if options.model:
        raise UsageError("no search starts from a model with effects", "leave out --model")
    if not (0 < options.tolerance < 1 and 0 <= options.latency < math.inf):
        raise UsageError(
            f"tolerance {options.tolerance:g} or latency {1e3 * options.latency:g} ms cannot be used",
            "the tolerance is a share between 0 and 1, the latency 0 or more",
        )
    (of_robot, of_soil), changes = names_of(trials, options), trials[0].info.changes
    robot, soil = load_robot(of_robot, changes=changes), load_soil(of_soil, changes)
    order = sorted(range(len(trials)), key=lambda i: trials[i].name)
    trials, motions = [trials[i] for i in order], [motions[i] for i in order]
    effects, cache = effects_of_search(options.effects), execution.cache
    key = search_key((*trials, *motions, robot, soil), options)
    if cache is not None and isinstance(remembered := cache.get(key, effects), Finding):
        return remembered
    with on_cluster(execution, options.effects) as respond:
        finding = discover(
            trials, motions, robot, soil, library(options.effects),
            Limits(options.tolerance, options.latency),
            SimulationOptions(execution.jobs or os.cpu_count() or 1, respond, progress),
        )  # fmt: skip
    law = law or law_by_slip(trials, motions, robot, soil)
    finding = replace(finding, a_theta=a_theta_views(finding, law), simulates=_simulated(finding))
    data = encode(((), finding))
    if cache is not None and not finding.failures:
        cache.put(key, data)
    same: Finding = decode(data, effects)[1]
    return same


def names_of(trials: Sequence[Trial], options: Options) -> tuple[str, str]:
    """Return robot and soil of trials, by name or path.

    Raises:
        UsageError: the trials are of several.
    """
    robots = {options.robot or trial.info.robot or "granite" for trial in trials}
    soils = {options.soil or trial.info.soil or "dry_sand" for trial in trials}
    for kind, names in (("robots", robots), ("soils", soils)):
        if len(names) > 1:
            raise UsageError(
                f"the trials are of several {kind}: {', '.join(sorted(names))}",
                "search for a missing effect in the trials of one robot on one soil",
            )
    return robots.pop(), soils.pop()


def search_key(inputs: Sequence[Any], options: Options) -> str:
    """Return the key of a finding in certain inputs."""
    of_user = fingerprint(options.effects) if options.effects else None
    hashes = [content(record) for record in inputs]
    return digest_of(code(), hashes, of_user, options.tolerance, options.latency)


def _simulated(finding: Finding) -> tuple[float, ...]:
    """Return the speeds of Table 2 [m/s] at which the model with what was found has a solution."""
    soil, a_theta = finding.sand_of()
    speeds = []
    for variant in load_variants():
        with suppress(LabError):
            simulate(variant, finding.robot, soil, a_theta=a_theta, effects=finding.active)
            speeds.append(variant.velocity)
    return tuple(speeds)


def law_by_slip(
    trials: Sequence[Trial], motions: Sequence[Motion], robot: Robot, soil: Soil
) -> AThetaFit | None:
    """Fit a_θ to the steady slip alone; None where the trials do not allow it."""
    fits = []
    for trial, motion in zip(trials, motions, strict=True):
        with suppress(EstimateError):
            fits.append(fitting.fit_k92(motion, trial, robot, soil, trajectory=False))
    return law_of(fits)


def law_of(fits: Sequence[K92Fit]) -> AThetaFit | None:
    """Fit a_θ over trials; None where they do not allow it."""
    try:
        return fitting.fit_a_theta(fits)
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
        discover: whether a search for a missing effect was asked for; None of commands without one.
    """
    info, model = trials[0].info, model_of(options)
    soil = options.soil or (model.soil if model else None) or info.soil or "dry_sand"
    rows = in_force(options.robot or info.robot or "granite", soil, changes=info.changes)
    given = options.given() + ((("discover", "no"),) if discover is False else ())
    used = [file for trial in trials for file in trial.inputs]
    read_files = {file.path for file in used}
    others = [*(path for path in paths if path not in read_files), *options.files()]
    inputs = [*used, *(InputFile(path, fingerprint(path)) for path in others)]
    return Source(
        version=__version__,
        command=command_of(command, paths, options.given()),
        inputs=tuple(dict.fromkeys(inputs)),
        parameters=tuple((f"{p.group}.{p.key}", f"{p.value:g}", p.unit, p.origin) for p in rows),
        options=given,
        code=code(),
    )
