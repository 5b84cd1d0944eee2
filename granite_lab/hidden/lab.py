"""Where the trials of a set are made: a robot, its sand, its logger, and what their files say of them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

from granite_lab.hidden.contact import FLOOR, NearRest
from granite_lab.parameters import Robot, Soil, load_paper
from granite_lab.parameters.quantity import key_of

LABS = ("bench", "wild")

SCATTER = {"frictional_modulus": 0.05, "cohesion": 0.05, "a_theta": 0.03}
"""Relative std from trial to trial on the bench, as raking leaves it; an assumption."""


@dataclass(frozen=True)
class Lab:
    """Robot, sand and logger of a set.

    Attributes:
        name: one of `LABS`.
        filed, robot: the robot as its file has it, and as it is, sensors included.
        filed_soil, soil: the same of the sand, on the average of the trials.
        robot_name, soil_name: what the trials call the files; ending in .toml where they lie beside them.
        a_theta: of (5) on the average of the trials [s/m].
        scatter: relative std of k_φ, c and a_θ from trial to trial.
        repetitions: of each variant; 0 leaves it to who asks.
        late: of the IMU's stamps behind the instants they stand for [s]; stamped_at_end: they are given
            at the end of the interval over which a sample is the mean.
        imu_jitter: std of the IMU's stamps [s].
        imu_gain: std of the scale of each axis in each trial.
        radius: relative std of each wheel's radius in each trial.
        rolls: the wheels roll by these radii, and angles are logged as they are; otherwise the wheels are
            alike and the logger counts their angles by these factors.
        ripple: relative std of the currents' fluctuation while the wheels turn.
        before, after: least and most of the standstills [s].
        near_rest: how the forces and the drive go on near rest.
        drawn: what of all this was drawn, for the answer.
    """

    name: str
    filed: Robot
    robot: Robot
    filed_soil: Soil
    soil: Soil
    robot_name: str
    soil_name: str
    a_theta: float
    scatter: Mapping[str, float] = field(default_factory=lambda: SCATTER)
    repetitions: int = 0
    late: float = 0.0
    stamped_at_end: bool = False
    imu_jitter: float = 1e-4
    imu_gain: float = 5e-4
    radius: float = 0.0
    rolls: bool = True
    ripple: float = 0.01
    before: tuple[float, float] = (1.5, 2.5)
    after: tuple[float, float] = (3.0, 3.5)
    near_rest: NearRest = FLOOR
    drawn: Mapping[str, Any] = field(default_factory=dict)

    def files(self) -> dict[str, str]:
        """Return the TOML files that lie beside the trials: what the laboratory knows of robot and sand."""
        records = {self.robot_name: self.filed, self.soil_name: self.filed_soil}
        return {name: toml_of(record) for name, record in records.items() if name.endswith(".toml")}


def bench(robot: Robot, soil: Soil) -> Lab:
    """Return the laboratory in which robot, sand and sensors are as their files say."""
    return Lab("bench", robot, robot, soil, soil, robot.name, soil.name, load_paper().a_theta)


def toml_of(record: Any, table: str = "") -> str:
    """Return a record of robot or soil as the TOML that reads back as the same."""
    lines, tables = [], []
    for each in fields(record):
        value, key = getattr(record, each.name), key_of(each)
        if is_dataclass(value):
            name = f"{table}.{key}" if table else key
            tables.append(f"\n[{name}]\n{toml_of(value, name)}")
        elif value is not None:
            lines.append(f"{key} = {json.dumps(value, ensure_ascii=False)}\n")
    return "".join(lines + tables)
