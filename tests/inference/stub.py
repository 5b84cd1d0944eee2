"""Trials of a robot whose response is known in closed form: linear in sand and effects, without a simulator.

The signals are smooth and of the size that the robot's are; each number of the sand and each effect adds a
trace of its own, so that everything the inference says can be computed by dense matrices beside it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache

import numpy as np
from scipy.integrate import cumulative_trapezoid

from granite_lab.inference.binning import Stream
from granite_lab.inference.derivatives import differentiate
from granite_lab.inference.nuisances import TrialModel
from granite_lab.inference.observation import Observation
from granite_lab.inference.point import SHARED, Point
from granite_lab.inference.pool import ACCURACY, SAND, SIGNALS, Scenario, SimulationPool, Task
from granite_lab.inference.pool import Respond as Answers
from granite_lab.inference.problem import Problem
from granite_lab.inference.setup import nominal
from granite_lab.logs.trial import Array
from granite_lab.model.command import corners, duration
from granite_lab.model.effect import Effect, EffectParameter
from granite_lab.model.instants import instants
from granite_lab.parameters import Variant, load_robot, load_soil

ROBOT, SOIL = load_robot(), load_soil()
COMMANDS = tuple(
    Variant(velocity=v, acceleration=a, distance=d)
    for v, a, d in ((0.2, 0.6, 0.3), (0.5, 1.5, 0.6), (0.7, 2.0, 0.8))
)

PLACE = {
    "accel_x": {0: 1.0}, "accel_z": {1: 1.0}, "pitch_rate": {2: 1.0}, "wheel": {3: 0.5, 4: 0.5},
    "wheel_split": {3: 1.0, 4: -1.0}, "current_f": {5: 1.0}, "current_r": {6: 1.0},
}  # fmt: skip
WIDTH = 0.05
"""Of the bins [s]."""
SIZE = np.array([1.0, 0.5, 0.05, 0.3, 0.3, 1.0, 1.0, 0.1])
"""Sizes of the traces of one unit of any number, by `SIGNALS`."""


def _parameter(name: str, width: float = 1.0, **kind: bool) -> EffectParameter:
    return EffectParameter(name, "N", name, -20.0, 20.0, 0.0, -width, width, **kind)


class MadeUp(Effect):
    """An effect without hooks; the stub knows its trace by its id."""

    def __init__(self, id_: str, *parameters: EffectParameter) -> None:
        self.id, self.parameters = id_, parameters or (_parameter("size"),)


EFFECTS: dict[str, Effect] = {e.id: e for e in (
    MadeUp("push"), MadeUp("pull"),
    MadeUp("shake", _parameter("size", per_trial=True)),
    MadeUp("lift", EffectParameter("size", "N", "size", 0.0, 20.0, 0.0, 0.1, 1.0)),  # a push that is no pull
    MadeUp("shove"),  # the same as a push: no trial can tell them apart
    MadeUp("motor"),  # currents larger by a share in every trial, as gains of the sensors might make them
    MadeUp("hidden"),  # no candidate
)}  # fmt: skip
TRACES = {"push": 100, "pull": 110, "shake": 120, "shove": 100, "lift": 100, "hidden": 140}
"""Number of the trace of an effect's first parameter."""


def moving(t: Array, variant: Variant) -> Array:
    """Return the desired velocity over the largest."""
    return np.interp(t, corners(variant), [0.0, 1.0, 1.0, 0.0])


@lru_cache(maxsize=200)
def trace(number: int, variant: Variant) -> Array:
    """Return the (8, M) trace of one unit of a number: smooth, in motion only, for each number another."""
    rng, t = np.random.default_rng(number), instants(variant, ACCURACY)
    s = np.clip(t / duration(variant), 0, 1)
    rows = []
    for size in SIZE:
        a, b, c = rng.normal(size=3)
        shape = a * np.sin(2 * np.pi * s) + b * np.sin(3 * np.pi * s) + c * variant.velocity
        rows.append(size * shape * moving(t, variant))
    return np.stack(rows)


@cache
def plain(variant: Variant) -> Array:
    """Return the (8, M) signals in the sand of the file, without effects."""
    t = instants(variant, ACCURACY)
    v = moving(t, variant)
    s = cumulative_trapezoid(v * variant.velocity, t, initial=0.0)
    out = np.zeros((len(SIGNALS), t.size))
    out[0] = np.gradient(v, t) * 0.5
    out[1] = 9.81 + 0.2 * v
    out[2] = 0.05 * v * np.sin(8 * t)
    out[3:5] = 0.95 * s / ROBOT.wheels.radius
    out[5:7] = (1.2 + 0.3 * np.sin(3 * t)) * v
    out[7] = v * variant.velocity
    return out


@dataclass(frozen=True)
class Respond:
    """The closed form; there is no solution where a logarithm of the sand exceeds `bound`."""

    bound: float = np.inf

    def __call__(self, scenario: Scenario, tasks: Sequence[Task]) -> list[Array | None]:
        return [self.one(scenario, task) for task in tasks]

    def one(self, scenario: Scenario, task: Task) -> Array | None:
        if max(np.abs(task.sand)) > self.bound:
            return None
        variant = scenario.variants[task.variant]
        out = plain(variant).copy()
        for k, value in enumerate(task.sand):
            out += value * trace(k, variant)
        for id_, values in task.setting:
            if id_ == "motor":
                out[5:7] *= 1 + values[0]
                continue
            for k, value in enumerate(values):
                out += value * trace(TRACES[id_] + k, variant)
        return out


def problem_of(
    commands: Sequence[int] = (0, 0, 1, 1), channels: Sequence[str] = tuple(PLACE), *,
    respond: Answers | None = None, effects: Mapping[str, Effect] = EFFECTS,
) -> Problem:  # fmt: skip
    """Return trials in which nothing was measured yet (all zero), with the nominal noise."""
    scenario = Scenario(ROBOT, SOIL, COMMANDS, effects)
    models = []
    for i, command in enumerate(commands):
        variant = COMMANDS[command]
        t = np.arange(-1.0, duration(variant) + 2.0, 0.003)
        edges = WIDTH * np.arange(-round(0.5 / WIDTH), np.ceil((duration(variant) + 1.5) / WIDTH) + 1)
        weights = {c: np.zeros(len(SIGNALS)) for c in channels}
        for c, w in weights.items():
            for k, share in PLACE[c].items():
                w[k] = share
        window = {c: 0.01 if w[:3].any() else 0.0 for c, w in weights.items()}
        streams = {c: Stream(t, 0 * t, w, c.startswith("wheel"), window[c]) for c, w in weights.items()}
        values = {c: np.zeros(edges.size - 1) for c in channels}
        o = Observation(f"trial {i}", variant, 0.0, edges, streams, values, 0.0, False)
        models.append(TrialModel(o, command, ROBOT))
    problem = Problem(models, SimulationPool(scenario, respond=respond or Respond()))
    start = problem.neutral()
    derivatives = differentiate(problem, start)
    problem.set_noise(nominal(problem), start, derivatives)
    return problem


def predicted(problem: Problem, point: Point) -> list[Array]:
    """Return per trial the (C, n) bins at a point."""
    found = problem.pool.run([problem.task(point, i) for i in range(len(problem.trials))])
    return [
        t.predict(r, x[: t.size], point.sensors)
        for t, r, x in zip(problem.trials, found, point.trials, strict=True)
        if r is not None
    ]


def measure(problem: Problem, point: Point, rng: np.random.Generator, discrepancy: float = 0.0) -> Point:
    """Let every trial measure what the model shows at a point, with noise and a discrepancy of a share."""
    shown = predicted(problem, point)
    for command, own in enumerate(problem.commands):
        for c in problem.trials[own[0]].channels:
            (part,) = problem._plain[command][c]
            shared = part.columns[:, part.kind == 0] @ rng.normal(size=int((part.kind == 0).sum()))
            for i in own:
                k = problem.trials[i].channels.index(c)
                std = 1 / problem.whiteners[i][k].filters[0].inverse
                problem.trials[i].measured[k] = shown[i][k] + discrepancy * shared
                problem.trials[i].measured[k] += std * rng.normal(size=std.size)
    return point


def drawn(problem: Problem, rng: np.random.Generator, *, common: float = 0.5, own: float = 0.5) -> Point:
    """Return a point drawn from the priors, their std shrunk by some factors."""
    point = problem.neutral()
    shared = point.shared.copy()
    shared[: len(SAND)] = common * problem.sand_std * rng.normal(size=len(SAND))
    shared[SHARED.index("latency")] = 0.004 * common * rng.normal()
    trials = tuple(
        own * np.array([s.std for s in t.slacks]) * rng.normal(size=t.size) for t in problem.trials
    )
    return replace(point, shared=shared, trials=trials)


def measured(
    seed: int, discrepancy: float = 0.0, commands: Sequence[int] = (0, 0, 1, 1)
) -> tuple[Problem, Point, np.random.Generator]:
    """Return trials that measured a point drawn from the priors, that point, and the source of more."""
    rng, problem = np.random.default_rng(seed), problem_of(commands)
    return problem, measure(problem, drawn(problem, rng), rng, discrepancy), rng
