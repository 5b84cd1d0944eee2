"""Derivatives of the responses by differences of simulations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from granite_lab.inference.constants import LINEAR
from granite_lab.inference.point import Derivatives, Difference, Point, stacked
from granite_lab.inference.pool import SIMULATED, Task
from granite_lab.inference.priors import is_central, step_of
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array
from granite_lab.model.leading import LEADS

_HALVED = ("tyre_friction", *LEADS)
STEP = np.array([LINEAR if n == "cohesion" else 0.01 / (1 + (n in _HALVED)) for n in SIMULATED])
"""Steps of the differences by `SIMULATED`, a tenth of their std and less: wide where little depends on a
number, so that the integrator's errors are less than the difference, and half where a kink is near."""

KINKED = ("cohesion", "shear_modulus", "friction_angle", "tyre_friction")
"""Sand by which differences are central: (10) has a kink where the other limit of the shear stress begins to
rule, and a difference to one side shows one of the two."""


def differentiate(
    problem: Problem,
    point: Point,
    sand_from: Derivatives | None = None,
    *,
    central: bool = True,
    per_trial: bool = False,
) -> Derivatives | None:
    """Differentiate the responses by differences; None where a run has no solution.

    Where a step leaves the region with a solution, the opposite one alone is taken.

    Args:
        problem: the trials.
        point: where.
        sand_from: derivatives at the same places; those by the sand are kept.
        central: take differences to both sides where the model has kinks.
        per_trial: take differences at each trial's own numbers, in place of the centre of its input.
    """
    groups = [(i,) for i, _ in enumerate(problem.trials)] if per_trial else problem.inputs
    skipped = 0 if sand_from is None else len(SIMULATED)
    differences = [_differences(problem, point, group, central)[skipped:] for group in groups]
    bases = [problem.mean_task(point, group) for group in groups]
    centres = [problem.centre(point, number) for number, _ in enumerate(problem.inputs)]
    without = [_without_each(problem, point, number) for number, _ in enumerate(problem.inputs)]
    needed = [*centres, *bases, *chain.from_iterable(without)]
    runs = _simulated(problem, needed, list(chain.from_iterable(differences)))
    if any(runs[task] is None for task in needed):
        return None
    solved = {task: run for task, run in runs.items() if run is not None}
    changes = []
    for number, (group, base, rows) in enumerate(zip(groups, bases, differences, strict=True)):
        by_sand = sand_from.by_simulated(number) if sand_from else None
        change = _changes(
            problem, point, group, solved[base], [d.derivative(solved[base], runs) for d in rows], by_sand
        )
        if change is None:
            return None
        changes.append(change)
    return Derivatives(
        response=tuple(solved[centre] for centre in centres),
        changes=tuple(changes[trials[0]] for trials in problem.inputs) if per_trial else tuple(changes),
        traces=tuple(
            stacked([solved[centre] - solved[task] for task in tasks], solved[centre])
            for centre, tasks in zip(centres, without, strict=True)
        ),
        private=len(problem.parameters(point.effects, per_trial=True)),
        per_trial=tuple(changes) if per_trial else (),
    )


def _simulated(
    problem: Problem, needed: Sequence[Task], differences: Sequence[Difference]
) -> dict[Task, Array | None]:
    """Return the responses that derivatives need, those of differences by their sides.

    The side behind is simulated only for a central difference, or where the one ahead has no solution.
    """
    sides = [task for d in differences for task in ((d.ahead, d.behind) if d.central else (d.ahead,))]
    tasks = list(dict.fromkeys([*needed, *sides]))
    runs = dict(zip(tasks, problem.pool.run(tasks), strict=True))
    lost = [d.behind for d in differences if not d.central and runs[d.ahead] is None]
    return runs | dict(zip(lost, problem.pool.run(lost) if lost else (), strict=True))


def _changes(
    problem: Problem,
    point: Point,
    group: Sequence[int],
    base: Array,
    derived: Sequence[Array | None],
    by_sand: Array | None,
) -> Array | None:
    """Return (8, M, 11 + o + e) as `Derivatives.changes` at the mean of some trials; None if one is missing.

    Args:
        problem: the trials.
        point: where.
        group: numbers of the trials.
        base: (8, M) response at their mean.
        derived: the derivatives (8, M) by the sand, unless `by_sand` is given, and the effects' parameters.
        by_sand: (8, M, 9) derivatives by the sand, where they are known.
    """
    complete = [d for d in derived if d is not None]
    if len(complete) < len(derived):
        return None
    n = 0 if by_sand is not None else len(SIMULATED)
    shared = len(problem.parameters(point.effects, per_trial=False))
    sand, common, private = np.split(stacked(complete, base), [n, n + shared], axis=-1)
    directions = problem.trials[group[0]].directions(base)
    return np.concatenate([directions, sand if by_sand is None else by_sand, private, common], axis=-1)


def _differences(problem: Problem, point: Point, group: Sequence[int], central: bool) -> list[Difference]:
    """Return the differences by the sand and by the effects' parameters, at the mean of some trials."""
    centre, differences = problem.mean_task(point, group), []
    numbers, task = np.array((*centre.sand, *centre.leads)), problem.pool.scenario.task
    for k, name in enumerate(SIMULATED):
        step = STEP * (np.arange(STEP.size) == k)
        sides = [task(centre.variant, x, centre.setting) for x in (numbers + step, numbers - step)]
        differences.append(Difference(float(STEP[k]), central and name in KINKED, *sides))
    shared = [p for _, p in problem.parameters(point.effects, per_trial=False)]
    private = [p for _, p in problem.parameters(point.effects, per_trial=True)]
    at = np.concatenate([point.common, problem.private_mean(point, group)])
    for k, p in enumerate([*shared, *private]):
        step, sides = step_of(p, float(at[k])), []
        for sign in (1, -1):
            values = at.copy()
            values[k] += sign * step
            setting = problem.setting(point.effects, values[: len(shared)], values[len(shared) :])
            sides.append(replace(centre, setting=setting))
        differences.append(Difference(step, central and is_central(p, float(at[k]), step), *sides))
    return differences


def _without_each(problem: Problem, point: Point, number: int) -> list[Task]:
    """Return the simulations of an input with one of the effects switched off."""
    centre, tasks = problem.centre(point, number), []
    for id_ in point.effects:
        left = problem.without_effect(point, id_)
        setting = problem.setting(
            left.effects, left.common, problem.private_mean(left, problem.inputs[number])
        )
        tasks.append(replace(centre, setting=setting))
    return tasks
