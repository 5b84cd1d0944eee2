"""The posterior over sets of effects: screened by linear algebra, the leaders fitted in full."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from granite_lab.discovery.candidates import Score
from granite_lab.discovery.fitted_sets import MOST, FittedSets, with_score
from granite_lab.discovery.heldout import Equations, losses, predict, predicts_better
from granite_lab.discovery.leaders import Fitted, Prospect, best_scores, overlooked
from granite_lab.discovery.models import Model, Search, finely, likely, ranked
from granite_lab.discovery.relevance import exceeds_formula_errors, left_without, share_made, unexplained
from granite_lab.discovery.saved_model import loss_of_files, loss_of_model, predicts_worse
from granite_lab.discovery.sets import TOGETHER, EffectSet, set_of
from granite_lab.inference.constants import FEW, LEAST_GAIN, MAX_REMAINDER, RIVAL, TOLERANCE, TRIED
from granite_lab.inference.fit import Fit, with_priors
from granite_lab.inference.gap import prediction_change
from granite_lab.inference.point import Point
from granite_lab.inference.problem import Problem
from granite_lab.inference.scales import FIRST, FORMULAS
from granite_lab.model.dictionary import is_term


def search(
    problem: Problem,
    base: Fit,
    candidates: Sequence[str],
    tolerance: float = TOLERANCE,
    tell: Callable[[str, int], None] = lambda *_: None,
) -> Search:
    """Extend the model effect by effect, revise the set, then exchange each of its effects for its rivals.

    Candidates are screened under the discrepancy as learnt and under one of the tolerated size.

    Args:
        problem: the trials, with the noise.
        base: the fit without effects.
        candidates: ids.
        tolerance: discrepancy that does not matter, as a share of a channel's rms.
        tell: called with the stage, and the number of effects beside which is searched; `MOST` while effects
            are exchanged.
    """
    sets = FittedSets(problem, candidates, tolerance, tell, {(): Model.of((), base)})
    return _exchanged(sets, *revise(sets, *extend_fully(sets, sets.baseline)))


def search_beside(
    found: Search,
    start: Model,
    problem: Problem,
    candidates: Sequence[str],
    tolerance: float = TOLERANCE,
    tell: Callable[[str, int], None] = lambda *_: None,
) -> Search:
    """Search on from a set that holds terms of the dictionary.

    An effect that closes little of a large gap shows only beside what closes the rest.

    Args:
        found: the search in the library.
        start: the set.
        problem, candidates, tolerance, tell: as in `search`.
    """
    sets = FittedSets.of_search(found, problem, candidates, tolerance, tell)
    sets.models[start.effects] = start
    sets.set_aside.discard(start.effects)
    return _exchanged(sets, *extend_fully(sets, start))


def search_from_rivals(
    found: Search,
    problem: Problem,
    candidates: Sequence[str],
    tolerance: float = TOLERANCE,
    tell: Callable[[str, int], None] = lambda *_: None,
) -> Search:
    """Search on from sets that nearly took the place of a part of the best one.

    A step of a search takes what explains most by itself. Two effects of which neither does may together
    explain more. `FEW` rivals are extended by one effect, and further where the set is then likelier than the
    sets of the same size on the way to the best one.

    Args:
        found: the search in the library.
        problem, candidates, tolerance, tell: as in `search`.

    Returns:
        the search with what was fitted; the same where there is no rival.
    """
    sets = FittedSets.of_search(found, problem, candidates, tolerance, tell)
    best = sets.likeliest()
    rivals = _rivals(sets, best)[:FEW]
    if not rivals or problem.is_exhausted:
        return found
    for rival in rivals:
        size = len(rival.effects) + 1
        parts = [m for m in found.models if set(m.effects) <= set(best.effects) and len(m.effects) <= size]
        larger, tried = extend(sets, rival)
        if larger.log_posterior <= max(m.log_posterior for m in parts) + LEAST_GAIN:
            continue
        new, more = extend_fully(sets, larger)
        if new.log_posterior > best.log_posterior + LEAST_GAIN:
            return _exchanged(sets, new, [Extension(rival, larger, tried), *more])
    return sets.as_search()


def _rivals(sets: FittedSets, best: Model) -> list[Model]:
    """Return the sets that were fitted beside a part of the best one, and gained `RIVAL` of what its effect
    did there; those that gained the largest share first.

    Sets beside which candidates were screened have been extended already.
    """
    shares: dict[EffectSet, float] = {}
    for origin in (k for k in sets.screenings if set(k) < set(best.effects)):
        before = sets.models[origin].log_posterior
        larger = {k: m for k, m in sets.models.items() if len(k) == len(origin) + 1 and set(k) > set(origin)}
        gains = {k: m.log_posterior - before for k, m in larger.items()}
        most = max((gain for k, gain in gains.items() if set(k) <= set(best.effects)), default=np.inf)
        others = {k: gain / most for k, gain in gains.items() if not set(k) <= set(best.effects)}
        shares |= {k: share for k, share in others.items() if share > RIVAL and k not in sets.screenings}
    return [sets.models[k] for k in sorted(shares, key=lambda k: -shares[k])]


def _exchanged(sets: FittedSets, best: Model, steps: Sequence[Extension]) -> Search:
    """Exchange the effects of the best set, and reduce the set to those that are needed."""
    if not sets.problem.is_exhausted:
        exchange(sets, best, steps)
        if (new := sets.likeliest()) is not best:
            extend_fully(sets, new)
    for _ in range(MOST):
        set_aside_bad_predictors(sets)
        if sets.problem.is_exhausted:
            break
        is_settled = fit_finely(sets)
        if is_settled and not reduce(sets):
            break
    return sets.as_search()


@dataclass(frozen=True, eq=False)
class Extension:
    """One step of a search: the set before it, that with one more effect, and what was tried."""

    before: Model
    after: Model
    tried: Sequence[Score]


def extend_fully(sets: FittedSets, model: Model) -> tuple[Model, list[Extension]]:
    """Extend a set effect by effect; return the last set and the steps to it."""
    steps: list[Extension] = []
    model = sets.at_optimum_if_adequate(model)
    while sum(not is_term(e) for e in model.effects) < MOST and not sets.problem.is_exhausted:
        larger, tried = extend(sets, model)
        if larger is model:
            break
        step = _or_overlooked(sets, Extension(model, sets.at_optimum_if_adequate(larger), tried))
        steps.append(step)
        model = step.after
    return model, steps


def _or_overlooked(sets: FittedSets, step: Extension) -> Extension:
    """Return a step, or that to an overlooked rival of the added effect where the rival is better.

    See `leaders.overlooked`.
    """
    if sets.problem.is_exhausted:
        return step
    before, added = step.before, _added(step.after, step.before)
    sets.stage = min(MOST, max(sets.stage, len(step.after.effects)))
    sets.prospects(step.after)  # screens beside it
    first, then = (sets.screenings.get(m.effects, ()) for m in (before, step.after))
    new = overlooked(first, then, added, {score.candidate for score in step.tried})
    if not new:
        return step
    points = [with_score(sets.problem, before.fit.point, score) for score in new]
    sets.fit_new([(point, before.fit) for point in points], step.after.log_posterior)
    best = _best_of(sets, before, [score.candidate for score in new])
    after = best if best.log_posterior > step.after.log_posterior else step.after
    return Extension(before, after, [*step.tried, *new])


def extend(sets: FittedSets, model: Model) -> tuple[Model, list[Score]]:
    """Return the best set with one more effect, the set itself if none is better, and what was tried."""
    sets.stage = min(MOST, max(sets.stage, len(model.effects)))
    tried: dict[str, Prospect] = {}

    def further(best: str = "") -> list[Prospect]:
        if sets.problem.is_exhausted:
            return []
        fitted = Fitted(tuple(tried), best)
        return [p for p in sets.prospects(model, fitted) if p.score.candidate not in tried]

    best, groups = model, _fitted_together(sets, model, further())
    while groups and best is model:
        new = groups.pop(0)
        while new:
            tried |= {p.score.candidate: p for p in new}
            sets.fit_prospects(model, new)
            best = _best_of(sets, model, list(tried))
            new = further(_added(best, model)) if best is not model and sets.is_adequate(best) else []
        if not groups and best is model and not _may_be_explained(sets, model):
            groups = _fitted_together(sets, model, further())
    return best, [p.score for p in tried.values()]


def _added(larger: Model, model: Model) -> str:
    """Return the effect that a set holds more than another one."""
    (id_,) = set(larger.effects) - set(model.effects)
    return id_


def _fitted_together(sets: FittedSets, model: Model, prospects: list[Prospect]) -> list[list[Prospect]]:
    """Return the groups in which candidates are fitted beside a model until one of them stays.

    Beside a set that leaves no discrepancy there are `TOGETHER` in each, for most often none stays. Where
    errors of the formulas may explain all that is left, it is only the first; elsewhere all together.
    """
    if sets.is_adequate(model):
        return [prospects[k : k + TOGETHER] for k in range(0, len(prospects), TOGETHER)]
    few = prospects[:1] if _may_be_explained(sets, model) else prospects
    return [few] if few else []


def _may_be_explained(sets: FittedSets, model: Model) -> bool:
    """Tell whether errors of the formulas of a set may explain all that it leaves."""
    if not model.effects:
        return False
    left = unexplained(sets.problem, model.fit, model.fit.scales, sets.tolerance)
    return max(left.values(), default=0.0) <= sets.tolerance


def _best_of(sets: FittedSets, model: Model, tried: Sequence[str]) -> Model:
    """Return the likeliest set with one of the tried whose new effect stays; the set itself if none.

    Where a likelier set predicts worse, its sand may still stand in for what was missing: it is fitted again
    from the numbers of the files.
    """
    keys = [model.with_effect(id_) for id_ in tried]
    for larger in ranked(sets.models[k] for k in keys if k in sets.models and k not in sets.set_aside):
        if larger.log_posterior <= model.log_posterior + LEAST_GAIN:
            break
        if model.is_improved_by(larger):
            if stays(sets, model, larger):
                return larger
            if not sets.is_adequate(larger):
                again = sets.refit(larger, [larger.fit.point.at_files()], FIRST)
                if again is not larger and stays(sets, model, again):
                    return again
        sets.set_aside.add(larger.effects)  # it cannot be named; it is listed
    return model


def stays(sets: FittedSets, model: Model, larger: Model) -> bool:
    """Tell whether the last effect of a set stays: it matters, and predicts what is left out.

    Beside others it must be needed, or show beyond the errors of their formulas as learnt. A contact law
    beside another one must be needed: it may be the error of that formula.
    """
    problem, scales, tolerance = sets.problem, larger.fit.scales, sets.tolerance
    changes = prediction_change(problem, model.fit, larger.fit)
    if max(changes.values(), default=0.0) <= tolerance:
        return False
    if model.effects:
        id_ = _added(larger, model)
        left = left_without(problem, model.fit, scales, id_, changes, tolerance)
        share = share_made(changes, prediction_change(problem, sets.baseline.fit, larger.fit), tolerance)
        laws = [e for e in larger.effects if problem.pool.scenario.effects[e].law]
        must_be_needed = id_ in laws and len(laws) > 1
        is_needed = max(left.values(), default=0.0) > tolerance
        if not is_needed and (must_be_needed or not exceeds_formula_errors(share, scales)):
            return False
    before = Equations(problem, with_priors(problem, model.fit, scales))
    return predicts_better(losses(problem, before, tolerance), sets.losses(larger))


def revise(sets: FittedSets, best: Model, steps: list[Extension]) -> tuple[Model, list[Extension]]:
    """Extend again sets from which the best one may have gone astray, and go on with a likelier one.

    An effect that resembles the sum of two missing ones may be found before either; see
    `_may_hold_substitute`. `FEW` of the sets of `_origins` are extended, the likeliest first.
    """
    for _ in range(MOST):
        if sets.problem.is_exhausted or not best.effects or not _may_hold_substitute(sets, best):
            break
        sets.stage = MOST
        new = [m for m in _origins(sets, best, steps) if m.effects not in sets.screenings]
        for origin in ranked(new)[:FEW]:
            larger, tried = extend(sets, origin)
            if larger.log_posterior > best.log_posterior + LEAST_GAIN:
                best, more = extend_fully(sets, larger)
                steps = [Extension(origin, larger, tried), *more]
                break
        else:
            break
    return best, steps


def _origins(sets: FittedSets, best: Model, steps: Sequence[Extension]) -> list[Model]:
    """Return the sets that lack one effect of the best one; where it has a single effect, its rivals."""
    if len(best.effects) > 1:
        return sets.fit_parts(best)
    keys = [(s.candidate,) for step in steps[-1:] for s in step.tried if s.candidate not in best.effects]
    return [m for k in keys if (m := sets.models.get(k))]


def _may_hold_substitute(sets: FittedSets, model: Model) -> bool:
    """Tell whether a set may hold an effect that stands in for others.

    Errors of its formulas are then as large as they may be in more than one channel. Of several effects, the
    set must also predict trials left out worse than noise and tolerance allow.
    """
    if sum(error >= FORMULAS[1] for error in model.fit.scales.formulas.values()) < 2:
        return False
    predicted = predict(sets.problem, model.fit, sets.tolerance)
    worse = predicted.unseen.sum() > (1 + MAX_REMAINDER**2) * predicted.expected.sum()
    return bool(worse or len(model.effects) == 1)


def exchange(sets: FittedSets, best: Model, steps: Sequence[Extension]) -> None:
    """Fit the best set with each of its effects exchanged for rivals.

    They are what was tried in its place; in that of the last effect it stood beside the same set. A contact
    law also has the laws for rivals that were only screened there.

    Args:
        sets: the sets that were fitted.
        best: the set.
        steps: the way to it.
    """
    sets.stage = MOST
    points: list[Point] = []
    for step in steps:
        without = sets.problem.without_effect(best.fit.point, _added(step.after, step.before))
        rivals = [
            *_screened_laws(sets, step),
            *(_tried_rivals(sets, step) if step is not steps[-1] else ()),
        ]
        points += [with_score(sets.problem, without, s) for s in rivals if s.candidate not in best.effects]
    sets.fit_new([(point, best.fit) for point in points], best.log_posterior)
    exchanged = (sets.models[k] for k in dict.fromkeys(map(set_of, points)) if k in sets.models)
    for rival in [m for m in exchanged if m.log_posterior > best.log_posterior]:
        for part in sets.fit_parts(rival, set(rival.effects) - set(best.effects)):
            if not stays(sets, part, rival):
                sets.set_aside.add(rival.effects)


def _tried_rivals(sets: FittedSets, step: Extension) -> list[Score]:
    """Return what was tried in a step and gained `RIVAL` of what its effect did: the sets beside differ."""
    gained = step.after.log_posterior - step.before.log_posterior
    keys = {score.candidate: step.before.with_effect(score.candidate) for score in step.tried}
    fitted = {c: sets.models[k].log_posterior for c, k in keys.items() if k in sets.models}
    least = step.before.log_posterior + RIVAL * gained
    return [score for score in step.tried if fitted.get(score.candidate, -np.inf) > least]


def _screened_laws(sets: FittedSets, step: Extension) -> list[Score]:
    """Return `TRIED` contact laws that promised anything in a step which added one, and were not tried.

    A screen is linear, and a law is not: a fit has gained six times what was promised.
    """
    effects = sets.problem.pool.scenario.effects
    if not effects[_added(step.after, step.before)].law:
        return []
    tried = {score.candidate for score in step.tried}
    best = best_scores(sets.screenings.get(step.before.effects, ())).values()
    laws = [s for s in best if effects[s.candidate].law and s.candidate not in tried and s.gain > LEAST_GAIN]
    return sorted(laws, key=lambda s: -s.gain)[:TRIED]


def set_aside_bad_predictors(sets: FittedSets) -> None:
    """Set aside sets that predict what is left out worse than the numbers of the files do.

    Sand that has moved to make up for a wrong effect shows there. None is set aside where every set does.
    """
    by_files = loss_of_files(sets.problem, sets.baseline.fit)
    bad: list[EffectSet] = []
    for model in ranked(m for k, m in sets.models.items() if k and k not in sets.set_aside):
        loss = loss_of_model(sets.problem, model.fit, sets.tolerance)
        if not predicts_worse(loss, by_files, sets.tolerance):
            sets.set_aside.update(bad)
            return
        bad.append(model.effects)


def fit_finely(sets: FittedSets) -> bool:
    """Fit the sets that can change a probability to their optimum; tell whether the likeliest one stays so.

    They are the first `TRIED` sets whose odds against the likeliest are not below `UNLIKELY`; the others keep
    their rough fit. A set that only adds effects which do not matter is left out: it is no evidence against
    the likeliest. That one is fitted under the other limit of (10), too: by other sand either limit may
    explain the trials, and no descent leads from one to the other.
    """
    best = sets.likeliest()
    best = sets.refit(best, [sets.problem.under_other_limit(best.fit.point)], best.fit.scales)
    others = [m for m in likely(sets.models.values(), best) if not set(m.effects) >= set(best.effects)]
    rough = [m for m in (best, *others[: TRIED - 1]) if not m.fit.fine]
    sets.tell_fits(m.effects for m in rough)
    sets.models.update({m.effects: m for m in finely(sets.problem, rough)})
    return sets.likeliest().effects == best.effects


def reduce(sets: FittedSets) -> bool:
    """Fit the likeliest set without each library effect; tell whether one is likelier, and extend it.

    A set that was fitted before another effect was known may have missed its optimum: what that effect closes
    is then too large. It is fitted again from the end of the likeliest set.
    """
    best = sets.likeliest()
    sets.stage = MOST
    known = [m for m in sets.models.values() if set(m.effects) < set(best.effects)]
    parts = [part for part in sets.fit_parts(best) if part in known]
    points = [sets.problem.without_effect(best.fit.point, _added(best, part)) for part in parts]
    sets.refit_each(parts, [[(point, best.fit.scales)] for point in points])
    if sets.likeliest() is best:
        return False
    extend_fully(sets, sets.likeliest())
    return True
