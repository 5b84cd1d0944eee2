"""Bags written by rosbags' own writers, from the samples of a trial."""

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
JOINTS = [f"{end}_{side}_wheel_joint" for end in ("front", "rear") for side in ("left", "right")]
IMU, WHEELS, ODOM, OUTSIDE = "/imu/data", "/joint_states", "/odom", "/mocap/odom"
EPOCH = 1_700_000_000


def rounded(trial: Trial, count: int | None = None) -> Trial:
    """Round the stamps of IMU and wheels to nanoseconds, which is what a bag can hold; keep `count`."""

    def one(stream: Any) -> Any:
        arrays = {f.name: getattr(stream, f.name) for f in dataclasses.fields(stream)}
        cut = {name: value[:count] for name, value in arrays.items() if isinstance(value, np.ndarray)}
        return dataclasses.replace(stream, **cut | {"t": np.rint(cut["t"] * 1e9) / 1e9})

    return dataclasses.replace(trial, currents=None, imu=one(trial.imu), wheels=one(trial.wheels))


class Bag:
    """Makes messages of a ROS distribution.

    Args:
        kind: one of `KINDS`.
        stamped: write the stamps into the messages' headers, not only into the bag.
        epoch: added to every stamp [s].
        late: messages arrive so much after their stamp [s].
    """

    def __init__(self, kind: str, *, stamped: bool = True, epoch: int = 0, late: float = 0.0) -> None:
        self.kind = kind
        self.first = kind == "ros1"
        self.store = get_typestore(Stores.ROS1_NOETIC if self.first else Stores.ROS2_HUMBLE)
        self.stamped = stamped
        self.epoch = epoch
        self.late = late

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

    def pose(self, x: float) -> Any:
        turned = self.of("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0)
        return self.of("geometry_msgs/msg/Pose", self.of("geometry_msgs/msg/Point", x, 0.0, 0.0), turned)

    def spread(self, x: float) -> Any:
        """Return a pose with covariance, which has no header."""
        return self.of("geometry_msgs/msg/PoseWithCovariance", self.pose(x), np.zeros(36))

    def odometry(self, t: float, x: float, v: float) -> Any:
        twist = self.of("geometry_msgs/msg/Twist", self.vector((v, 0, 0)), self.vector((0, 0, 0)))
        moving = self.of("geometry_msgs/msg/TwistWithCovariance", twist, np.zeros(36))
        return self.of("nav_msgs/msg/Odometry", self.header(t), "base", self.spread(x), moving)

    def place(self, kind: str, t: float, x: float) -> Any:
        """Return a message with a place from outside, of a kind that ROS has for it."""
        if kind == "NavSatFix":
            status = self.of("sensor_msgs/msg/NavSatStatus", 0, 1)
            place = (52.0 + x / 111_267.0, 21.0, 100.0)
            return self.of("sensor_msgs/msg/NavSatFix", self.header(t), status, *place, np.zeros(9), 0)
        if kind == "Odometry":
            return self.odometry(t, x, 0.2)
        body = self.spread(x) if "Covariance" in kind else self.pose(x)
        return self.of(f"geometry_msgs/msg/{kind}", self.header(t), body) if "Stamped" in kind else body

    def of_imu(self, trial: Trial) -> Iterator[tuple[str, float, Any]]:
        """Yield (topic, stamp, message) of the IMU of a trial."""
        for t, force, rate in zip(trial.imu.t, trial.imu.specific_force, trial.imu.angular_rate, strict=True):
            yield IMU, t, self.imu(t, force, rate)

    def of_wheels(self, trial: Trial, **more: Any) -> Iterator[tuple[str, float, Any]]:
        """Yield the same of its wheel angles."""
        for t, angle in zip(trial.wheels.t, trial.wheels.angle, strict=True):
            yield WHEELS, t, self.joints(t, JOINTS, angle, **more)

    def trial(self, trial: Trial) -> Iterator[tuple[str, float, Any]]:
        """Yield both."""
        yield from self.of_imu(trial)
        yield from self.of_wheels(trial)

    def write(self, folder: Path, name: str, messages: Any) -> Path:
        """Write messages in the order of their stamps; return the path that a user would name."""
        ordered = sorted(messages, key=lambda item: item[1])
        types = {topic: message.__msgtype__ for topic, _, message in ordered}
        path = folder / (f"{name}.bag" if self.first else name)
        plugin = StoragePlugin.SQLITE3 if self.kind == "ros2" else StoragePlugin.MCAP
        writer: Any = Writer1(path) if self.first else Writer2(path, version=9, storage_plugin=plugin)
        with writer:
            links = {
                topic: writer.add_connection(topic, kind, typestore=self.store)
                for topic, kind in types.items()
            }
            for topic, t, message in ordered:
                pack = self.store.serialize_ros1 if self.first else self.store.serialize_cdr
                writer.write(links[topic], self.ns(t + self.late), pack(message, message.__msgtype__))
        return next(path.glob("*.mcap")) if self.kind == "mcap file" else path
