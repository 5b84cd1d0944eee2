"""How far logs differ without one of their causes, before and after a refit of sand and sensors."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from granite_lab.hidden.catalogue import influence
from granite_lab.hidden.contact import Array
from granite_lab.logs.trial import Trial
from granite_lab.parameters import Robot

LEAST = 0.1
"""Share of the squared gap that the absence of a cause reopens at least, if the cause is to count."""

STILL = 0.5
"""Beginning of each log in which the robot stands [s]; laboratories wait 0.7 s or more."""

ALIKE = ("friction_angle", "shear_modulus", "exponent", "tyre_friction")
"""Numbers of the sand that all trials share."""

OWN = ("frictional_modulus", "cohesion", "a_theta")
"""Numbers that each trial has of its own."""

CHANGE = 0.03
"""Relative change of a number of the sand for its derivatives."""

SAND_STD = 0.2
"""Std of the numbers of the sand, as a share: dry sands of the literature differ by 10 to 20 % (Wong 2008,
table 2.3)."""

LATE_STD = 0.02
"""Std of the delay between the stamps of two sensors [s]: transport and filters cause 1 to 20 ms (Furgale et
al. 2013)."""


class MakeTrials(Protocol):
    """Makes the same trials under some of the causes, one number of their sand changed by a factor."""

    def __call__(self, active: Sequence[str], number: str = "", factor: float = 1.0) -> Sequence[Trial]:
        """Return the trials; without a number, on the sand as it is."""


@dataclass(frozen=True, eq=False)
class Signals:
    """All that the sensors of one trial log, each over its noise.

    Attributes:
        stamps: per sensor (N,) [s].
        values: per sensor (N, K); of the wheels their rates.
        kinds: per sensor "force", "rate", "current" or "wheel".
    """

    stamps: tuple[Array, ...]
    values: tuple[Array, ...]
    kinds: tuple[str, ...]

    @classmethod
    def of(cls, trial: Trial, robot: Robot) -> Signals:
        """Return the signals of a trial, over the noise that the robot's file states."""
        stamps, values, kinds = zip(*_over_noise(trial, robot), strict=True)
        return cls(stamps, values, kinds)

    def at(self, other: Signals) -> Signals:
        """Return them interpolated to the stamps of others."""
        pairs = zip(other.stamps, self.stamps, self.values, strict=True)
        values = [np.stack([np.interp(t, u, column) for column in x.T], axis=1) for t, u, x in pairs]
        return Signals(other.stamps, tuple(values), self.kinds)

    def minus(self, other: Signals) -> Array:
        """Return how far they exceed others, at their own stamps."""
        return self._listed([x - y for x, y in zip(self.values, other.at(self).values, strict=True)])

    def errors(self, robot: Robot) -> Iterator[Array]:
        """Yield how errors of one std show: gains of the currents, tilt of the IMU, and delays.

        The IMU is late by itself, wheels and currents together: the start of a trial is not known better.
        """
        nothing = [np.zeros_like(x) for x in self.values]

        def shown(changed: Mapping[int, Array]) -> Array:
            return self._listed([changed.get(k, x) for k, x in enumerate(nothing)])

        late: dict[bool, dict[int, Array]] = {True: {}, False: {}}
        for k, (t, x, kind) in enumerate(zip(self.stamps, self.values, self.kinds, strict=True)):
            if kind == "current":
                for column in np.eye(x.shape[1]):
                    yield shown({k: robot.currents.gain * x * column})
            elif kind == "force":
                turned = np.stack([x[:, 2], np.zeros(t.size), -x[:, 0]], axis=1)
                yield shown({k: np.radians(robot.imu.tilt) * turned})
            late[kind in ("force", "rate")][k] = LATE_STD * np.gradient(x, t, axis=0)
        yield from (shown(changed) for changed in late.values() if changed)

    def _listed(self, values: Sequence[Array]) -> Array:
        """Return values of all sensors one after the other, without what there is at standstill.

        Every analysis subtracts that: a tilt of the IMU alone is no gap.
        """
        rests = [x[t < t[0] + STILL] for t, x in zip(self.stamps, values, strict=True)]
        away = [x - np.nan_to_num(rest).mean(axis=0) for x, rest in zip(values, rests, strict=True)]
        return np.concatenate([np.nan_to_num(x).ravel() for x in away])


def _over_noise(trial: Trial, robot: Robot) -> Iterator[tuple[Array, Array, str]]:
    """Yield stamps, values over their noise, and the kind of each sensor."""
    if trial.imu is not None:
        yield trial.imu.t, trial.imu.specific_force / robot.imu.vibration, "force"
        yield trial.imu.t, trial.imu.angular_rate / robot.imu.vibration_rate, "rate"
    if trial.currents is not None:
        yield trial.currents.t, trial.currents.current / robot.currents.noise, "current"
    if trial.wheels is not None:
        t, count = trial.wheels.t, 2 * np.pi / robot.encoders.counts
        yield t, np.gradient(trial.wheels.angle, t, axis=0) * float(np.median(np.diff(t))) / count, "wheel"


@dataclass(frozen=True, eq=False)
class Gaps:
    """How far some trials differ from those without causes. Their random numbers are the same: noise cancels.

    A trace with a new phase in each trial turns with the wheels. Without another cause the wheels turn at
    another rate, and the trace is out of step with itself. It is left out where another cause is judged.

    Attributes:
        robot: whose filed noise weighs the sensors.
        steady: the causes whose phase is not new in each trial.
        logged: the trials under these alone.
        whole: per trial (N,) what is left open without any cause.
        without: cause to the same without it alone.
    """

    robot: Robot
    steady: tuple[str, ...]
    logged: tuple[Signals, ...]
    whole: tuple[Array, ...]
    without: Mapping[str, tuple[Array, ...]]

    @classmethod
    def of(cls, make: MakeTrials, names: Sequence[str], robot: Robot, least: float = 0.0) -> Gaps | None:
        """Return the gaps of some causes; None once one reopens less than `least` of the squared gap."""

        def logged(active: Sequence[str]) -> tuple[Signals, ...]:
            return tuple(Signals.of(trial, robot) for trial in make(active))

        def apart(first: Sequence[Signals], second: Sequence[Signals]) -> tuple[Array, ...]:
            return tuple(a.minus(b) for a, b in zip(first, second, strict=True))

        steady = tuple(name for name in names if not influence(name).has_phase())
        whole, bare = logged(names), logged(())
        alone = whole if len(steady) == len(names) else logged(steady) if steady else bare
        alone = tuple(a.at(w) for a, w in zip(alone, whole, strict=True))
        gaps = cls(robot, steady, alone, apart(whole, bare), {})
        for name in names:
            beside, present = (alone, steady) if name in steady else (whole, names)
            without = apart(beside, logged([other for other in present if other != name]))
            gaps = replace(gaps, without={**gaps.without, name: without})
            if gaps.reopened()[name] < least:
                return None
        return gaps

    def reopened(self) -> dict[str, float]:
        """Return for each cause the share of the squared gap that its absence reopens. Nothing is fitted."""
        return self._shares(lambda gap: float(gap @ gap))

    def reopened_after_refit(self, make: MakeTrials) -> dict[str, float]:
        """Return the same where sand and sensors are fitted again to each gap, linear about the trials.

        Their numbers stay within what files and literature say of them; the sum of squares counts these, too.

        Args:
            make: as in `of`.
        """
        columns = np.stack(list(self._columns(make)), axis=1)
        factor = np.linalg.cholesky(np.eye(columns.shape[1]) + columns.T @ columns)

        def left(gap: Array) -> float:
            explained = np.linalg.solve(factor, columns.T @ gap)
            return float(gap @ gap - explained @ explained)

        return self._shares(left)

    def _columns(self, make: MakeTrials) -> Iterator[Array]:
        """Yield how each number of sand and sensors shows in all trials, changed by its std."""
        for number in (*ALIKE, *OWN):
            changed = [Signals.of(trial, self.robot) for trial in make(self.steady, number, 1 + CHANGE)]
            pairs = zip(changed, self.logged, strict=True)
            shown = [SAND_STD / CHANGE * c.at(s).minus(s) for c, s in pairs]
            if number in ALIKE:
                yield np.concatenate(shown)
            else:
                yield from (self._each(k, x) for k, x in enumerate(shown))
        for k, signals in enumerate(self.logged):
            yield from (self._each(k, x) for x in signals.errors(self.robot))

    def _each(self, trial: int, shown: Array) -> Array:
        """Return what shows in one trial alone as a column of all."""
        return np.concatenate([shown if k == trial else np.zeros_like(x) for k, x in enumerate(self.whole)])

    def _shares(self, size: Callable[[Array], float]) -> dict[str, float]:
        total = size(np.concatenate(self.whole))
        return {name: size(np.concatenate(gaps)) / total for name, gaps in self.without.items()}
