"""Simulations of the same few commands in this process or in several."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, groupby
from types import TracebackType
from typing import ClassVar, Self, TypeVar

import numpy as np

from granite_lab.errors import EstimateError, InputError
from granite_lab.inference.constants import MEMORY, SAND_PER_TRIAL_STD
from granite_lab.logs.trial import Array
from granite_lab.model.command import kind_of
from granite_lab.model.effect import Active, Effect, activate
from granite_lab.model.instants import Accuracy
from granite_lab.model.leading import LEADS, count_of, led
from granite_lab.model.simulator import integrate, moving, repeats
from granite_lab.model.symbols import ModelParameters, model_parameters
from granite_lab.parameters import Robot, Soil, Variant, load_paper
from granite_lab.processes import forked_map, forked_pool, mapped

X = TypeVar("X")
Y = TypeVar("Y")

SIGNALS = (
    "imu_ax_mps2", "imu_az_mps2", "imu_gy_radps", "enc_f_rad", "enc_r_rad", "cur_f_A", "cur_r_A", "v_mps",
)  # fmt: skip
"""The simulated signals, in the order of a response's rows: those of sensors, then the velocity."""

SAND = (
    "a_theta", "frictional_modulus", "cohesion",
    "shear_modulus", "friction_angle", "exponent", "tyre_friction",
)  # fmt: skip
"""Parameters of the sand that are fitted, as logarithms of their ratio to the file's value."""

SIMULATED = (*SAND, *LEADS)
"""Numbers of a simulation that all trials share: the sand, and the times by which a command whose start or
course is not stated leads the wheels [s]."""

SAND_PER_TRIAL = len(SAND_PER_TRIAL_STD)
"""So many of `SAND`, the first ones, differ from trial to trial, as raking leaves the sand."""

ACCURACY = Accuracy(relative=1e-5, absolute=2e-8, travel=0.0018, lean=True, order=3)
"""Errors of a bin of at most 4e-4 m/s^2, 5e-6 rad/s, 3e-5 rad and 7e-4 A, those of the instants included. Of
five times the errors the differences of neighbouring runs, which are derivatives, were too rough for a fit
to end twice at the same numbers."""

REMEMBERED = MEMORY / 8
"""Bytes of signals of a call at most that are remembered: those of all differences of long runs take more."""

Values = tuple[float, ...]
Setting = tuple[tuple[str, Values], ...]
"""Effects that are switched on: (id, parameter values) of each."""


@dataclass(frozen=True)
class Task:
    """One simulation: number of the command, sand (logarithms, as `SAND`), effects, leads as `LEADS`.

    It repeats the steps of the simulation that it is `like`.
    """

    variant: int
    sand: Values
    setting: Setting = ()
    leads: Values = (0.0,) * len(LEADS)
    like: Task | None = None

    @property
    def ids(self) -> tuple[str, ...]:
        """The effects."""
        return tuple(id_ for id_, _ in self.setting)


@dataclass(frozen=True)
class Scenario:
    """What all simulations share; `fixed` are effects that are always switched on."""

    accuracy: ClassVar[Accuracy] = ACCURACY
    robot: Robot
    soil: Soil
    variants: tuple[Variant, ...]
    effects: Mapping[str, Effect]
    fixed: tuple[Active, ...] = ()

    def parameters(self, task: Task) -> ModelParameters:
        """Return the numbers of a run without those of effects."""
        ratio = dict(zip(SAND, np.exp(task.sand).tolist(), strict=True))
        a_theta = load_paper().a_theta * ratio.pop("a_theta")
        soil = dataclasses.replace(
            self.soil, **{name: getattr(self.soil, name) * value for name, value in ratio.items()}
        )
        variant = led(self.variants[task.variant], task.leads, self.robot)
        return model_parameters(self.robot, soil, variant, a_theta=a_theta)

    def task(self, variant: int, numbers: Array, setting: Setting) -> Task:
        """Return the simulation of a command at (9,) numbers by `SIMULATED`.

        Leads that change no simulation of the input are zero.
        """
        sand, leads = tuple(numbers[: len(SAND)].tolist()), tuple(numbers[len(SAND) :].tolist())
        count = count_of(self.variants[variant])
        return Task(variant, sand, setting, leads[:count] + (0.0,) * (len(LEADS) - count))

    def active(self, task: Task) -> tuple[Active, ...]:
        """Return the effects of a run.

        Raises:
            InputError: a number is out of bounds.
        """
        active = list(self.fixed)
        for id_, values in task.setting:
            effect = self.effects[id_]
            active.append(
                activate(effect, {q.name: v for q, v in zip(effect.parameters, values, strict=True)})
            )
        return tuple(active)

    def respond(self, task: Task) -> Array | None:
        """Return the (8, M) signals of a run; None where it has no solution."""
        p, like = self.parameters(task), None
        try:
            if task.like is not None:
                like = self.parameters(task.like), moving(self.active(task.like))
            signals = integrate(p, self.active(task), self.accuracy, SIGNALS, like)
        except (EstimateError, InputError):
            return None
        return np.stack([signals[name] for name in SIGNALS])


Respond = Callable[[Scenario, Sequence[Task]], list[Array | None]]
"""Simulates tasks elsewhere: the signals of each task, in their order."""

_scenario: Scenario | None = None


def _enter(scenario: Scenario) -> None:
    global _scenario  # noqa: PLW0603, a worker process has exactly one scenario
    _scenario = scenario


def _work(tasks: Sequence[Task]) -> tuple[list[Array | None], float]:
    assert _scenario is not None
    return _timed(_scenario, tasks)


def _timed(scenario: Scenario, tasks: Sequence[Task]) -> tuple[list[Array | None], float]:
    """Return the signals of tasks, and the processor time that they took [s]."""
    begin = time.process_time()
    return [scenario.respond(task) for task in tasks], time.process_time() - begin


def _batches(tasks: Sequence[Task]) -> list[list[Task]]:
    """Split tasks into what a process takes at once, the largest first.

    Each has one set of effects, for which a process builds the equations anew. With about as many batches as
    tasks in each, all processes end at about the same time.
    """
    most = math.isqrt(len(tasks)) + 1
    batches: list[list[Task]] = []
    for _, alike in groupby(sorted(tasks, key=lambda task: task.ids), key=lambda task: task.ids):
        group = list(alike)
        batches += [group[k : k + most] for k in range(0, len(group), most)]
    return sorted(batches, key=len, reverse=True)


def _forked_call(task: tuple[SimulationPool, Callable[[X], Y], Sequence[X]], k: int) -> tuple[Y, int, float]:
    """Return ``call(items[k])``, the number of its simulations and their time, in a forked process."""
    pool, call, items = task
    pool.use_this_process()
    runs, seconds = pool.runs, pool.seconds
    return call(items[k]), pool.runs - runs, pool.seconds - seconds


class SimulationPool:
    """Runs tasks; a context manager that ends its processes.

    Processes are forked, so that effects of a user's file need not be loaded again; where the
    system cannot fork safely, everything runs in this process. `respond` takes the place of both.

    Attributes:
        scenario: what all simulations share.
        runs: number of simulations.
        seconds: processor time that they took [s]; those of `respond` are not counted.
    """

    def __init__(
        self,
        scenario: Scenario,
        jobs: int = 1,
        tick: Callable[[int], None] = lambda _: None,
        respond: Respond | None = None,
    ) -> None:
        self.scenario, self.runs, self.seconds, self._jobs = scenario, 0, 0.0, jobs
        self._respond = respond
        self._tick = tick
        self._pool = forked_pool(jobs, _enter, scenario) if respond is None else None
        self._responses: dict[Task, Array | None] = {}
        self._last: Sequence[Task] = ()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)

    def use_this_process(self) -> None:
        """Simulate in this process from now on, without reports of progress."""
        self._pool, self._tick = None, lambda _: None

    def parallel(self, call: Callable[[X], Y], items: Sequence[X]) -> list[Y]:
        """Return ``call(item)`` for each of some items, each in a process that simulates what it needs.

        What they simulate is not remembered here.

        Raises:
            LabError: a process died.
        """
        if len(items) < 2 or self._pool is None:
            return [call(item) for item in items]
        answers = []
        for answer, runs, seconds in forked_map(
            _forked_call, (self, call, items), len(items), "searched", jobs=self._jobs
        ):
            answers.append(answer)
            self.runs, self.seconds = self.runs + runs, self.seconds + seconds
            self._tick(runs)
        return answers

    def repeats(self, task: Task) -> bool:
        """Tell whether neighbours of a simulation repeat its steps; not where blows come at other times."""
        effects = [e.effect for e in self.scenario.active(task)]
        if any(q.moving for e in effects for q in e.parameters):
            return False
        kind = kind_of(self.scenario.variants[task.variant])
        return self._respond is not None or repeats(effects, kind)

    def run(self, tasks: Sequence[Task], *, keep: bool = True) -> list[Array | None]:
        """Return the (8, M) signals of each task, None where a run has no solution.

        Args:
            tasks: what to simulate; the same task is simulated once.
            keep: remember the signals for the next two calls, if they are not larger than `REMEMBERED`: a fit
                tries a step, and may go back.

        Raises:
            LabError: a process died.
        """
        new = list(dict.fromkeys(t for t in tasks if t not in self._responses))
        if self._respond is not None:
            responses = self._respond(self.scenario, new)
        elif self._pool is None:
            responses, seconds = _timed(self.scenario, new)
            self.seconds += seconds
        else:
            batches = _batches(new)
            new = list(chain.from_iterable(batches))
            done = list(mapped(self._pool, _work, batches, "simulated"))
            responses = [run for runs, _ in done for run in runs]
            self.seconds += sum(seconds for _, seconds in done)
        self.runs += len(new)
        self._tick(len(new))
        known = self._responses | dict(zip(new, responses, strict=True))
        size = sum(run.nbytes for t in {*tasks} if (run := known[t]) is not None)
        if keep and size <= REMEMBERED:
            self._responses = {task: known[task] for task in (*self._last, *tasks) if task in known}
            self._last = tuple(tasks)
        return [known[task] for task in tasks]
