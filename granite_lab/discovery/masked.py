"""Effects that the gains of the sensors mask: the trials hardly show them, and a simulation needs them.

A wrong torque constant scales both motor currents, as gains of their sensors do. Where such gains are
refitted, the effect changes no prediction, and it is not named. A simulation has no gains.
"""

from __future__ import annotations

from dataclasses import replace

from granite_lab.discovery.models import Model, Search, finely, likely, ranked
from granite_lab.discovery.numbers import Numbers
from granite_lab.discovery.saved_model import loss_of_model, predicts_worse
from granite_lab.discovery.verdict import Judgement, unjudged
from granite_lab.inference.constants import LEAST_GAIN, TRIED
from granite_lab.inference.problem import Problem


def with_masked(problem: Problem, search: Search, judgement: Judgement, tolerance: float) -> Judgement:
    """Return a judgement whose model also holds the effect that gains of the sensors mask.

    Where gains that all trials share lie two std off their files, the first `TRIED` of the likely sets with
    one more effect are fitted finely. The model is then the set that strains the gains least, of those that
    are likelier than it and whose simulations predict what was left out better by more than a standard error.
    What is named does not change; the further effect is listed as small.

    Args:
        problem, tolerance: as in `judge`.
        search: the search in the library.
        judgement: of it.
    """
    best, strain = judgement.model, _strain(problem, judgement.model)
    if not judgement.named or strain == 0:
        return judgement
    larger = [m for m in likely(search.models, best) if set(m.effects) > set(best.effects)]
    tried = [m for m in larger if len(m.effects) == len(best.effects) + 1][:TRIED]
    fine = ranked(finely(problem, tried))
    before = loss_of_model(problem, best.fit, tolerance)

    def simulates_better(model: Model) -> bool:
        return predicts_worse(before, loss_of_model(problem, model.fit, tolerance), tolerance)

    likelier = [m for m in fine if m.log_posterior > best.log_posterior + LEAST_GAIN]
    relieved = [m for m in likelier if _strain(problem, m) < strain]
    model = next(filter(simulates_better, sorted(relieved, key=lambda m: _strain(problem, m))), None)
    if model is None:
        return judgement
    further = tuple(e for e in model.effects if e not in best.effects)
    known = [e for e in judgement.small if e.id not in further]
    return replace(judgement, model=model, small=(*unjudged(further), *known), masked=further)


def _strain(problem: Problem, model: Model) -> float:
    """Return the sum of squares of the gains that all trials share, in std of their files, beyond two."""
    numbers, std = Numbers(problem, model.fit), problem.learnt_std
    strained = (name for name in numbers.alike if name in model.fit.point.calibration)
    return sum((numbers.own_means[name] / std[name]) ** 2 for name in strained)
