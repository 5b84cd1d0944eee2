"""From the screen to named effects: full fits, a further effect, and what must be true of each."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from granite_lab.discovery.adjust import FINAL
from granite_lab.discovery.adjust import fit as adjust
from granite_lab.discovery.baseline import learn_noise, noise_energy
from granite_lab.discovery.bench import PER_TRIAL
from granite_lab.discovery.constancy import uneven
from granite_lab.discovery.point import Fit, Point
from granite_lab.discovery.problem import Problem
from granite_lab.discovery.refit import (
    at_bound,
    enough,
    held_out,
    misfit,
    nearly_all,
    plainly_needed,
    refit,
    with_effect,
)
from granite_lab.discovery.related import Relatives
from granite_lab.discovery.rivals import freedom, rivals, without
from granite_lab.discovery.screen import Score, evidence, scores
from granite_lab.discovery.signature import Signatures, signatures
from granite_lab.errors import EstimateError
from granite_lab.model.effect import Effect

PROMISING = 6
"""Most candidates that are fitted in full."""

WORTH = 0.1
"""Share of the best candidate's screened evidence below which another is not fitted in full."""

STRONG = 1000.0
"""Drop of chi2 from which a fit also starts afresh: the nuisances may have run after the effect."""


SHARE = 0.4
"""A further effect must explain at least this share of what is left: a formula that differs from nature's
leaves something, too, of which some other candidate explains a part."""

CLOSE = 1 / 3
"""Share of the best evidence at which the screen may be wrong about the order: such a candidate is fitted."""

FAR_FROM_IDLE = 10.0
"""A strength this many times the threshold from neutral, as its square over its variance, is not idle: only a
fit tells how much worse the model is without it, but that far the quadratic is not wrong by so much."""

MOST = 3


@dataclass(frozen=True, eq=False)
class Trial:
    """One candidate fitted in full.

    Attributes:
        effect: id.
        screened: what the screen said.
        fit: the fit, None where none converged.
        evidence: drop of chi2 against the model without it, as of one number.
        bounds: parameters that ended at a bound.
        status: "evaluated", "at a bound", "uneven": of another size in each trial, "not converged", "screened
            only", or "related": it explains no more than a fault in the formula of one that was found before.
    """

    effect: str
    screened: Score
    fit: Fit | None
    evidence: float
    bounds: tuple[str, ...]
    status: str


@dataclass(frozen=True, eq=False)
class Choice:
    """The outcome of the search.

    Attributes:
        fit: with all chosen effects.
        effects: ids, in the order in which they were found.
        twins: per chosen effect the ids that explain the data as well in its place.
        rounds: per round the candidates, best first.
        base: the fit without effects, improved where the search came upon better sand.
    """

    fit: Fit
    effects: tuple[str, ...]
    twins: Mapping[str, tuple[str, ...]]
    rounds: tuple[tuple[Trial, ...], ...]
    base: Fit


def search(
    problem: Problem,
    base: Fit,
    signs: Signatures,
    candidates: Mapping[str, Effect],
    threshold: float,
    tick: Callable[[str], None] = lambda _: None,
) -> Choice:
    """Add effects one after the other while each clears the threshold.

    Args:
        problem: the trials, with the noise learnt.
        base: the fit without effects.
        signs: signatures around it.
        candidates: effects to choose from.
        threshold: evidence that chance exceeds once in a hundred sets.
        tick: told what is being done.
    """
    fit, rounds = base, []  # type: Fit, list[tuple[Trial, ...]]
    twins: Mapping[str, tuple[str, ...]] = {}
    known: dict[str, Fit] = {}
    relatives = Relatives()
    refused: set[str] = set()
    while True:
        chosen = fit.point.effects
        left = {id_: e for id_, e in candidates.items() if id_ not in chosen}
        if rounds:
            tick("looking for twins and for a further effect")
            signs = signatures(problem, fit, left, small=bool(chosen))
        if chosen:
            twins, better = rivals(problem, fit, signs, left, known)
            if better is not None:
                fit = settle(problem, better)
                relatives.replace(chosen, fit.point.effects)
                chosen = fit.point.effects
                left = {id_: e for id_, e in candidates.items() if id_ not in chosen}
                signs = signatures(problem, fit, left, small=True)
                twins, _ = rivals(problem, fit, signs, left, known)
        ranking = [s for s in scores(problem, fit, signs, left) if s.effect not in refused]
        remains = misfit(fit.white, noise_energy(problem, fit.white)) if chosen else 0.0
        least = max(threshold, SHARE * remains)
        tick("fitting the promising effects")
        tried = _try_all(problem, fit, _promising(ranking, threshold)) if len(chosen) < MOST else ()
        known |= {t.effect: t.fit for t in tried if t.fit is not None}
        tried = tuple(_or_related(t, least, relatives.least(t.effect, chosen)) for t in tried)
        rounds.append((*tried, *_untried(ranking, tried), *_lost(left, ranking, refused)))
        good = [t for t in tried if t.status == "evaluated" and t.evidence > least]
        winner = next((t for t in good if t.fit is not None and _generalises(problem, fit, t.fit)), None)
        if winner is None or winner.fit is None:
            return Choice(base if not chosen else fit, chosen, twins, tuple(rounds), base)
        # the fit of a strong effect has begun in the files' sand already
        best = winner.fit if winner.screened.drop > STRONG else _afresh(problem, winner.fit)
        # the fit with the effect may have found better sand: that alone is no evidence
        plain = without(problem, best, winner.effect, goal=fit.chi2)
        if plain is not None and plain.chi2 < fit.chi2:
            fit = plain
            base = base if chosen else plain
            if evidence(plain.chi2 - best.chi2, freedom(problem, problem.effect(winner.effect))) < least:
                refused.add(winner.effect)
                continue
        relatives.add(winner.effect, winner.evidence, signs, left)
        fit = _without_idle(problem, settle(problem, best), threshold)


def _untried(ranking: Sequence[Score], tried: Sequence[Trial]) -> list[Trial]:
    """Return the candidates that the screen held back."""
    names = {t.effect for t in tried}
    return [
        Trial(s.effect, s, None, s.evidence, (), "screened only") for s in ranking if s.effect not in names
    ]


def _or_related(trial: Trial, least: float, common: float) -> Trial:
    """Mark a candidate that counts, but explains little of what it has in common with one found before."""
    related = trial.status == "evaluated" and least < trial.evidence <= common
    return replace(trial, status="related") if related else trial


def _lost(candidates: Mapping[str, Effect], ranking: Sequence[Score], refused: set[str]) -> list[Trial]:
    """Return the candidates of which no size could be simulated around this fit."""
    known = refused | {s.effect for s in ranking}
    return [
        Trial(id_, Score(id_, 0.0, 1, tuple(p.neutral for p in e.parameters)), None, 0.0, (), "not converged")
        for id_, e in candidates.items()
        if id_ not in known
    ]


def _without_idle(problem: Problem, fit: Fit, threshold: float) -> Fit:
    """Drop effects that no longer explain anything beside the one that came last."""
    for id_ in fit.point.effects[:-1]:
        if plainly_needed(problem, fit, id_, FAR_FROM_IDLE * threshold):
            continue
        plain = without(problem, fit, id_, goal=fit.chi2)
        if plain is not None and (
            evidence(plain.chi2 - fit.chi2, freedom(problem, problem.effect(id_))) < threshold
        ):
            return _without_idle(problem, settle(problem, plain), threshold)
    return fit


def settle(problem: Problem, fit: Fit) -> Fit:
    """Learn the noise anew from what the effects leave, and converge under it."""
    learn_noise(problem, fit.residuals)
    try:
        return adjust(problem, fit.point, slopes=fit.slopes, tolerance=FINAL)
    except EstimateError:
        return adjust(problem, fit.point, tolerance=FINAL)


def _promising(ranking: Sequence[Score], threshold: float) -> list[Score]:
    """Return what is worth a full fit; the screen is linear and may see too little of a strong effect."""
    least = max(threshold, WORTH * ranking[0].evidence) if ranking else threshold
    return [s for s in ranking if s.evidence > least][:PROMISING]


def starts(problem: Problem, fit: Fit, id_: str, values: Sequence[float], drop: float) -> list[Point]:
    """Return where a fit with one more effect begins: here, and afresh where the effect is strong."""
    here = with_effect(problem, fit.point, id_, values)
    return [_fresh(problem, fit, id_, values), here] if drop > STRONG else [here]


def _fresh(problem: Problem, fit: Fit, id_: str, values: Sequence[float]) -> Point:
    """Return a point with one more effect in the files' sand."""
    fresh = replace(
        fit.point,
        sand=problem.neutral().sand,
        trials=tuple(
            np.concatenate([np.zeros(t.size), x[t.size :]])
            for t, x in zip(problem.trials, fit.point.trials, strict=True)
        ),
    )
    return with_effect(problem, fresh, id_, values)


def _try_all(problem: Problem, fit: Fit, promising: Sequence[Score]) -> tuple[Trial, ...]:
    """Fit the promising candidates in full, the best first; hopeless ones are not finished."""
    tried: list[Trial] = []
    for score in promising:
        fits = [t.fit for t in tried if t.fit is not None and t.status == "evaluated"]
        best = max((t.evidence for t in tried if t.status == "evaluated"), default=0.0)
        if score.evidence < CLOSE * best and any(
            enough(problem, f) or nearly_all(problem, fit, f) for f in fits
        ):
            break
        tried.append(_try(problem, fit, score, min((f.chi2 for f in fits), default=np.inf)))
    return tuple(sorted(tried, key=lambda t: -t.evidence))


def _try(problem: Problem, fit: Fit, score: Score, goal: float) -> Trial:
    where = starts(problem, fit, score.effect, score.values, score.drop)
    found = refit(problem, where, near=fit.slopes, goal=goal, before=fit, expected=score.drop)
    if found is None:
        return Trial(score.effect, score, None, 0.0, (), "not converged")
    bounds = at_bound(problem, found)
    effect = problem.effect(score.effect)
    drop = evidence(fit.chi2 - found.chi2, freedom(problem, effect))
    status = "evaluated" if found.converged or drop > 0 else "not converged"
    status = "at a bound" if bounds else "uneven" if uneven(problem, found, score.effect) else status
    return Trial(score.effect, score, found, drop, bounds, status)


def _afresh(problem: Problem, fit: Fit) -> Fit:
    """Return a fit, or a better one with its effects from the files' sand.

    Starts, offsets and gains stay those of the fit: without them the way to its valley is too far.
    """
    own = tuple(np.concatenate([np.zeros(PER_TRIAL), x[PER_TRIAL:]]) for x in fit.point.trials)
    start = replace(fit.point, sand=problem.neutral().sand, trials=own)
    other = refit(problem, [start], goal=fit.chi2)
    better = other is not None and other.chi2 < fit.chi2 and not at_bound(problem, other)
    return other if other is not None and better else fit


def _generalises(problem: Problem, before: Fit, after: Fit) -> bool:
    """Tell whether trials that were left out are predicted better with the effect."""
    if len(problem.trials) < 2:
        return True
    groups = list(range(len(problem.trials)))
    return float(held_out(problem, after, groups).loss.sum()) < float(
        held_out(problem, before, groups).loss.sum()
    )
