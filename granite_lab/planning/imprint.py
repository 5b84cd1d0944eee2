"""What an effect changes in the sensors' readings, and what of it nothing else can imitate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from granite_lab.errors import EstimateError
from granite_lab.inference.bench import ACCURACY, Bench, World
from granite_lab.inference.noise import NOMINAL
from granite_lab.inference.noise import nominal as nominal_noise
from granite_lab.inference.normal import Scales
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array
from granite_lab.model.effect import Active
from granite_lab.parameters import Robot, Soil, Variant
from granite_lab.planning.stage import nominal, trial_model


@dataclass(frozen=True, eq=False)
class Seen:
    """What an effect changes in one trial.

    Attributes:
        variant: the command.
        t: (n,) middle of each bin since the start of the command [s].
        phase: (n,) commanded phase.
        width: of a bin [s].
        raw: channel to (n,) readings with the effect less those without, all else equal [its unit].
        left: the same once sand, start and the sensors' offsets, gains and tilt are fitted.
        weight: channel to (n,) `left` in stds of the noise.
    """

    variant: Variant
    t: Array
    phase: tuple[str, ...]
    width: float
    raw: Mapping[str, Array]
    left: Mapping[str, Array]
    weight: Mapping[str, Array]


@dataclass(frozen=True, eq=False)
class Imprint:
    """What an effect changes over several commands, one trial of each.

    Attributes:
        active: the effect with its size.
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
    design = nominal(robot, soil, variants)
    with Bench(FineWorld(robot, soil, tuple(variants), {active.id: active.effect}), jobs) as bench:
        problem = Problem(
            [trial_model(design, k, v, design.driven[k]) for k, v in enumerate(variants)], bench
        )
        point = problem.neutral()
        slopes = problem.slopes(point)
        moved = problem.with_effect(point, active.id, active.values)
        runs = problem.respond([problem.centre(moved, k) for k, _ in enumerate(variants)])
    if slopes is None or runs is None:
        raise EstimateError(
            f"{active.id}: a simulation does not converge",
            "the effect is too strong for this robot on this soil",
        )
    problem.weigh(nominal_noise(problem), point, slopes)
    change = {k: run - slopes.response[k] for k, run in enumerate(runs)}
    normal = problem.normal(
        point, slopes, [np.zeros_like(t.measured) for t in problem.trials], candidates=[change]
    )
    rows: dict[tuple[int, str], Array] = {}
    for part in normal.parts:
        for c in part.channels:
            row = c.rows[0]
            rows[row.trial, c.name] = np.zeros((row.columns.shape[0], normal.size - 1))
            rows[row.trial, c.name][:, part.place[row.place]] = row.columns
    std, _ = problem.prior(point, Scales(0.0, 0.0))
    p = std.size
    gram = np.sum([A.T @ A for A in rows.values()], axis=0)
    explained = np.append(-np.linalg.solve(gram[:p, :p] + np.diag(std**-2.0), gram[:p, p]), 1.0)
    seen = []
    for i, trial in enumerate(problem.trials):
        o = trial.observation
        white = {c: rows[i, c] @ explained for c in trial.channels}
        raw = {c: NOMINAL[c] * rows[i, c][:, p] for c in trial.channels}
        left = {c: NOMINAL[c] * row for c, row in white.items()}
        seen.append(Seen(o.variant, o.t, o.phase, o.width, raw, left, white))
    remaining = sum(float(np.sum(row**2)) for s in seen for row in s.weight.values())
    return Imprint(active, tuple(seen), float(np.sqrt(remaining / gram[p, p])) if gram[p, p] > 0 else 0.0)
