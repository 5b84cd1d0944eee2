"""`discover`: from corrected trials to a Finding."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace

import numpy as np

from granite_lab.discovery.assemble import Attempts, assemble
from granite_lab.discovery.candidates import screen
from granite_lab.discovery.finding import Ceiling, Confusion, Detectable, Finding
from granite_lab.discovery.ground_waves import ground_wave
from granite_lab.discovery.orders import lugs
from granite_lab.discovery.power import detectable
from granite_lab.discovery.remainder import remainder, savable
from granite_lab.discovery.search import MOST, Search, search
from granite_lab.discovery.verdict import Judgement, by_posterior, judge, with_ground_wave
from granite_lab.errors import EstimateError
from granite_lab.estimation.motion import Motion
from granite_lab.fitting.drive import drives, goes_by_command
from granite_lab.inference.bench import Bench, Respond, World
from granite_lab.inference.conditions import under_conditions
from granite_lab.inference.constants import FEW, LATENCY_LIMIT, OUTLIER, TOLERANCE
from granite_lab.inference.fit import Fit
from granite_lab.inference.priors import sand_std
from granite_lab.inference.problem import Problem
from granite_lab.inference.setup import at_first, baseline, clocks, nominal, trial_models
from granite_lab.logs.trial import Trial
from granite_lab.model.dictionary import dictionary
from granite_lab.model.effect import Effect
from granite_lab.model.latent import LatentForce
from granite_lab.parameters import Course, Robot, Soil, Variant, is_driven
from granite_lab.processes import Progress, give_back, one_thread

LATENCY_EFFECT = "clock_offset"
"""The effect that latency is; it is no candidate, for latency is fitted in any case."""

STEPS = MOST + 4
"""Steps of a search: the model without effects, one for each effect that may be named and one for exchanging
these, predictions, and what the trials could show. A search that names fewer effects passes some over."""


def discover(
    trials: Sequence[Trial],
    robot: Robot,
    soil: Soil,
    *,
    effects: Mapping[str, Effect],
    motions: Sequence[Motion],
    jobs: int = 1,
    respond: Respond | None = None,
    progress: Progress = lambda *_: None,
    tolerance: float = TOLERANCE,
    latency: float = LATENCY_LIMIT,
) -> Finding:
    """Find out whether the model explains trials, and if not, what is missing.

    Args:
        trials: of one robot on one soil, as estimation corrected them.
        robot, soil: the model's numbers.
        effects: candidates by id.
        motions: estimates of the trials, in their order; they know what was commanded and when.
        jobs: number of processes.
        respond: simulates in place of these processes.
        progress: called with the stage, the number of finished steps, and their largest number.
        tolerance: discrepancy that does not matter, as a share of a channel's rms in motion.
        latency: largest delay between the stamps of two sensors that is no missing effect [s].

    Raises:
        InputError: the robot cannot be simulated for want of numbers.
        EstimateError: a trial has no sensor to compare with, or the robot cannot be simulated on this soil.
    """
    give_back()
    order = sorted(range(len(trials)), key=lambda i: trials[i].name)
    readings = clocks([trials[i] for i in order], [motions[i] for i in order])
    candidates = dict(sorted((id_, e) for id_, e in effects.items() if id_ != LATENCY_EFFECT))
    left_out, unobservable = _unobservable([m.variant for m in motions], candidates)
    candidates = {id_: e for id_, e in candidates.items() if id_ not in left_out}
    library = tuple(candidates)
    simulated = candidates | dictionary() | {LatentForce.id: LatentForce()}

    stage = ("", 0)

    def tell(text: str, step: int) -> None:
        nonlocal stage
        stage = (text, step)
        progress(text, step, STEPS)

    def tick(_: int) -> None:
        text, step = stage
        progress(f"{text} ({bench.runs} simulations)", step, STEPS)

    every = [trial_models(some, robot, seen) for some, seen in readings]
    plain = World(robot, soil, every[0][1], simulated)
    worlds = [under_conditions(plain, some, m) for (some, _), (m, _) in zip(readings, every, strict=True)]
    with one_thread(), ExitStack() as stack:
        bench = stack.enter_context(Bench(worlds[0], jobs, tick, respond))
        tell("fitting the model without effects", 0)
        ways = [_possible(Problem(models, bench, sand_std(soil))) for models, _ in every]
        fits = [at_first(way)[1] for way, _ in ways] if len(ways) > 1 else [0.0]
        chosen = int(np.argmin(fits))
        (problem, dropped), (trials, motions) = ways[chosen], readings[chosen]
        base = baseline(problem)
        problem, outliers = _without(problem, _outliers(problem, base))
        if outliers:
            base, dropped = baseline(problem), (*dropped, *outliers)
        count = lugs(problem, base, robot.wheels.lugs)
        if count != robot.wheels.lugs:
            bench = stack.enter_context(Bench(_with_lugs(bench.world, count), jobs, tick, respond))
            bench.runs, problem.bench = problem.bench.runs, bench
        searched = search(problem, base, library, tolerance, lambda text, named: tell(text, 1 + named))
        parts = Attempts()
        tell("predicting trials that are left out", STEPS - 2)
        judged = parts.of(
            "predictions of trials that are left out",
            lambda: judge(problem, searched, tolerance),
            by_posterior(problem, searched),
        )
        judged = parts.of("what may be saved", lambda: savable(problem, searched, judged, tolerance), judged)
        nothing: tuple[Judgement, Ceiling | None] = (judged, None)
        judgement, limit = parts.of(
            "what the library leaves",
            lambda: remainder(problem, searched, judged, tolerance, lambda text: tell(text, STEPS - 2)),
            nothing,
        )
        judgement = parts.of(
            "waves of the ground",
            lambda: with_ground_wave(
                judgement, ground_wave(problem, judgement.model.fit, motions, tolerance)
            ),
            judgement,
        )
        tell("checking what these trials could show", STEPS - 1)
        power = parts.of(
            "what these trials could show",
            lambda: _power(problem, searched, judged, library, tolerance),
            None,
        )
        finding = assemble(
            problem=problem,
            search=searched,
            judgement=judgement,
            limit=limit,
            power=power,
            effects=effects,
            tolerance=tolerance,
            latency=latency,
            clock_applied={t.name: m.clock_applied for t, m in zip(trials, motions, strict=True)},
            dropped=dropped,
            virtual=all(t.info.virtual for t in trials),
            parts=parts,
        )
        finding = _noting_lugs(finding, robot, count)
        return replace(
            finding, notes=(*finding.notes, *unobservable), failures=tuple(parts.lines),
            tracebacks=tuple(parts.tracebacks),
        )  # fmt: skip


def _without(problem: Problem, reasons: Mapping[int, str]) -> tuple[Problem, tuple[tuple[str, str], ...]]:
    """Leave trials out; return the problem of the others, and the names of those with the reasons."""
    if not reasons:
        return problem, ()
    kept = [t for i, t in enumerate(problem.trials) if i not in reasons]
    names = tuple((problem.trials[i].observation.name, why) for i, why in reasons.items())
    return Problem(kept, problem.bench, tuple(problem.sand_std.tolist())), names


def _with_lugs(world: World, count: float) -> World:
    """Return what simulations share, for wheels with another number of lugs."""
    return replace(world, robot=replace(world.robot, wheels=replace(world.robot.wheels, lugs=count)))


def _noting_lugs(finding: Finding, robot: Robot, count: float) -> Finding:
    """Add a note on the number of lugs that the search took, where a found effect depends on it."""
    if not any(active.effect.by_lugs for active in finding.active):
        return replace(finding, robot=robot)
    if count == robot.wheels.lugs:
        return finding
    repeats = f"What the model leaves repeats {count:g} times a turn of the wheels."
    stated = f"The robot's file says {robot.wheels.lugs:g} lugs; the search took {count:g}."
    return replace(finding, notes=(*finding.notes, f"{repeats} {stated}"))


def _unobservable(
    variants: Sequence[Variant], candidates: Mapping[str, Effect]
) -> tuple[set[str], list[str]]:
    """Return effects that measured wheel speeds as the input of simulations hide, and notes on them."""
    turned = [v for v in variants if is_driven(v)]
    free = sum(isinstance(v, Course) and not v.commanded for v in turned)
    of_drives = [id_ for id_, e in candidates.items() if turned and drives(e)]
    of_command = [id_ for id_, e in candidates.items() if free and goes_by_command(e)]
    notes = []
    if of_drives:
        notes.append(
            f"The measured wheel speeds drive {len(turned)} of {len(variants)} trials: effects of drives and "
            f"encoders are no candidates ({', '.join(of_drives)})."
        )
    if of_command:
        notes.append(
            f"No command is known of {free} of {len(variants)} trials, k_92 goes by their wheels: effects of "
            f"the command on k_92 are no candidates ({', '.join(of_command)})."
        )
    return {*of_drives, *of_command}, notes


def _power(
    problem: Problem, searched: Search, judgement: Judgement, library: Sequence[str], tolerance: float
) -> tuple[tuple[Detectable, ...], Confusion]:
    """Return what the trials could show beside the named effects, by the stored screen where there is one."""
    model = judgement.model
    looks = searched.looks.get(model.effects, ())
    rest = [c for c in library if c not in model.effects]
    screened = next((k.screened for k in looks if k.screened), None) or screen(
        problem, model.fit, rest, most=FEW
    )
    return detectable(problem, model.fit, screened, tolerance)


def _possible(problem: Problem) -> tuple[Problem, tuple[tuple[str, str], ...]]:
    """Leave out trials whose command has no solution in the model.

    Raises:
        EstimateError: that holds for all.
    """
    neutral = problem.neutral()
    runs = problem.bench.run([problem.centre(neutral, c) for c in range(len(problem.inputs))])
    out = {i for served, run in zip(problem.inputs, runs, strict=True) if run is None for i in served}
    if len(out) == len(problem.trials):
        raise EstimateError(
            "the robot cannot be simulated on this soil", "check the robot's and the soil's file"
        )
    return _without(problem, dict.fromkeys(sorted(out), "its command has no solution in the model"))


def _outliers(problem: Problem, base: Fit) -> dict[int, str]:
    """Return the trials that nothing fits, each with the reason.

    They are weighed by the nominal noise and the first values of the priors: what was learnt is loud and wide
    where such a trial differs from its repetitions.
    """
    if len(problem.trials) <= 2:  # which of two is strange?
        return {}
    reasons: dict[int, str] = {}
    rows = zip(nominal(problem), base.residuals, strict=True)
    residuals = [
        np.concatenate([w(r) for w, r in zip(whiteners, table, strict=True)]) for whiteners, table in rows
    ]
    numbers = [x / [s.std for s in t.slacks] for t, x in zip(problem.trials, base.point.trials, strict=True)]
    for subject, values in (
        ("its residuals are", residuals), ("its sand, offsets and gains lie off their files", numbers),
    ):  # fmt: skip
        rms = np.sqrt([np.mean(v**2) for v in values])
        ratio = rms / np.median(rms)
        for i in np.flatnonzero(ratio > OUTLIER).tolist():
            reasons.setdefault(i, f"{subject} {ratio[i]:.0f} times those of the others")
    return reasons
