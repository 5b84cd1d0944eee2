"""The file of a new robot: each number with its meaning and bounds, and what is not known as a comment."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

from granite_lab.errors import UsageError
from granite_lab.parameters.analyses import analyses, needed
from granite_lab.parameters.changes import quantities
from granite_lab.parameters.quantity import key_of, toml_line
from granite_lab.parameters.records import Chassis, Currents, Drive, Encoders, Imu, Robot, Wheels

TABLES: Mapping[str, tuple[type[Any], str]] = {
    "wheels": (Wheels, "radius: axle to ground, robot on hard floor"),
    "chassis": (Chassis, "for all simulations; inertias affect the ramps only"),
    "drive": (Drive, "for simulations by the command, and for torques from currents"),
    "imu": (Imu, "place and axes"),
    "encoders": (Encoders, "at the wheels"),
    "currents": (Currents, "sensors of the motor currents"),
}
"""Tables of a robot's file in their order: the record, and what its numbers are for."""

UNDECIDED: Mapping[str, tuple[tuple[str, object, str], ...]] = {
    "imu": (
        ("grade", "consumer", 'noise of the IMU where no standstill shows it: "industrial", "consumer"'),
        ("forward", "find", "where its axes point is not known; gravity and the wheels tell"),
        ("rotation", (0.0, 0.0, 0.0), "roll, pitch, yaw [deg] from its axes to forward, left, up"),
    )
}
"""Keys that are no numbers, as comments: an example and what it means."""


def questions(analysis: str) -> dict[str, str]:
    """Return what is to be asked for an analysis and those before it: each key of `--set` to the question.

    Raises:
        UsageError: there is no such analysis.
    """
    order = [a.id for a in analyses()]
    if analysis not in order:
        raise UsageError(f"unknown analysis '{analysis}'", f"known: {', '.join(order)}")
    wanted = analyses()[: order.index(analysis) + 1]
    keys = dict.fromkeys(f"robot.{key}" for each in wanted for key in (*each.needs, *each.expects))
    return {key: _question(**quantities()[key]) for key in keys}


def _question(*, meaning: str, unit: str, low: float, high: float, **_: str) -> str:
    return f"{meaning}{f' [{unit}]' if unit else ''} ({low:g} to {high:g})"


def text_of(name: str, given: Mapping[str, float], like: Robot | None = None) -> str:
    """Return the file of a robot.

    A table that lacks a number it needs is a comment as a whole, because it would be refused.

    Args:
        name: of the robot.
        given: numbers by the keys of `quantities`, within their bounds.
        like: a robot whose numbers stand in for those that are not given; a comment in the file names it.

    Raises:
        UsageError: the radius of the wheels is not known.
    """
    if "robot.wheels.radius_m" not in given and like is None:
        raise UsageError(
            "the radius of the wheels is needed in any case",
            "give it, as in --set robot.wheels.radius_m=0.1, or take that of another robot with --like",
        )
    lines = [
        toml_line("name", name),
        toml_line("title", name),
        'source = ""   # data sheets, who measured and when',
    ]  # fmt: skip
    for table, (record, purpose) in TABLES.items():
        rows = list(_rows(table, record, given, getattr(like, table, None), like))
        gaps = [key for key, value, _ in rows if value is None and key in needed(record)]
        lines += ["", f"# {purpose}"]
        if gaps:
            lines.append(f"# incomplete, so a comment: {', '.join(gaps)} not known")
        mark = "# " if gaps else ""
        lines.append(f"{mark}[{table}]")
        for key, value, note in rows:
            lines.append(
                f"# {key} = …   # {note}" if value is None else f"{mark}{toml_line(key, value)}   # {note}"
            )
        lines += [f"# {toml_line(key, value)}   # {note}" for key, value, note in UNDECIDED.get(table, ())]
    return "\n".join(lines) + "\n"


def _rows(
    table: str, record: type[Any], given: Mapping[str, float], other: Any, like: Robot | None
) -> Iterator[tuple[str, float | None, str]]:
    """Yield key, value and note of each number of a table; None where it is not given."""
    for field in dataclasses.fields(record):
        if "unit" not in field.metadata:
            continue
        key, m = key_of(field), field.metadata
        value, note = given.get(f"robot.{table}.{key}"), f"{m['meaning']}, {m['low']:g} to {m['high']:g}"
        if value is None and other is not None and (number := getattr(other, field.name)) != field.default:
            value, note = number, f"{note}; of {like.name if like else ''}, to be measured"
        elif value is None and field.default is not dataclasses.MISSING:
            note = f"{note}; {field.default:g} by default"
        yield key, value, note
