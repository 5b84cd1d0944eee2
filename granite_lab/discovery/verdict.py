"""From the posterior over sets to a verdict: none, named (alone or as twins), or unknown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from granite_lab.discovery.finding import Verdict
from granite_lab.discovery.heldout import Predicted, closed, predict
from granite_lab.discovery.search import Model, Search, good, is_empirical, matters
from granite_lab.estimate import Estimate
from granite_lab.inference.constants import CREDIBLE, LEAST_SHARE
from granite_lab.inference.fit import under
from granite_lab.inference.gap import moved
from granite_lab.inference.problem import Problem

LARGEST_SET = 3
"""Most effects that cannot be told apart in an answer that still is one."""

CLOSED = 0.5
"""Share of the gap on trials left out that named effects must close together: more than half."""


@dataclass(frozen=True)
class Named:
    """One effect of the best set.

    Attributes:
        id: of the effect.
        twins: effects that may stand in its place.
        probability: that it or one of its twins is in the model.
        closes: share of the gap on trials left out.
        channel: of which it makes the largest share of what the set changes, and that share.
    """

    id: str
    twins: tuple[str, ...]
    probability: float
    closes: Estimate
    channel: tuple[str, float] = ("", float("nan"))

    @property
    def matters(self) -> bool:
        """Whether it closes enough to be named."""
        return self.closes.value >= LEAST_SHARE or self.channel[1] >= LEAST_SHARE


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
    """

    verdict: Verdict
    probability: float
    model: Model
    named: tuple[Named, ...]
    small: tuple[Named, ...]
    before: Predicted
    after: Predicted
    gap: np.ndarray[tuple[int, ...], np.dtype[np.float64]]
    remainder: float


def judge(problem: Problem, search: Search, tolerance: float) -> Judgement:
    """Decide.

    * ``none`` where the model alone leaves no discrepancy beyond the tolerance, the trials differing as the
      likeliest model says, and that model changes no channel by more than the tolerance.
    * Effects of the likeliest set are named that close at least `LEAST_SHARE` of the gap, or make that share
      of what the set changes in a channel, and more than the tolerance. Alone, or with at most two others
      that cannot be told from them, they must have a posterior probability of `CREDIBLE`; together they must
      close more than half of the gap.
    * ``unknown`` otherwise.
    """
    alone = search.model(())
    assert alone is not None
    alone = replace(alone, fit=under(problem, alone.fit, search.best.fit.scales))
    before = predict(problem, alone.fit, tolerance)
    if not matters(problem, alone.fit, search.best.fit, tolerance):
        small = tuple(
            Named(e, (), search.probability(holding(e)), Estimate(np.nan)) for e in search.best.effects
        )
        gap = np.zeros_like(before.own)
        return Judgement("none", 1.0, alone, (), small, before, before, gap, float("nan"))
    best = search.best
    after = predict(problem, best.fit, tolerance)
    base = before.left_out if np.isfinite(before.left_out).any() else before.own
    floor = np.fmin(after.expected, before.expected)
    gap = base - (floor if floor.sum() < _left(after).sum() else _left(after))
    parts = [_named(problem, search, best, e, gap, after, tolerance) for e in best.effects]
    relevant = [n for n in parts if n.matters]
    small = tuple(n for n in parts if not n.matters)
    library = [n for n in relevant if not is_empirical(n.id)]
    law = [n for n in relevant if is_empirical(n.id)]
    sure = [n for n in library if n.probability >= CREDIBLE and len(n.twins) < LARGEST_SET]
    remainder = 1 - closed(base, _left(after), gap).value
    by_law = sum(n.closes.value for n in law)
    enough = sum(n.closes.value for n in sure) > max(CLOSED, by_law) and remainder + by_law < CLOSED
    enough |= not law and good(problem, alone.fit, tolerance)  # a gap too small to be divided
    if sure and len(sure) == len(library) and enough:
        probability = float(min(n.probability for n in sure))
        return Judgement("named", probability, best, tuple(sure), small, before, after, gap, remainder)
    doubt = 1 - float(min((n.probability for n in library), default=0.0)) if not enough else 0.0
    shown = tuple(law) if law else ()
    if not shown:
        return Judgement("unknown", doubt or 1.0, alone, (), tuple(parts), before, before, gap, 1.0)
    return Judgement(
        "unknown", 1.0, best, shown, tuple(n for n in parts if n not in law), before, after, gap, remainder
    )


def _left(predicted: Predicted) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return predicted.left_out if np.isfinite(predicted.left_out).any() else predicted.own


def holding(id_: str, without: str = "") -> Callable[[Model], bool]:
    """Return the condition that a model holds one effect, and not another."""

    def holds(model: Model) -> bool:
        return id_ in model.effects and without not in model.effects

    return holds


def _named(
    problem: Problem,
    search: Search,
    best: Model,
    id_: str,
    gap: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
    after: Predicted,
    tolerance: float,
) -> Named:
    """Return what speaks for one effect of the best set: its rivals, and what it closes."""
    rest = tuple(e for e in best.effects if e != id_)
    without = search.model(rest)
    closes, channel = Estimate(float("nan")), ("", float("nan"))
    if without is not None:
        channel = _channel(problem, search, without, best, tolerance)
        left = _left(predict(problem, under(problem, without.fit, best.fit.scales), tolerance))
        closes = closed(left, _left(after), gap)
    probability = search.probability(holding(id_))
    rivals: list[tuple[float, str]] = []
    for model in search.models:
        other = [e for e in model.effects if e not in rest]
        if set(rest) <= set(model.effects) and len(other) == 1 and other[0] != id_:
            rivals.append((search.probability(holding(other[0], id_)), other[0]))
    twins: list[str] = []
    for share, rival in sorted(rivals, reverse=True):
        if probability >= 0.95 or share < 0.01:
            break
        twins.append(rival)
        probability += share
    return Named(id_, tuple(twins), min(probability, 1.0), closes, channel)


def _channel(
    problem: Problem, search: Search, without: Model, best: Model, tolerance: float
) -> tuple[str, float]:
    """Return the channel of which an effect makes the largest share of what the whole set changes."""
    alone = search.model(())
    assert alone is not None
    whole, own = moved(problem, alone.fit, best.fit), moved(problem, without.fit, best.fit)
    made = {c: own[c] / max(whole[c], own[c]) for c in own if own[c] > tolerance}
    return max(made.items(), key=lambda item: item[1], default=("", float("nan")))
