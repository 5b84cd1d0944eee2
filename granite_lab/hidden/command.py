"""A desired velocity that is linear between corners: of a trapezoid of Table 2, or of a stick in a hand."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

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
class Command:
    """Desired velocity that is linear between corners; the robot stands before the first and after the last.

    Attributes:
        label: word for it in the name of a trial.
        times: (K,) of the corners [s]; the first is 0.
        speeds: (K,) velocities there [m/s]; 0 at both ends, never negative.
        measured: begin and end of the part over which λ_R is taken [s].
        stated: velocity [m/s], acceleration [m/s^2] and distance [m], which the log of a trapezoid states;
            None for a stick.
    """

    label: str
    times: tuple[float, ...]
    speeds: tuple[float, ...]
    measured: tuple[float, float]
    stated: tuple[float, float, float] | None = None

    @property
    def end(self) -> float:
        """Instant at which the desired velocity is zero for good [s]."""
        return self.times[-1]

    @cached_property
    def _distances(self) -> list[float]:
        """(K,) of the corners [m]."""
        t, v = np.array(self.times), np.array(self.speeds)
        return [0.0, *np.cumsum(np.diff(t) * (v[1:] + v[:-1]) / 2).tolist()]

    @property
    def distance(self) -> float:
        """Way in all [m]."""
        return self._distances[-1]

    def velocity(self, t: float) -> float:
        """Return v_d(t) [m/s]."""
        k = bisect_right(self.times, t)
        if k in (0, len(self.times)):
            return 0.0
        (t0, t1), (v0, v1) = self.times[k - 1 : k + 1], self.speeds[k - 1 : k + 1]
        return v0 + (v1 - v0) / (t1 - t0) * (t - t0)

    def position(self, t: float) -> float:
        """Return s_d(t), the integral of v_d [m]."""
        k = bisect_right(self.times, t) - 1
        if k < 0 or t >= self.end:
            return 0.0 if k < 0 else self.distance
        return self._distances[k] + 0.5 * (t - self.times[k]) * (self.speeds[k] + self.velocity(t))

    def corners(self, v_floor: float) -> tuple[float, ...]:
        """Instants at which the law of v_d changes, or v_d crosses `v_floor`."""
        marks = set(self.times)
        for (t0, v0), (t1, v1) in pairwise(zip(self.times, self.speeds, strict=True)):
            if min(v0, v1) < v_floor < max(v0, v1):
                marks.add(t0 + (v_floor - v0) / (v1 - v0) * (t1 - t0))
        return tuple(sorted(marks))


def trapezoid(v: float, a: float, distance: float) -> Command:
    """Return the command that accelerates at `a` [m/s^2] to `v` [m/s], holds, and brakes at `a`.

    λ_R is taken over the second half of the steady part.

    Args:
        v, a: of the steady part and of both ramps.
        distance: in all [m].

    Raises:
        ValueError: the distance is too short to reach the velocity.
    """
    ramp, hold = v / a, (distance - v**2 / a) / v
    if hold < 0:
        raise ValueError("the distance is too short to reach the velocity")
    times, speeds = (0.0, ramp, ramp + hold, 2 * ramp + hold), (0.0, v, v, 0.0)
    return Command(f"v{v:g}", times, speeds, (ramp + 0.5 * hold, ramp + hold), (v, a, distance))


def draw_stick(rng: np.random.Generator, number: int, top: float) -> Command:
    """Draw how a person drives whose fastest speed is `top` [m/s]; λ_R is taken over all of it.

    `number` counts the sticks of a set, from 1 on.
    """
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
    return Command(f"s{number}", tuple(times), tuple(speeds), (0.0, times[-1]))
