"""From the posterior over sets to a verdict: none, named (alone or as twins), or unknown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from granite_lab.discovery.finding import Verdict
from granite_lab.discovery.heldout import Predicted, closed, predict
from granite_lab.discovery.search import Model, Search, good, is_empirical, matters
from granite_lab.estimate import Estimate
from granite_lab.inference.constants import CREDIBLE, LEAST_SHARE, LEFT
from granite_lab.inference.fit import FORMULAS, under
from granite_lab.inference.gap import moved, scatter
from granite_lab.inference.normal import Scales
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array

LARGEST_SET = 3
"""Most effects that cannot be told apart in an answer that still is one."""


@dataclass(frozen=True)
class Named:
    """One effect of the best set.

    Attributes:
        id: of the effect.
        twins: effects that may stand in its place.
        probability: that it or one of its twins is in the model.
        closes: share of the gap on trials left out.
        channel: of which it makes the largest share of what the set changes, and that share.
        changes: channel to how far it moves the prediction, as a share of the channel's rms in motion.
    """

    id: str
    twins: tuple[str, ...]
    probability: float
    closes: Estimate
    channel: tuple[str, float] = ("", float("nan"))
    changes: Mapping[str, float] = field(default_factory=dict)

    def stands_out(self, scatter: Mapping[str, float], tolerance: float) -> bool:
        """Tell whether it changes some channel by more than repetitions differ there, and the tolerance."""
        return any(moved > max(scatter.get(c, 0.0), tolerance) for c, moved in self.changes.items())

    def matters(self, remainder: float, scales: Scales) -> bool:
        """Tell whether it closes enough to be named.

        Trials left out must show it, and it must do more than the errors of the formulas beside it may do.
        Without it the gap must be larger by `LEFT`, as an rms of all channels, or a channel's change smaller
        by `LEAST_SHARE` and two standard deviations of those errors, which are not known at their limit.

        Args:
            remainder: share of the gap that the whole set leaves.
            scales: as learnt, the error of the formulas in each channel among them.
        """
        if not np.isfinite(self.closes.value) or self.closes.value < 2 * self.closes.std:
            return False  # trials left out do not show it
        left = max(remainder, 0.0)
        closes = np.sqrt(max(left + self.closes.value, 0.0)) - np.sqrt(left)
        channel, made = self.channel
        formula = scales.formula_of(channel)
        seen = formula < FORMULAS[1] and made >= max(LEAST_SHARE, 2 * formula)
        return bool(closes >= LEFT or seen)


@dataclass(frozen=True, eq=False)
class Judgement:
    """What follows from a search.

    Attributes:
        verdict: "none", "named" or "unknown".
        probability: posterior probability of the verdict.
        model: the likeliest; the model alone where nothing is named.
        named: what is named; the terms of the empirical law for "unknown".
        small: what the best set holds besides and does not matter.
        before, after: predictions without and with the effects.
        gap: (trials,) misfit of the model alone beyond what noise and the tolerance explain, left out.
        remainder: share of the gap that is left.
        scatter: channel to how far repetitions differ, where that is more than `LEAST_SHARE`; see
            `inference.gap.scatter`.
    """

    verdict: Verdict
    probability: float
    model: Model
    named: tuple[Named, ...]
    small: tuple[Named, ...]
    before: Predicted
    after: Predicted
    gap: Array
    remainder: float
    scatter: Mapping[str, float] = field(default_factory=dict)


def judge(problem: Problem, search: Search, tolerance: float) -> Judgement:
    """Decide by what repetitions share, see `_judged`, and by how they differ.

    It is ``unknown`` where they differ by more than `LEAST_SHARE`, and the model explains all that they share
    or a named effect changes no channel by more than they differ: what acts there acts on the mean, too.
    """
    every = scatter(problem, search.best.fit)
    differ = {c: share for c, share in every.items() if share > LEAST_SHARE}
    found = _judged(problem, search, tolerance, every if differ else {})
    verdict: Verdict = "unknown" if found.verdict == "none" and differ else found.verdict
    return replace(found, scatter=differ, verdict=verdict)


def _judged(problem: Problem, search: Search, tolerance: float, differ: Mapping[str, float]) -> Judgement:
    """Decide by what repetitions share.

    * ``none`` where the model alone leaves no discrepancy beyond the tolerance, the trials differing as the
      likeliest model says, and that model changes no channel by more than the tolerance.
    * Effects of the likeliest set are named that trials left out show, and that close at least `LEFT` of the
      gap or show in a channel, see `Named.matters`, by more than the tolerance. Alone,
      or with at most two others that cannot be told from them, they must have a posterior probability of
      `CREDIBLE`. Together they must leave less than `LEFT` of the gap, as an rms; or not more by two standard
      errors, if errors of their formulas within `FORMULA_ERROR` and the tolerance explain what they leave.
    * ``unknown`` otherwise, and where repetitions differ and one of those effects does not stand out.

    Args:
        problem, search, tolerance: as in `judge`.
        differ: channel to how far repetitions differ; empty where that is little.
    """
    alone = search.model(())
    assert alone is not None
    alone = replace(alone, fit=under(problem, alone.fit, search.best.fit.scales))
    fits, together = (alone.fit, search.best.fit), problem.bench.side_by_side
    before, after = together(lambda k: predict(problem, fits[k], tolerance), 2)
    beside = _held(search, search.beside)
    if not matters(problem, alone.fit, search.best.fit, tolerance):
        small = (*beside, *_held(search, search.best.effects))
        gap = np.zeros_like(before.own)
        return Judgement("none", 1.0, alone, (), small, before, before, gap, float("nan"))
    best = search.best
    base = before.left_out if np.isfinite(before.left_out).any() else before.own
    floor = np.fmin(after.expected, before.expected)
    gap = base - (floor if floor.sum() < _left(after).sum() else _left(after))
    whole_closes = closed(base, _left(after), gap)
    remainder = 1 - whole_closes.value
    beyond = remainder - 2 * whole_closes.std > LEFT**2  # not so where the standard error is not known
    whole = _Whole(base, gap, after, remainder)
    parts = together(lambda k: _named(problem, search, best.effects[k], whole, tolerance), len(best.effects))
    relevant = [n for n in parts if n.matters(remainder, best.fit.scales)]
    small = (*beside, *(n for n in parts if n not in relevant))
    library = [n for n in relevant if not is_empirical(n.id)]
    law = [n for n in relevant if is_empirical(n.id)]
    sure = [n for n in library if n.probability >= CREDIBLE and len(n.twins) < LARGEST_SET]
    by_law = sum(n.closes.value for n in law)
    explained = not law and not beyond and good(problem, best.fit, tolerance)
    enough = remainder + by_law < LEFT**2 or explained
    known = bool(sure) and len(sure) == len(library) and enough
    nothing = Judgement("unknown", 1.0, alone, (), (*beside, *parts), before, before, gap, 1.0)
    if differ and not all(n.stands_out(differ, tolerance) for n in (sure if known else law)):
        return nothing
    if known:
        probability = float(min(n.probability for n in sure))
        return Judgement("named", probability, best, tuple(sure), small, before, after, gap, remainder)
    if not law:
        doubt = 1 - float(min((n.probability for n in library), default=0.0)) if not enough else 0.0
        return replace(nothing, probability=doubt or 1.0)
    small = (*beside, *(n for n in parts if n not in law))
    return Judgement("unknown", 1.0, best, tuple(law), small, before, after, gap, remainder)


def _held(search: Search, effects: Sequence[str]) -> tuple[Named, ...]:
    """Return effects with their probability alone: what they close is not known."""
    return tuple(Named(e, (), search.probability(holding(e)), Estimate(np.nan)) for e in effects)


def by_posterior(problem: Problem, search: Search) -> Judgement:
    """Return what the posterior alone says; it stands in where trials cannot be predicted."""
    best = search.best
    nothing = np.full(len(problem.trials), np.nan)
    unseen = Predicted(nothing, nothing, nothing, nothing)
    named = _held(search, best.effects)
    sure = all(n.probability >= CREDIBLE and not is_empirical(n.id) for n in named)
    verdict: Verdict = "none" if not named else "named" if sure else "unknown"
    probability = min((n.probability for n in named), default=1.0)
    return Judgement(verdict, probability, best, named, (), unseen, unseen, nothing, float("nan"))


@dataclass(frozen=True, eq=False)
class _Whole:
    """How the best set does on trials left out: misfits without it, the gap, its own, what it leaves."""

    base: Array
    gap: Array
    after: Predicted
    remainder: float


def _left(predicted: Predicted) -> Array:
    return predicted.left_out if np.isfinite(predicted.left_out).any() else predicted.own


def holding(id_: str, without: str = "") -> Callable[[Model], bool]:
    """Return the condition that a model holds one effect, and not another."""

    def holds(model: Model) -> bool:
        return id_ in model.effects and without not in model.effects

    return holds


def _named(problem: Problem, search: Search, id_: str, whole: _Whole, tolerance: float) -> Named:
    """Return what speaks for one effect of the best set: its rivals, and what it closes.

    Rivals in its place are twins where the posterior does not exclude them. The likeliest come first, until
    half of the doubt that a name may carry is left; a rival that holds less than a tenth of this doubt is no
    twin. Rivals are twins, too, where they leave less than twice what the best set leaves of the gap, both as
    an rms: a formula that is off by that much cannot exclude another that is off by as much more.
    """
    best = search.best
    rest = tuple(e for e in best.effects if e != id_)
    without = search.model(rest) or next(m for m in search.models if set(m.effects) <= set(rest))

    def left_by(model: Model) -> Array:
        return _left(predict(problem, under(problem, model.fit, best.fit.scales), tolerance))

    changes = moved(problem, without.fit, best.fit)
    closes = closed(left_by(without), _left(whole.after), whole.gap)
    probability = search.probability(holding(id_))
    rivals: list[tuple[float, str, Model]] = []
    for model in search.models:
        other = [e for e in model.effects if e not in rest]
        if set(rest) <= set(model.effects) and len(other) == 1 and other[0] != id_:
            rivals.append((search.probability(holding(other[0], id_)), other[0], model))
    twins: list[str] = []
    doubt = 1 - CREDIBLE
    for share, rival, model in sorted(rivals, key=lambda r: r[:2], reverse=True):
        likely = 1 - probability > doubt / 2 and share >= LEAST_SHARE * doubt
        if not likely and not is_empirical(rival) and whole.remainder > 0:
            left = 1 - closed(whole.base, left_by(model), whole.gap).value
            likely = left < 4 * whole.remainder
        if likely:
            twins.append(rival)
            probability += share
    channel = _channel(problem, search, changes, tolerance)
    return Named(id_, tuple(twins), min(probability, 1.0), closes, channel, changes)


def _channel(
    problem: Problem, search: Search, own: Mapping[str, float], tolerance: float
) -> tuple[str, float]:
    """Return the channel of which an effect makes the largest share of what the whole set changes."""
    alone = search.model(())
    assert alone is not None
    whole = moved(problem, alone.fit, search.best.fit)
    made = {c: own[c] / max(whole[c], own[c]) for c in own if own[c] > tolerance}
    return max(made.items(), key=lambda item: item[1], default=("", float("nan")))
