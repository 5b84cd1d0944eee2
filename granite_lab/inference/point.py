"""Where the numbers of a problem stand, and how the responses change there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
import numpy.typing as npt

from granite_lab.inference.nuisances import CALIBRATION, SENSORS
from granite_lab.inference.pool import SAND_PER_TRIAL, SIMULATED, Task
from granite_lab.logs.trial import Array

DIRECTIONS = 2
"""Number of `TrialModel.directions`."""

SHARED = (*SIMULATED, *SENSORS)
"""Numbers that all trials share, those of effects excepted."""


@dataclass(frozen=True, eq=False)
class Point:
    """Where the numbers stand.

    Attributes:
        shared: numbers common to all trials, as `SHARED`.
        effects: ids of the effects that are switched on.
        common: (e,) parameters of those effects that all trials share, in order.
        trials: per trial its numbers: those of `TrialModel`, then its own parameters of effects.
    """

    shared: Array
    effects: tuple[str, ...]
    common: Array
    trials: tuple[Array, ...]

    @property
    def sensors(self) -> Array:
        """The numbers of the sensors."""
        return self.shared[len(SIMULATED) :]

    @property
    def calibration(self) -> dict[str, float]:
        """Gain of a sensor to what all trials share of it, as `CALIBRATION`."""
        named = dict(zip(SENSORS, self.sensors.tolist(), strict=True))
        return {name: named[name] for name in CALIBRATION}

    @property
    def vector(self) -> Array:
        """All numbers: the trials' own one after the other, then the shared ones."""
        return np.concatenate([*self.trials, self.shared, self.common])

    def at_files(self, count: int = len(SHARED)) -> Point:
        """Return the point with the first `count` of `SHARED` and the raking of the trials as filed."""
        trials = tuple(np.append(np.zeros(SAND_PER_TRIAL), x[SAND_PER_TRIAL:]) for x in self.trials)
        return replace(self, shared=np.append(np.zeros(count), self.shared[count:]), trials=trials)


@dataclass(frozen=True)
class Difference:
    """A difference that stands for a derivative.

    Attributes:
        step: of the number.
        ahead, behind: the simulations a step further and a step back.
    """

    step: float
    ahead: Task
    behind: Task

    def turned(self) -> Difference:
        """Return the difference to the other side."""
        return Difference(-self.step, self.behind, self.ahead)

    def derivative(self, base: Array, runs: Mapping[Task, Array | None]) -> Array | None:
        """Return the (8, M) derivative, to the side that has a solution; None where neither has one.

        Args:
            base: the response in between.
            runs: of the simulations, where they were made.
        """
        ahead, behind = runs.get(self.ahead), runs.get(self.behind)
        if ahead is not None:
            return np.asarray((ahead - base) / self.step)
        return None if behind is None else np.asarray((base - behind) / self.step)


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives of the responses at one point.

    Attributes:
        response: per input the (8, M) response.
        changes: per input (8, M, 11 + o + e) all that `TrialModel.columns` takes: by the two directions of
            `TrialModel.directions`, the numbers of `SIMULATED`, and the effects' own parameters of the trials
            and shared ones.
        traces: per input (8, M, s), what each effect changes.
        private: number o of the effects' own parameters.
        per_trial: per trial the changes at its own numbers; empty where those of its input serve.
    """

    response: tuple[Array, ...]
    changes: tuple[Array, ...]
    traces: tuple[Array, ...]
    private: int
    per_trial: tuple[Array, ...] = ()

    def by_simulated(self, number: int) -> Array:
        """Return the (8, M, 9) derivatives of an input by the numbers of `SIMULATED`."""
        return self.changes[number][..., DIRECTIONS : DIRECTIONS + len(SIMULATED)]


@dataclass(frozen=True, eq=False)
class Further:
    """Changes of the response that are no parameters yet: candidates of a screen.

    Attributes:
        changes: per input (8, M, k); first those that all trials share.
        per_trial: number of the last ones, which each trial has of its own.
        counts: per command the number of the others, where each command has its own; empty where all commands
            share them.
        columns: trial to all its columns, `Problem.columns` and these, where they were computed already.
    """

    changes: tuple[Array, ...]
    per_trial: int = 0
    counts: tuple[int, ...] = ()
    columns: Mapping[int, Array] = field(default_factory=dict)

    @classmethod
    def computed(cls, columns: Mapping[int, Array], count: int, per_trial: int) -> Self:
        """Return `count` changes whose columns are known already, so that only their number matters."""
        return cls((np.zeros((0, 0, count)),), per_trial, columns=columns)

    def places(self, command: int) -> npt.NDArray[np.int64]:
        """Return the places of a command's columns among all that are not of single trials."""
        if not self.counts:
            return np.arange(self.count)
        return sum(self.counts[:command]) + np.arange(self.counts[command])

    @property
    def count(self) -> int:
        """The number of columns that are not of single trials."""
        return sum(self.counts) if self.counts else self.changes[0].shape[-1] - self.per_trial


def stacked(changes: Sequence[Array], like: Array) -> Array:
    """Return k changes of a response as one (8, M, k) array; `like` is a response."""
    return np.stack(changes, axis=-1) if changes else np.zeros((*like.shape, 0))
