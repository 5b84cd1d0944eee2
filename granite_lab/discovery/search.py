"""The posterior over sets of effects: screened by linear algebra, the leaders fitted in full."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from granite_lab.discovery.candidates import Score, Screen, scores, screen
from granite_lab.discovery.empirical import EmpiricalLaw
from granite_lab.errors import EstimateError
from granite_lab.inference.bench import RAKED
from granite_lab.inference.constants import EFFECT_ODDS, LEFT, SPREAD, TOLERANCE, WORTH
from granite_lab.inference.fit import Fit, fit, under
from granite_lab.inference.gap import moved, shares
from granite_lab.inference.normal import Scales
from granite_lab.inference.point import Point
from granite_lab.inference.problem import Problem

MOST = 3
"""Effects in a set at most."""

TRIED = 3
"""Candidates of a screen that are fitted in full."""

FEW, ALL = 2, 99
"""Sizes of a strength that are probed, the smallest first."""


@dataclass(frozen=True, eq=False)
class Model:
    """A set of effects with its fit.

    Attributes:
        effects: ids, sorted; terms of the empirical law are ``empirical.term``.
        fit: the best that was found.
        log_posterior: evidence and the prior of the set.
    """

    effects: tuple[str, ...]
    fit: Fit
    log_posterior: float

    @property
    def empirical(self) -> bool:
        """Whether a term of the empirical law is in it."""
        return any(is_empirical(e) for e in self.effects)


@dataclass(frozen=True, eq=False)
class Look:
    """A screen of all candidates.

    Attributes:
        origin: the fit about which it is linear.
        screened: the columns.
        scores: what each candidate would bring, the best first.
    """

    origin: Fit
    screened: Screen
    scores: tuple[Score, ...]


@dataclass(frozen=True, eq=False)
class Search:
    """What a search has looked at.

    Attributes:
        models: fitted sets, the likeliest first.
        looks: sets beside which candidates were screened, to the screens.
        small: sets whose last effect changes no channel by more than the tolerance.
    """

    models: tuple[Model, ...]
    looks: Mapping[tuple[str, ...], tuple[Look, ...]]
    small: frozenset[tuple[str, ...]] = frozenset()

    @property
    def best(self) -> Model:
        """The likeliest set all of whose effects matter."""
        return next(m for m in self.models if m.effects not in self.small)

    @property
    def beside(self) -> tuple[str, ...]:
        """The effects that are likely beside the best set, and too small to matter."""
        likelier = self.models[: self.models.index(self.best)]
        return tuple(dict.fromkeys(e for m in likelier for e in m.effects if e not in self.best.effects))

    def model(self, effects: Sequence[str]) -> Model | None:
        """Return the model of a set, None where it was not fitted."""
        key = tuple(sorted(effects))
        return next((m for m in self.models if m.effects == key), None)

    def probability(self, wanted: Callable[[Model], bool]) -> float:
        """Return the posterior probability of the models that fulfil a condition."""
        weights = np.exp(np.array([m.log_posterior for m in self.models]) - self.models[0].log_posterior)
        return float(weights[[wanted(m) for m in self.models]].sum() / weights.sum())


def is_empirical(id_: str) -> bool:
    """Tell a term of the empirical law from an effect."""
    return id_.partition(".")[0] == EmpiricalLaw.id


def search(
    problem: Problem,
    base: Fit,
    candidates: Sequence[str],
    tolerance: float = TOLERANCE,
    tell: Callable[[str], None] = lambda _: None,
) -> Search:
    """Extend the model effect by effect, then exchange each effect of the best set for its rivals.

    Beside effects that leave no discrepancy the empirical law is not looked for.

    Args:
        problem: the trials, with the noise.
        base: the fit without effects.
        candidates: ids, terms of the empirical law among them.
        tolerance: discrepancy that does not matter, as a share of a channel's rms.
        tell: told what is being done.
    """
    found: dict[tuple[str, ...], Model] = {(): _model((), base, candidates)}
    looks: dict[tuple[str, ...], tuple[Look, ...]] = {}
    own = frozenset(c for c in candidates if any(p.per_trial for p in problem.parameters_of(c)))

    def fitted(starts: Sequence[tuple[Point, Fit]]) -> None:
        """Fit the sets of some points that are not fitted yet, each with the scales of a fit nearby."""
        new = [(start, near.scales) for start, near in starts if _set(start) not in found]
        if new:
            tell(f"fitting {', '.join(dict.fromkeys(_words(_set(start)) for start, _ in new))}")
        fits = fit_sets(problem, new, {k: m.fit for k, m in found.items()})
        found.update({k: _model(k, f, candidates) for k, f in fits.items()})

    def extended(model: Model, wanted: Callable[[str, float], bool], most: int = TRIED) -> list[Score]:
        """Fit the promising ones of the wanted candidates beside those of a model, and return them."""
        if model.effects not in looks:
            tell(f"screening candidates beside {_words(model.effects)}")
            closed = bool(model.effects) and settled(model)
            others = [c for c in candidates if c not in model.effects and not (closed and is_empirical(c))]
            sizes = FEW if model.effects else ALL
            origins = _origins(problem, model.fit)
            screens = problem.bench.side_by_side(
                lambda k: _screened(problem, origins[k], others, sizes), len(origins)
            )
            looks[model.effects] = tuple(
                Look(origin, *found) for origin, found in zip(origins, screens, strict=True)
            )
        promises = _promises(looks[model.effects])
        promising = _promising({c: p for c, p in promises.items() if wanted(c, p.gain)}, most)
        starts = [_with(problem, o.point, score) for p in promising for o, score in p.starts]
        if len(promising) == 1:  # it will be in the set: the exchange asks for it beside the others
            without = [problem.without_effect(starts[0], id_) for id_ in model.effects]
            starts += [_where_alone(problem, point, found) for point in without]
        fitted([(start, model.fit) for start in starts])
        return [p.score for p in promising]

    @cache
    def settled(model: Model) -> bool:
        return good(problem, model.fit, tolerance) and not strained(problem, model.fit)

    def sets(model: Model, tried: Sequence[Score]) -> list[tuple[str, ...]]:
        every = [tuple(sorted((*model.effects, s.candidate))) for s in tried]
        return [e for e in every if e in found]

    def best_of(model: Model, tried: Sequence[Score]) -> Model:
        own = [found[e] for e in sets(model, tried) if e not in small]
        return max(own, key=lambda m: m.log_posterior, default=model)

    current = found[()]
    small: set[tuple[str, ...]] = set()
    path: list[tuple[str, list[Score]]] = []
    for _ in range(MOST):
        fine = settled(current)
        wanted = left_open(current, base, own) if fine and current.effects else lambda *_: True
        tried = extended(current, wanted, 1 if fine else TRIED)
        best = best_of(current, tried)
        if fine and best is not current:
            tried = extended(current, wanted)
            for effects in sets(current, tried):
                if not matters(problem, current.fit, found[effects].fit, tolerance):
                    small.add(effects)  # it cannot be named; it is listed
            best = best_of(current, tried)
        if best.log_posterior <= current.log_posterior + WORTH:
            break
        path.append((next(e for e in best.effects if e not in current.effects), tried))
        current = best
    exchanged: list[Point] = []
    closed = len(path) > 1 and settled(current)
    for id_, tried in path[:-1]:  # those of the last stood beside the same effects
        without = problem.without_effect(current.fit.point, id_)
        exchanged.append(_where_alone(problem, without, found))
        rivals = [s for s in tried if s.candidate not in current.effects]
        rivals = [s for s in rivals if not (closed and is_empirical(s.candidate))]
        exchanged += [_with(problem, without, score) for score in rivals]
    fitted([(point, current.fit) for point in exchanged])
    models = sorted(found.values(), key=lambda m: -m.log_posterior)
    return Search(tuple(models), looks, frozenset(small))


def _with(problem: Problem, point: Point, score: Score) -> Point:
    return problem.with_effect(point, score.candidate, score.values, score.own)


def _where_alone(problem: Problem, point: Point, known: Mapping[tuple[str, ...], Model]) -> Point:
    """Return a point with the sand, offsets and gains of the best fit of a part of its effects.

    There they stand in already for what the point lacks.
    """
    parts = [m.fit for k, m in known.items() if set(k) < set(point.effects)]
    part = max(parts, key=lambda f: f.evidence).point
    pairs = zip(problem.trials, point.trials, part.trials, strict=True)
    own = tuple(np.concatenate([theirs[: t.size], x[t.size :]]) for t, x, theirs in pairs)
    return replace(point, shared=part.shared, trials=own)


def fit_sets(
    problem: Problem, starts: Sequence[tuple[Point, Scales]], known: Mapping[tuple[str, ...], Fit]
) -> dict[tuple[str, ...], Fit]:
    """Return the best fit of each set of effects, those left out whose starts have no solution.

    A fit can be no worse than that of a part of the set: one that is has missed the optimum. It is made again
    from the part, with the other effects at their neutral values.

    Args:
        problem: the trials.
        starts: where to begin, with the set switched on, and the scales to begin with; several of a set.
        known: fits of other sets.
    """
    found = _attempts(problem, starts)
    again: dict[tuple[str, ...], tuple[Point, Scales]] = {}
    for key, effects in {_set(start): start.effects for start, _ in starts}.items():
        parts = [f for k, f in {**known, **found}.items() if set(k) < set(key)]
        part = max(parts, key=lambda f: f.evidence, default=None)
        if part is not None and not (key in found and found[key].evidence > part.evidence):
            point = part.point
            for id_ in (e for e in effects if e not in point.effects):
                point = problem.with_effect(point, id_, [p.neutral for p in problem.parameters_of(id_)])
            again[key] = point, part.scales
    for key, other in _attempts(problem, list(again.values())).items():
        if key not in found or other.evidence > found[key].evidence:
            found[key] = other
    return found


def _attempts(problem: Problem, starts: Sequence[tuple[Point, Scales]]) -> dict[tuple[str, ...], Fit]:
    def one(k: int) -> Fit | None:
        try:
            return fit(problem, *starts[k])
        except EstimateError:
            return None

    found: dict[tuple[str, ...], Fit] = {}
    for (start, _), f in zip(starts, problem.bench.side_by_side(one, len(starts)), strict=True):
        key = _set(start)
        if f is not None and (key not in found or f.evidence > found[key].evidence):
            found[key] = f
    return found


def _set(point: Point) -> tuple[str, ...]:
    """Return the effects of a point, sorted."""
    return tuple(sorted(point.effects))


def left_open(model: Model, base: Fit, own: Collection[str]) -> Callable[[str, float], bool]:
    """Return which candidates, by their gain, are of interest beside a model that leaves no discrepancy.

    Such a model says nothing of what differs from trial to trial. Of the rest, a candidate that promises no
    more than the errors of the formulas in the model may have left is not of interest.

    Args:
        model: the effects with their fit.
        base: the fit without effects.
        own: candidates with numbers of their own in each trial.
    """
    least = LEFT**2 * (model.fit.evidence - base.evidence)
    return lambda c, gain: c in own or (gain > least and not is_empirical(c))


def good(problem: Problem, result: Fit, tolerance: float) -> bool:
    """Tell whether a fit leaves no discrepancy beyond the tolerance and no louder noise."""
    return max(shares(problem, result).values(), default=0.0) <= tolerance and not result.scales.loud


def strained(problem: Problem, result: Fit) -> bool:
    """Tell whether numbers of the trials stand in for something that is missing.

    Their scale is then two standard deviations beyond what it was taken for.
    """
    first = {s.name: s.std for t in problem.trials for s in t.slacks if s.learnt}
    return any(result.scales.priors.get(n, std) > np.exp(2 * SPREAD) * std for n, std in first.items())


def matters(problem: Problem, alone: Fit, best: Fit, tolerance: float) -> bool:
    """Tell whether the model alone leaves, or another model changes, more than the tolerance in a channel."""
    changed = max(moved(problem, alone, best).values(), default=0.0)
    return changed > tolerance or not good(problem, under(problem, alone, best.scales), tolerance)


def _origins(problem: Problem, result: Fit) -> list[Fit]:
    """Return where candidates are screened: at the fit, and at the files' sand where the fit is bad.

    Where much is missing, the sand has moved to stand in for it.
    """
    if not result.scales.loud and result.scales.largest <= 2 * TOLERANCE:
        return [result]
    trials = []
    for x in result.point.trials:
        own = x.copy()
        own[:RAKED] = 0.0
        trials.append(own)
    afresh = replace(result.point, shared=np.zeros_like(result.point.shared), trials=tuple(trials))
    try:
        return [result, fit(problem, afresh, result.scales, rounds=0)]
    except EstimateError:
        return [result]


def _screened(
    problem: Problem, origin: Fit, candidates: Sequence[str], sizes: int
) -> tuple[Screen, tuple[Score, ...]]:
    screened = screen(problem, origin, candidates, most=sizes)
    return screened, tuple(scores(problem, screened))


@dataclass(frozen=True, eq=False)
class _Promise:
    """What a candidate would bring at most over some screens: its gain, its score there, and where to start.

    A gain is linear about its screen's origin and does not tell from where a fit ends best: from sand that
    stands in for what is missing it may end a thousand units of log evidence lower. A term of the empirical
    law starts where it promises most: it only shows that no effect of the library will do.
    """

    gain: float
    score: Score
    starts: tuple[tuple[Fit, Score], ...]


def _promises(looks: Sequence[Look]) -> dict[str, _Promise]:
    """Return candidate to what it promises."""
    first = looks[0].origin.posterior.evidence
    every: dict[str, list[tuple[Fit, Score]]] = {}
    for look in looks:
        for score in look.scores:
            every.setdefault(score.candidate, []).append((look.origin, score))
    found = {}
    for id_, own in every.items():
        gains = [origin.posterior.evidence + score.gain - first for origin, score in own]
        best = int(np.argmax(gains))
        starts = own[best : best + 1] if is_empirical(id_) else own
        found[id_] = _Promise(gains[best], own[best][1], tuple(starts))
    return found


def _promising(promises: Mapping[str, _Promise], most: int) -> list[_Promise]:
    """Return what is promised by the candidates to be fitted.

    They are the `most` best effects of the library, and the best term of the empirical law. A rival must
    promise `LEFT` of what the best one does: the screen is linear, and full fits have changed the order of
    candidates by factors of up to two.
    """
    least = max(WORTH, LEFT * max((p.gain for p in promises.values()), default=0.0))
    ranked = sorted((p for p in promises.values() if p.gain > least), key=lambda p: -p.gain)
    library = [p for p in ranked if not is_empirical(p.score.candidate)][:most]
    law = [p for p in ranked if is_empirical(p.score.candidate)][: most // 2]
    return law + library  # a fit of the law takes longest


def _model(effects: tuple[str, ...], result: Fit, candidates: Sequence[str]) -> Model:
    """Give a fit the prior of its set: equal odds for each effect, shared by the empirical terms."""
    terms = max(1, sum(is_empirical(c) for c in candidates))
    library = max(1, len(candidates) - terms)
    odds = [np.log(EFFECT_ODDS * (library / terms if is_empirical(e) else 1.0)) for e in effects]
    return Model(effects, result, result.evidence + float(np.sum(odds)))


def _words(effects: Sequence[str]) -> str:
    return " + ".join(effects) if effects else "the model alone"
