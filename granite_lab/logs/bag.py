"""A recording by ROS as a file of a trial: its messages as columns, bound like those of any other log."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from granite_lab.errors import InputError
from granite_lab.files import sha256
from granite_lab.logs.bagfile import ROLES, Messages, read_messages
from granite_lab.logs.dialect import Dialect
from granite_lab.logs.joints import assign
from granite_lab.logs.layouts import ACCELERATION, ENCODERS, RATE, Column, Layout
from granite_lab.logs.matching import best, match
from granite_lab.logs.metadata import collect
from granite_lab.logs.named import name_of
from granite_lab.logs.source import Source
from granite_lab.logs.trial import Array, InputFile

__all__ = ["ROLES", "open_bag"]

ENCODING = "ROS"
"""What stands for the text encoding of a bag."""


def open_bag(path: Path, maps: Sequence[Layout] = (), topics: Mapping[str, str] | None = None) -> Source:
    """Read a bag; column maps may name its quantities as ``/topic.field``.

    Args:
        path: a ``.bag`` or ``.mcap`` file, or the folder of a ROS 2 recording.
        maps: column maps the user gave; without one that fits, the topics say what they are.
        topics: what a topic is to be taken for (a key of `ROLES`), to its name.

    Raises:
        InputError: the bag cannot be read, or holds no sensor.
        UsageError: an asked topic is not there or is of another type.
    """
    held = read_messages(path, topics or {})
    names = tuple(held.columns)
    dialect = Dialect(ENCODING, ",", ".", (names,), 0, 0, len(names), (), ())
    fits = [m for m in (match(layout, path, dialect) for layout in maps) if m.complete]
    found = best(path, fits) if fits else match(layout_of(path, held), path, dialect)
    doubts = list(held.doubts)
    bound = {binding.channel for binding in found.bindings}
    if "joints" in held.topics and not bound & set(ENCODERS):
        what = f"no wheel among the joints of {held.topics['joints']}"
        if not bound & {*ACCELERATION, *RATE}:
            shown = ", ".join(names[1:9]) + (", …" if len(names) > 9 else "")
            raise InputError(f"{path}: {what}", f"name them in a column map for --map; there are: {shown}")
        doubts.append(f"{path.name}: {what}; a column map can name them")
    sidecar = path.parent / f"{name_of(path)}.toml"
    beside = sidecar if sidecar.is_file() else None
    metadata = collect((), path, doubts, beside)
    inputs = tuple(InputFile(file, sha256(file)) for file in [path, *([beside] if beside else [])])
    columns: dict[int, Array] = dict(enumerate(held.columns.values()))
    kept = np.arange(len(columns[0]), dtype=np.float64)
    return Source(path, dialect, found, columns, kept, metadata, inputs, tuple(doubts))


def layout_of(path: Path, held: Messages) -> Layout:
    """Bind the quantities of a bag: IMU, wheels by the names of their joints, odometry, reference."""
    columns = [Column(to=("t",), name="t", unit="s")]

    def bind(name: str, unit: str, *to: str) -> None:
        if name in held.columns:
            columns.append(Column(to=to, name=name, unit=unit))

    if topic := held.topics.get("imu"):
        for axis in "xyz":
            bind(f"{topic}.linear_acceleration.{axis}", "m/s^2", f"imu_a{axis}")
            bind(f"{topic}.angular_velocity.{axis}", "rad/s", f"imu_g{axis}")
    if topic := held.topics.get("joints"):
        _bind_wheels(topic, held, bind)
    if topic := held.topics.get("odom"):
        bind(f"{topic}.twist.twist.linear.x", "m/s", "enc_fl", "enc_fr", "enc_rl", "enc_rr")
    if topic := held.topics.get("reference"):
        bind(f"{topic}.twist.twist.linear.x", "m/s", "ref_v")
        bind(f"{topic}.pose.pose.position.x", "m", "ref_x")
        bind(f"{topic}.pose.pose.position.y", "m", "ref_y")
        bind(f"{topic}.latitude", "deg", "ref_lat")
        bind(f"{topic}.longitude", "deg", "ref_lon")
    name = "ROS: " + ", ".join(f"{role} {topic}" for role, topic in held.topics.items())
    return Layout(name=name, column=tuple(columns), title=path.name)


def _bind_wheels(topic: str, held: Messages, bind: Callable[..., None]) -> None:
    """Bind each wheel's position, or its velocity where the positions were not published."""
    for quantity, unit in (("position", "rad"), ("velocity", "rad/s")):
        start = f"{topic}.{quantity}."
        joints = [name.removeprefix(start) for name in held.columns if name.startswith(start)]
        found = assign(joints)
        for joint, wheels in found.items():
            bind(start + joint, unit, *(f"enc_{wheel}" for wheel in wheels))
        if found:
            return
