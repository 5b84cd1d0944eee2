"""The trapezoid of the desired velocity, written down from Table 2's description of a variant."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property


@dataclass(frozen=True)
class Trapezoid:
    """Accelerate at `a` [m/s^2] to `v` [m/s], hold, brake at `a`; `distance` [m] in all; starts at t = 0."""

    v: float
    a: float
    distance: float

    def __post_init__(self) -> None:
        if self.v**2 / self.a > self.distance:
            raise ValueError("the distance is too short to reach the velocity")

    @cached_property
    def ramp(self) -> float:
        """Duration of the acceleration, and of the braking [s]."""
        return self.v / self.a

    @cached_property
    def hold(self) -> float:
        """Duration of the steady part [s]."""
        return (self.distance - self.v**2 / self.a) / self.v

    @cached_property
    def end(self) -> float:
        """Instant at which the desired velocity is zero again [s]."""
        return 2 * self.ramp + self.hold

    def velocity(self, t: float) -> float:
        """Return v_d(t) [m/s]."""
        if t <= 0 or t >= self.end:
            return 0.0
        return min(self.a * t, self.v, self.a * (self.end - t))

    def position(self, t: float) -> float:
        """Return s_d(t), the integral of v_d [m]."""
        if t <= 0:
            return 0.0
        if t >= self.end:
            return self.distance
        if t < self.ramp:
            return 0.5 * self.a * t**2
        if t < self.ramp + self.hold:
            return self.v * (t - 0.5 * self.ramp)
        return self.distance - 0.5 * self.a * (self.end - t) ** 2

    def corners(self, v_floor: float) -> tuple[float, ...]:
        """Instants at which the law of v_d changes, or v_d crosses `v_floor`."""
        low = v_floor / self.a
        marks = {0.0, low, self.ramp, self.ramp + self.hold, self.end - low, self.end}
        return tuple(sorted(marks))
