"""A description of what the library lacks: terms of the dictionary, chosen by speeds left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from granite_lab.discovery.describing import Screened
from granite_lab.discovery.heldout import Equations, Predicted, closed, predict, predicts_better, transferred
from granite_lab.discovery.pushes import Pushes
from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate
from granite_lab.inference.fit import Fit, fit
from granite_lab.inference.problem import Problem
from granite_lab.model.dictionary import dictionary, is_term

MOST = 8
"""Effects and terms in a model at most: with more a sum follows any curve at the speeds that were driven."""

TRIED = 3
"""Terms of a screen whose prediction of speeds left out is compared: their gains are first-order."""


@dataclass(frozen=True)
class Described:
    """One term of a description.

    Attributes:
        id: of the term.
        closes, speeds: share of the whole gap that it closes on trials and on speeds left out.
    """

    id: str
    closes: Estimate
    speeds: Estimate


def described(problem: Problem, pushes: Pushes, tolerance: float) -> Fit | None:
    """Add the terms to a fit that predict what was left out; None where none does.

    Terms enter one by one, by the linear algebra of the normal equations, and stay if they lower the misfit
    of speeds left out (trials, with fewer than three speeds) by more than a standard error. All are then
    fitted together, and each is asked again beside the others. What does not stay is removed.

    Args:
        problem: the trials.
        pushes: about the fit.
        tolerance: discrepancy that is taken for granted, as a share of a channel's rms.
    """
    before = pushes.fit
    try:
        screened = Screened(problem, pushes, list(dictionary().values()))
        chosen = _chosen(problem, screened, tolerance, MOST - len(before.point.effects))
    except (EstimateError, np.linalg.LinAlgError):
        return None
    point = before.point
    for k, a in zip(chosen, screened.sizes(chosen, tolerance) if chosen else (), strict=True):
        p = screened.terms[k].parameters[0]
        point = problem.with_effect(point, screened.terms[k].id, [float(np.clip(a, p.low, p.high))])
    while len(point.effects) > len(before.point.effects):
        try:
            found = fit(problem, point, before.scales)
        except EstimateError:
            return None
        with_all = predict(problem, found, tolerance)
        lost = [
            id_
            for id_ in filter(is_term, found.point.effects)
            if not predicts_better(problem, lacking(problem, found, id_, tolerance), with_all)
        ]
        if not lost:
            return found if predicts_better(problem, predict(problem, before, tolerance), with_all) else None
        point = found.point
        for id_ in lost:
            point = problem.without_effect(point, id_)
    return None


def lacking(problem: Problem, found: Fit, id_: str, tolerance: float) -> Predicted:
    """Return the prediction without one effect, everything else refitted; linear about the fit."""
    names = problem.parameters(found.point.effects, per_trial=False)
    pinned = [k for k, (e, _) in enumerate(names) if e == id_]
    return predict(problem, found, tolerance, Equations(problem, found, pinned))


def _chosen(problem: Problem, screened: Screened, tolerance: float, most: int) -> list[int]:
    """Return the places of the terms that enter, in their order."""
    chosen: list[int] = []
    now = predict(problem, screened.fit, tolerance, screened.beside(chosen))
    while len(chosen) < most:
        gains = screened.gains(chosen, tolerance)
        order = [int(k) for k in np.argsort(-gains)[:TRIED] if gains[k] > 0]
        after = {
            k: predict(problem, screened.fit, tolerance, screened.beside([*chosen, k])) for k in order
        }
        better = [k for k in order if predicts_better(problem, now, after[k])]
        if not better:
            break
        best = min(better, key=lambda k: float(np.nansum(transferred(problem, after[k]))))
        chosen.append(best)
        now = after[best]
    return chosen
