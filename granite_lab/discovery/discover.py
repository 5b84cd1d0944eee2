"""`discover`: from corrected trials to a Finding."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace

import numpy as np

from granite_lab.discovery.assemble import OptionalParts, Outcome, SearchedTrials, assemble
from granite_lab.discovery.finding import USUAL, Ceiling, Confusion, Detectable, Finding, Limits
from granite_lab.discovery.fitted_sets import MOST
from granite_lab.discovery.ground_waves import ground_wave
from granite_lab.discovery.masked import with_masked
from granite_lab.discovery.models import Search
from granite_lab.discovery.orders import lugs
from granite_lab.discovery.power import detectable
from granite_lab.discovery.remainder import beside_terms, credited, remainder, savable
from granite_lab.discovery.screens import screen
from granite_lab.discovery.search import search, search_from_rivals
from granite_lab.discovery.verdict import Judgement, by_posterior, judge, with_ground_wave
from granite_lab.errors import EstimateError
from granite_lab.estimation.motion import Motion
from granite_lab.fitting.drive import drives, goes_by_command
from granite_lab.inference.conditions import under_conditions
from granite_lab.inference.constants import FEW, OUTLIER
from granite_lab.inference.fit import Fit
from granite_lab.inference.pool import Respond, Scenario, SimulationPool
from granite_lab.inference.priors import sand_std
from granite_lab.inference.problem import Problem
from granite_lab.inference.setup import baseline, clock_choices, initial_point, nominal, trial_models
from granite_lab.logs.trial import Trial
from granite_lab.model.dictionary import dictionary
from granite_lab.model.effect import Effect
from granite_lab.model.latent import LatentForce
from granite_lab.parameters import Course, Robot, Soil, is_driven
from granite_lab.processes import Progress, one_thread, return_freed_memory

LATENCY_EFFECT = "clock_offset"
"""The effect that latency is; it is no candidate, for latency is fitted in any case."""

STEPS = MOST + 4
"""Steps of a search: the model without effects, one for each effect that may be named and one for exchanging
these, predictions, and what the trials could show. A search that names fewer effects passes some over."""


@dataclass(frozen=True)
class SimulationOptions:
    """How a search simulates.

    Attributes:
        jobs: number of processes.
        respond: simulates in place of these processes.
        progress: called with the stage, the number of finished steps, and their largest number.
    """

    jobs: int = 1
    respond: Respond | None = None
    progress: Progress = lambda *_: None


IN_PROCESS = SimulationOptions()
"""In this process, without a word."""


def discover(
    trials: Sequence[Trial],
    motions: Sequence[Motion],
    robot: Robot,
    soil: Soil,
    effects: Mapping[str, Effect],
    limits: Limits = USUAL,
    simulating: SimulationOptions = IN_PROCESS,
) -> Finding:
    """Find out whether the model explains trials, and if not, what is missing.

    Args:
        trials: of one robot on one soil, as estimation corrected them.
        motions: estimates of the trials, in their order; they know what was commanded and when.
        robot, soil: the model's numbers.
        effects: candidates by id.
        limits: what is no missing effect.
        simulating: how.

    Raises:
        InputError: the robot cannot be simulated for want of numbers.
        EstimateError: a trial has no sensor to compare with, or the robot cannot be simulated on this soil.
    """
    return_freed_memory()
    order = sorted(range(len(trials)), key=lambda i: trials[i].name)
    trials, motions = [trials[i] for i in order], [motions[i] for i in order]
    library, unobservable = _observable(motions, effects)
    scenario = Scenario(robot, soil, (), library | dictionary() | {LatentForce.id: LatentForce()})
    with one_thread(), ExitStack() as stack:
        watch = _Watch(simulating.progress)

        def opened(scenario: Scenario) -> SimulationPool:
            pool = SimulationPool(scenario, simulating.jobs, watch.tick, simulating.respond)
            return stack.enter_context(pool)

        watch.tell("fitting the model without effects", 0)
        start = _fit_baseline(trials, motions, scenario, opened)
        count = lugs(start.problem, start.fit, robot.wheels.lugs)
        if count != robot.wheels.lugs:
            start.problem.pool = opened(_with_lugs(start.problem.pool.scenario, count))
        searched = search(
            start.problem, start.fit, tuple(library), limits.discrepancy,
            lambda text, named: watch.tell(text, 1 + named),
        )  # fmt: skip
        parts = OptionalParts()
        outcome = _judged(start, searched, tuple(library), limits.discrepancy, parts, watch.tell)
        finding = assemble(start.problem, outcome, start.searched, effects, limits, parts)
    finding = _noting_lugs(finding, robot, count)
    return replace(
        finding, notes=(*finding.notes, *unobservable), failures=tuple(parts.lines),
        tracebacks=tuple(parts.tracebacks), runs=watch.runs,
    )  # fmt: skip


@dataclass
class _Watch:
    """Says which stage a search has reached, and counts its simulations."""

    progress: Progress
    text: str = ""
    step: int = 0
    runs: int = 0

    def tell(self, text: str, step: int) -> None:
        """Begin a stage."""
        self.text, self.step = text, step
        self.progress(text, step, STEPS)

    def tick(self, runs: int) -> None:
        """Count further simulations."""
        self.runs += runs
        self.progress(f"{self.text} ({self.runs} simulations)", self.step, STEPS)


@dataclass(frozen=True, eq=False)
class _Start:
    """Where a search starts: the trials that the model may explain, and the fit without effects."""

    problem: Problem
    fit: Fit
    searched: SearchedTrials


def _fit_baseline(
    trials: Sequence[Trial],
    motions: Sequence[Motion],
    scenario: Scenario,
    opened: Callable[[Scenario], SimulationPool],
) -> _Start:
    """Fit the model without effects, by the clocks that it explains better, and leave out what nothing fits.

    Raises:
        InputError, EstimateError: as `discover`.
    """
    choices = clock_choices(trials, motions)
    models = [trial_models(t, scenario.robot, m) for t, m in choices]
    plain = replace(scenario, variants=models[0][1])
    scenarios = [under_conditions(plain, t, m) for (t, _), (m, _) in zip(choices, models, strict=True)]
    pool, std = opened(scenarios[0]), sand_std(scenario.soil)
    possible = [_possible(Problem(m, pool, std)) for m, _ in models]
    misfits = [initial_point(problem)[1] for problem, _ in possible] if len(possible) > 1 else [0.0]
    chosen = int(np.argmin(misfits))
    problem, dropped = possible[chosen]
    base = baseline(problem)
    problem, outliers = _without(problem, _outliers(problem, base))
    if outliers:
        base = baseline(problem)
    trials, motions = choices[chosen]
    return _Start(problem, base, SearchedTrials(tuple(trials), tuple(motions), (*dropped, *outliers)))


def _judged(
    start: _Start,
    searched: Search,
    library: Sequence[str],
    tolerance: float,
    parts: OptionalParts,
    tell: Callable[[str, int], None],
) -> Outcome:
    """Judge what a search has fitted, describe what it leaves, and say what the trials could show.

    What fails after the search leaves what was known before.
    """
    problem = start.problem
    tell("predicting trials that are left out", STEPS - 2)
    judged = parts.attempt(
        "predictions of trials that are left out",
        lambda: judge(problem, searched, tolerance),
        by_posterior(problem, searched),
    )
    searched, judged = parts.attempt(
        "rivals of what was found",
        lambda: _reconsidered(
            problem, searched, judged, library, tolerance, lambda text: tell(text, STEPS - 2)
        ),
        (searched, judged),
    )
    judged = parts.attempt("what may be saved", lambda: savable(problem, searched, judged, tolerance), judged)
    judged = parts.attempt(
        "what gains mask", lambda: with_masked(problem, searched, judged, tolerance), judged
    )
    nothing: tuple[Judgement, Ceiling | None] = (judged, None)
    judgement, limit = parts.attempt(
        "what the library leaves",
        lambda: remainder(problem, searched, judged, tolerance, lambda text: tell(text, STEPS - 2)),
        nothing,
    )
    whole, judgement, limit = parts.attempt(
        "effects beside what describes the rest",
        lambda: beside_terms(
            problem, searched, judgement, limit, library, tolerance, lambda text: tell(text, STEPS - 2)
        ),
        (searched, judgement, limit),
    )
    judgement = parts.attempt(
        "what simulations close", lambda: credited(problem, searched, judgement, tolerance), judgement
    )
    judgement = parts.attempt(
        "waves of the ground",
        lambda: with_ground_wave(
            judgement, ground_wave(problem, judgement.model.fit, start.searched.motions, tolerance)
        ),
        judgement,
    )
    tell("checking what these trials could show", STEPS - 1)
    power = parts.attempt(
        "what these trials could show", lambda: _power(problem, searched, judged, library, tolerance), None
    )
    return Outcome(whole, judgement, limit, power)


def _reconsidered(
    problem: Problem,
    searched: Search,
    judged: Judgement,
    library: Sequence[str],
    tolerance: float,
    tell: Callable[[str], None],
) -> tuple[Search, Judgement]:
    """Search on from rivals where not all that matters is named; return search and judgement."""
    if judged.verdict in ("none", "named"):
        return searched, judged
    again = search_from_rivals(searched, problem, library, tolerance, lambda text, _: tell(text))
    return (searched, judged) if again is searched else (again, judge(problem, again, tolerance))


def _without(problem: Problem, reasons: Mapping[int, str]) -> tuple[Problem, tuple[tuple[str, str], ...]]:
    """Leave trials out; return the problem of the others, and the names of those with the reasons."""
    if not reasons:
        return problem, ()
    kept = [t for i, t in enumerate(problem.trials) if i not in reasons]
    names = tuple((problem.trials[i].observation.name, why) for i, why in reasons.items())
    return Problem(kept, problem.pool, tuple(problem.sand_std.tolist())), names


def _with_lugs(scenario: Scenario, count: float) -> Scenario:
    """Return what simulations share, for wheels with another number of lugs."""
    return replace(scenario, robot=replace(scenario.robot, wheels=replace(scenario.robot.wheels, lugs=count)))


def _noting_lugs(finding: Finding, robot: Robot, count: float) -> Finding:
    """Add a note on the number of lugs that the search took, where a found effect depends on it."""
    if not any(active.effect.by_lugs for active in finding.active):
        return replace(finding, robot=robot)
    if count == robot.wheels.lugs:
        return finding
    repeats = f"What the model leaves repeats {count:g} times a turn of the wheels."
    stated = f"The robot's file says {robot.wheels.lugs:g} lugs; the search took {count:g}."
    return replace(finding, notes=(*finding.notes, f"{repeats} {stated}"))


def _observable(
    motions: Sequence[Motion], effects: Mapping[str, Effect]
) -> tuple[dict[str, Effect], list[str]]:
    """Return the candidates in alphabetical order, and notes on those that are left out.

    Measured wheel speeds as the input of simulations hide what acts on drives and encoders; where no command
    is known they hide what acts on the command.
    """
    candidates = {id_: e for id_, e in sorted(effects.items()) if id_ != LATENCY_EFFECT}
    turned = [m.variant for m in motions if is_driven(m.variant)]
    free = sum(isinstance(v, Course) and not v.commanded for v in turned)
    of_drives = [id_ for id_, e in candidates.items() if turned and drives(e)]
    of_command = [id_ for id_, e in candidates.items() if free and goes_by_command(e)]
    notes = []
    if of_drives:
        notes.append(
            f"The measured wheel speeds drive {len(turned)} of {len(motions)} trials: effects of drives and "
            f"encoders are no candidates ({', '.join(of_drives)})."
        )
    if of_command:
        notes.append(
            f"No command is known of {free} of {len(motions)} trials, k_92 goes by their wheels: effects of "
            f"the command on k_92 are no candidates ({', '.join(of_command)})."
        )
    hidden = {*of_drives, *of_command}
    return {id_: e for id_, e in candidates.items() if id_ not in hidden}, notes


def _power(
    problem: Problem, searched: Search, judgement: Judgement, library: Sequence[str], tolerance: float
) -> tuple[tuple[Detectable, ...], Confusion]:
    """Return what the trials could show beside the named effects, by the stored screen where there is one."""
    model = judgement.model
    screenings = searched.screenings.get(model.effects, ())
    rest = [c for c in library if c not in model.effects]
    screened = next((k.screened for k in screenings if k.screened), None) or screen(
        problem, model.fit, rest, most=FEW
    )
    return detectable(problem, model.fit, screened, tolerance)


def _possible(problem: Problem) -> tuple[Problem, tuple[tuple[str, str], ...]]:
    """Leave out trials whose command has no solution in the model.

    Raises:
        EstimateError: that holds for all.
    """
    neutral = problem.neutral()
    runs = problem.pool.run([problem.centre(neutral, c) for c in range(len(problem.inputs))])
    out = {i for served, run in zip(problem.inputs, runs, strict=True) if run is None for i in served}
    if len(out) == len(problem.trials):
        raise EstimateError(
            "the robot cannot be simulated on this soil", "check the robot's and the soil's file"
        )
    return _without(problem, dict.fromkeys(sorted(out), "its command has no solution in the model"))


def _outliers(problem: Problem, base: Fit) -> dict[int, str]:
    """Return the trials that nothing fits, each with the reason.

    They are weighed by the nominal noise and the first values of the priors: what was learnt is large where
    such a trial differs from its repetitions.
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
