"""Verdict on the sets of a search: none, named (alone or as twins), partly named, or unknown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from granite_lab.discovery.description import lacking
from granite_lab.discovery.finding import LIKELY, GroundWave, Verdict
from granite_lab.discovery.heldout import Predicted, closed, gaps
from granite_lab.discovery.models import Model, Search, finely
from granite_lab.discovery.relevance import (
    anything_matters,
    exceeds_formula_errors,
    is_adequate,
    left_without,
    share_made,
)
from granite_lab.discovery.resampling import (
    Competition,
    Predictions,
    by_evidence,
    compete,
    nothing_missing,
    winner,
)
from granite_lab.estimate import Estimate
from granite_lab.inference.constants import (
    CERTAIN,
    CREDIBLE,
    FORMULA_ERROR,
    LEAST_SHARE,
    MAX_REMAINDER,
    NEAR_ZERO,
    RELEVANT,
    SUBSTITUTE,
    TRIED,
)
from granite_lab.inference.fit import Fit, with_priors
from granite_lab.inference.gap import prediction_change, scatter
from granite_lab.inference.normal import Scales
from granite_lab.inference.priors import width_of
from granite_lab.inference.problem import Problem
from granite_lab.inference.scales import FORMULAS
from granite_lab.logs.trial import Array
from granite_lab.model.dictionary import is_term
from granite_lab.model.effect import EffectParameter

OPEN = Estimate(float("nan"))
"""A share that is not known."""

AT_BOUND = NEAR_ZERO
"""Share of a parameter's range within which it counts as being at its bound."""


@dataclass(frozen=True)
class EffectEvidence:
    """One effect of the best set.

    Attributes:
        id: of the effect.
        twins: effects that may stand in its place.
        probability: that it or one of its twins is in the model, see `discovery.resampling`; NaN where no
            trial left out has judged that.
        closes, speeds: share of the gap on trials and on speeds left out.
        strained: its numbers that ended at a bound, or two standard deviations outside what is expected.
        at_bound: a number ended at a bound: its likeliest size is none that it can have.
        changes: channel to how far it moves the prediction, as a share of the channel's rms in motion.
        share_made: channel to which share it makes of what the set changes there.
        left_without: channel to what the rest of the set leaves there without it, beyond errors of its
            formulas; a share of the channel's rms in motion.
    """

    id: str
    twins: tuple[str, ...]
    probability: float
    closes: Estimate
    speeds: Estimate = OPEN
    strained: tuple[str, ...] = ()
    at_bound: bool = False
    changes: Mapping[str, float] = field(default_factory=dict)
    share_made: Mapping[str, float] = field(default_factory=dict)
    left_without: Mapping[str, float] = field(default_factory=dict)

    @property
    def channel(self) -> tuple[str, float]:
        """The channel of which it makes the largest share of what the set changes, and that share."""
        return max(self.share_made.items(), key=lambda item: item[1], default=("", float("nan")))

    def stands_out(self, scatter: Mapping[str, float], tolerance: float) -> bool:
        """Tell whether it changes some channel by more than repetitions differ there, and the tolerance."""
        return any(change > max(scatter.get(c, 0.0), tolerance) for c, change in self.changes.items())

    def matters(self, remainder: float, tolerance: float, scales: Scales) -> bool:
        """Tell whether it closes enough to be named.

        Trials left out must show it, and it must do more than the errors of the formulas beside it may do.
        Without it the gap must be larger by `RELEVANT`, as an rms of all channels; or in a channel of whose
        change it makes `LEAST_SHARE`, the others must leave more than the tolerance even if their formulas
        are off by as much as they may be. An effect that exceeds the errors as learnt, see
        `exceeds_formula_errors`, and not their limit must be certain by two standard deviations.

        Args:
            remainder: share of the gap that the whole set leaves.
            tolerance: as in `judge`.
            scales: as learnt, the error of the formulas in each channel among them.
        """
        if not np.isfinite(self.closes.value) or self.closes.value < 2 * self.closes.std:
            return False  # trials left out do not show it
        left = max(remainder, 0.0)
        closes = np.sqrt(max(left + self.closes.value, 0.0)) - np.sqrt(left)
        channels = [c for c, share in self.share_made.items() if share >= LEAST_SHARE]
        if closes >= RELEVANT or any(self.left_without.get(c, 0.0) > tolerance for c in channels):
            return True
        return self.probability >= CERTAIN and exceeds_formula_errors(self.share_made, scales)

    def is_shown(self) -> bool:
        """Tell whether trials left out show it."""
        return bool(self.closes.value >= 2 * self.closes.std)

    def is_sure(self) -> bool:
        """Tell whether it, alone or with its twins, may be named where little else is missing.

        Of a screen no more than `TRIED` are fitted: where so many cannot be told apart, others may not, too.
        """
        return self.probability >= CREDIBLE and len(self.twins) < TRIED

    def is_likely(self) -> bool:
        """Tell whether it is a cause that acts rather than not."""
        return not is_term(self.id) and self.probability >= LIKELY

    def is_sure_beside(self, unexplained: float, scales: Scales) -> bool:
        """Tell whether it may be named although more is missing, which it could resemble.

        Of what it closes and of what is left unexplained together, less than `SUBSTITUTE` must be left: what
        stands in for another cause leaves more. Speeds left out must show it. Its numbers must be as
        expected; so must the error of its formula in the channel that it changes most.
        """
        speeds = self.speeds.value >= 2 * self.speeds.std
        most = max(self.changes, key=lambda c: self.changes[c], default="")
        more = unexplained < SUBSTITUTE * (self.closes.value + unexplained)
        usual = not self.strained and scales.formula_of(most) < FORMULAS[1]
        return self.is_sure() and more and speeds and usual

    def as_likely(self, unexplained: float) -> EffectEvidence:
        """Return it with the probability that it acts, where it may not be named beside what is unexplained.

        A cause for which it stands in would close what it closes and what is unexplained: of these two, only
        its own share speaks for it.
        """
        closes, more = max(self.closes.value, 0.0), max(unexplained, 0.0)
        return replace(self, probability=self.probability * closes / (closes + more) if closes > 0 else 0.0)


@dataclass(frozen=True, eq=False)
class Judgement:
    """What follows from a search.

    Attributes:
        verdict: "none", "named", "partly named" or "unknown".
        probability: of the verdict: of all its names; that nothing is missing; that something is.
        model: the likeliest; the model alone where nothing is missing.
        named: what is named.
        described: what trials left out show besides: likely effects, which the model may lack, and terms.
        small: what it holds besides and does not matter.
        before, after: predictions without and with the effects.
        closed: share of the gap that is closed on trials left out.
        speeds: the same on speeds left out.
        scatter: channel to how far repetitions differ, where that is more than `LEAST_SHARE`; see
            `inference.gap.scatter`.
        competition: how often each set wins on other speeds or trials; None where no set competes.
        ground_wave: what repeats with the position of the robot; None where nothing does.
        simulates_worse: simulations with the model predict what was left out worse than those by the files.
        masked: small effects that the model holds because gains of the sensors mask them.
    """

    verdict: Verdict
    probability: float
    model: Model
    named: tuple[EffectEvidence, ...]
    described: tuple[EffectEvidence, ...]
    small: tuple[EffectEvidence, ...]
    before: Predicted
    after: Predicted
    closed: Estimate = OPEN
    speeds: Estimate = OPEN
    scatter: Mapping[str, float] = field(default_factory=dict)
    competition: Competition | None = None
    ground_wave: GroundWave | None = None
    simulates_worse: bool = False
    masked: tuple[str, ...] = ()

    @property
    def remainder(self) -> float:
        """Share of the gap that is left on trials left out; NaN without a gap."""
        return 1 - self.closed.value


def with_ground_wave(judgement: Judgement, wave: GroundWave | None) -> Judgement:
    """Return a judgement with the wave that its model leaves: what is named is not all that is missing."""
    further: dict[Verdict, Verdict] = {"none": "unknown", "named": "partly named"}
    verdict = judgement.verdict if wave is None else further.get(judgement.verdict, judgement.verdict)
    return replace(judgement, ground_wave=wave, verdict=verdict)


def judge(problem: Problem, search: Search, tolerance: float) -> Judgement:
    """Decide by what repetitions share, see `_judged`, and by how they differ.

    It is ``unknown`` where they differ by more than `LEAST_SHARE`, and the model explains all they share. A
    named effect must change some channel by more than they differ: what acts there acts on the mean, too.
    """
    every = scatter(problem, search.best.fit)
    differ = {c: share for c, share in every.items() if share > LEAST_SHARE}
    judgement = _judged(problem, search, tolerance, every if differ else {})
    verdict: Verdict = "unknown" if judgement.verdict == "none" and differ else judgement.verdict
    return replace(judgement, scatter=differ, verdict=verdict)


@dataclass(frozen=True)
class _Left:
    """What the likeliest set leaves of the gap on trials left out.

    Attributes:
        share: of the gap; what a strength at its bound closes counts as left, for it has another cause.
        explained: errors of its formulas within `FORMULA_ERROR` and the tolerance explain it.
        little: it is less than `MAX_REMAINDER`, as an rms; or not more by two standard errors, if explained.
    """

    share: float
    explained: bool
    little: bool

    @classmethod
    def of(cls, whole: SetPerformance, evidence: Sequence[EffectEvidence], explained: bool) -> _Left:
        """Return what a set leaves, by what it closes and what speaks for its effects."""
        at_bound = sum(e.closes.value for e in evidence if e.at_bound and e.is_shown())
        share = 1 - whole.closed.value + at_bound
        surely_more = share - 2 * whole.closed.std > MAX_REMAINDER**2  # not where the std is not known
        return cls(share, explained, share < MAX_REMAINDER**2 or (explained and not surely_more))

    def allows(self, effect: EffectEvidence, scales: Scales) -> bool:
        """Tell whether an effect may be named beside what is left.

        Where that is not explained, the effect must close more than is left: what is missing could otherwise
        be all that speaks for it.
        """
        if not effect.is_sure() or effect.at_bound:
            return False
        least = 0.0 if self.explained else self.share
        return (self.little and effect.closes.value > least) or effect.is_sure_beside(self.share, scales)


def _judged(
    problem: Problem, search: Search, tolerance: float, differ: Mapping[str, float], *, final: bool = False
) -> Judgement:
    """Decide by what repetitions share, about the likeliest set, or the one that predicts what is left out.

    * ``none`` where the model without effects leaves no discrepancy beyond the tolerance, and the likeliest
      model changes no channel by more than the tolerance. Trials differ as the likeliest model says.
    * An effect of the likeliest set is named if it matters (`EffectEvidence.matters`), is sure enough, and
      what the set leaves allows it (`_Left.allows`). A term of the dictionary is a description.
    * ``named`` where all that matter are named, little is left, and no term stands for what is not known.
      ``partly named`` where some are named and more is missing or not sure, ``unknown`` where none is named.
      What else trials left out show is a description.

    Args:
        problem, search, tolerance: as in `judge`.
        differ: channel to how far repetitions differ; empty where that is little.
        final: the best set of the search is judged even where another one predicts better.
    """
    best, scales = search.best, search.best.fit.scales
    baseline = replace(search.baseline, fit=with_priors(problem, search.baseline.fit, scales))
    predictions = Predictions(problem, best.fit, tolerance)
    before, after = predictions.of((baseline, best))
    negligible = unjudged(search.negligible)
    if not anything_matters(problem, baseline.fit, best.fit, tolerance):
        small = (*negligible, *unjudged(best.effects))
        return Judgement("none", nothing_missing(search), baseline, (), (), small, before, before)
    competition = compete(problem, search, predictions)
    if not final and (first := winner(competition, search)).effects not in ((), best.effects):
        (first,) = finely(problem, [first])
        return _judged(problem, search.led_by(first), tolerance, differ, final=True)
    whole = performance_of(before, after)

    def evidence_of(id_: str) -> EffectEvidence:
        if is_term(id_):
            return evidence_of_term(problem, best.fit, id_, whole, tolerance)
        return _evidence_of(problem, search, id_, whole, competition, predictions)

    evidence = problem.pool.parallel(evidence_of, best.effects)
    left = _Left.of(whole, evidence, is_adequate(problem, best.fit, tolerance))
    relevant = [e for e in evidence if not is_term(e.id) and e.matters(left.share, tolerance, scales)]
    stand_out = [e for e in relevant if not differ or e.stands_out(differ, tolerance)]
    named = [e for e in stand_out if left.allows(e, scales)]
    complete = left.little and len(named) == len(relevant) and not any(map(is_term, best.effects))
    verdict: Verdict = "unknown" if not named else "named" if complete else "partly named"
    rest = [e for e in evidence if e not in named]
    shown = [e for e in rest if verdict != "named" and e.is_shown()]
    small = (*negligible, *(e for e in rest if e not in shown))
    described = tuple(e if is_term(e.id) else e.as_likely(left.share) for e in shown)
    missing = 1 - competition.probability(lambda m: not m.effects)
    probability = float(min((e.probability for e in named), default=missing))
    return Judgement(
        verdict, probability, best, tuple(named), described, small, before, after,
        whole.closed, whole.speeds, competition=competition,
    )  # fmt: skip


def unjudged(effects: Sequence[str]) -> tuple[EffectEvidence, ...]:
    """Return effects that no trial left out has judged.

    Their evidence alone is no probability: a small error of the model has as much.
    """
    return tuple(EffectEvidence(e, (), np.nan, OPEN) for e in effects)


def by_posterior(problem: Problem, search: Search) -> Judgement:
    """Return what the posterior alone says; it stands in where trials cannot be predicted."""
    best = search.best
    unseen = Predicted.unknown(problem)
    competition = by_evidence(search)
    named = tuple(EffectEvidence(e, (), competition.probability(holding(e)), OPEN) for e in best.effects)
    sure = all(n.probability >= CREDIBLE for n in named)
    verdict: Verdict = "none" if not named else "named" if sure else "unknown"
    probability = min((n.probability for n in named), default=nothing_missing(search))
    names, terms = (named, ()) if sure else ((), named)
    return Judgement(verdict, probability, best, names, terms, (), unseen, unseen, competition=competition)


@dataclass(frozen=True, eq=False)
class SetPerformance:
    """How the best set does on trials left out.

    Attributes:
        base: (trials,) misfits without it.
        gap, gap_speeds: (trials,) misfits beyond what noise and the tolerance explain; with speeds left out.
        after: predictions with it.
        closed, speeds: share of either gap that it closes.
    """

    base: Array
    gap: Array
    gap_speeds: Array
    after: Predicted
    closed: Estimate
    speeds: Estimate


def performance_of(before: Predicted, after: Predicted) -> SetPerformance:
    """Return how a set does on trials left out, given the predictions without and with it."""
    base, left = before.unseen, after.unseen
    gap, other = gaps(before, after)
    speeds = closed(before.speed_left_out, after.speed_left_out, other)
    return SetPerformance(base, gap, other, after, closed(base, left, gap), speeds)


def holding(id_: str, without: str = "") -> Callable[[Model], bool]:
    """Return the condition that a model holds one effect, and not another."""

    def holds(model: Model) -> bool:
        return id_ in model.effects and without not in model.effects

    return holds


def _evidence_of(
    problem: Problem,
    search: Search,
    id_: str,
    whole: SetPerformance,
    competition: Competition,
    predictions: Predictions,
) -> EffectEvidence:
    """Return what speaks for one effect of the best set: its rivals, and what it closes."""
    best, tolerance = search.best, predictions.tolerance
    rest = tuple(e for e in best.effects if e != id_)
    without = search.model(rest) or next(m for m in search.models if set(m.effects) <= set(rest))
    changes, (lacking,) = prediction_change(problem, without.fit, best.fit), predictions.of((without,))
    closes = closed(lacking.unseen, whole.after.unseen, whole.gap)
    speeds = closed(lacking.speed_left_out, whole.after.speed_left_out, whole.gap_speeds)
    twins, probability = _twins(search, id_, closes.value, whole, competition, predictions)
    of_set = prediction_change(problem, search.baseline.fit, best.fit)
    return EffectEvidence(
        id_, twins, min(probability, 1.0), closes, speeds, strained_numbers(problem, best.fit, id_),
        bool(at_bounds(problem, best.fit, id_)), changes, share_made(changes, of_set, tolerance),
        left_without(problem, without.fit, best.fit.scales, id_, changes, tolerance),
    )  # fmt: skip


def evidence_of_term(
    problem: Problem, fit: Fit, id_: str, whole: SetPerformance, tolerance: float
) -> EffectEvidence:
    """Return what a term of the dictionary closes, linear about the fit of its set; it states no cause."""
    without = lacking(problem, fit, [id_], tolerance)
    return EffectEvidence(
        id_, (), 1.0, closed(without.unseen, whole.after.unseen, whole.gap),
        closed(without.speed_left_out, whole.after.speed_left_out, whole.gap_speeds),
        strained_numbers(problem, fit, id_),
    )  # fmt: skip


def _twins(
    search: Search,
    id_: str,
    closes: float,
    whole: SetPerformance,
    competition: Competition,
    predictions: Predictions,
) -> tuple[tuple[str, ...], float]:
    """Return the rivals that cannot be told from an effect, and the probability of all of them together.

    The likeliest rivals come first, until effect and twins may be named together. One that holds less than a
    tenth of the doubt that a name may carry is no twin. Two other kinds of rivals are: one that closes all of
    what the effect closes but the largest error that the formula of an effect may have; and one that closes
    nearly as much and leaves less than twice what the best set leaves of the gap, both as an rms, since a
    formula that is off by that much cannot exclude another that is off by as much more. Beside a rival other
    effects may act: the likeliest set with it and no likelier rival, as large as the best set at most, says
    what it closes.

    Args:
        search, whole, competition, predictions: as in `_evidence_of`.
        id_: the effect.
        closes: share of the gap that it closes.
    """
    rest = {e for e in search.best.effects if e != id_}
    rivals: list[tuple[float, str, Model]] = []
    for model in search.models:
        others = [e for e in model.effects if e not in rest]
        if rest <= set(model.effects) and len(others) == 1 and others[0] != id_:
            (rival,) = others
            excluded = {id_, *(r for _, r, _ in rivals)}
            sets = (m for m in search.models if rival in m.effects and not excluded & set(m.effects))
            likeliest = next(m for m in sets if len(m.effects) <= len(rest) + 1)
            rivals.append((competition.probability(holding(rival, id_)), rival, likeliest))
    remainder, doubt = 1 - whole.closed.value, 1 - CREDIBLE
    twins, probability = [], competition.probability(holding(id_))
    for share, rival, model in sorted(rivals, key=lambda r: r[:2], reverse=True):
        is_twin = probability < CREDIBLE and share >= LEAST_SHARE * doubt
        if not is_twin:
            (predicted,) = predictions.of((model,))
            left = 1 - closed(whole.base, predicted.unseen, whole.gap).value
            more = (left - remainder) / closes if closes > 0 else np.inf
            is_twin = more < FORMULA_ERROR[1] ** 2 or (left < 2**2 * remainder and more < SUBSTITUTE)
        if is_twin:
            twins.append(rival)
            probability += share
    return tuple(twins), probability


def strained_numbers(problem: Problem, fit: Fit, id_: str) -> tuple[str, ...]:
    """Name the numbers of an effect at a bound, and its strengths two std outside their prior.

    A strength at its neutral value is no strain: the effect is then not there.
    """
    return tuple(
        p.name
        for p, value in _common_numbers(problem, fit, id_)
        if _is_bound(p, value) or (not p.shape and abs(value - p.neutral) > 2 * width_of(p))
    )


def at_bounds(problem: Problem, fit: Fit, id_: str) -> tuple[str, ...]:
    """Name the numbers of an effect that ended at a bound, see `_is_bound`."""
    return tuple(p.name for p, value in _common_numbers(problem, fit, id_) if _is_bound(p, value))


def _common_numbers(problem: Problem, fit: Fit, id_: str) -> list[tuple[EffectParameter, float]]:
    """Return the numbers of an effect that all trials share, with their values."""
    common = problem.parameters(fit.point.effects, per_trial=False)
    pairs = zip(common, fit.point.common.tolist(), strict=True)
    return [(p, value) for (e, p), value in pairs if e == id_]


def _is_bound(p: EffectParameter, value: float) -> bool:
    """Tell whether a number is at a bound at which the effect cannot be what the trials show.

    For a strength that is a bound other than its neutral value. For a shape it is one larger than all that is
    expected, as of a lag: the trials then ask for something else. Near zero a lag is only too short to show.
    """
    margin, expected = AT_BOUND * (p.high - p.low), max(abs(p.prior_low), abs(p.prior_high))
    bounds = (b for b in (p.low, p.high) if (abs(b) > expected if p.shape else abs(b - p.neutral) > margin))
    return any(abs(value - b) < margin for b in bounds)
