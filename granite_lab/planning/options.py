"""Trials that could be driven next, each with its reason."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from itertools import pairwise

from granite_lab.inference.conditions import PLAIN, Conditions
from granite_lab.model.command import duration, peak_velocity
from granite_lab.parameters import Variant
from granite_lab.planning.design import Design, Driven

FASTER, SLOWER = 1.25, 0.6
"""Proposed speeds over the fastest and the slowest so far: near enough for the fitted model to hold."""

SHARPER = 2.0
"""Factor of the accelerations so far: pitch, tyres and gears answer to the start."""

STEADY = 2.5
"""Time at constant speed of a proposed command [s], where the room allows it: slip is steady after 0.35 s."""

PAYLOAD = 0.2
"""Payload as a share of the robot's mass: slip and sinkage change visibly, and most robots bear it."""

RAMP = 3.0
"""Slope [deg]: a pull of 5 % of the weight, far below where sand gives way."""

LONGEST = 20.0
"""A proposed command takes no longer [s]."""

LEFT_OUT = (
    "driving backwards: the controller (26) drives forward only",
    "a payload off the centre of mass, another soil, turns: the model is planar, with one sand",
)
"""What is not proposed, and why."""


@dataclass(frozen=True)
class Option:
    """A trial that could be driven.

    Attributes:
        variant, conditions: the command, and under what it is driven.
        like: the trials at hand whose channels and noise it would have.
        why: what it adds.
        repeats: the command was driven already under these conditions.
    """

    variant: Variant
    conditions: Conditions
    like: Driven
    why: str
    repeats: bool = False

    @property
    def words(self) -> str:
        """Command and conditions."""
        v = self.variant
        command = f"{v.velocity:g} m/s, {v.acceleration:g} m/s², {v.distance:g} m"
        return f"{command}, {self.conditions.words}" if self.conditions.words else command

    @property
    def how(self) -> str:
        """How it is driven."""
        under = self.conditions
        if under.wheels_up:
            return "put the robot on a block so that no wheel touches anything, and give the command"
        if under.turned:
            return "turn the robot round and drive back over ground raked as before; do not move the IMU"
        if under.payload:
            return f"fix {under.payload:g} kg at the centre of mass"
        if under.slope:
            end = "far" if under.slope > 0 else "near"
            return f"raise the {end} end of the box by {abs(under.slope):g}°, measured with a level"
        if under.same_rut:
            return "drive once on raked sand, lift the robot back and drive again in the same rut"
        return "rake, and drive it like the others"


def options(
    design: Design, effects: Collection[str], *, room: float | None = None, max_speed: float | None = None
) -> list[Option]:
    """List the trials that are worth simulating.

    Args:
        design: the trials at hand.
        effects: ids of all explanations; some conditions matter only to some of them.
        room: longest way the sand allows [m]; the longest so far by default.
        max_speed: fastest command [m/s]; 1.25 times the fastest so far by default.
    """
    room = room or max(d.variant.distance for d in design.driven)
    ranked = sorted(design.driven, key=lambda d: peak_velocity(d.variant))
    slow, fast = ranked[0], ranked[-1]
    limit = max_speed or _attainable(design, FASTER * peak_velocity(fast.variant))
    found = [
        Option(d.variant, d.conditions, d, "averages noise and raking", True)
        for d in design.driven
        if d.variant.distance <= room and peak_velocity(d.variant) <= limit * (1 + 1e-9)
    ]

    def add(like: Driven, v: float, a: float, why: str, distance: float | None = None) -> None:
        """Add a command on raked, level sand if the room suffices and it is new."""
        v, a = float(f"{v:.2g}"), float(f"{a:.2g}")
        way = distance or min(room, math.ceil(2 * (v * v / a + STEADY * v)) / 2)
        new = Variant(velocity=v, acceleration=a, distance=way)
        known = any(o.variant == new and o.conditions == PLAIN for o in found)
        if not known and v * v / a <= way <= room and v <= limit * (1 + 1e-9) and duration(new) <= LONGEST:
            found.append(Option(new, PLAIN, like, why))

    v_slow, v_fast = peak_velocity(slow.variant), peak_velocity(fast.variant)
    a_slow, a_fast = slow.variant.acceleration, fast.variant.acceleration
    add(slow, min(SLOWER * v_slow, limit), a_slow, "slower than so far: sinkage and slip of slow shear")
    add(fast, min(FASTER * v_fast, limit), a_fast, "faster than so far: what grows with speed stands out")
    speeds = [peak_velocity(d.variant) for d in ranked]
    below, above = max(pairwise(speeds), key=lambda p: p[1] / p[0], default=(1, 1))
    if above > 1.2 * below:
        add(fast, math.sqrt(below * above), a_fast, "a speed between those so far")
    for like, v in ((slow, v_slow), (fast, v_fast)):
        starts = [d.variant.acceleration for d in ranked]
        add(
            like, v, SHARPER * max(starts), "a sharper start than so far: pitch, tyres and gears answer to it"
        )
        add(like, v, min(starts) / SHARPER, "a gentler start than so far: inertia matters less")
    if room > 1.2 * fast.variant.distance:
        add(fast, v_fast, a_fast, "a longer way: what goes with distance or time adds up", room)
    plain = [o for o in found if o.repeats and o.conditions == PLAIN]
    ends = dict.fromkeys(o.like for o in (plain[:1] + plain[-1:]))
    known_to = {(o.variant, o.conditions) for o in found}
    for like in ends:
        for conditions, why in _conditions(design, effects):
            if (like.variant, conditions) not in known_to:
                found.append(Option(like.variant, conditions, like, why))
    return found


def _conditions(design: Design, effects: Collection[str]) -> list[tuple[Conditions, str]]:
    """List conditions that could matter: only a slope knows directions, only a rut remembers."""
    found = [
        (replace(PLAIN, slope=RAMP), "a known pull against the way: more slip, the drives stay the same"),
        (replace(PLAIN, slope=-RAMP), "a known pull along the way: less slip, the drives stay the same"),
        (replace(PLAIN, wheels_up=True), "without ground only the drives are seen"),
    ]
    if design.robot.chassis is not None:
        mass = float(f"{PAYLOAD * design.robot.chassis.total_mass:.1g}")
        why = "more weight on the wheels, the drives stay the same"
        found.append((replace(PLAIN, payload=mass), why))
    if "ground_slope" in effects:
        found.append((replace(PLAIN, turned=True), "the slope changes its sign, everything else stays"))
    if "multi_pass" in effects:
        found.append((replace(PLAIN, same_rut=True), "all wheels run in compacted sand from the start"))
    return found


def _attainable(design: Design, speed: float) -> float:
    """Return a speed, or less where the motors' voltage would not suffice."""
    drive = design.robot.drive
    if drive is None:
        return speed
    free = drive.voltage_max / (drive.emf_constant * drive.gear_ratio) * design.robot.wheels.radius
    return max(min(speed, 0.8 * free), *(peak_velocity(d.variant) for d in design.driven))
