"""Derivatives of the responses by differences of simulations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from granite_lab.inference.point import Derivatives, Difference, Point, stacked
from granite_lab.inference.pool import SIMULATED, Task
from granite_lab.inference.priors import step_of
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array
from granite_lab.model.leading import LEADS

STEP = 1e-5
"""Step of a difference of two simulations with the same integration steps, as a share of a number or of an
effect's prior range: the derivative at the point, but for a hundred thousandth of how it changes."""

OWN_STEP = 0.01
"""The same where each simulation chooses its integration steps: large beside their errors."""

LEAD_STEP = 0.005
"""Step of the difference by a lead of the command [s]; a run that begins later has steps of its own."""


def differentiate(
    problem: Problem,
    point: Point,
    sand_from: Derivatives | None = None,
    *,
    per_trial: bool = False,
    behind: bool = False,
) -> Derivatives | None:
    """Differentiate the responses by differences; None where a run has no solution.

    Where a step leaves the region with a solution, the opposite one is taken.

    Args:
        problem: the trials.
        point: where.
        sand_from: derivatives at the same places; those by the sand are kept.
        per_trial: take differences at each trial's own numbers, in place of the centre of its input.
        behind: take differences to smaller numbers; at a kink of the model they differ from the others.
    """
    groups = [(i,) for i, _ in enumerate(problem.trials)] if per_trial else problem.inputs
    skipped = 0 if sand_from is None else len(SIMULATED)
    differences = [_differences(problem, point, group)[skipped:] for group in groups]
    if behind:
        differences = [[d.turned() for d in rows] for rows in differences]
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

    The side behind is simulated only where the one ahead has no solution.
    """
    tasks = list(dict.fromkeys([*needed, *(d.ahead for d in differences)]))
    runs = dict(zip(tasks, problem.pool.run(tasks), strict=True))
    lost = [d.behind for d in differences if runs[d.ahead] is None]
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


def _differences(problem: Problem, point: Point, group: Sequence[int]) -> list[Difference]:
    """Return the differences by the sand and by the effects' parameters, at the mean of some trials."""
    centre = problem.mean_task(point, group)
    shared = [p for _, p in problem.parameters(point.effects, per_trial=False)]
    private = [p for _, p in problem.parameters(point.effects, per_trial=True)]
    like = centre if problem.pool.repeats(centre) else None
    numbers, task = np.array((*centre.sand, *centre.leads)), problem.pool.scenario.task
    differences = []
    for k, name in enumerate(SIMULATED):
        h = LEAD_STEP if name in LEADS else STEP if like else OWN_STEP
        step = h * (np.arange(numbers.size) == k)
        sides = [task(centre.variant, x, centre.setting) for x in (numbers + step, numbers - step)]
        same = None if name in LEADS else like
        differences.append(Difference(h, *(replace(side, like=same) for side in sides)))
    at = np.concatenate([point.common, problem.private_mean(point, group)])
    for k, p in enumerate([*shared, *private]):
        h, sides = step_of(p, float(at[k]), STEP if like else None), []
        for sign in (1, -1):
            values = at.copy()
            values[k] += sign * h
            setting = problem.setting(point.effects, values[: len(shared)], values[len(shared) :])
            sides.append(replace(centre, setting=setting, like=like))
        differences.append(Difference(h, *sides))
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
