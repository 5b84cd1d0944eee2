"""A robot driven by a person's stick: the desired velocity is linear between the corners of its course."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from granite_lab.hidden.contact import Array

LASTS = 5.0, 10.0
"""Time for which a run is driven, but for its last ramp [s]; the variants of Table 2 take 5 to 7 s."""

MOVED = 0.3, 1.5
"""A hand takes this long to move the stick from one place to another [s]; an assumption."""

REST = 0.5, 3.0
"""It rests there for this long [s], at zero in a pause too; an assumption."""

PAUSE, DRIFT = 0.2, 0.5
"""Share of the places that are a pause, and of those at which the hand drifts by up to `BY`; assumptions."""

SLOWEST, BY, STEP = 0.4, 0.15, 0.01
"""Slowest place over the fastest, relative drift, and smallest step of a stick's speed [m/s]."""


@dataclass(frozen=True)
class Stick:
    """Desired velocity that is linear between corners; the robot stands before the first and after the last.

    Attributes:
        number: which stick of its set, from 1 on.
        times: (K,) of the corners [s]; the first is 0.
        speeds: (K,) velocities there [m/s]; 0 at both ends, never negative.
    """

    number: int
    times: tuple[float, ...]
    speeds: tuple[float, ...]

    @property
    def label(self) -> str:
        """Word for it in the name of a trial."""
        return f"s{self.number}"

    @property
    def end(self) -> float:
        """Instant at which the desired velocity is zero for good [s]."""
        return self.times[-1]

    @cached_property
    def _ways(self) -> Array:
        t, v = np.array(self.times), np.array(self.speeds)
        return np.concatenate([[0.0], np.cumsum(np.diff(t) * (v[1:] + v[:-1]) / 2)])

    @property
    def distance(self) -> float:
        """Way in all [m]."""
        return float(self._ways[-1])

    def velocity(self, t: float) -> float:
        """Return v_d(t) [m/s]."""
        return float(np.interp(t, self.times, self.speeds))

    def position(self, t: float) -> float:
        """Return s_d(t), the integral of v_d [m]."""
        if t >= self.end:
            return self.distance
        k = int(np.searchsorted(self.times, t, side="right")) - 1
        if k < 0:
            return 0.0
        return float(self._ways[k]) + 0.5 * (t - self.times[k]) * (self.speeds[k] + self.velocity(t))

    def corners(self, v_floor: float) -> tuple[float, ...]:
        """Instants at which the law of v_d changes, or v_d crosses `v_floor`."""
        marks = set(self.times)
        for (t0, v0), (t1, v1) in zip(
            zip(self.times, self.speeds, strict=True),
            zip(self.times[1:], self.speeds[1:], strict=True),
            strict=False,
        ):
            if min(v0, v1) < v_floor < max(v0, v1):
                marks.add(t0 + (v_floor - v0) / (v1 - v0) * (t1 - t0))
        return tuple(sorted(marks))

    def measured(self, start: float) -> Array:
        """Return begin and end of where λ_R is taken, all of a run that began at `start` [s]."""
        return start + np.array([0.0, self.end])


def draw_stick(rng: np.random.Generator, number: int, top: float) -> Stick:
    """Draw how a person drives whose fastest speed is `top` [m/s]."""
    times, speeds = [0.0], [0.0]

    def go(speed: float, within: tuple[float, float]) -> None:
        times.append(round(times[-1] + float(rng.uniform(*within)), 3))
        speeds.append(round(speed / STEP) * STEP)

    last, lasts = 0.0, float(rng.uniform(*LASTS))
    while times[-1] < lasts:
        place = top if last == 0.0 and len(times) == 1 else top * float(rng.uniform(SLOWEST, 1.0))
        if last > 0.0 and rng.random() < PAUSE:
            place = 0.0
        go(place, MOVED)
        drift = float(rng.uniform(-BY, BY)) if rng.random() < DRIFT else 0.0
        go(min(place * (1 + drift), top), REST)
        last = place
    if speeds[-1] > 0.0:
        go(0.0, MOVED)
    return Stick(number, tuple(times), tuple(speeds))
