"""How well the numbers of a soil's and a robot's file are known."""

from __future__ import annotations

from granite_lab.inference.bench import SAND
from granite_lab.inference.constants import SAND_STD
from granite_lab.parameters import Robot, Soil

RADIUS_STD = 0.005
"""Std of the mean wheel radius where the robot's file states none, as a share of it: a tape measure over a
driven distance gives the mean wheel diameter to 0.3 to 0.5 % (Borenstein and Feng, IEEE Transactions on
Robotics and Automation 12, 1996, 869-880)."""


def sand_std(soil: Soil) -> tuple[float, ...]:
    """Return the std of the logarithm of each number of `SAND`.

    It is the soil file's (``friction_angle_std_deg = 1.5``); by default that of the literature, `SAND_STD`.
    """
    stds = []
    for name, usual in zip(SAND, SAND_STD, strict=True):
        stated = float(getattr(soil, f"{name}_std", 0.0))
        stds.append(stated / float(getattr(soil, name)) if stated > 0 else usual)
    return tuple(stds)


def radius_std(robot: Robot) -> float:
    """Return the std of the wheel radius over the radius: the robot file's, else `RADIUS_STD`."""
    return robot.wheels.radius_std / robot.wheels.radius or RADIUS_STD
