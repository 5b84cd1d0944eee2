"""The command, laws of k_92 and the small records that the methods of the truth's model pass on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from granite_lab.hidden.contact import Array

Law = Callable[[float], float]
Method = Literal["LSODA", "Radau"]
"""Of `scipy.integrate.solve_ivp`."""

Sizes = Mapping[str, float]
"""Parameters of an influence by name."""


@dataclass(frozen=True)
class Trapezoid:
    """Accelerate at `a` [m/s^2] to `v` [m/s], hold, brake at `a`; `distance` [m] in all; starts at t = 0."""

    v: float
    a: float
    distance: float

    def __post_init__(self) -> None:
        if self.v**2 / self.a > self.distance:
            raise ValueError("the distance is too short to reach the velocity")

    @property
    def label(self) -> str:
        """Word for it in the name of a trial."""
        return f"v{self.v:g}"

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

    def measured(self, start: float) -> Array:
        """Return begin and end of the part over which λ_R is taken, of a run that began at `start` [s].

        It is the second half of the steady part.
        """
        return start + self.ramp + np.array([0.5, 1.0]) * self.hold

    def corners(self, v_floor: float) -> tuple[float, ...]:
        """Instants at which the law of v_d changes, or v_d crosses `v_floor`."""
        low = v_floor / self.a
        marks = {0.0, low, self.ramp, self.ramp + self.hold, self.end - low, self.end}
        return tuple(sorted(marks))


def exponential_k92(a_theta: float) -> Law:
    """Return k_92(v_d) of (5)."""
    return lambda v_d: float(np.exp(-a_theta * v_d))


@dataclass(frozen=True)
class Push:
    """Force on the centre of mass in O [N] and moment about y, nose down [N m]: weight and what else acts."""

    x: float
    z: float
    moment: float = 0.0

    def __add__(self, other: Push) -> Push:
        return Push(self.x + other.x, self.z + other.z, self.moment + other.moment)


@dataclass(frozen=True, eq=False)
class Misreading:
    """Errors of the sensors that are the same in every trial.

    Attributes:
        accel, gyro: (3, 3) matrices from right to wrong reading, in sensor axes.
        encoder: (4,) factors on the wheel angles.
        late: by how much the stamps of the encoders are late [s]; those of the currents are by
            `later` times that.
    """

    accel: Array
    gyro: Array
    encoder: Array = field(default_factory=lambda: np.ones(4))
    late: float = 0.0
    later: float = 1.0
