"""A description of what the library lacks: terms of the dictionary, chosen by speeds left out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from granite_lab.discovery.describing import ScreenedTerms
from granite_lab.discovery.heldout import Equations, Predicted, losses, predict, predicts_better
from granite_lab.discovery.impulses import ImpulseResponses
from granite_lab.errors import EstimateError
from granite_lab.inference.constants import TRIED
from granite_lab.inference.descent import ROUGH, TO_OPTIMUM
from granite_lab.inference.fit import Fit, fit
from granite_lab.inference.problem import Problem
from granite_lab.model.dictionary import Term, dictionary, is_term

MOST_TERMS = 8
"""Effects and terms in a model at most: with more a sum follows any curve at the speeds that were driven."""


def described(problem: Problem, impulses: ImpulseResponses, tolerance: float) -> Fit | None:
    """Add the terms to a fit that predict what was left out; None where none does.

    Terms enter one by one, by the linear algebra of the normal equations, and stay if they lower the misfit
    of speeds left out (trials, with fewer than three speeds) by more than a standard error. All are then
    fitted together, and each is asked again beside the others. What does not stay is removed; what stays
    after a rough fit is fitted to the optimum, and asked once more.

    Args:
        problem: the trials.
        impulses: about the fit.
        tolerance: discrepancy that is taken for granted, as a share of a channel's rms.
    """
    before = impulses.fit
    try:
        screened = ScreenedTerms(problem, impulses, terms_beside(before.point.effects))
        chosen = _chosen(problem, screened, tolerance, MOST_TERMS - len(before.point.effects))
    except (EstimateError, np.linalg.LinAlgError):
        return None
    point = before.point
    for k, a in zip(chosen, screened.sizes(chosen, tolerance) if chosen else (), strict=True):
        p = screened.terms[k].parameters[0]
        point = problem.with_effect(point, screened.terms[k].id, [float(np.clip(a, p.low, p.high))])
    goal, scales = ROUGH, before.scales
    while len(point.effects) > len(before.point.effects):
        try:
            fitted = fit(problem, point, scales, goal)
        except EstimateError:
            return None
        stay = _staying(problem, fitted, tolerance)
        lost = [id_ for id_ in fitted.point.effects if is_term(id_) and id_ not in stay]
        if not lost and goal.fine:
            old, new = (losses(problem, Equations(problem, f), tolerance) for f in (before, fitted))
            return fitted if predicts_better(old, new) else None
        point, scales, goal = fitted.point, fitted.scales, ROUGH if lost else TO_OPTIMUM
        for id_ in lost:
            point = problem.without_effect(point, id_)
    return None


def terms_beside(effects: Sequence[str]) -> list[Term]:
    """Return the terms of the dictionary that a model does not hold."""
    return [t for t in dictionary().values() if isinstance(t, Term) and t.id not in effects]


def _staying(problem: Problem, fitted: Fit, tolerance: float) -> list[str]:
    """Return the terms that predict what was left out beside the others; the least useful goes first."""
    stay = list(filter(is_term, fitted.point.effects))
    gone: list[str] = []
    equations = Equations(problem, fitted)
    while stay:
        now = losses(problem, equations.without(gone), tolerance)
        without = {id_: losses(problem, equations.without([*gone, id_]), tolerance) for id_ in stay}
        lost = [id_ for id_ in stay if not predicts_better(without[id_], now)]
        if not lost:
            break
        least = min(lost, key=lambda id_: float(np.nansum(without[id_])))
        stay.remove(least)
        gone.append(least)
    return stay


def lacking(problem: Problem, fitted: Fit, ids: Sequence[str], tolerance: float) -> Predicted:
    """Return the prediction without some effects, everything else refitted; linear about the fit."""
    return predict(problem, fitted, tolerance, Equations(problem, fitted).without(ids))


def _chosen(problem: Problem, screened: ScreenedTerms, tolerance: float, most: int) -> list[int]:
    """Return the places of the terms that enter, in their order."""
    chosen: list[int] = []
    now = losses(problem, screened.beside(chosen), tolerance)
    while len(chosen) < most:
        gains = screened.gains(chosen, tolerance)
        order = [int(k) for k in np.argsort(-gains)[:TRIED] if gains[k] > 0]
        after = {k: losses(problem, screened.beside([*chosen, k]), tolerance) for k in order}
        better = [k for k in order if predicts_better(now, after[k])]
        if not better:
            break
        best = min(better, key=lambda k: float(np.nansum(after[k])))
        chosen.append(best)
        now = after[best]
    return chosen
