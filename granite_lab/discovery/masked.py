"""Effects that the gains of the sensors mask: the trials hardly show them, and a simulation needs them.

A wrong torque constant scales both motor currents, as gains of their sensors do. Where such gains are
refitted, the effect changes no prediction. A simulation has no gains. The gains tell of the effect: alike in
all trials, they lie further off than their data sheets allow.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np
from scipy.special import softmax

from granite_lab.discovery.fitted_sets import with_score
from granite_lab.discovery.models import Model, Search, finely, likely
from granite_lab.discovery.numbers import Numbers
from granite_lab.discovery.resampling import SUREST
from granite_lab.discovery.saved_model import loss_of_files, loss_of_model, predicts_worse, share_closed
from granite_lab.discovery.sets import best_fits
from granite_lab.discovery.verdict import EffectEvidence, Judgement, at_bounds, strained_numbers, unjudged
from granite_lab.estimate import Estimate
from granite_lab.inference.constants import CREDIBLE, LEAST_GAIN, THREE_SIGMA, TRIED
from granite_lab.inference.descent import TO_OPTIMUM
from granite_lab.inference.point import SHARED
from granite_lab.inference.problem import Problem


def with_masked(problem: Problem, search: Search, judgement: Judgement, tolerance: float) -> Judgement:
    """Return a judgement whose model also holds the effect that gains of the sensors mask.

    The model is the set with one more effect, see `_relieved`, that strains the gains least. The effect is
    named where a gain that it relieves lay `THREE_SIGMA` off, errors of the formulas included, and no other
    of these sets may be the likelier one; else it is small, which matters only beside what is named.

    Args:
        problem, tolerance: as in `judge`.
        search: the search in the library.
        judgement: of it.
    """
    if judgement.verdict == "none" or problem.is_exhausted:
        return judgement
    small = {e.id for e in judgement.small}
    best = search.model([e for e in judgement.model.effects if e not in small]) or judgement.model
    strains = _strain(problem, best)
    if max(strains.values(), default=0.0) <= (0.0 if judgement.named else THREE_SIGMA**2):
        return judgement
    relieved = _relieved(problem, search, best, strains, tolerance)
    if not relieved:
        return judgement
    model = relieved[0]
    (id_,) = set(model.effects) - set(best.effects)
    rest = tuple(e for e in judgement.small if e.id != id_)
    shares = softmax([m.log_posterior for m in (model, best, *relieved[1:])])
    probability = min(float(shares[0]), SUREST)
    gains = strains.keys() - _strain(problem, model).keys()
    sure = probability >= CREDIBLE and _is_certain(problem, best, gains)
    if not sure or at_bounds(problem, model.fit, id_):
        known = model.effects == judgement.model.effects
        further = replace(judgement, model=model, small=(*unjudged([id_]), *rest), masked=(id_,))
        return judgement if known else further
    closes = _closes(problem, search, best, model, tolerance)
    strained = strained_numbers(problem, model.fit, id_)
    return replace(
        judgement,
        model=model,
        verdict="named" if judgement.verdict == "named" else "partly named",
        named=(*judgement.named, EffectEvidence(id_, (), probability, closes, closes, strained)),
        small=rest,
        probability=min([probability, *(n.probability for n in judgement.named)]),
        masked=(id_,),
    )


def _relieved(
    problem: Problem, search: Search, best: Model, strains: Mapping[str, float], tolerance: float
) -> list[Model]:
    """Return sets with one more effect that strain the gains less, those that strain them least first.

    Where gains that all trials share lie two std off their files, `TRIED` of the likely sets with one more
    effect are fitted finely; where they lie `THREE_SIGMA` off, as many of the candidates that a screen beside
    the model promises most of, too. The sets are those of them that are likelier than the model, and whose
    simulations predict what was left out better by more than a standard error, and no worse than files do.
    """
    larger = _fitted_with_one_more(problem, search, best)
    if max(strains.values()) > THREE_SIGMA**2:
        larger += _screened_with_one_more(problem, search, best)
    likelier = [m for m in larger if m.log_posterior > best.log_posterior + LEAST_GAIN]
    strained = {m: _strain(problem, m) for m in likelier}
    left = {m: after for m, after in strained.items() if _is_relief(strains, after)}
    before, by_files = (
        loss_of_model(problem, best.fit, tolerance),
        loss_of_files(problem, search.baseline.fit),
    )

    def simulates_better(model: Model) -> bool:
        after = loss_of_model(problem, model.fit, tolerance)
        return predicts_worse(before, after, tolerance) and not predicts_worse(after, by_files, tolerance)

    return [m for m in sorted(left, key=lambda m: sum(left[m].values())) if simulates_better(m)]


def _is_relief(before: Mapping[str, float], after: Mapping[str, float]) -> bool:
    """Tell whether gains are strained less, one of them by more than half."""
    is_less = sum(after.values()) < sum(before.values())
    return is_less and any(after.get(name, 0.0) < strain / 2 for name, strain in before.items())


def _fitted_with_one_more(problem: Problem, search: Search, best: Model) -> list[Model]:
    """Return `TRIED` of the fitted sets with one more effect at their optimum."""
    larger = (m for m in likely(search.models, best) if set(m.effects) > set(best.effects))
    return finely(problem, [m for m in larger if len(m.effects) == len(best.effects) + 1][:TRIED])


def _screened_with_one_more(problem: Problem, search: Search, best: Model) -> list[Model]:
    """Return the sets with a candidate of which a screen promises most, those that were not fitted."""
    screenings = [k for k in search.screenings.get(best.effects, ()) if not k.tolerated]
    scores = [s for k in screenings for s in k.scores[:TRIED] if s.gain > LEAST_GAIN]
    new = [s for s in scores if search.model(best.with_effect(s.candidate)) is None]
    starts = [(with_score(problem, best.fit.point, s), best.fit.scales) for s in new]
    return [Model.of(k, f) for k, f in best_fits(problem, starts, TO_OPTIMUM).items()]


def _closes(problem: Problem, search: Search, best: Model, model: Model, tolerance: float) -> Estimate:
    """Return the share of the gap that a further effect closes, told by simulations: these have no gains."""
    by_files = loss_of_files(problem, search.baseline.fit)
    losses = [loss_of_model(problem, m.fit, tolerance) for m in (model, best)]
    after, before = (
        np.nan if loss is None or by_files is None else share_closed(loss, by_files, tolerance)
        for loss in losses
    )
    return Estimate(float(after - before))


def _is_certain(problem: Problem, best: Model, gains: Collection[str]) -> bool:
    """Tell whether one of the gains that a further effect relieves lay `THREE_SIGMA` off its file without it.

    The std holds what the fit and errors of the formulas leave open of the gain: what a formula misses in a
    channel may look like a gain of it.
    """
    numbers, shared = Numbers(problem, best.fit), best.fit.point.shared.size
    first = best.fit.std.size - best.fit.point.common.size - shared
    open_ = np.hypot(best.fit.std, numbers.by_formulas)[first : first + shared]
    std = {name: np.hypot(problem.learnt_std[name], open_[SHARED.index(name)]) for name in gains}
    return any(abs(numbers.own_means[name]) > THREE_SIGMA * std[name] for name in gains)


def _strain(problem: Problem, model: Model) -> dict[str, float]:
    """Return gain that all trials share to its square, in std of its file, where it lies beyond two."""
    numbers, std = Numbers(problem, model.fit), problem.learnt_std
    strained = (name for name in numbers.alike if name in model.fit.point.calibration)
    return {name: (numbers.own_means[name] / std[name]) ** 2 for name in strained}
