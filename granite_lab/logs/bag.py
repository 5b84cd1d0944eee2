"""Recordings by ROS 1 and 2 and MCAP files, read through the library rosbags, as one table."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial, reduce
from pathlib import Path
from typing import Any

import numpy as np

from granite_lab.errors import InputError, LabError, UsageError
from granite_lab.files import is_folder, readable, refuse_special
from granite_lab.logs.layouts import Column, Layout
from granite_lab.logs.quantities import ROS, WORDS, wheels_named, words
from granite_lab.logs.sensors.doubt import some_of
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

Message = tuple[str, int, Any]  # its topic, when it arrived [ns], and what it says

_SECOND = 1_000_000_000


_NUMBER = re.compile(r"std_msgs/msg/U?(Int|Float)\d+")  # messages of one number, as small computers send them
_TOGETHER = 0.5  # of a period: numbers that come within it are of one sample


def read_bag(
    path: Path, asked: Mapping[str, str], named: Iterable[str] | None = ()
) -> tuple[Table, dict[str, str]]:
    """Read the topics of a bag that hold an IMU, wheel joints or odometry; `asked` names those of some roles.

    Columns that are `named`, as a column map does it, are read from messages of any type: ``/topic.field``,
    with the place in an array as in ``/rpm.data.0``. With None, messages of one number are read.

    Returns a table with a row a message and columns called ``/topic.field``, and what each topic was taken
    for. Numbers that are sent one by one and come together share a row. Its column `t` is in [s] since the
    whole second of the first stamp.

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
    doubts, chosen = list[str](), dict[str, str]()
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            numbers = [
                f"{n}.data" for n, t in sorted(reader.topics.items()) if _NUMBER.match(t.msgtype or "")
            ]
            others = _others(reader.topics, numbers if named is None else named)
            if named is not None:
                chosen = _choose(path, reader.topics, asked, doubts, numbers, given=bool(others))
            wanted = [c for c in reader.connections if c.topic in {*chosen.values(), *others}]
            rows: list[Message] = [
                (connection.topic, stamp, reader.deserialize(raw, connection.msgtype))
                for connection, stamp, raw in reader.messages(connections=wanted)
            ]
    except LabError:
        raise
    except Exception as error:  # the parsers raise whatever a damaged file makes them stumble over
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        hint = "is the recording complete? 'ros2 bag reindex' may repair it"
        raise InputError(f"{path}: cannot be read as a ROS bag: {reason}", hint) from None
    read = {topic: [*ROS[role]["fields"], *others.get(topic, ())] for role, topic in chosen.items()}
    return _table(path, rows, {**others, **read}, doubts), chosen


def _table(
    path: Path, rows: Sequence[Message], names: Mapping[str, Iterable[str]], doubts: list[str]
) -> Table:
    """Return the fields of some `names` of each topic as columns."""
    stamps = _stamps(rows, doubts)
    first, places = _rows(stamps, [topic if _NUMBER.match(m.__msgtype__) else "" for topic, _, m in rows])
    columns = defaultdict[str, Array](lambda: np.full(len(first), np.nan), t=stamps[first])
    fields = dict[str, list[Field]]()
    for row, (topic, _, message) in zip(places, rows, strict=True):
        if topic not in fields:
            fields[topic] = list(_find(message, dict.fromkeys(names[topic])))
        for name, value in _numbers(message, fields[topic]):
            columns[f"{topic}.{name}"][row] = value
    return Table(
        path=path, headers=(tuple(columns),), width=len(columns), encoding="ROS",
        doubts=tuple(f"{path.name}: {doubt}" for doubt in doubts), numbers=tuple(columns.values()),
    )  # fmt: skip


def _others(topics: Iterable[str], named: Iterable[str]) -> dict[str, list[str]]:
    """Return the fields of topics that columns called ``/topic.field`` name; topics may hold points."""
    fields = defaultdict[str, list[str]](list)
    for name in named:
        held = [topic for topic in topics if name.startswith(f"{topic}.")]
        if held:
            topic = max(held, key=len)
            fields[topic].append(name.removeprefix(f"{topic}."))
    return fields


def _rows(stamps: Array, numbers: Sequence[str]) -> tuple[list[int], list[int]]:
    """Return the first message of each row, and the row of each message, of stamps (N,) [s].

    `numbers` says of each message which topic of one number it is from, "" for others. Numbers are of one
    row until one of them comes again, or until half a period has passed.
    """
    of_topic = defaultdict[str, list[float]](list)
    for stamp, topic in zip(stamps, numbers, strict=True):
        of_topic[topic].append(stamp)
    periods = [float(np.median(np.diff(t))) for topic, t in of_topic.items() if topic and len(t) > 1]
    longest = _TOGETHER * min(periods, default=0.0)
    first, places, here = list[int](), list[int](), set[str]()
    begun = 0
    for k, topic in enumerate(numbers):
        if topic and here and topic not in here and stamps[k] - stamps[first[begun]] <= longest:
            here.add(topic)
            places.append(begun)
            continue
        if topic:
            begun, here = len(first), {topic}
        places.append(len(first))
        first.append(k)
    return first, places


def _choose(
    path: Path,
    topics: Mapping[str, Any],
    asked: Mapping[str, str],
    doubts: list[str],
    numbers: Sequence[str],
    *,
    given: bool,
) -> dict[str, str]:
    """Return what each topic is taken for; where several fit, the one with most messages.

    `numbers` are columns of messages of one number. Where a column map has `given` columns, a bag may hold
    none of the topics that are looked for.
    """
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
                doubts.append(f"topic {best} taken as {role}, not {others}; --topic {role}=… chooses another")
    shown = some_of(numbers, 6)
    if not given and not set(chosen) & set(_INSTEAD):
        types = ", ".join(sorted({str(info.msgtype) for info in topics.values()})) or "nothing"
        imu, joints, odometry = (ROLES[role][0] for role in _INSTEAD)
        hint = f"a column map (inspect --write-map) can name single numbers: {shown}" if numbers else ""
        raise InputError(
            f"{path}: no topic with {imu}, {joints} or {odometry}", hint or f"the bag holds: {types}"
        )
    if numbers and not given and not {"joints", "odom"} & {*chosen, *asked}:
        doubts.append(f"no joint states or odometry; a column map can name wheels among {shown}")
    if "odom" in chosen:
        doubts.append(f"no joint states: the wheels' velocity is that of odometry {chosen['odom']}")
    return chosen


def _stamps(rows: Sequence[Message], doubts: list[str]) -> Array:
    """Return stamps (N,) [s] since the whole second of the first.

    They stand in the messages' headers; 0 there says that it was not set. Messages without one, and those
    whose stamps stand still or tick too rarely, are taken when they arrived, less the time that the others
    usually take to arrive.
    """
    headers = [getattr(message, "header", None) for _, _, message in rows]
    stamps = [h.stamp.sec * _SECOND + h.stamp.nanosec if h is not None else 0 for h in headers]
    arrivals, places = [arrival for _, arrival, _ in rows], defaultdict[str, list[int]](list)
    for k, (topic, _, _) in enumerate(rows):
        places[topic].append(k)
    bare, faults = set[str](), defaultdict[str, list[str]](list)
    for topic in sorted(places):
        of_topic, came = ([x[k] for k in places[topic]] for x in (stamps, arrivals))
        if any(of_topic) and not _stands_still(of_topic, came):
            continue
        bare.add(topic)
        fault = "have no stamps" if not any(of_topic) else f"have {len(set(of_topic))} different stamps"
        faults[f"{len(of_topic)} messages of {{}} {fault}; the time of arrival is used"].append(topic)
    doubts += [fault.format(", ".join(of)) for fault, of in faults.items()]
    stamped = {topic: messages for topic, messages in places.items() if topic not in bare}
    stamps = _at_one_rate(stamps, arrivals, stamped, doubts)
    late = [arrivals[k] - stamps[k] for messages in stamped.values() for k in messages]
    delay = int(np.median(late)) if bare and late else 0
    for k in (k for topic in bare for k in places[topic]):
        stamps[k] = arrivals[k] - delay
    origin = min(stamps, default=0) // _SECOND
    return np.array([(stamp - origin * _SECOND) / 1e9 for stamp in stamps])


def _at_one_rate(
    stamps: Sequence[int], arrivals: Sequence[int], places: Mapping[str, Sequence[int]], doubts: list[str]
) -> list[int]:
    """Return stamps [ns], those of a topic whose clock runs unlike the others' at the rate of its arrivals.

    Where all topics run alike they have one clock, maybe that of a simulation. `places` are the messages of
    each topic that has stamps.
    """
    rates, paced = dict[str, float](), list(stamps)
    for topic, rows in places.items():
        t, arrival = (np.array([x[k] - x[rows[0]] for k in rows]) / 1e9 for x in (stamps, arrivals))
        rates[topic] = rate_by_arrival(t, arrival)
    if max(rates.values(), default=0.0) - min(rates.values(), default=0.0) < CRYSTAL:
        return paced
    for topic, rate in rates.items():
        if CRYSTAL < abs(rate) < FASTEST:
            first = stamps[places[topic][0]]
            for k in places[topic]:
                paced[k] = first + round((stamps[k] - first) * (1.0 + rate))
            way = "slow" if rate > 0 else "fast"
            seen = f"the clock of {topic} runs {100 * abs(rate):.2f} % {way} by the times of arrival"
            doubts.append(f"{seen}; corrected")
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
                part, path = _part(part, step), [*path, step]
        if part is not None and np.ndim(part) == 0:
            covariance = f"{path[0]}_covariance"
            yield name, covariance if hasattr(message, covariance) else "", partial(reduce, _part, path)


def _part(whole: Any, step: str) -> Any:
    """Return a field of a message, or an element of an array; None if there is none."""
    if step.isdigit():
        return whole[int(step)] if np.ndim(whole) and int(step) < len(whole) else None
    return getattr(whole, step, None)


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
            lacks = f"no wheel among the joints of {topic}"
            if len(columns) == 1:
                there = f"there are: {some_of(names[1:], 8)}"
                raise InputError(f"{table.path}: {lacks}", f"name them in a column map for --map; {there}")
            doubts.append(f"{table.path.name}: {lacks}; a column map can name them")
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
