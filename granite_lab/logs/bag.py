"""Recordings by ROS 1 and 2 and MCAP files, read through the library rosbags, as one table."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from granite_lab.errors import InputError, LabError, UsageError
from granite_lab.files import is_folder, readable, refuse_special
from granite_lab.logs.layouts import Column, Layout
from granite_lab.logs.quantities import ROS, WORDS, wheels_named, words
from granite_lab.logs.sensors.stamps import CRYSTAL, FASTEST, rate_by_arrival, ticks_too_rarely
from granite_lab.logs.table import Table
from granite_lab.logs.trial import Array

ROLES = {role: tuple(told["types"].split()) for role, told in ROS.items()}
"""What a topic can be taken for, and the types of its messages. `odom` is the odometry of the wheels,
`reference` a place from outside (GPS, motion capture) that only judges."""

# What a bag must hold one of, and which of them makes it needless.
_INSTEAD = {"imu": "", "joints": "odom", "odom": "joints"}
_LEFT_OUT = "none"  # given for a role in place of a topic, it leaves the role out

# A field of messages: its name, the name of its covariance ("": none), and how to get its number.
Field = tuple[str, str, Callable[[Any], float]]

_SECOND = 1_000_000_000


def read_bag(path: Path, asked: Mapping[str, str]) -> tuple[Table, dict[str, str]]:
    """Read the topics of a bag that hold an IMU, wheel joints or odometry; `asked` names those of some roles.

    Returns a table with a row a message and columns called ``/topic.field``, and what each topic was taken
    for. Its column `t` is in [s] since the whole second of the first stamp.

    Raises:
        InputError: the bag cannot be read, or holds none of these.
        UsageError: an asked topic is not there or is of another type.
        LabError: the library is not installed.
    """
    try:
        from rosbags.highlevel import AnyReader  # noqa: PLC0415, an extra
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415
    except ImportError:
        reason = f"{path}: reading ROS bags and MCAP needs rosbags, which is not installed"
        raise LabError(reason, "pip install 'granite-lab[ros]'") from None
    refuse_special(path)
    try:
        if not is_folder(path):
            path.open("rb").close()
    except OSError as error:
        raise readable(error, path) from None
    doubts: list[str] = []
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            chosen = _choose(path, reader.topics, asked, doubts)
            wanted = [c for c in reader.connections if c.topic in chosen.values()]
            rows = [
                (connection.topic, stamp, reader.deserialize(raw, connection.msgtype))
                for connection, stamp, raw in reader.messages(connections=wanted)
            ]
    except LabError:
        raise
    except Exception as error:  # the parsers raise whatever a damaged file makes them stumble over
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        hint = "is the recording complete? 'ros2 bag reindex' may repair it"
        raise InputError(f"{path}: cannot be read as a ROS bag: {reason}", hint) from None
    columns = defaultdict[str, Array](lambda: np.full(len(rows), np.nan), t=_stamps(path, rows, doubts))
    names, fields = {topic: ROS[role]["fields"] for role, topic in chosen.items()}, dict[str, list[Field]]()
    for row, (topic, _, message) in enumerate(rows):
        if topic not in fields:
            fields[topic] = list(_find(message, names[topic]))
        for name, value in _numbers(message, fields[topic]):
            columns[f"{topic}.{name}"][row] = value
    headers, numbers = (tuple(columns),), tuple(columns.values())
    table = Table(
        path=path, headers=headers, width=len(columns), encoding="ROS", doubts=tuple(doubts), numbers=numbers
    )  # fmt: skip
    return table, chosen


def _choose(
    path: Path, topics: Mapping[str, Any], asked: Mapping[str, str], doubts: list[str]
) -> dict[str, str]:
    """Return what each topic is taken for; where several fit, the one with most messages."""
    chosen: dict[str, str] = {}
    for role, name in asked.items():
        if name == _LEFT_OUT:
            continue
        if name not in topics:
            listed = ", ".join(sorted(topics)) or "none"
            raise UsageError(f"{path}: there is no topic '{name}'", f"topics: {listed}")
        if topics[name].msgtype not in ROLES[role]:
            fault = f"holds {topics[name].msgtype}, expected {' or '.join(ROLES[role])} for {role}"
            raise UsageError(f"{path}: topic '{name}' {fault}", "choose another topic")
        chosen[role] = name
    for role, instead in _INSTEAD.items():
        if role in asked or instead in chosen:
            continue
        free = [
            (-info.msgcount, name)
            for name, info in topics.items()
            if info.msgtype in ROLES[role] and info.msgcount > 0 and name not in asked.values()
        ]
        if free:
            chosen[role] = best = min(free)[1]
            if others := ", ".join(sorted(name for _, name in free if name != best)):
                taken = f"{path.name}: topic {best} taken as {role}, not {others}"
                doubts.append(f"{taken}; --topic {role}=… chooses another")
    if not set(chosen) & set(_INSTEAD):
        types = ", ".join(sorted({str(info.msgtype) for info in topics.values()})) or "nothing"
        imu, joints, odometry = (ROLES[role][0] for role in _INSTEAD)
        raise InputError(f"{path}: no topic with {imu}, {joints} or {odometry}", f"the bag holds: {types}")
    if "odom" in chosen:
        taken = f"no joint states: the wheels' velocity is that of odometry {chosen['odom']}"
        doubts.append(f"{path.name}: {taken}")
    return chosen


def _stamps(path: Path, rows: Sequence[tuple[str, int, Any]], doubts: list[str]) -> Array:
    """Return stamps (N,) [s] since the whole second of the first.

    They stand in the messages' headers; 0 there says that it was not set. Messages without one, and those
    whose stamps stand still or tick too rarely, are taken when they arrived, less the time that the others
    usually take to arrive.
    """
    headers = [getattr(message, "header", None) for _, _, message in rows]
    stamps = [h.stamp.sec * _SECOND + h.stamp.nanosec if h is not None else 0 for h in headers]
    logged = list(zip(rows, stamps, strict=True))
    bare: set[str] = set()
    for topic in sorted({topic for topic, _, _ in rows}):
        of_topic = [stamp for (name, _, _), stamp in logged if name == topic]
        if any(of_topic) and not _stands_still(
            of_topic, [arrival for name, arrival, _ in rows if name == topic]
        ):
            continue
        bare.add(topic)
        fault = "have no stamps" if not any(of_topic) else f"have {len(set(of_topic))} different stamps"
        doubts.append(
            f"{path.name}: {len(of_topic)} messages of {topic} {fault}; the time of arrival is used"
        )
    stamps = _at_one_rate(path, [(topic, arrival) for topic, arrival, _ in rows], stamps, bare, doubts)
    logged = list(zip(rows, stamps, strict=True))
    late = [arrival - stamp for (topic, arrival, _), stamp in logged if topic not in bare]
    delay = int(np.median(late)) if bare and late else 0
    stamps = [arrival - delay if topic in bare else stamp for (topic, arrival, _), stamp in logged]
    origin = min(stamps, default=0) // _SECOND
    return np.array([(stamp - origin * _SECOND) / 1e9 for stamp in stamps])


def _at_one_rate(
    path: Path, came: Sequence[tuple[str, int]], stamps: Sequence[int], bare: set[str], doubts: list[str]
) -> list[int]:
    """Return stamps [ns], those of a topic whose clock runs unlike the others' at the rate of its arrivals.

    Where all topics run alike they have one clock, maybe that of a simulation; `bare` ones have none.
    """
    places = defaultdict[str, list[int]](list)
    for k, (topic, _) in enumerate(came):
        if topic not in bare:
            places[topic].append(k)
    rates = {}
    for topic, rows in places.items():
        t, arrival = (
            np.array([x[k] - x[rows[0]] for k in rows]) / 1e9 for x in (stamps, [at for _, at in came])
        )
        rates[topic] = rate_by_arrival(t, arrival)
    if max(rates.values(), default=0.0) - min(rates.values(), default=0.0) < CRYSTAL:
        return list(stamps)
    paced = list(stamps)
    for topic, rate in rates.items():
        if CRYSTAL < abs(rate) < FASTEST:
            first = stamps[places[topic][0]]
            for k in places[topic]:
                paced[k] = first + round((stamps[k] - first) * (1.0 + rate))
            way = "slow" if rate > 0 else "fast"
            seen = f"the clock of {topic} runs {100 * abs(rate):.2f} % {way} by the times of arrival"
            doubts.append(f"{path.name}: {seen}; corrected")
    return paced


def _stands_still(stamps: Sequence[int], arrivals: Sequence[int]) -> bool:
    """Say whether stamps [ns] tick too rarely to be used, and arrivals do not."""
    of_headers, of_arrival = (np.array([(x - t[0]) / 1e9 for x in t]) for t in (stamps, arrivals))
    return len(stamps) > 1 and ticks_too_rarely(of_headers) and not ticks_too_rarely(of_arrival)


def _find(message: Any, names: Iterable[str]) -> Iterator[Field]:
    """Yield those fields that a message has: name, its covariance's, and how to get it."""
    for name in names:
        part, path = message, list[str]()
        for step in name.split("."):
            if step != "pose" or hasattr(part, step):
                part, path = getattr(part, step, None), [*path, step]
        if part is not None:
            covariance = f"{path[0]}_covariance"
            yield name, covariance if hasattr(message, covariance) else "", attrgetter(".".join(path))


def _numbers(message: Any, fields: Iterable[Field]) -> Iterator[tuple[str, float]]:
    """Yield the numbers of a message by the name of their field; what is not there is passed over.

    Of an IMU, a covariance that begins with -1 says so; of a place on the globe, the status; of joints, NaN.
    """
    if hasattr(message, "effort"):
        for name in ("position", "velocity", "effort"):
            values = zip(message.name, getattr(message, name), strict=False)
            yield from ((f"{name}.{joint}", value) for joint, value in values if not math.isnan(value))
    if hasattr(message, "latitude") and message.status.status < 0:
        return
    for name, covariance, get in fields:
        if not covariance or getattr(message, covariance)[0] != -1:
            yield name, get(message)


def bag_layout(table: Table, roles: Mapping[str, str]) -> tuple[Layout, list[str]]:
    """Return a layout of the bag that `read_bag` gave, wheels by the names of their joints, and doubts.

    A bag without an IMU and without a joint that is a wheel is refused.
    """
    names, doubts = table.headers[0], list[str]()
    columns = [Column(to=("t",), name="t", unit="s")]
    for role, topic in ((role, roles[role]) for role in ROLES if role in roles):
        fields = ROS[role]["fields"] or _wheels(names, topic)
        columns += [
            Column(to=tuple(to), name=name, unit=unit)
            for field, (unit, *to) in fields.items()
            if to and (name := f"{topic}.{field}") in names
        ]
        if not fields:
            message = f"{table.path}: no wheel among the joints of {topic}"
            if len(columns) == 1:
                shown = ", ".join(names[1:9]) + (", …" if len(names) > 9 else "")
                raise InputError(message, f"name them in a column map for --map; there are: {shown}")
            doubts.append(f"{message}; a column map can name them")
    name = "ROS: " + ", ".join(f"{role} {topic}" for role, topic in roles.items())
    return Layout(name=name, column=tuple(columns), title=table.path.name), doubts


def _wheels(names: Sequence[str], topic: str) -> dict[str, list[str]]:
    """Return the fields of joints that are wheels: their positions, or else their velocities."""
    for quantity, unit in (("position", "rad"), ("velocity", "rad/s")):
        start = f"{topic}.{quantity}."
        assigned = assign([name.removeprefix(start) for name in names if name.startswith(start)])
        if assigned:
            return {
                f"{quantity}.{joint}": [unit, *(f"enc_{wheel}" for wheel in wheels)]
                for joint, wheels in assigned.items()
            }
    return {}


def assign(joints: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return joint to the wheels that it turns, each wheel from one joint.

    Names are read word by word, as in ``front_left_wheel_joint``, ``wheel_FL`` or ``LeftWheel``; a
    ``left_wheel`` stands for both of its side. Of several joints that claim a wheel, one that says its axle
    goes first, then one that calls itself a wheel.
    """
    claims: dict[str, tuple[str, ...]] = {}
    for joint in joints:
        parts = words(joint)[0]
        wheels = () if WORDS["not_wheel"] & set(parts) else wheels_named(parts)
        claims[joint] = wheels if len(wheels) == 1 or "wheel" in joint.lower() else ()
    order = sorted(joints, key=lambda joint: (len(claims[joint]), "wheel" not in joint.lower()))
    taken = {wheel: joint for joint in reversed(order) for wheel in claims[joint]}
    wheels_of = {joint: tuple(w for w in claims[joint] if taken[w] == joint) for joint in joints}
    return {joint: wheels for joint, wheels in wheels_of.items() if wheels}
