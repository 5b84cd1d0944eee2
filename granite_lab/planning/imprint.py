"""What an effect changes in the sensors' readings, and what of it nothing else can imitate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from granite_lab.errors import EstimateError
from granite_lab.inference.bench import ACCURACY, Bench, World
from granite_lab.inference.noise import NOMINAL
from granite_lab.inference.normal import Scales
from granite_lab.inference.observation import CHANNELS, Observation
from granite_lab.inference.point import Further, stacked
from granite_lab.inference.problem import Problem
from granite_lab.inference.setup import nominal
from granite_lab.logs.trial import Array
from granite_lab.model.effect import Active
from granite_lab.parameters import Robot, Soil, Variant
from granite_lab.planning.design import Driven, Noise
from granite_lab.planning.stage import trial_model


@dataclass(frozen=True, eq=False)
class Seen:
    """What an effect changes in one trial.

    Attributes:
        observation: command and bins of the trial.
        raw: channel to (n,) readings with the effect less those without, all else equal [its unit].
        left: the same once sand, start and the sensors' offsets, gains and tilt are fitted.
    """

    observation: Observation
    raw: Mapping[str, Array]
    left: Mapping[str, Array]


@dataclass(frozen=True, eq=False)
class Imprint:
    """What an effect with its size changes in one trial of each command.

    Attributes:
        active: the effect.
        seen: per command.
        share: of the raw change, in stds of the noise, that is left.
    """

    active: Active
    seen: tuple[Seen, ...]
    share: float


class FineWorld(World):
    """Simulations whose differences are smooth where almost all of them is taken away again."""

    accuracy = replace(ACCURACY, relative=1e-8, absolute=1e-10, order=5)


def imprint(
    active: Active, robot: Robot, soil: Soil, variants: Sequence[Variant], *, jobs: int = 1
) -> Imprint:
    """Simulate with an effect and without, and take away what the nuisances explain.

    Args:
        active: the effect with its size.
        robot, soil: of the model.
        variants: the commands.
        jobs: number of processes.

    Raises:
        EstimateError: a simulation does not converge.
        InputError: the robot cannot be simulated.
    """
    white = tuple(Noise(channel=c, rest=NOMINAL[c]) for c in CHANNELS)
    driven = [Driven(variant=v, noise=white) for v in variants]
    with Bench(FineWorld(robot, soil, tuple(variants), {active.id: active.effect}), jobs) as bench:
        trials = [trial_model(k, d.variant, d, robot) for k, d in enumerate(driven)]
        problem = Problem(trials, bench)
        point = problem.neutral()
        slopes = problem.slopes(point)
        moved = problem.with_effect(point, active.id, active.values)
        runs = problem.respond([problem.centre(moved, k) for k, _ in enumerate(trials)])
    if slopes is None or runs is None:
        hint = "the effect is too strong for this robot on this soil"
        raise EstimateError(f"{active.id}: a simulation does not converge", hint)
    problem.weigh(nominal(problem), point, slopes)
    pairs = zip(runs, slopes.response, strict=True)
    change = tuple(stacked([run - response], response) for run, response in pairs)
    nothing = [np.zeros_like(t.measured) for t in trials]
    normal = problem.normal(point, slopes, nothing, further=Further(change))
    rows: dict[tuple[int, str], Array] = {}  # whitened, the change behind the nuisances
    for part in normal.parts:
        for c in part.channels:
            row = rows[c.rows[0].trial, c.name] = np.zeros((c.rows[0].columns.shape[0], normal.size - 1))
            row[:, part.place[c.rows[0].place]] = c.rows[0].columns
    precision = problem.prior(point, Scales(0.0, 0.0))[0] ** -2.0
    gram = np.sum([row.T @ row for row in rows.values()], axis=0)
    fitted = np.linalg.solve(gram[:-1, :-1] + np.diag(precision), gram[:-1, -1])
    left = {key: row @ np.append(-fitted, 1.0) for key, row in rows.items()}
    seen = tuple(
        Seen(
            t.observation,
            {c: NOMINAL[c] * rows[k, c][:, -1] for c in t.channels},
            {c: NOMINAL[c] * left[k, c] for c in t.channels},
        )
        for k, t in enumerate(trials)
    )
    remaining = sum(float(np.sum(row**2)) for row in left.values())
    return Imprint(active, seen, float(np.sqrt(remaining / max(gram[-1, -1], 1e-300))))
