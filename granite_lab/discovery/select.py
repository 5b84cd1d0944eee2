"""From the screen to named effects: one after the other, and what must be true of each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from granite_lab.discovery.adjust import FINAL
from granite_lab.discovery.adjust import fit as adjust
from granite_lab.discovery.baseline import learn_noise, noise_energy
from granite_lab.discovery.point import Fit
from granite_lab.discovery.problem import Problem
from granite_lab.discovery.refit import held_out, misfit, plainly_needed
from granite_lab.discovery.related import Relatives
from granite_lab.discovery.rivals import freedom, rivals, without
from granite_lab.discovery.screen import evidence, scores
from granite_lab.discovery.signature import Signatures, signatures
from granite_lab.discovery.tried import STRONG, Trial, afresh, lost, or_related, promising, try_all, untried
from granite_lab.errors import EstimateError
from granite_lab.model.effect import Effect

SHARE = 0.4
"""A further effect must explain at least this share of what is left: a formula that differs from nature's
leaves something, too, of which some other candidate explains a part."""

FAR_FROM_IDLE = 10.0
"""A strength is not idle whose distance from neutral, as its square over its variance, is this many times the
evidence asked: only a fit tells how much worse the model is without it, but that far a quadratic will do."""

MOST = 3
"""Most effects that are named together."""


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
        least = _least(problem, fit, threshold) if chosen else threshold
        tick("fitting the promising effects")
        tried = try_all(problem, fit, promising(ranking, threshold)) if len(chosen) < MOST else ()
        known |= {t.effect: t.fit for t in tried if t.fit is not None}
        tried = tuple(or_related(t, least, relatives.least(t.effect, chosen)) for t in tried)
        rounds.append((*tried, *untried(ranking, tried), *lost(left, ranking, refused)))
        good = [t for t in tried if t.status == "evaluated" and t.evidence > least]
        winner = next((t for t in good if t.fit is not None and _generalises(problem, fit, t.fit)), None)
        if winner is None or winner.fit is None:
            return Choice(base if not chosen else fit, chosen, twins, tuple(rounds), base)
        # the fit of a strong effect has begun in the files' sand already
        best = winner.fit if winner.screened.drop > STRONG else afresh(problem, winner.fit)
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


def _without_idle(problem: Problem, fit: Fit, threshold: float) -> Fit:
    """Drop effects that would not be taken in beside the one that came last."""
    for id_ in fit.point.effects[:-1]:
        if plainly_needed(problem, fit, id_, FAR_FROM_IDLE * _least(problem, fit, threshold)):
            continue
        plain = without(problem, fit, id_, goal=fit.chi2)
        if plain is not None and (
            evidence(plain.chi2 - fit.chi2, freedom(problem, problem.effect(id_)))
            < _least(problem, plain, threshold)
        ):
            return _without_idle(problem, settle(problem, plain), threshold)
    return fit


def _least(problem: Problem, fit: Fit, threshold: float) -> float:
    """Return the evidence that a further effect must have beside those of a fit."""
    return max(threshold, SHARE * misfit(fit.white, noise_energy(problem, fit.white)))


def settle(problem: Problem, fit: Fit) -> Fit:
    """Learn the noise anew from what the effects leave, and converge under it."""
    learn_noise(problem, fit.residuals)
    try:
        return adjust(problem, fit.point, slopes=fit.slopes, tolerance=FINAL)
    except EstimateError:
        return adjust(problem, fit.point, tolerance=FINAL)


def _generalises(problem: Problem, before: Fit, after: Fit) -> bool:
    """Tell whether trials that were left out are predicted better with the effect."""
    if len(problem.trials) < 2:
        return True
    groups = list(range(len(problem.trials)))
    return float(held_out(problem, after, groups).loss.sum()) < float(
        held_out(problem, before, groups).loss.sum()
    )
