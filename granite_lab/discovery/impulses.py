"""Impulse responses: how the sensors would show short pushes of any force, all along each command."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from granite_lab.inference.constants import LINEAR, MEMORY, THREE_SIGMA
from granite_lab.inference.fit import Fit
from granite_lab.inference.point import Further, stacked
from granite_lab.inference.pool import SIGNALS, Task
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array
from granite_lab.model.command import duration
from granite_lab.model.latent import PERIOD, PUSHES, SPACING, WIDTH, LatentForce
from granite_lab.parameters import GRAVITY, Robot

LARGEST = MEMORY / np.dtype(float).itemsize
"""Most numbers in all responses. Courses of minutes, with one
push each 0.15 s, would need more; nothing is pushed there."""

BEFORE = THREE_SIGMA * WIDTH
"""Time from which on a push is felt before its centre [s]."""

Places = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ImpulseResponses:
    """Responses to pushes about one fit.

    Attributes:
        fit: about which they are linear.
        changes: per input (8, M, K) of the response, by pushes of unit size.
        kind: per command (K,) place of the pushed quantity among `PUSHES`.
        centres: per command (K,) times of the pushes [s].
        sizes: (5,) unit sizes of the quantities: the robot's weight, or weight times wheel radius [N, N m].
    """

    fit: Fit
    changes: tuple[Array, ...]
    kind: tuple[Places, ...]
    centres: tuple[Array, ...]
    sizes: Array

    @property
    def further(self) -> Further:
        """The columns, each command's own."""
        return Further(self.changes, counts=tuple(k.size for k in self.kind))


def sizes_of(robot: Robot) -> Array:
    """Return the (5,) unit sizes of `PUSHES`: weight or weight times wheel radius; a wheel has a quarter."""
    assert robot.chassis is not None
    weight = robot.chassis.total_mass * GRAVITY
    arm = weight * robot.wheels.radius
    return np.array([weight, weight, arm, arm / 4, arm / 4])


def impulse_responses(problem: Problem, fit: Fit) -> ImpulseResponses | None:
    """Simulate pushes about a fit; None where the model has no solution with them, or trials are too long.

    A run carries pushes of one quantity a `PERIOD` apart; what the sensors show from one on until the next
    is the response to it.
    """
    sizes = sizes_of(problem.pool.scenario.robot)
    phases: Array = SPACING * np.arange(round(PERIOD / SPACING), dtype=float)
    tasks: list[Task] = []
    if sum(_count(problem, number) for number, _ in enumerate(problem.inputs)) > LARGEST:
        return None
    for number, _ in enumerate(problem.inputs):
        centre = problem.centre(fit.point, number)
        tasks.append(centre)
        for q in range(len(PUSHES)):
            for phase in phases:
                values = [0.0] * len(PUSHES) + [float(phase)]
                values[q] = LINEAR * float(sizes[q])
                setting = (*centre.setting, (LatentForce.id, tuple(values)))
                tasks.append(replace(centre, setting=setting))
    runs = problem.pool.run(tasks, keep=False)
    responses = [r for r in runs if r is not None]
    if len(responses) < len(runs):
        return None
    each = 1 + len(PUSHES) * phases.size
    parts = [
        _apart(problem, k, responses[k * each : (k + 1) * each], phases) for k, _ in enumerate(problem.inputs)
    ]
    first = [problem.input_of[repetitions[0]] for repetitions in problem.commands]
    kind, centres = zip(*(parts[k][1:] for k in first), strict=True)
    return ImpulseResponses(fit, tuple(changes for changes, *_ in parts), kind, centres, sizes)


def _end(problem: Problem, number: int) -> float:
    """Return when the last trial of an input's command has ended [s since its start]."""
    command = problem.command_of[problem.inputs[number][0]]
    return max(duration(problem.trials[i].observation.variant) for i in problem.commands[command])


def _count(problem: Problem, number: int) -> float:
    """Return the number of numbers in the responses of an input."""
    trial = problem.trials[problem.inputs[number][0]]
    impulses = len(PUSHES) * (_end(problem, number) + BEFORE) / SPACING
    return len(SIGNALS) * trial.t.size * impulses


def _apart(problem: Problem, number: int, runs: list[Array], phases: Array) -> tuple[Array, Places, Array]:
    """Return the responses of one input to single pushes, what each pushes, and when."""
    trial = problem.trials[problem.inputs[number][0]]
    t, end = trial.t, _end(problem, number)
    base, *others = runs
    changes, kind, centres = [], [], []
    for q in range(len(PUSHES)):
        for phase, run in zip(phases, others[q * phases.size : (q + 1) * phases.size], strict=True):
            whole = (run - base) / LINEAR
            for at in np.arange(phase, end + BEFORE, PERIOD):
                felt = (t >= at - BEFORE) & (t < at - BEFORE + PERIOD)
                changes.append(whole * felt)
                kind.append(q)
                centres.append(float(at))
    return stacked(changes, base), np.array(kind), np.array(centres)
