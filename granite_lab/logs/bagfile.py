"""Messages out of ROS 1 bags, ROS 2 bags and MCAP files, through the library rosbags."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from granite_lab.errors import InputError, LabError, UsageError
from granite_lab.files import is_folder, readable, refuse_special
from granite_lab.logs.trial import Array

IMU, JOINTS, ODOMETRY = "sensor_msgs/msg/Imu", "sensor_msgs/msg/JointState", "nav_msgs/msg/Odometry"

FIX, POSE = "sensor_msgs/msg/NavSatFix", "geometry_msgs/msg/Pose"

ROLES: dict[str, tuple[str, ...]] = {
    "imu": (IMU,),
    "joints": (JOINTS,),
    "odom": (ODOMETRY,),
    "reference": (ODOMETRY, f"{POSE}Stamped", f"{POSE}WithCovarianceStamped", FIX),
}
"""What a topic can be taken for, and the types of its messages. `odom` is the odometry of the wheels,
`reference` a place from outside (GPS, motion capture) that only judges."""

LEFT_OUT = "none"
"""Given for a role in place of a topic, it leaves the role out."""


@dataclass(frozen=True, eq=False)
class Messages:
    """The messages of some topics as one table, a row a message, in the order of the bag.

    Attributes:
        topics: what a topic was taken for, to its name.
        columns: name to (N,) values, NaN where a message does not carry the quantity; `t` is in [s]
            since `origin`.
        origin: whole seconds of the first stamp, since 1970 or since the clock began.
        doubts: what was not sure.
    """

    topics: dict[str, str]
    columns: dict[str, Array]
    origin: int
    doubts: tuple[str, ...]


def read_messages(path: Path, asked: Mapping[str, str]) -> Messages:
    """Read the topics of a bag that hold an IMU, wheel joints or odometry.

    Args:
        path: a ``.bag`` or ``.mcap`` file, or the folder of a ROS 2 recording.
        asked: what a topic is to be taken for (a key of `ROLES`), to its name.

    Raises:
        InputError: the bag cannot be read, or holds none of these.
        UsageError: an asked topic is not there or is of another type.
        LabError: the library is not installed.
    """
    try:
        from rosbags.highlevel import AnyReader  # noqa: PLC0415, an extra
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415
    except ImportError:
        raise LabError(
            f"{path}: reading ROS bags and MCAP needs rosbags, which is not installed",
            "pip install 'granite-lab[ros]'",
        ) from None
    refuse_special(path)
    try:
        if not is_folder(path):
            path.open("rb").close()
    except OSError as error:
        raise readable(error, path) from None
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            doubts: list[str] = []
            chosen = _choose(path, reader.topics, asked, doubts)
            wanted = [c for c in reader.connections if c.topic in chosen.values()]
            rows = [
                (connection.topic, stamp, reader.deserialize(raw, connection.msgtype))
                for connection, stamp, raw in reader.messages(connections=wanted)
            ]
    except LabError:
        raise
    except Exception as error:  # the parsers raise whatever a damaged file makes them stumble over
        what = " ".join(str(error).split())[:120] or type(error).__name__
        raise InputError(
            f"{path}: cannot be read as a ROS bag: {what}",
            "is the recording complete? 'ros2 bag reindex' mends some",
        ) from None
    return _table(path, chosen, rows, doubts)


def _choose(
    path: Path, topics: Mapping[str, Any], asked: Mapping[str, str], doubts: list[str]
) -> dict[str, str]:
    """Return what each topic is taken for; where several fit, the one with most messages."""
    chosen: dict[str, str] = {}
    for role, name in asked.items():
        if name == LEFT_OUT:
            continue
        if name not in topics:
            known = ", ".join(sorted(topics)) or "none"
            raise UsageError(f"{path}: there is no topic '{name}'", f"topics: {known}")
        if topics[name].msgtype not in ROLES[role]:
            raise UsageError(
                f"{path}: topic '{name}' holds {topics[name].msgtype}, expected {' or '.join(ROLES[role])} "
                f"for {role}",
                "choose another topic",
            )
        chosen[role] = name
    for role in ("imu", "joints", "odom"):
        if (
            role in asked
            or (role == "joints" and "odom" in chosen)
            or (role == "odom" and "joints" in chosen)
        ):
            continue
        free = {
            name: info.msgcount
            for name, info in topics.items()
            if info.msgtype in ROLES[role] and info.msgcount > 0 and name not in asked.values()
        }
        if not free:
            continue
        best = min(free, key=lambda name: (-free[name], name))
        chosen[role] = best
        others = ", ".join(sorted(set(free) - {best}))
        if others:
            doubts.append(
                f"{path.name}: topic {best} taken as {role}, not {others}; --topic {role}=… chooses another"
            )
    if not set(chosen) & {"imu", "joints", "odom"}:
        held = ", ".join(sorted({str(info.msgtype) for info in topics.values()})) or "nothing"
        raise InputError(f"{path}: no topic with {IMU}, {JOINTS} or {ODOMETRY}", f"the bag holds: {held}")
    if "odom" in chosen:
        doubts.append(
            f"{path.name}: no joint states: the wheels' velocity is that of odometry {chosen['odom']}"
        )
    return chosen


def _table(
    path: Path, topics: dict[str, str], rows: list[tuple[str, int, Any]], doubts: list[str]
) -> Messages:
    """Put messages into columns."""
    role_of = {name: role for role, name in topics.items()}
    stamps = [_stamp(message) for _, _, message in rows]
    if not any(stamps):
        stamps = [arrival for _, arrival, _ in rows]
        if rows:
            doubts.append(f"{path.name}: messages carry no stamps; taken when they arrived")
    origin = min(stamps, default=0) // 1_000_000_000
    columns: dict[str, Array] = {"t": np.array([(s - origin * 1_000_000_000) / 1e9 for s in stamps])}
    for row, (topic, _, message) in enumerate(rows):
        for name, value in _FIELDS[role_of[topic]](topic, message):
            if name not in columns:
                columns[name] = np.full(len(rows), np.nan)
            columns[name][row] = value
    return Messages(topics, columns, int(origin), tuple(doubts))


def _stamp(message: Any) -> int:
    """Return the stamp in a message's header [ns]; 0 where nobody set it."""
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _imu(topic: str, message: Any) -> Iterator[tuple[str, float]]:
    """Yield the quantities of an IMU message; a covariance that begins with -1 says there is none."""
    for name in ("linear_acceleration", "angular_velocity"):
        if message.__dict__[f"{name}_covariance"][0] == -1:
            continue
        vector = message.__dict__[name]
        for axis in "xyz":
            yield f"{topic}.{name}.{axis}", getattr(vector, axis)


def _joints(topic: str, message: Any) -> Iterator[tuple[str, float]]:
    """Yield position [rad], velocity [rad/s] and effort [N m] of each joint."""
    for name in ("position", "velocity", "effort"):
        for joint, value in zip(message.name, message.__dict__[name], strict=False):
            if not math.isnan(value):
                yield f"{topic}.{name}.{joint}", value


def _odometry(topic: str, message: Any) -> Iterator[tuple[str, float]]:
    """Yield velocity and place, of a pose only the place, of a satellite fix latitude and longitude."""
    if hasattr(message, "latitude"):
        if message.status.status >= 0:  # -1: no fix
            yield f"{topic}.latitude", message.latitude
            yield f"{topic}.longitude", message.longitude
        return
    if hasattr(message, "twist"):
        yield f"{topic}.twist.twist.linear.x", message.twist.twist.linear.x
    pose = message.pose if hasattr(message.pose, "position") else message.pose.pose
    yield f"{topic}.pose.pose.position.x", pose.position.x
    yield f"{topic}.pose.pose.position.y", pose.position.y


_FIELDS = {"imu": _imu, "joints": _joints, "odom": _odometry, "reference": _odometry}
