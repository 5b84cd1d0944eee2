"""Which candidates of a screen are fitted in full: the most promising one and its rivals."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from granite_lab.discovery.candidates import Score, rivals, scores
from granite_lab.discovery.screens import Screen, rescreened, screen
from granite_lab.errors import EstimateError
from granite_lab.inference.constants import FEW, LEAST_GAIN, RIVAL, TOLERANCE, TRIED
from granite_lab.inference.descent import AT_START
from granite_lab.inference.fit import Fit, fit, with_scales
from granite_lab.inference.gap import tolerated
from granite_lab.inference.problem import Problem


@dataclass(frozen=True, eq=False)
class Screening:
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
    if not result.scales.poor_fit and result.scales.largest <= 2 * TOLERANCE:
        return [result]
    try:
        return [result, fit(problem, result.point.at_files(), result.scales, AT_START)]
    except EstimateError:
        return [result]


def screened(
    problem: Problem,
    origin: Fit,
    candidates: Sequence[str],
    sizes: int | None,
    tolerance: float,
    also_tolerated: bool,
) -> list[Screening]:
    """Return the screens about a fit: with the scales as learnt, and with a tolerated discrepancy, too.

    In the latter trials differ as the files say: a tilt that all have alike may have widened what was learnt.
    """
    columns = screen(problem, origin, candidates, most=sizes)
    screenings = [Screening(origin, columns, tuple(scores(problem, columns, tolerance)))]
    if also_tolerated:
        learnt = problem.learnt_std
        priors = {name: std for name, std in origin.scales.priors.items() if name not in learnt}
        fixed = with_scales(problem, origin, replace(tolerated(origin.scales, tolerance), priors=priors))
        other = rescreened(problem, columns, fixed)
        screenings.append(Screening(fixed, other, tuple(scores(problem, other, tolerance)), True))
    return screenings


@dataclass(frozen=True, eq=False)
class Prospect:
    """What a candidate would bring at most over some screens: its gain, its score there, and where to start.

    A gain is linear about its screen's origin and does not tell from where a fit ends best: from sand that
    stands in for what is missing it may end a thousand units of log evidence lower.
    """

    gain: float
    score: Score
    starts: tuple[tuple[Fit, Score], ...]


def _prospects(screenings: Sequence[Screening]) -> dict[str, Prospect]:
    """Return candidate to what it promises."""
    first = screenings[0].origin.posterior.evidence
    every: dict[str, list[tuple[Fit, Score]]] = {}
    for screening in screenings:
        for score in screening.scores:
            every.setdefault(score.candidate, []).append((screening.origin, score))
    prospects = {}
    for id_, entries in every.items():
        gains = [origin.posterior.evidence + score.gain - first for origin, score in entries]
        best = int(np.argmax(gains))
        prospects[id_] = Prospect(gains[best], entries[best][1], tuple(entries))
    return prospects


@dataclass(frozen=True)
class Fitted:
    """Candidates that were fitted beside a set, and the one that is the best of them; none at first."""

    ids: tuple[str, ...] = ()
    best: str = ""


NOTHING_FITTED = Fitted()


def _best_prospects(prospects: Mapping[str, Prospect], most: int, fitted: Fitted) -> list[Prospect]:
    """Return the prospects of the candidates to be fitted.

    They are the `most` best. A rival must promise `RIVAL` of what the best one does: the screen is linear,
    and full fits have changed the order of candidates by factors of up to two. Where fits have shown that the
    last of those is the best, the next one may be better yet.
    """
    least = max(LEAST_GAIN, RIVAL * max((p.gain for p in prospects.values()), default=0.0))
    ranked = sorted((p for p in prospects.values() if p.gain > least), key=lambda p: -p.gain)
    ids = [p.score.candidate for p in ranked]
    last = ids.index(fitted.best) + 1 if fitted.best in ids else 0
    is_last = last >= most and set(ids[:last]) <= set(fitted.ids)
    return ranked[: last + 1 if is_last else most]


def _best_and_rivals(screenings: Sequence[Screening], most: int, fitted: Fitted) -> list[Prospect]:
    """Return the prospects of the best candidate and of its rivals.

    What adds to the best candidate in place of being its rival has its turn beside it; or now, if none of
    these was found to be better than the set without it.
    """
    ranked = _best_prospects(_prospects(screenings), most, fitted)
    if not ranked or ranked[0].score.trial_values is not None:
        return ranked
    first = ranked[0].score.candidate
    close = {
        first,
        *(c for screening in screenings if screening.screened for c in rivals(screening.screened, first)),
    }
    group = [p for p in ranked if p.score.candidate in close]
    have_failed = not fitted.best and {p.score.candidate for p in group} <= set(fitted.ids)
    return ranked if have_failed else group


def leaders(screenings: Sequence[Screening], fitted: Fitted = NOTHING_FITTED) -> list[Prospect]:
    """Return the candidates of some screens that are fitted in full.

    They are `TRIED` under the scales as learnt, which come first, and `FEW` under the tolerated ones.

    Args:
        screenings: beside one set.
        fitted: the candidates that were fitted there already.
    """
    prospects = _best_and_rivals([k for k in screenings if not k.tolerated], TRIED, fitted)
    if tolerated := [k for k in screenings if k.tolerated]:
        prospects += _best_and_rivals(tolerated, FEW, fitted)
    first: dict[str, Prospect] = {}
    for prospect in prospects:
        first.setdefault(prospect.score.candidate, prospect)
    return list(first.values())


def overlooked(
    before: Sequence[Screening], after: Sequence[Screening], added: str, tried: Collection[str]
) -> list[Score]:
    """Return candidates that were taken to add to an effect, and turn out to be its rivals.

    Beside the set before it they promised `RIVAL` of what the effect did, and beside the effect they promise
    less than half of that. They are the `FEW` that promised most.

    Args:
        before, after: the screens beside the set without the effect, and beside that with it.
        added: the effect.
        tried: candidates that were fitted beside the set before it, the effect among them.
    """
    shares: dict[str, tuple[float, Score]] = {}
    for kind in (False, True):
        first, then = (best_scores(screenings, under_tolerated=kind) for screenings in (before, after))
        least = max(first[added].gain, LEAST_GAIN) if added in first else np.inf
        for id_, score in first.items():
            share = score.gain / least
            is_less = id_ not in then or then[id_].gain < score.gain / 2
            if id_ not in tried and is_less and share > max(RIVAL, shares.get(id_, (0.0, score))[0]):
                shares[id_] = share, score
    return [score for _, score in sorted(shares.values(), key=lambda pair: -pair[0])[:FEW]]


def best_scores(screenings: Sequence[Screening], *, under_tolerated: bool = False) -> dict[str, Score]:
    """Return candidate to the score that promises most, the best last; by scales as learnt, or tolerated."""
    scores = [
        s for screening in screenings if screening.tolerated is under_tolerated for s in screening.scores
    ]
    return {score.candidate: score for score in sorted(scores, key=lambda s: s.gain)}
