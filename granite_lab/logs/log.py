"""What every check of a log needs: its robot, its columns, and where its doubts go."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from granite_lab.errors import InputError
from granite_lab.logs.layouts import Binding
from granite_lab.logs.trial import Array
from granite_lab.parameters import Robot

OUT = "to = [] in a column map (inspect --write-map) leaves it out"


@dataclass(frozen=True)
class Log:
    """A log under examination.

    Attributes:
        robot: its wheels, motors, IMU and how that is mounted.
        where: the file, for messages.
        columns: channel to the column that feeds it.
        doubts: warnings are added here.
    """

    robot: Robot
    where: str
    columns: Mapping[str, Binding]
    doubts: list[str]

    def name(self, channel: str) -> str:
        """Return what the file calls the column of a channel."""
        return self.columns[channel].name if channel in self.columns else channel

    def column(self, *channels: str) -> str:
        """Name the column of a channel, or the columns of several."""
        names = " ".join(f"'{self.name(channel)}'" for channel in channels)
        return f"column{'s' * (len(channels) > 1)} {names}"

    def unit(self, *channels: str) -> str:
        """Return the unit that the first logged of some channels was said to have."""
        return next((self.columns[channel].unit.name for channel in channels if channel in self.columns), "")

    def refuse(self, channels: str | tuple[str, ...], what: str, hint: str = OUT) -> InputError:
        """Return the error that names the columns of some channels."""
        named = self.column(*([channels] if isinstance(channels, str) else channels))
        return InputError(f"{self.where}: {named}{what}", hint)

    @cached_property
    def mounting(self) -> Array:
        """Matrix from the IMU's axes to the robot's."""
        roll, pitch, yaw = self.robot.imu.rotation
        return np.asarray(Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True).as_matrix())
