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
        raw: channel to (n,) readings with the effect less those without, all else equal [its unit].
        left: the same once sand, start and the sensors' offsets, gains and tilt are fitted.
    """

    observation: Observation
    raw: Mapping[str, Array]
    left: Mapping[str, Array]


@dataclass(frozen=True, eq=False)
class Imprint:
    """What an effect changes in one trial of each command; the share that is left is in stds of the noise."""

    active: Active
    seen: tuple[Seen, ...]
    share: float


class FineWorld(World):
    """Simulations whose differences are smooth where almost all of them is taken away again."""

    accuracy = replace(ACCURACY, relative=1e-8, absolute=1e-10, order=5)


def imprint(
    active: Active, robot: Robot, soil: Soil, variants: Sequence[Variant], *, jobs: int = 1
) -> Imprint:
    """Simulate commands with an effect and without it, and take away what the nuisances explain.

    Raises:
        EstimateError: a simulation does not converge.
        InputError: the robot cannot be simulated.
    """
    white = tuple(Noise(channel=c, rest=NOMINAL[c]) for c in CHANNELS if c != "current_side")
    with Bench(FineWorld(robot, soil, tuple(variants), {active.id: active.effect}), jobs) as bench:
        trials = [trial_model(k, v, Driven(variant=v, noise=white), robot) for k, v in enumerate(variants)]
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
    further = Further(tuple(stacked([run - response], response) for run, response in pairs))
    local = sum(x.size for x in point.trials)
    rows, begin = [], 0  # whitened, the change behind the nuisances
    for k, x in enumerate(point.trials):
        columns = problem.whiten(k, problem.columns(k, point, slopes, further))
        row = np.zeros((columns.shape[0], point.vector.size + 1))
        row[:, begin : begin + x.size], row[:, local:] = columns[:, : x.size], columns[:, x.size :]
        rows.append(row)
        begin += x.size
    precision = problem.prior(point, Scales(0.0, 0.0))[0] ** -2.0
    gram = np.sum([row.T @ row for row in rows], axis=0)
    fitted = np.linalg.solve(gram[:-1, :-1] + np.diag(precision), gram[:-1, -1])
    left = [row @ np.append(-fitted, 1.0) for row in rows]
    seen = []
    for t, bins, row, rest in zip(trials, problem.rows, rows, left, strict=True):
        raw, gone = ({c: NOMINAL[c] * of[at] for c, at in bins.items()} for of in (row[:, -1], rest))
        seen.append(Seen(t.observation, raw, gone))
    remaining = sum(float(rest @ rest) for rest in left)
    return Imprint(active, tuple(seen), float(np.sqrt(remaining / max(gram[-1, -1], 1e-300))))
