"""Bags written by rosbags' own writers, from the samples of a trial."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from granite_lab.logs.trial import Trial

KINDS = ("ros1", "ros2", "mcap", "mcap file")
JOINTS = (
    "front_left_wheel_joint",
    "front_right_wheel_joint",
    "rear_left_wheel_joint",
    "rear_right_wheel_joint",
)
IMU, WHEELS, ODOM, OUTSIDE = "/imu/data", "/joint_states", "/odom", "/mocap/odom"
EPOCH = 1_700_000_000


def rounded(trial: Trial) -> Trial:
    """Round all stamps to nanoseconds, which is what a bag can hold."""

    def one(stream: Any) -> Any:
        return None if stream is None else dataclasses.replace(stream, t=np.rint(stream.t * 1e9) / 1e9)

    names = ("imu", "wheels", "command", "reference_x", "reference_v")
    return dataclasses.replace(trial, currents=None, **{name: one(getattr(trial, name)) for name in names})


class Bag:
    """Makes messages of a ROS distribution.

    Args:
        kind: one of `KINDS`.
        stamped: write the stamps into the messages' headers, not only into the bag.
        epoch: added to every stamp [s].
    """

    def __init__(self, kind: str, *, stamped: bool = True, epoch: int = 0) -> None:
        self.kind = kind
        self.first = kind == "ros1"
        self.store = get_typestore(Stores.ROS1_NOETIC if self.first else Stores.ROS2_HUMBLE)
        self.stamped = stamped
        self.epoch = epoch

    def of(self, name: str, *args: Any, **kwargs: Any) -> Any:
        return self.store.types[name](*args, **kwargs)

    def ns(self, t: float) -> int:
        return round(t * 1e9) + self.epoch * 1_000_000_000

    def header(self, t: float) -> Any:
        sec, nsec = divmod(self.ns(t) if self.stamped else 0, 1_000_000_000)
        stamp = self.of("builtin_interfaces/msg/Time", sec, nsec)
        extra = {"seq": 0} if self.first else {}
        return self.of("std_msgs/msg/Header", stamp=stamp, frame_id="base", **extra)

    def vector(self, values: Any) -> Any:
        return self.of("geometry_msgs/msg/Vector3", *map(float, values))

    def imu(self, t: float, force: Any, rate: Any, *, no_force: bool = False) -> Any:
        nothing, absent = np.zeros(9), np.zeros(9)
        absent[0] = -1
        turned = self.of("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0)
        sensed = (self.vector(rate), nothing, self.vector(force), absent if no_force else nothing)
        return self.of("sensor_msgs/msg/Imu", self.header(t), turned, absent, *sensed)

    def joints(self, t: float, names: Any, position: Any = (), velocity: Any = (), effort: Any = ()) -> Any:
        arrays = [np.array(values, dtype=float) for values in (position, velocity, effort)]
        return self.of("sensor_msgs/msg/JointState", self.header(t), list(names), *arrays)

    def odometry(self, t: float, x: float, v: float) -> Any:
        pose = self.of(
            "geometry_msgs/msg/Pose", self.of("geometry_msgs/msg/Point", float(x), 0.0, 0.0),
            self.of("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0),
        )  # fmt: skip
        twist = self.of("geometry_msgs/msg/Twist", self.vector((v, 0, 0)), self.vector((0, 0, 0)))
        return self.of(
            "nav_msgs/msg/Odometry", self.header(t), "base",
            self.of("geometry_msgs/msg/PoseWithCovariance", pose, np.zeros(36)),
            self.of("geometry_msgs/msg/TwistWithCovariance", twist, np.zeros(36)),
        )  # fmt: skip

    def trial(self, trial: Trial) -> Iterator[tuple[str, float, Any]]:
        """Yield (topic, stamp, message) of the IMU and the wheel angles of a trial."""
        assert trial.imu is not None
        assert trial.wheels is not None
        imu, wheels = trial.imu, trial.wheels
        for t, force, rate in zip(imu.t, imu.specific_force, imu.angular_rate, strict=True):
            yield IMU, t, self.imu(t, force, rate)
        for t, angle in zip(wheels.t, wheels.angle, strict=True):
            yield WHEELS, t, self.joints(t, JOINTS, angle)

    def write(self, folder: Path, name: str, messages: Any) -> Path:
        """Write messages in the order of their stamps; return the path that a user would name."""
        ordered = sorted(messages, key=lambda item: item[1])
        types = {topic: message.__msgtype__ for topic, _, message in ordered}
        path = folder / (f"{name}.bag" if self.first else name)
        writer: Any = (
            Writer1(path)
            if self.first
            else Writer2(
                path,
                version=9,
                storage_plugin=StoragePlugin.SQLITE3 if self.kind == "ros2" else StoragePlugin.MCAP,
            )
        )
        with writer:
            links = {
                topic: writer.add_connection(topic, kind, typestore=self.store)
                for topic, kind in types.items()
            }
            for topic, t, message in ordered:
                pack = self.store.serialize_ros1 if self.first else self.store.serialize_cdr
                writer.write(links[topic], self.ns(t), pack(message, message.__msgtype__))
        return next(path.glob("*.mcap")) if self.kind == "mcap file" else path
