"""When a fit leaves nothing that matters, and when an effect does more than errors of formulas could."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from granite_lab.inference.constants import FORMULA_ERROR, LEAST_SHARE
from granite_lab.inference.fit import Fit, with_priors, with_scales
from granite_lab.inference.gap import largest_discrepancies, prediction_change, tolerated
from granite_lab.inference.normal import Scales
from granite_lab.inference.problem import Problem


def is_adequate(problem: Problem, result: Fit, tolerance: float) -> bool:
    """Tell whether a fit leaves no discrepancy beyond the tolerance and no larger noise."""
    return (
        max(largest_discrepancies(problem, result).values(), default=0.0) <= tolerance
        and not result.scales.poor_fit
    )


def has_strained_trials(problem: Problem, result: Fit) -> bool:
    """Tell whether numbers of the trials stand in for something that is missing.

    Their scale, or what all trials share of them, is then as far beyond what it was taken for as a scale is
    with two standard deviations of its logarithm.
    """
    now, shared = result.scales.priors, result.point.calibration
    return any(
        max(now.get(name, std), abs(shared.get(name, 0.0))) > np.exp(2) * std
        for name, std in problem.learnt_std.items()
    )


def anything_matters(problem: Problem, baseline: Fit, best: Fit, tolerance: float) -> bool:
    """Tell whether the model alone leaves, or another model changes, more than the tolerance in a channel."""
    changed = max(prediction_change(problem, baseline, best).values(), default=0.0)
    return changed > tolerance or not is_adequate(
        problem, with_priors(problem, baseline, best.scales), tolerance
    )


def left_without(
    problem: Problem, without: Fit, scales: Scales, id_: str, changes: Mapping[str, float], tolerance: float
) -> Mapping[str, float]:
    """Return channel to what is left without an effect where all else may be as wrong as it may be.

    The formulas of the others are off by `FORMULA_ERROR` at most, the model by the tolerance, and trials
    differ as a set with the effect says. An error of a formula is alike in all trials of a command: it cannot
    stand for an effect that differs from trial to trial.

    Args:
        problem: the trials.
        without: fit without the effect.
        scales: of a set with it.
        id_: the effect.
        changes: channel to how far it moves the prediction, as a share of the channel's rms in motion.
        tolerance: as in `search`.
    """
    if any(p.per_trial for p in problem.parameters_of(id_)):
        return changes
    return unexplained(problem, without, scales, tolerance)


def unexplained(problem: Problem, result: Fit, scales: Scales, tolerance: float) -> dict[str, float]:
    """Return channel to what a fit leaves where formulas and model are as wrong as they may be.

    Args:
        problem: the trials.
        result: the fit.
        scales: say how trials differ.
        tolerance: as in `search`.
    """
    baseline = with_priors(problem, result, scales)
    worst = replace(tolerated(baseline.scales, tolerance), formula=FORMULA_ERROR[1])
    return largest_discrepancies(problem, with_scales(problem, baseline, worst))


def share_made(
    changes: Mapping[str, float], whole: Mapping[str, float], tolerance: float
) -> dict[str, float]:
    """Return channel to the share that an effect makes of what its set changes there, beyond the tolerance.

    Args:
        changes, whole: channel to how far the effect, and the set, moves the prediction.
        tolerance: as in `search`.
    """
    return {c: change / max(whole[c], change) for c, change in changes.items() if change > tolerance}


def exceeds_formula_errors(made: Mapping[str, float], scales: Scales) -> bool:
    """Tell whether an effect makes so much of a channel's change that errors of formulas do not.

    That is `LEAST_SHARE`, and two standard deviations of those errors, which are not known at their limit.
    """
    formulas = {c: scales.formula_of(c) for c in made}
    return any(
        formulas[c] < FORMULA_ERROR[1] and share >= max(LEAST_SHARE, 2 * formulas[c])
        for c, share in made.items()
    )
