"""Trials that could be driven next."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from granite_lab.discovery.plan_conditions import Conditions
from granite_lab.discovery.plan_design import Design, Driven
from granite_lab.model.command import duration, peak_velocity
from granite_lab.parameters import Variant

ACCELERATIONS = (0.6, 2.4, 4.8)
"""Of the proposed commands [m/s^2]."""

FASTER = 1.25
"""A proposed speed is at most this times the fastest so far, unless another limit is given."""

STEADY = 2.5
"""Time at constant speed that a proposed command has where the room allows it [s]."""

PAYLOAD, RAMP = 5.0, 3.0
"""Payload [kg] and slope [deg] that are proposed."""

LONGEST = 20.0
"""A proposed command takes no longer [s]."""

LEFT_OUT = (
    "driving backwards: the controller (26) drives forward only, and so do the logs that can be read",
    "a payload off the centre of mass, other soils and turns: the model is planar, with one sand",
)
"""What cannot be simulated honestly, and why."""


@dataclass(frozen=True)
class Option:
    """A trial that could be driven.

    Attributes:
        variant: the command.
        conditions: under which.
        like: the trials whose channels and noise it would have.
        repeats: the command was driven already.
    """

    variant: Variant
    conditions: Conditions
    like: Driven
    repeats: bool


def options(
    design: Design, rivals: Sequence[str], *, room: float | None = None, max_speed: float | None = None
) -> list[Option]:
    """List what is worth simulating.

    Args:
        design: what was driven.
        rivals: ids of the explanations; some conditions matter only to some of them.
        room: longest way the sand allows [m]; the longest so far by default.
        max_speed: fastest command [m/s].
    """
    room = room or max(d.variant.distance for d in design.driven)
    fastest = max(peak_velocity(d.variant) for d in design.driven)
    limit = max_speed or _top(design, FASTER * fastest)
    found = [Option(d.variant, d.conditions, d, True) for d in design.driven if d.variant.distance <= room]
    known = {o.variant for o in found if o.conditions == Conditions()}
    speeds = {0.2, 0.35, 0.5, 0.7, round(fastest, 2), math.floor(limit * 20) / 20}
    for v in sorted(s for s in speeds if s <= limit + 1e-9):
        for a in ACCELERATIONS:
            for d in _ways(v, a, room):
                variant = Variant(velocity=v, acceleration=a, distance=d)
                if variant not in known and duration(variant) <= LONGEST:
                    found.append(Option(variant, Conditions(), nearest(design, v), False))
    plain = [d for d in design.driven if d.conditions == Conditions()] or list(design.driven)
    slow = min(plain, key=lambda d: peak_velocity(d.variant))
    fast = max(plain, key=lambda d: peak_velocity(d.variant))
    for like in dict.fromkeys(d.variant for d in (slow, fast)):
        own = next(d for d in plain if d.variant == like)
        if like.distance <= room:
            driven = {o.conditions for o in found if o.repeats and o.variant == like}
            found += [Option(like, c, own, False) for c in conditions(rivals) if c not in driven]
    return found


def conditions(rivals: Sequence[str]) -> list[Conditions]:
    """List the conditions that could matter: only a slope knows directions, only a rut remembers."""
    found = [
        Conditions(payload=PAYLOAD),
        Conditions(slope=RAMP),
        Conditions(slope=-RAMP),
        Conditions(wheels_up=True),
    ]
    if "ground_slope" in rivals:
        found.append(Conditions(turned=True))
    if "multi_pass" in rivals:
        found.append(Conditions(same_rut=True))
    return found


def nearest(design: Design, speed: float) -> Driven:
    """Return the trials that were driven at the nearest speed."""
    return min(design.driven, key=lambda d: abs(math.log(peak_velocity(d.variant) / speed)))


def _ways(v: float, a: float, room: float) -> list[float]:
    """Return distances: one with some time at constant speed, and the whole room."""
    least = v * v / a
    if least > room:
        return []
    some = min(room, math.ceil(2 * (least + STEADY * v)) / 2)
    return sorted({some, room} if a == ACCELERATIONS[1] else {some})


def _top(design: Design, speed: float) -> float:
    """Return the speed, or less where the motors' voltage would not suffice."""
    drive = design.robot.drive
    if drive is None:
        return speed
    free = drive.voltage_max / (drive.emf_constant * drive.gear_ratio) * design.robot.wheels.radius
    return min(speed, 0.8 * free)
