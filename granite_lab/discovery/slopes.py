"""Derivatives of the responses by differences, and of the whitened bins by all numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from granite_lab.discovery.arrow import Block, covariance
from granite_lab.discovery.bench import PER_TRIAL, SAND, Task
from granite_lab.discovery.point import Point, Slopes
from granite_lab.discovery.problem import Problem, as_values
from granite_lab.errors import EstimateError
from granite_lab.logs.trial import Array

_COARSE_STEP = (0.01, 0.01, -0.15, 0.01, -0.06, 0.01, 0.03)
_FINE_STEP = (0.01, 0.01, -0.03, 0.01, -0.01, 0.01, 0.005)
"""Steps of the differences by `SAND`. The smaller of two laws limits the shear stress, (10), and in the
sand of the file it is friction on the tyre everywhere; only a step of a few percent in cohesion and
angle of friction shows what the other law would do. Near the solution both laws rule in places, and
only small steps tell what each of them does there."""

_EFFECT_STEP, _WIDEST_STEP = 0.02, 0.2
"""Least and largest step of a difference by an effect's parameter, as shares of its prior range."""

_MOVING_STEP = 0.03
"""Step by a parameter whose trace moves in time, as a share of its value."""


def slopes_at(
    problem: Problem,
    point: Point,
    *,
    sand_from: Slopes | None = None,
    fine: bool = False,
    near: Sequence[Block] | None = None,
) -> Slopes:
    """Differentiate the responses, one command at a time, at the mean sand of its trials.

    Args:
        problem: the trials.
        point: where.
        sand_from: slopes whose derivatives by the sand are good enough to be kept.
        fine: small steps, for a point near the solution.
        near: derivatives of before, which tell how well the effects' parameters are known: over a step far
            below that, the noise of the simulations would pass for knowledge.

    Raises:
        EstimateError: a simulation fails.
    """
    shared, private = problem.effect_parameters(point.effects)
    tasks: list[Task] = []
    steps: list[float] = []
    apart_by = _FINE_STEP if fine else _COARSE_STEP
    extra = {v: problem.extra(point, v) for v in problem.variants}
    known = [0.0] * (len(shared) + len(private))
    if near is not None and shared:
        variance = np.diag(covariance(near, problem.bounds(point)[0]))[len(SAND) :]
        known[: len(shared)] = np.sqrt(variance).tolist()
    for v in problem.variants:
        centre = problem.centre(point, v)
        tasks.append(centre)
        steps.append(1.0)
        if sand_from is None:
            for k in range(len(SAND)):
                moved = np.array(centre.sand)
                moved[k] += apart_by[k]
                tasks.append(Task(v, as_values(moved), centre.setting))
                steps.append(apart_by[k])
        for k, p in enumerate([*shared, *private]):
            values = np.concatenate([point.common, extra[v]])
            width = p.prior_high - p.prior_low
            h = float(np.clip(known[k], _EFFECT_STEP * width, _WIDEST_STEP * width))
            if p.moving:  # blows come at other times already with a little more of it
                h = float(np.clip(_MOVING_STEP * abs(values[k] - p.neutral), 0.1 * h, h))
            h = h if values[k] + h <= p.high else -h
            values[k] += h
            tasks.append(
                Task(
                    v,
                    centre.sand,
                    problem.setting(point.effects, values[: len(shared)], values[len(shared) :]),
                )
            )
            steps.append(h)
    found = problem.responses(tasks)
    if found is None:
        raise EstimateError("a simulation near the fit does not converge", "check robot and soil files")
    count = len(found) // len(problem.variants)
    result = Slopes([], [], [], [])
    for j, _ in enumerate(problem.variants):
        base, *others = found[j * count : (j + 1) * count]
        apart = steps[j * count + 1 : (j + 1) * count]
        derived = [(other - base) / s for other, s in zip(others, apart, strict=True)]
        of_sand = 0 if sand_from is not None else len(SAND)
        result.response.append(base)
        result.sand.append(sand_from.sand[j] if sand_from is not None else np.stack(derived[:of_sand]))
        empty = np.zeros((0, *base.shape))
        effect = derived[of_sand:]
        result.common.append(np.stack(effect[: len(shared)]) if shared else empty)
        result.own.append(np.stack(effect[len(shared) :]) if private else empty)
    return result


def blocks_at(problem: Problem, point: Point, slopes: Slopes) -> list[Block]:
    """Return the whitened derivatives per trial."""
    _, private = problem.effect_parameters(point.effects)
    precision = problem.own_precision(point.effects)
    blocks: list[Block] = []
    own_of: dict[int, Array] = {}
    for i, (t, x) in enumerate(zip(problem.trials, point.trials, strict=True)):
        j = problem.variants.index(t.variant)
        response, sand = slopes.response[j], slopes.sand[j]
        if j not in own_of:
            own_of[j] = np.concatenate([sand[:PER_TRIAL], t.by_start(response)[None]])
        local = t.columns(response, own_of[j], x[: t.size])
        extra = t.effect_columns(np.concatenate([sand[PER_TRIAL:], slopes.common[j], slopes.own[j]]), x)
        shared = np.column_stack([local[:, :PER_TRIAL], extra])
        own = shared[:, shared.shape[1] - len(private) :]
        local = problem.whiten(i, np.column_stack([local, own]))
        shared = problem.whiten(i, shared[:, : shared.shape[1] - len(private)])
        blocks.append(Block(local, shared, np.concatenate([t.prior**-2, precision])))
    return blocks
