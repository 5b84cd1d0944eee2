"""The candidates of one round: which are fitted in full, where the fits begin, and what came of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from granite_lab.discovery.bench import PER_TRIAL
from granite_lab.discovery.constancy import uneven
from granite_lab.discovery.point import Fit, Point
from granite_lab.discovery.problem import Problem
from granite_lab.discovery.refit import at_bound, enough, nearly_all, refit, with_effect
from granite_lab.discovery.rivals import freedom
from granite_lab.discovery.screen import Score, evidence
from granite_lab.model.effect import Effect

PROMISING = 6
"""Most candidates that are fitted in full."""

WORTH = 0.1
"""Share of the best candidate's screened evidence below which another is not fitted in full."""

STRONG = 1000.0
"""Drop of chi2 from which a fit begins in the files' sand, too: nuisances may have run after the effect."""

CLOSE = 1 / 3
"""Share of the best evidence at which the screen may be wrong about the order: such a candidate is fitted."""


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


def promising(ranking: Sequence[Score], threshold: float) -> list[Score]:
    """Return what is worth a full fit; the screen is linear and may see too little of a strong effect."""
    least = max(threshold, WORTH * ranking[0].evidence) if ranking else threshold
    return [s for s in ranking if s.evidence > least][:PROMISING]


def _starts(problem: Problem, fit: Fit, id_: str, values: Sequence[float], drop: float) -> list[Point]:
    """Return where a fit with one more effect begins: here, and afresh where the effect is strong."""
    here = with_effect(problem, fit.point, id_, values)
    return [_fresh(problem, fit, id_, values), here] if drop > STRONG else [here]


def _fresh(problem: Problem, fit: Fit, id_: str, values: Sequence[float]) -> Point:
    """Return a point with one more effect in the files' sand, where nothing is known of the trials yet."""
    return with_effect(problem, _in_files_sand(problem, fit, [t.size for t in problem.trials]), id_, values)


def _in_files_sand(problem: Problem, fit: Fit, cleared: Sequence[int]) -> Point:
    """Return the point of a fit in the files' sand, with the first so many numbers of each trial cleared."""
    trials = tuple(
        np.concatenate([np.zeros(n), x[n:]]) for n, x in zip(cleared, fit.point.trials, strict=True)
    )
    return replace(fit.point, sand=problem.neutral().sand, trials=trials)


def try_all(problem: Problem, fit: Fit, ranking: Sequence[Score]) -> tuple[Trial, ...]:
    """Fit candidates in full, the best first; hopeless ones are not finished."""
    tried: list[Trial] = []
    for score in ranking:
        fits = [t.fit for t in tried if t.fit is not None and t.status == "evaluated"]
        best = max((t.evidence for t in tried if t.status == "evaluated"), default=0.0)
        if score.evidence < CLOSE * best and any(
            enough(problem, f) or nearly_all(problem, fit, f) for f in fits
        ):
            break
        tried.append(_try(problem, fit, score, min((f.chi2 for f in fits), default=np.inf)))
    return tuple(sorted(tried, key=lambda t: -t.evidence))


def _try(problem: Problem, fit: Fit, score: Score, goal: float) -> Trial:
    where = _starts(problem, fit, score.effect, score.values, score.drop)
    found = refit(problem, where, near=fit.slopes, goal=goal, before=fit, expected=score.drop)
    if found is None:
        return Trial(score.effect, score, None, 0.0, (), "not converged")
    bounds = at_bound(problem, found)
    effect = problem.effect(score.effect)
    drop = evidence(fit.chi2 - found.chi2, freedom(problem, effect))
    status = "evaluated" if found.converged or drop > 0 else "not converged"
    status = "at a bound" if bounds else "uneven" if uneven(problem, found, score.effect) else status
    return Trial(score.effect, score, found, drop, bounds, status)


def afresh(problem: Problem, fit: Fit) -> Fit:
    """Return a fit, or a better one with its effects from the files' sand.

    Starts, offsets and gains stay those of the fit: without them the way to its valley is too far.
    """
    start = _in_files_sand(problem, fit, [PER_TRIAL] * len(problem.trials))
    other = refit(problem, [start], goal=fit.chi2)
    better = other is not None and other.chi2 < fit.chi2 and not at_bound(problem, other)
    return other if other is not None and better else fit


def untried(ranking: Sequence[Score], tried: Sequence[Trial]) -> list[Trial]:
    """Return the candidates that the screen held back."""
    names = {t.effect for t in tried}
    return [
        Trial(s.effect, s, None, s.evidence, (), "screened only") for s in ranking if s.effect not in names
    ]


def or_related(trial: Trial, least: float, common: float) -> Trial:
    """Mark a candidate that counts, but explains little of what it has in common with one found before."""
    related = trial.status == "evaluated" and least < trial.evidence <= common
    return replace(trial, status="related") if related else trial


def lost(candidates: Mapping[str, Effect], ranking: Sequence[Score], refused: set[str]) -> list[Trial]:
    """Return the candidates of which no size could be simulated around this fit."""
    known = refused | {s.effect for s in ranking}
    return [
        Trial(id_, Score(id_, 0.0, 1, tuple(p.neutral for p in e.parameters)), None, 0.0, (), "not converged")
        for id_, e in candidates.items()
        if id_ not in known
    ]
