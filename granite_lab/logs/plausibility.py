"""Do the numbers look like what their columns say they are?"""

from __future__ import annotations

from granite_lab.logs.trial import ImuStream, WheelStream
from granite_lab.parameters import Robot


def check_imu(imu: ImuStream, robot: Robot, where: str) -> tuple[ImuStream, list[str]]:
    """."""
    return imu, []


def check_wheels(
    wheels: WheelStream, imu: ImuStream | None, robot: Robot, where: str
) -> tuple[WheelStream, list[str]]:
    """."""
    return wheels, []
