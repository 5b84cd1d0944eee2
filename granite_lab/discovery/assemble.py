"""From a search and its judgement to the Finding: numbers, gaps, residuals and words."""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from scipy.special import ndtr

from granite_lab.discovery.finding import (
    Candidate,
    Ceiling,
    Confusion,
    Detectable,
    EffectFinding,
    Finding,
    FittedParameter,
    Gap,
    LeftOut,
    Limits,
    Residual,
    Status,
    Verdict,
)
from granite_lab.discovery.models import Search
from granite_lab.discovery.numbers import Numbers, active_of
from granite_lab.discovery.power import POWER
from granite_lab.discovery.resampling import SUREST, by_evidence
from granite_lab.discovery.verdict import OPEN, EffectEvidence, Judgement, at_bounds, holding
from granite_lab.discovery.where import disagreements
from granite_lab.discovery.words import notes, provisional, sentence
from granite_lab.estimate import Estimate, Part
from granite_lab.estimation.motion import Motion
from granite_lab.fitting.fit import AThetaFit, View, views_of
from granite_lab.fitting.k92 import SHARED_AS
from granite_lab.inference.fit import Fit
from granite_lab.inference.gap import Discrepancy, beyond, discrepancies
from granite_lab.inference.observation import CHANNELS, UNITS
from granite_lab.inference.point import SHARED
from granite_lab.inference.pool import SAND
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array, Trial
from granite_lab.model.dictionary import is_term
from granite_lab.model.effect import Active, Effect

T = TypeVar("T")


@dataclass
class OptionalParts:
    """Parts of the analysis after the search: what fails costs nothing of the others.

    Attributes:
        lines: what failed, one line each.
        tracebacks: of these.
    """

    lines: list[str] = field(default_factory=list)
    tracebacks: list[str] = field(default_factory=list)

    def attempt(self, part: str, make: Callable[[], T], otherwise: T) -> T:
        """Return what a part gives, or a value in its place where a defect ends it.

        Args:
            part: its name.
            make: does it.
            otherwise: stands in for it.
        """
        try:
            return make()
        except Exception as error:
            self.lines.append(f"{part}: {type(error).__name__}: {error}")
            self.tracebacks.append(traceback.format_exc())
            return otherwise


@dataclass(frozen=True)
class SearchedTrials:
    """The trials of a search.

    Attributes:
        trials, motions: all that were given, as estimation corrected them, on their clocks.
        dropped: name and reason of those that were left out.
    """

    trials: tuple[Trial, ...]
    motions: tuple[Motion, ...]
    dropped: tuple[tuple[str, str], ...]

    @property
    def clock_applied(self) -> dict[str, float]:
        """Trial to what was added to its stamps of encoders and currents before the search [s]."""
        return {t.name: m.clock_applied for t, m in zip(self.trials, self.motions, strict=True)}


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came out of a search.

    Attributes:
        search: the sets that were fitted.
        judgement: of them.
        limit: what any force could close; None where nothing remains.
        power: what these trials could show; None where that failed.
    """

    search: Search
    judgement: Judgement
    limit: Ceiling | None
    power: tuple[tuple[Detectable, ...], Confusion] | None


def assemble(
    problem: Problem,
    outcome: Outcome,
    trials: SearchedTrials,
    effects: Mapping[str, Effect],
    limits: Limits,
    parts: OptionalParts,
) -> Finding:
    """Gather what was found.

    Args:
        problem: the trials.
        outcome: of the search.
        trials: from which the problem was made.
        effects: all effects by id.
        limits: what is no missing effect.
        parts: tries the parts that the verdict does not need, and keeps what fails.
    """
    search, judgement, tolerance = outcome.search, outcome.judgement, limits.discrepancy
    before, after, power = search.baseline.fit, judgement.model.fit, outcome.power
    late = _latency(search.best.fit, problem, trials.clock_applied)
    numbers = Numbers(problem, after)
    terms = _terms(numbers, search, judgement, late, limits.latency, effects)
    none: list[Discrepancy] = []
    lacking = parts.attempt("the discrepancy", lambda: discrepancies(problem, before), none)
    missing = parts.attempt("what is left of it", lambda: discrepancies(problem, after), none)
    reasons = provisional(problem)
    finding = Finding(
        verdict=terms.verdict,
        sentence=sentence(terms.verdict, terms.named, terms.described, judgement, reasons, tolerance),
        probability=judgement.probability,
        provisional=reasons,
        effects=terms.named,
        description=terms.described,
        small=tuple(_effect(numbers, search, n, effects) for n in judgement.small),
        closed={"trials": judgement.closed, "speeds": judgement.speeds},
        ceiling=outcome.limit,
        strained=_strained(numbers, judgement),
        remainder=judgement.remainder,
        tolerance=tolerance,
        latency=late,
        sand=numbers.sand,
        sand_per_trial=tuple(numbers.sand_of_trial(i) for i in range(len(problem.trials))),
        scales=dict(after.scales.priors),
        own_means=numbers.own_means,
        discrepancy=after.scales.largest,
        scatter=judgement.scatter,
        ground_wave=judgement.ground_wave,
        trials_left_out=_trials_left_out(problem, judgement),
        speeds_left_out=_speeds_left_out(problem, judgement),
        dropped=trials.dropped,
        notes=notes(problem, judgement, terms.named),
        robot=problem.pool.scenario.robot,
        soil=problem.pool.scenario.soil,
        active=terms.active,
        virtual=all(t.info.virtual for t in trials.trials),
        detectable=(*power[0], *_clock_detectable(late, limits.latency, effects)) if power else (),
        confusion=power[1] if power else None,
    )
    return _detailed(finding, problem, outcome, (lacking, missing), parts)


def _detailed(
    finding: Finding,
    problem: Problem,
    outcome: Outcome,
    missing: tuple[list[Discrepancy], list[Discrepancy]],
    parts: OptionalParts,
) -> Finding:
    """Add gaps, intervals, candidates and residuals; `missing` is without and with the effects."""
    judgement, tolerance = outcome.judgement, finding.tolerance
    fits, (without, with_effects) = (outcome.search.baseline.fit, judgement.model.fit), missing
    return replace(
        finding,
        gap=parts.attempt("the gap", lambda: _gap(problem, judgement, *fits, tolerance), finding.gap),
        gaps=tuple(_gap_of(c, *missing, tolerance) for c in _channels(problem)),
        where=parts.attempt("where they disagree", lambda: disagreements(problem, without, tolerance), ()),
        left=parts.attempt("what is left", lambda: disagreements(problem, with_effects, tolerance), ()),
        candidates=parts.attempt(
            "the list of candidates", lambda: _candidates(problem, outcome.search, judgement, tolerance), ()
        ),
        residuals=parts.attempt("the residuals", lambda: tuple(_residuals(problem, fits, missing)), ()),
    )


@dataclass(frozen=True)
class _Terms:
    """What the likeliest model holds, with an offset of the clocks where there is one."""

    verdict: Verdict
    named: tuple[EffectFinding, ...]
    described: tuple[EffectFinding, ...]
    active: tuple[Active, ...]


def _terms(
    numbers: Numbers,
    search: Search,
    judgement: Judgement,
    late: Estimate,
    limit: float,
    effects: Mapping[str, Effect],
) -> _Terms:
    """Return the terms of a judgement; a latency beyond the limit [s] is one more."""
    named, described = (
        tuple(_effect(numbers, search, n, effects) for n in of)
        for of in (judgement.named, judgement.described)
    )
    verdict, active = judgement.verdict, active_of(numbers.problem, numbers.fit)
    clock = _clock(late, limit, effects)
    if clock is None:
        return _Terms(verdict, named, described, active)
    offset = effects[clock.id].parameters[0]
    active = (*active, Active(effects[clock.id], (min(max(-late.value, offset.low), offset.high),)))
    if verdict in ("unknown", "partly named"):  # what is missing may look like an offset
        likely = clock.probability * float(np.clip(1 - np.nan_to_num(judgement.remainder), 0, 1))
        return _Terms(verdict, named, (*described, replace(clock, probability=likely)), active)
    return _Terms("named", (*named, clock), described, active)


def _channels(problem: Problem) -> list[str]:
    return [c for c in CHANNELS if any(c in t.channels for t in problem.trials)]


def _latency(fit: Fit, problem: Problem, clock_applied: Mapping[str, float]) -> Estimate:
    """Return the latency, with what was taken out of the stamps put back (mean over trials)."""
    k = SHARED.index("latency")
    place = sum(x.size for x in fit.point.trials) + k
    before = float(np.mean([clock_applied[t.observation.name] for t in problem.trials]))
    return Estimate(float(fit.point.shared[k]) + before, float(fit.std[place]))


def _clock(late: Estimate, limit: float, effects: Mapping[str, Effect]) -> EffectFinding | None:
    """Return the clocks' offset as an effect where the latency is beyond what loggers do."""
    if abs(late.value) <= limit + 2 * late.std or "clock_offset" not in effects:
        return None
    effect = effects["clock_offset"]
    number = FittedParameter("offset", "s", Estimate(-late.value, late.std))
    later = float(ndtr((abs(late.value) - limit) / late.std)) if late.std > 0 else SUREST
    sure = min(later, SUREST)
    return EffectFinding(effect.id, effect.title, effect.equation, (number,), (), sure, OPEN, OPEN)


def _clock_detectable(late: Estimate, limit: float, effects: Mapping[str, Effect]) -> tuple[Detectable, ...]:
    """Return from which offset of the clocks on the latency is named."""
    if "clock_offset" not in effects:
        return ()
    return (Detectable("clock_offset", "offset", "s", limit + (2 + POWER) * late.std, "tolerance", ()),)


def _effect(
    numbers: Numbers, search: Search, evidence: EffectEvidence, effects: Mapping[str, Effect]
) -> EffectFinding:
    """Return an effect with its numbers in the model, or in the likeliest set that holds it."""
    id_, held = evidence.id, numbers
    if id_ not in numbers.fit.point.effects:
        model = next((m for m in search.models if id_ in m.effects), None)
        held = numbers if model is None else Numbers(numbers.problem, model.fit)
    effect = numbers.problem.pool.scenario.effects.get(id_) or effects[id_]
    return EffectFinding(
        id_, effect.title, effect.equation, held.of_effect(id_) if id_ in held.fit.point.effects else (),
        evidence.twins, evidence.probability, evidence.closes, evidence.speeds, is_term(id_),
    )  # fmt: skip


def _strained(numbers: Numbers, judgement: Judgement) -> tuple[str, ...]:
    """Name the numbers of effects, of sand and of the trials that are not as expected.

    Those of the trials where they lie two standard deviations off on average, as a tilt of the IMU in all.
    """
    named = (*judgement.named, *judgement.described)
    of_effects = [f"{n.id}.{name}" for n in named for name in n.strained]
    stds = zip(SAND, numbers.problem.sand_std, strict=True)
    sand = [name for name, std in stds if abs(numbers.sand[name].value) > 2 * std]
    return (*of_effects, *sand, *numbers.alike)


def _gap(problem: Problem, judgement: Judgement, before: Fit, after: Fit, tolerance: float) -> Gap:
    """Return the gap of all channels together."""
    expected = float(np.sum(np.fmin(judgement.before.expected, judgement.after.expected)))
    left_out = [float(np.sum(p.left_out)) for p in (judgement.before, judgement.after)]
    left = [beyond(problem, f, tolerance) for f in (before, after)]
    return Gap("all", _ratio([m for m, _ in left], min(f for _, f in left)), _ratio(left_out, expected))


def _gap_of(
    channel: str, before: Sequence[Discrepancy], after: Sequence[Discrepancy], tolerance: float
) -> Gap:
    """Return the gap of one channel: its largest discrepancy over the tolerance."""
    first, last = (max((d.share for d in of if d.channel == channel), default=0.0) for of in (before, after))
    return Gap(channel, (first / tolerance, last / tolerance), (float("nan"), float("nan")))


def _ratio(values: Sequence[float], floor: float) -> tuple[float, float]:
    before, after = (float(np.sqrt(max(v, 0.0) / floor)) if floor > 0 else float("nan") for v in values)
    return before, after


def _candidates(
    problem: Problem, search: Search, judgement: Judgement, tolerance: float
) -> tuple[Candidate, ...]:
    """Return every candidate as it fared as the only effect, the likeliest first."""
    baseline, competition = search.baseline, judgement.competition or by_evidence(search)
    misfit, floor = beyond(problem, baseline.fit, tolerance)
    candidates = []
    for id_, score in search.screened_alone().items():
        model, gain = search.model((id_,)), score.gain
        closes, bounds = float("nan"), _NO_BOUNDS
        if model is not None:
            gain = model.fit.evidence - baseline.fit.evidence
            bounds = at_bounds(problem, model.fit, id_)
            if misfit > floor:
                closes = (misfit - beyond(problem, model.fit, tolerance)[0]) / (misfit - floor)
        status = _status(judgement, id_, "screened" if model is None else "less likely", bounds)
        probability = competition.probability(holding(id_))
        candidates.append(Candidate(id_, gain, probability, closes, status, bounds))
    return tuple(sorted(candidates, key=lambda c: (-c.probability, -c.gain)))


_NO_BOUNDS: tuple[str, ...] = ()


def _status(judgement: Judgement, id_: str, otherwise: Status, bounds: tuple[str, ...]) -> Status:
    """Return what became of a candidate, `otherwise` if the judgement does not mention it."""
    statuses: tuple[tuple[Status, set[str]], ...] = (
        ("named", {e.id for e in judgement.named}),
        ("twin", {twin for e in judgement.named for twin in e.twins}),
        ("described", {e.id for e in judgement.described}),
        ("small", {e.id for e in judgement.small}),
    )
    unmentioned: Status = "at a bound" if bounds else otherwise
    return next((status for status, ids in statuses if id_ in ids), unmentioned)


def _residuals(
    problem: Problem, fits: tuple[Fit, Fit], missing: tuple[Sequence[Discrepancy], Sequence[Discrepancy]]
) -> list[Residual]:
    """Return every channel of every trial beside the model, without and with the effects."""
    residuals = []
    before, after = fits
    shared = [{(d.command, d.channel): d for d in of} for of in missing]
    for i, trial in enumerate(problem.trials):
        o = trial.observation
        command = next(c for c, repetitions in enumerate(problem.commands) if i in repetitions)
        for k, c in enumerate(trial.channels):
            first, second = (of[command, c] for of in shared)
            residuals.append(
                Residual(
                    trial=o.name,
                    channel=c,
                    unit=UNITS[c],
                    variant=o.variant.velocity,
                    command=command,
                    t=o.t,
                    t_start=o.t_start,
                    phase=o.phase,
                    measured=trial.measured[k],
                    before=trial.measured[k] - before.residuals[i][k],
                    after=trial.measured[k] - after.residuals[i][k],
                    discrepancy_before=first.value,
                    discrepancy_after=second.value,
                    std=second.std,
                    size=second.size,
                )
            )
    return residuals


def _trials_left_out(problem: Problem, judgement: Judgement) -> tuple[LeftOut, ...]:
    expected = np.fmin(judgement.before.expected, judgement.after.expected)
    rows = zip(problem.trials, judgement.before.left_out, judgement.after.left_out, expected, strict=True)
    return tuple(LeftOut(t.observation.name, *_ratio([a, b], e)) for t, a, b, e in rows if np.isfinite(a + b))


def _speeds_left_out(problem: Problem, judgement: Judgement) -> tuple[LeftOut, ...]:
    expected = np.fmin(judgement.before.expected, judgement.after.expected)
    rows = []
    for repetitions in problem.commands:
        k = list(repetitions)
        a, b = (_sum(p.speed_left_out, k) for p in (judgement.before, judgement.after))
        if np.isfinite(a + b):
            speed = problem.trials[k[0]].observation.variant.velocity
            rows.append(LeftOut(f"{speed:g}", *_ratio([a, b], _sum(expected, k))))
    return tuple(rows)


def _sum(values: Array, places: Sequence[int]) -> float:
    return float(np.sum(values[list(places)]))


def a_theta_views(finding: Finding, fit: AThetaFit | None) -> tuple[View, ...]:
    """Return a_θ by the files, with their uncertainty, and with the soil fitted and what was found.

    The last is that of the likeliest model, fitted to all sensors together with soil, gains and offsets. An
    error of the wheel radius that all trials share is no part of that fit: what it does to the slip is added.

    Args:
        finding: with the common sand as fitted.
        fit: to the steady slip of the same trials; None where it could not be made.
    """
    value, std = finding.fitted_sand["a_theta"].value, finding.sand["a_theta"].std
    parts = [Part("fit to all sensors", "A", "log-normal", "1", std, value * std)]
    if fit is not None:
        radius = [part for part in fit.shared if part.name == SHARED_AS["radius"]]
        parts += [part.times(value / fit.a_theta.value) for part in radius]
    std = math.hypot(*(part.contribution for part in parts))
    low, high = Estimate(math.log(value), std / value).interval()
    augmented = View("found", Estimate(value, std), (math.exp(low), math.exp(high)), tuple(parts))
    return (*(views_of(fit) if fit is not None else ()), augmented)
