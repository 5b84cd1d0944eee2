"""Which candidates of a screen are fitted in full: the most promising one and its rivals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from granite_lab.discovery.candidates import Score, Screen, rescreened, rivals, scores, screen
from granite_lab.errors import EstimateError
from granite_lab.inference.constants import FEW, RIVAL, TOLERANCE, TRIED, WORTH
from granite_lab.inference.fit import Fit, fit, taken
from granite_lab.inference.gap import tolerated
from granite_lab.inference.problem import Problem


@dataclass(frozen=True, eq=False)
class Look:
    """A screen of all candidates.

    Attributes:
        origin: the fit about which it is linear.
        screened: the columns; None where a later screen took their place.
        scores: what each candidate would bring, the best first.
        tolerated: the discrepancy was taken to be of the tolerated size, and trials to differ as the files
            say, so that neither hides an effect, in place of what was learnt.
    """

    origin: Fit
    screened: Screen | None
    scores: tuple[Score, ...]
    tolerated: bool = False


def origins(problem: Problem, result: Fit) -> list[Fit]:
    """Return where candidates are screened: at the fit, and where it is bad at the numbers of the files.

    Where much is missing, sand and sensors have moved to stand in for it.
    """
    if not result.scales.loud and result.scales.largest <= 2 * TOLERANCE:
        return [result]
    try:
        return [result, fit(problem, result.point.at_files(), result.scales, rounds=0)]
    except EstimateError:
        return [result]


def screened(
    problem: Problem, origin: Fit, candidates: Sequence[str], sizes: int | None, tolerance: float | None
) -> list[Look]:
    """Return the screens about a fit: with the scales as learnt, and with a tolerated discrepancy.

    In the latter trials differ as the files say: what all have in common may have widened what was learnt.
    """
    columns = screen(problem, origin, candidates, most=sizes)
    looks = [Look(origin, columns, tuple(scores(problem, columns)))]
    if tolerance is not None:
        learnt = problem.learnt_std
        priors = {name: std for name, std in origin.scales.priors.items() if name not in learnt}
        fixed = taken(problem, origin, replace(tolerated(origin.scales, tolerance), priors=priors))
        other = rescreened(problem, columns, fixed)
        looks.append(Look(fixed, other, tuple(scores(problem, other)), True))
    return looks


@dataclass(frozen=True, eq=False)
class Promise:
    """What a candidate would bring at most over some screens: its gain, its score there, and where to start.

    A gain is linear about its screen's origin and does not tell from where a fit ends best: from sand that
    stands in for what is missing it may end a thousand units of log evidence lower.
    """

    gain: float
    score: Score
    starts: tuple[tuple[Fit, Score], ...]


def _promises(looks: Sequence[Look]) -> dict[str, Promise]:
    """Return candidate to what it promises."""
    first = looks[0].origin.posterior.evidence
    every: dict[str, list[tuple[Fit, Score]]] = {}
    for look in looks:
        for score in look.scores:
            every.setdefault(score.candidate, []).append((look.origin, score))
    promises = {}
    for id_, entries in every.items():
        gains = [origin.posterior.evidence + score.gain - first for origin, score in entries]
        best = int(np.argmax(gains))
        promises[id_] = Promise(gains[best], entries[best][1], tuple(entries))
    return promises


def _promising(promises: Mapping[str, Promise], most: int) -> list[Promise]:
    """Return what is promised by the candidates to be fitted.

    They are the `most` best. A rival must promise `RIVAL` of what the best one does: the screen is linear,
    and full fits have changed the order of candidates by factors of up to two.
    """
    least = max(WORTH, RIVAL * max((p.gain for p in promises.values()), default=0.0))
    ranked = sorted((p for p in promises.values() if p.gain > least), key=lambda p: -p.gain)
    return ranked[:most]


def _best_and_rivals(looks: Sequence[Look], most: int) -> list[Promise]:
    """Return what is promised by the best candidate and its rivals.

    What adds to the best candidate in place of being its rival has its turn beside it.
    """
    ranked = _promising(_promises(looks), most)
    if not ranked or ranked[0].score.trial_values is not None:
        return ranked
    first = ranked[0].score.candidate
    close = {first, *(c for look in looks if look.screened for c in rivals(look.screened, first))}
    return [p for p in ranked if p.score.candidate in close]


def leaders(looks: Sequence[Look]) -> list[Promise]:
    """Return the candidates of some screens that are fitted in full.

    They are `TRIED` under the scales as learnt, which come first, and `FEW` under the tolerated ones.
    """
    promises = _best_and_rivals([k for k in looks if not k.tolerated], TRIED)
    if tolerated := [k for k in looks if k.tolerated]:
        promises += _best_and_rivals(tolerated, FEW)
    first: dict[str, Promise] = {}
    for promise in promises:
        first.setdefault(promise.score.candidate, promise)
    return list(first.values())
