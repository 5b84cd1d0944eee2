"""Trials that could be driven next, each with its reason."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from itertools import pairwise

from granite_lab.inference.conditions import PLAIN, Conditions
from granite_lab.model.command import duration, peak_velocity
from granite_lab.parameters import Variant
from granite_lab.planning.design import Design, Driven

FASTER, SLOWER = 1.25, 0.6
"""Proposed speeds over the fastest and the slowest so far: near enough for the fitted model to hold."""

SHARPER = 2.0
"""Factor of the accelerations so far."""

STEADY = 2.5
"""Time at constant speed of a proposed command [s], where the room allows it: slip is steady after 0.35 s."""

PAYLOAD = 0.2
"""Payload as a share of the robot's mass: it shows in slip and sinkage, and most robots bear it."""

RAMP = 3.0
"""Slope [deg]: a pull of 5 % of the weight, far below where sand gives way."""

LONGEST = 20.0
"""A proposed command takes no longer [s]."""


@dataclass(frozen=True)
class Option:
    """A trial that could be driven.

    Attributes:
        variant, conditions: the command, and under what it is driven.
        like: the trials at hand whose channels and noise it would have.
        why: what it adds.
        how: what to do.
        repeats: the command was driven already under these conditions.
    """

    variant: Variant
    conditions: Conditions
    like: Driven
    why: str
    how: str = "rake the sand and drive as before"
    repeats: bool = False


def options(
    design: Design, effects: Collection[str], *, room: float | None = None, max_speed: float | None = None
) -> list[Option]:
    """List the trials that are worth simulating; room and speed as in `plan_next`.

    Args:
        design: the trials at hand.
        effects: ids of all explanations; some conditions matter only to some of them.
    """
    ranked = sorted(design.driven, key=lambda d: peak_velocity(d.variant))
    slow, fast = ranked[0], ranked[-1]
    speeds = [peak_velocity(d.variant) for d in ranked]
    starts = [d.variant.acceleration for d in ranked]
    room = room or max(d.variant.distance for d in ranked)
    free, drive = math.inf, design.robot.drive
    if drive is not None:  # what the voltage allows, with a reserve for torque
        free = 0.8 * drive.voltage_max / (drive.emf_constant * drive.gear_ratio) * design.robot.wheels.radius
    top = max_speed or max(speeds[-1], min(FASTER * speeds[-1], free))
    found = [
        Option(d.variant, d.conditions, d, "averages noise and scatter of the sand", repeats=True)
        for d, v in zip(ranked, speeds, strict=True)
        if d.variant.distance <= room and v <= top
    ]

    known = {(o.variant, o.conditions) for o in found}

    def add(like: Driven, v: float, a: float, why: str, way: float = 0.0) -> None:
        """Add a command on raked, level sand if the room suffices and it is new."""
        digit = 10.0 ** (math.floor(math.log10(v)) - 1)  # speeds are rounded down, to two digits
        v, a = float(f"{math.floor(min(v, top) / digit + 1e-6) * digit:.2g}"), float(f"{a:.2g}")
        way = way or min(room, math.ceil(2 * (v * v / a + STEADY * v)) / 2)
        new = Variant(velocity=v, acceleration=a, distance=way)
        if v * v / a <= way and duration(new) <= LONGEST and (new, PLAIN) not in known:
            known.add((new, PLAIN))
            found.append(Option(new, PLAIN, like, why))

    add(slow, SLOWER * speeds[0], starts[0], "lower speed than before: sinkage and slip at slow shear")
    if top > 1.02 * speeds[-1]:
        add(fast, top, starts[-1], "higher speed than before: effects that grow with speed are larger")
    below, above = max(pairwise(speeds), key=lambda p: p[1] / p[0], default=(1.0, 1.0))
    if above > 1.2 * below:
        add(fast, math.sqrt(below * above), starts[-1], "speed between the previous ones")
    for like, v in ((slow, speeds[0]), (fast, speeds[-1])):
        add(like, v, SHARPER * max(starts), "higher acceleration than before: excites pitch, tyres and gears")
        add(like, v, min(starts) / SHARPER, "lower acceleration than before: less influence of inertia")
    if room > 1.2 * fast.variant.distance:
        add(fast, speeds[-1], starts[-1], "longer distance: effects of distance or time accumulate", room)
    plain = [o.like for o in found if o.repeats and o.conditions == PLAIN]
    for like in dict.fromkeys(plain[:1] + plain[-1:]):
        for under, why, how in _conditions(design, effects):
            if (like.variant, under) not in known:
                found.append(Option(like.variant, under, like, why, how))
    return found


def _conditions(design: Design, effects: Collection[str]) -> list[tuple[Conditions, str, str]]:
    """List conditions with why and how."""
    level = f"by {RAMP:g}°, measured with a level"
    found = [
        (Conditions(slope=RAMP), "known force against the motion: more slip, same drives",
         f"raise the far end of the box {level}"),
        (Conditions(slope=-RAMP), "known force along the motion: less slip, same drives",
         f"raise the near end of the box {level}"),
        (Conditions(wheels_up=True), "no ground contact: only the drives are measured",
         "put the robot on a block so that no wheel touches anything, and give the command"),
    ]  # fmt: skip
    if design.robot.chassis is not None:
        mass = float(f"{PAYLOAD * design.robot.chassis.total_mass:.1g}")
        why, how = (
            "more load on the wheels, same drives",
            f"fix {mass:g} kg at the centre of mass",
        )
        found.append((Conditions(payload=mass), why, how))
    if "ground_slope" in effects:
        how = "turn the robot round and drive back over ground raked as before; do not move the IMU"
        found.append((Conditions(turned=True), "slope with opposite sign, everything else unchanged", how))
    if "multi_pass" in effects:
        how = "drive once on raked sand, lift the robot back and drive again in the same rut"
        found.append((Conditions(same_rut=True), "all wheels run in compacted sand from the start", how))
    return found
