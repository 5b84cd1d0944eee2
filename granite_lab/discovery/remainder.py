"""What the library leaves: described by terms of the dictionary, and the ceiling of what any force could."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from granite_lab.discovery.ceiling import ceiling
from granite_lab.discovery.description import described
from granite_lab.discovery.finding import Ceiling
from granite_lab.discovery.heldout import Equations, losses, predict, predicts_better
from granite_lab.discovery.impulses import ImpulseResponses, impulse_responses
from granite_lab.discovery.models import Model, Search
from granite_lab.discovery.relevance import is_adequate
from granite_lab.discovery.saved_model import loss_of_files, loss_of_model, predicts_worse, share_closed
from granite_lab.discovery.search import search_beside
from granite_lab.discovery.sets import set_of
from granite_lab.discovery.verdict import Judgement, evidence_of_term, judge, performance_of
from granite_lab.estimate import Estimate
from granite_lab.inference.constants import MAX_REMAINDER
from granite_lab.inference.descent import AT_START
from granite_lab.inference.fit import Fit, fit, with_priors
from granite_lab.inference.pool import SAND
from granite_lab.inference.problem import Problem
from granite_lab.model.dictionary import is_term


def remainder(
    problem: Problem,
    search: Search,
    judgement: Judgement,
    tolerance: float,
    tell: Callable[[str], None] = lambda _: None,
) -> tuple[Judgement, Ceiling | None]:
    """Describe what the library leaves, and say how much any force could close beside the likeliest model.

    Terms are looked for where more is left than the errors of the formulas may leave; where nothing is named,
    those of effects that are not sure count for nothing. Terms stand beside what is named; effects that are
    not sure stay in the model only if they predict as well as the terms in their place.

    Args:
        problem, tolerance: as in `judge`.
        search: the search in the library.
        judgement: of it.
        tell: told what is being done.

    Returns:
        the judgement with the description, and the ceiling; None where nothing remains to be closed.
    """
    baseline = search.baseline
    if judgement.verdict == "none" or problem.is_exhausted:
        return judgement, None
    if judgement.named and is_adequate(problem, judgement.model.fit, tolerance):
        return judgement, None
    impulses: ImpulseResponses | None = None
    if not judgement.remainder <= MAX_REMAINDER**2:
        tell("describing what the library leaves")
        names = tuple(n.id for n in judgement.named)
        bases = [m for m in (search.model(names), judgement.model) if m is not None]
        best = judgement.model.fit
        for base in {m.effects: m for m in bases}.values():
            impulses = impulse_responses(problem, base.fit)
            extended = described(problem, impulses, tolerance) if impulses else None
            if extended is not None and _better(problem, baseline.fit, best, extended, tolerance):
                best = extended
        if best is not judgement.model.fit:
            judgement = _with_terms(problem, baseline.fit, judgement, best, tolerance)
    if is_adequate(problem, judgement.model.fit, tolerance):
        return judgement, None
    tell("computing what any force could close")
    if impulses is None or impulses.fit is not judgement.model.fit:
        impulses = impulse_responses(problem, judgement.model.fit)
    return judgement, ceiling(problem, baseline.fit, impulses, tolerance) if impulses else None


def beside_terms(
    problem: Problem,
    found: Search,
    judgement: Judgement,
    limit: Ceiling | None,
    candidates: Sequence[str],
    tolerance: float,
    tell: Callable[[str], None] = lambda _: None,
) -> tuple[Search, Judgement, Ceiling | None]:
    """Search the library again beside the terms that describe what it left, then describe what is left now.

    An effect that closes little of a large gap is sure only beside what closes the rest.

    Args:
        problem, tolerance: as in `judge`.
        found: the search in the library.
        judgement, limit: as `remainder` returned them.
        candidates: ids.
        tell: told what is being done.

    Returns:
        search, judgement and ceiling; as they were where no further effect is named, and the model predicts
        no better.
    """
    start = judgement.model
    if not any(map(is_term, start.effects)) or problem.is_exhausted:
        return found, judgement, limit
    again = search_beside(found, start, problem, candidates, tolerance, lambda text, _: tell(text))
    other = judge(problem, again, tolerance)
    more = len(other.named) > len(judgement.named)
    if more or _better(problem, found.baseline.fit, start.fit, other.model.fit, tolerance):
        return again, *remainder(problem, again, other, tolerance, tell)
    return found, judgement, limit


def _better(problem: Problem, baseline: Fit, before: Fit, after: Fit, tolerance: float) -> bool:
    """Tell whether a model predicts what was left out better, and its simulations no worse."""
    fits = with_priors(problem, before, after.scales), after
    if not predicts_better(*(losses(problem, Equations(problem, f), tolerance) for f in fits)):
        return False
    simulated = loss_of_model(problem, after, tolerance)
    others = loss_of_model(problem, before, tolerance), loss_of_files(problem, baseline)
    return not any(predicts_worse(simulated, other, tolerance) for other in others)


def savable(problem: Problem, search: Search, judgement: Judgement, tolerance: float) -> Judgement:
    """Return a judgement whose model may be saved: simulations of what was left out are no worse for it.

    Where nothing is named and they are worse than those by the files, the files are the model: what the
    trials ask of the sand then stands in for what is missing, and unsure effects do not explain it. Those
    that are likely are still said to be.

    Args:
        problem, tolerance: as in `judge`.
        search: the search in the library.
        judgement: of it.
    """
    baseline = search.baseline
    if judgement.named:
        return judgement
    by_files = loss_of_files(problem, baseline.fit)
    if not predicts_worse(loss_of_model(problem, judgement.model.fit, tolerance), by_files, tolerance):
        return judgement
    plain = fit(problem, baseline.fit.point.at_files(len(SAND)), baseline.fit.scales, AT_START)
    nothing = Estimate(0.0, 0.0) if np.isfinite(judgement.closed.value) else judgement.closed
    return replace(
        judgement,
        model=Model((), plain, plain.evidence),
        described=tuple(n for n in judgement.described if n.is_likely()),
        small=(*judgement.small, *(n for n in judgement.described if not n.is_likely())),
        after=judgement.before,
        closed=nothing,
        speeds=nothing,
    )


def credited(problem: Problem, search: Search, judgement: Judgement, tolerance: float) -> Judgement:
    """Return a judgement that credits what is closed to the saved model alone.

    Where simulations predict what was left out worse than those by the files, what is closed is what these
    close at most: the sand and the gains that are refitted in each trial then stand in for something that is
    missing.

    Args:
        problem, tolerance: as in `judge`.
        search: the search in the library.
        judgement: of it.
    """
    best, baseline = judgement.model.fit, search.baseline.fit
    if not judgement.model.effects:
        return judgement
    simulated, by_files = loss_of_model(problem, best, tolerance), loss_of_files(problem, baseline)
    if simulated is None or by_files is None or not predicts_worse(simulated, by_files, tolerance):
        return judgement
    share = share_closed(simulated, by_files, tolerance)
    closed, speeds = (
        replace(own, value=float(np.fmin(own.value, share))) for own in (judgement.closed, judgement.speeds)
    )
    return replace(judgement, closed=closed, speeds=speeds, simulates_worse=True)


def _with_terms(
    problem: Problem, baseline: Fit, judgement: Judgement, extended: Fit, tolerance: float
) -> Judgement:
    """Return the judgement with a model that holds terms; what is named stays as it is."""
    before = predict(problem, with_priors(problem, baseline, extended.scales), tolerance)
    after = predict(problem, extended, tolerance)
    whole = performance_of(before, after)
    ids = filter(is_term, extended.point.effects)
    terms = [evidence_of_term(problem, extended, id_, whole, tolerance) for id_ in ids]
    effects = [n for n in judgement.described if not is_term(n.id)]
    kept = tuple(n for n in effects if n.id in extended.point.effects or n.is_likely())
    small = tuple(n for n in effects if n not in kept)
    return replace(
        judgement,
        model=Model.of(set_of(extended.point), extended),
        described=(*kept, *sorted(terms, key=lambda n: -n.closes.value)),
        small=(*judgement.small, *small),
        before=before,
        after=after,
        closed=whole.closed,
        speeds=whole.speeds,
    )
