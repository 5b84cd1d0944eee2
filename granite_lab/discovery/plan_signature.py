"""What an effect changes in the sensors' readings, and what of it nothing else can imitate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from granite_lab.discovery.arrow import project
from granite_lab.discovery.bench import ACCURACY, Bench, Task, World
from granite_lab.discovery.plan_design import nominal
from granite_lab.discovery.plan_stage import staged
from granite_lab.discovery.slopes import blocks_at, slopes_at
from granite_lab.errors import EstimateError
from granite_lab.logs.trial import Array
from granite_lab.model.effect import Active
from granite_lab.parameters import Robot, Soil, Variant


@dataclass(frozen=True, eq=False)
class Seen:
    """What an effect changes in one trial.

    Attributes:
        variant: the command.
        t: (n,) middle of each bin since the start of the command [s].
        phase: (n,) commanded phase.
        width: of a bin [s].
        raw: channel to (n,) readings with the effect less those without, all else equal [its unit].
        left: the same once sand, start of the command, and the sensors' offsets, gains and tilt are
            fitted anew; they are drawn to what is likely, as in a search.
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
    """Simulations whose differences shall look smooth where almost all of them is taken away again."""

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
    world = FineWorld(robot, soil, tuple(variants), {active.id: active.effect})
    design = nominal(robot, soil, variants)
    with Bench(world, jobs) as bench:
        problem = staged(design, bench, list(enumerate(design.driven)))
        point = problem.neutral()
        slopes = slopes_at(problem, point)
        with_effect = bench.run(
            [Task(v, (0.0,) * point.sand.size, ((active.id, active.values),)) for v in problem.variants]
        )
    columns, raws = [], []
    for i, trial in enumerate(problem.trials):
        response = with_effect[i]
        if response is None:
            speed = trial.observation.variant.velocity
            raise EstimateError(
                f"{active.id}: the simulation at {speed:g} m/s does not converge",
                "the effect is too strong for this robot on this soil",
            )
        raws.append(trial.effect_columns(response[None] - slopes.response[i], point.trials[i])[:, 0])
        columns.append(problem.whiten(i, raws[-1])[:, None])
    blocks = blocks_at(problem, point, slopes)
    through = project(blocks, columns, problem.bounds(point)[0])
    seen = []
    for i, trial in enumerate(problem.trials):
        shape = (len(trial.channels), trial.observation.bins)
        white = through.left[i][:, 0].reshape(shape)
        # the noise is white here, so that readings and whitened readings differ by a factor
        factor = [w.factor[0, 0] for w in problem.whiteners[i]]
        seen.append(
            Seen(
                trial.observation.variant,
                trial.observation.t,
                trial.observation.phase,
                trial.observation.width,
                dict(zip(trial.channels, raws[i].reshape(shape), strict=True)),
                {c: f * row for c, f, row in zip(trial.channels, factor, white, strict=True)},
                dict(zip(trial.channels, white, strict=True)),
            )
        )
    whole = sum(float(np.sum(c**2)) for c in columns)
    left = sum(float(np.sum(p**2)) for p in through.left)
    return Imprint(active, tuple(seen), float(np.sqrt(left / whole)) if whole > 0 else 0.0)
