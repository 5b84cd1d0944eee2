"""The search for a missing effect, from trials to a finding and to the model with what was found."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from granite_lab import __version__
from granite_lab.discovery.discover import discover
from granite_lab.discovery.empirical import EmpiricalLaw
from granite_lab.discovery.finding import DESIGN, MODEL, Finding
from granite_lab.effects import library
from granite_lab.effects.model_file import FittedEffect, ModelFile, save_model
from granite_lab.errors import LabError, UsageError
from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Motion
from granite_lab.files import write_text
from granite_lab.folders import replacing
from granite_lab.inference.bench import Respond, Task, World
from granite_lab.logs.trial import Array, Trial
from granite_lab.model.effect import Effect
from granite_lab.options import Options
from granite_lab.parameters import load_paper, load_robot, load_soil
from granite_lab.running.cache import code, digest_of, fingerprint
from granite_lab.running.codec import content, decode, encode
from granite_lab.running.each import HERE, Execution, connected, run_on
from granite_lab.running.output import Guard


def search(
    trials: Sequence[Trial],
    options: Options,
    *,
    motions: Sequence[Motion],
    execution: Execution = HERE,
    progress: Callable[[str, int], None] = lambda *_: None,
) -> Finding:
    """Find the effect that the model lacks, or remember what was found before in the same trials.

    Args:
        trials: of one robot on one soil, as estimation corrected them.
        motions: estimates of the trials.
        progress: as in `discovery.discover`.

    Raises:
        UsageError: trials of several robots or soils, or options that cannot be used.
        LabError: of `discovery.discover`.
    """
    if options.model:
        raise UsageError("no search starts from a model with effects", "leave out --model")
    if not (0 < options.tolerance < 1 and 0 <= options.latency < math.inf):
        raise UsageError(
            f"tolerance {options.tolerance:g} or latency {1e3 * options.latency:g} ms cannot be used",
            "the tolerance is a share between 0 and 1, the latency 0 or more",
        )
    robot_name, soil_name = names_of(trials, options)
    robot, soil = load_robot(robot_name), load_soil(soil_name)
    order = sorted(range(len(trials)), key=lambda i: trials[i].name)
    trials, motions = [trials[i] for i in order], [motions[i] for i in order]
    effects, cache = _effects(options.effects), execution.cache
    key = search_key((*trials, *motions, robot, soil), options)
    if cache is not None and isinstance(found := cache.get(key, effects), Finding):
        return found
    with _respond(execution, options.effects) as respond:
        finding = discover(
            trials, robot, soil, effects=library(options.effects), motions=motions,
            jobs=execution.jobs or os.cpu_count() or 1, respond=respond, progress=progress,
            tolerance=options.tolerance, latency=options.latency,
        )  # fmt: skip
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
    own = fingerprint(options.effects) if options.effects else None
    hashes = [content(record) for record in inputs]
    return digest_of(code(), hashes, own, options.tolerance, options.latency)


def save_found(
    finding: Finding,
    options: Options,
    trials: Sequence[Trial],
    motions: Sequence[Motion],
    guard: Guard,
) -> Path | None:
    """Write the baseline with the physical effects that were named, and beside it what a plan needs.

    The motions of the trials know what was commanded. Returns the path of the model file, None where it could
    not be written.
    """
    from granite_lab.planning.design import save_design  # noqa: PLC0415, a defect there is guarded

    saved = guard.run("model", lambda: _save_model(finding, options, trials, guard.folder))
    said = []  # trials whose metadata say what was commanded
    for trial, motion in zip(trials, motions, strict=True):
        v, a, d = motion.variant.velocity, motion.variant.acceleration, motion.variant.distance
        said.append(replace(trial, info=replace(trial.info, v_desired=v, a_max=a, distance=d)))

    def design() -> None:
        with replacing(guard.folder, "design") as new:
            save_design(finding, said, new / DESIGN)

    def tracebacks() -> None:
        with replacing(guard.folder, "tracebacks") as new:
            if finding.tracebacks:
                write_text(new / "failure-search.txt", "\n".join(finding.tracebacks))

    guard.run("design", design)
    guard.run("tracebacks", tracebacks)
    return saved


def _save_model(finding: Finding, options: Options, trials: Sequence[Trial], folder: Path) -> Path:
    active = {item.id: item for item in finding.active}
    fitted = []
    for found in finding.effects:
        if not found.empirical:
            item = active[found.id]
            std = {p.name: p.estimate.std for p in found.parameters}
            values = {name: Estimate(v, std.get(name, 0.0)) for name, v in item.as_dict().items()}
            fitted.append(FittedEffect(item.effect, values, found.twins))
    files = sorted((file.path.name, file.sha256) for t in trials for file in t.inputs)
    provenance = {
        "version": __version__,
        "verdict": finding.verdict,
        "virtual": finding.virtual,
        "inputs": [f"{name} sha256 {sha}" for name, sha in files],
    }
    law = Estimate(load_paper().a_theta)
    model = ModelFile(*names_of(trials, options), "exponential", law, tuple(fitted), provenance)
    with replacing(folder, "model") as new:
        save_model(model, new / MODEL)
    return folder / MODEL


@contextmanager
def _respond(execution: Execution, effects: Path | None) -> Iterator[Respond | None]:
    """Give what simulates on the cluster, or None where this machine does it."""
    if execution.scheduler is None:
        yield None
        return
    sha = fingerprint(effects) if effects else ""
    with connected(execution.scheduler) as client:

        def respond(world: World, tasks: Sequence[Task]) -> list[Array | None]:
            if type(world) is not World:  # a worker makes a plain world
                return [world.respond(task) for task in tasks]
            size = max(1, min(16, len(tasks) // (2 * max(1, sum(client.nthreads().values())))))
            parts = [tuple(tasks[i : i + size]) for i in range(0, len(tasks), size)]
            found: dict[int, list[Array | None]] = {}
            for index, part in run_on(client, partial(_simulate, encode(world), effects, sha), parts):
                if isinstance(part, LabError):
                    raise LabError(f"the cluster failed: {part.message.partition(': ')[2]}", part.hint)
                found[index] = part
            return [signals for index in range(len(parts)) for signals in found[index]]

        yield respond


def _simulate(
    world: bytes, effects: Path | None, sha: str, tasks: Sequence[Task]
) -> list[Array | None] | LabError:
    """Simulate on a worker, which takes a user's own effects from their file."""
    if effects and fingerprint(effects) != sha:
        return LabError(f"worker: {effects} is another file on a worker", "share the folder with the workers")
    made: World = decode(world, _effects(effects))
    return [made.respond(task) for task in tasks]


def _effects(own: Path | None) -> dict[str, Effect]:
    """Return all effects that a finding may name."""
    return library(own) | {EmpiricalLaw.id: EmpiricalLaw()}
