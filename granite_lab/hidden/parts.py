"""The robot that is simulated, laws of k_92, and the small records that the methods of the truth pass on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from granite_lab.errors import UsageError
from granite_lab.hidden.contact import Array
from granite_lab.parameters import Chassis, Drive, Robot

Law = Callable[[float | Array], float | Array]
Method = Literal["LSODA", "Radau"]
"""Of `scipy.integrate.solve_ivp`."""

Sizes = Mapping[str, float]
"""Parameters of an influence by name."""


@dataclass(frozen=True, kw_only=True)
class CompleteRobot(Robot):
    """A robot that can be simulated."""

    chassis: Chassis
    drive: Drive


def complete(robot: Robot) -> CompleteRobot:
    """Return a robot as one that can be simulated.

    Raises:
        UsageError: its file lacks a part.
    """
    if robot.chassis is None or robot.drive is None:
        raise UsageError(f"robot '{robot.name}' cannot be simulated", "give one with chassis and drive")
    return CompleteRobot(**vars(robot))


def exponential_k92(a_theta: float) -> Law:
    """Return k_92(v_d) of (5)."""
    return lambda v_d: np.asarray(np.exp(-a_theta * v_d))


@dataclass(frozen=True, eq=False)
class Misreading:
    """Errors of the sensors that are the same in every trial.

    Attributes:
        accel, gyro: (3, 3) matrices from right to wrong reading, in sensor axes.
        encoder: (4,) factors on the wheel angles.
        late: by how much the stamps of the encoders are late [s]; those of the currents are by
            `later` times that.
    """

    accel: Array = field(default_factory=lambda: np.eye(3))
    gyro: Array = field(default_factory=lambda: np.eye(3))
    encoder: Array = field(default_factory=lambda: np.ones(4))
    late: float = 0.0
    later: float = 1.0
