"""The responses of all trials, followed from point to point by one simulation per command."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from granite_lab.discovery.bench import PER_TRIAL
from granite_lab.discovery.point import Point, Slopes
from granite_lab.discovery.problem import Problem
from granite_lab.logs.trial import Array


@dataclass(frozen=True, eq=False)
class Responses:
    """What the simulations show at one point.

    Attributes:
        trials: per trial its (7, M) response.
        centres: per command the (7, M) response at the mean sand of its trials.
        exact: every trial was simulated at its own sand.
    """

    trials: tuple[Array, ...]
    centres: tuple[Array, ...]
    exact: bool


def simulated(problem: Problem, point: Point) -> Responses | None:
    """Simulate every trial; None where one has no solution."""
    tasks = [problem.task(point, i) for i in range(len(problem.trials))]
    tasks += [problem.centre(point, v) for v in problem.variants]
    found = problem.responses(tasks)
    if found is None:
        return None
    count = len(problem.trials)
    return Responses(tuple(found[:count]), tuple(found[count:]), exact=True)


def followed(problem: Problem, before: Responses, old: Point, new: Point, slopes: Slopes) -> Responses | None:
    """Move every trial along with the centre of its command; None where a centre has no solution.

    The sand of a trial is within several percent of the mean of its command. What that difference
    changes is kept from the old point and moved by the derivatives, so only the centres are simulated.

    Args:
        problem: the trials.
        before: the responses at the old point.
        old, new: from where and to where.
        slopes: derivatives somewhere near.
    """
    centres = problem.responses([problem.centre(new, v) for v in problem.variants])
    if centres is None:
        return None
    apart = [b - a for a, b in zip(_apart(problem, old), _apart(problem, new), strict=True)]
    trials = []
    for trial, response, move in zip(problem.trials, before.trials, apart, strict=True):
        j = problem.variants.index(trial.variant)
        slope = np.concatenate([slopes.sand[j][:PER_TRIAL], slopes.own[j]])
        trials.append(response + (centres[j] - before.centres[j]) + np.tensordot(move, slope, axes=1))
    return Responses(tuple(trials), tuple(centres), exact=False)


def _apart(problem: Problem, point: Point) -> list[Array]:
    """Return per trial how its sand and its own numbers of effects differ from the mean of its command."""
    own = [
        np.concatenate([x[:PER_TRIAL], x[t.size :]])
        for t, x in zip(problem.trials, point.trials, strict=True)
    ]
    mean = {
        v: np.mean([x for t, x in zip(problem.trials, own, strict=True) if t.variant == v], axis=0)
        for v in problem.variants
    }
    return [x - mean[t.variant] for t, x in zip(problem.trials, own, strict=True)]
