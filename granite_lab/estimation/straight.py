"""Where a robot drives straight ahead: bends, turns on the spot and ways back are told by gyro and wheels.

In a bend the wheels of both sides go different ways, and slip sideways. It counts as one where the wheels of
a side are faster or slower than the robot by `SHARE`, and where it turns by more than a driver corrects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from granite_lab.logs.counters import Mask, integral, runs
from granite_lab.logs.sensors.mounting import TURN
from granite_lab.logs.sensors.standstill import MOVING, Interval, bridged, inside
from granite_lab.logs.trial import Array
from granite_lab.parameters import Robot

SHARE = 0.05
"""Share of the speed by which a side is faster or slower: a slip ratio known to so much is known
(`motion.TELLING`)."""

SMOOTH, JOINED = 0.5, 1.0
"""Time over which the yaw rate is averaged, and pause that does not part two bends [s]."""

WIDTH = 0.5
"""Distance between left and right wheels of a robot whose file does not state it [m]."""

OFF = "no slip ratio is taken over it"
"""What a warning of a course that is not straight says."""

LEAST = 2.0
"""A straight stretch that is shorter than this is not offered [s]."""


@dataclass(frozen=True, eq=False)
class Straightness:
    """Where a robot drives straight ahead, and where not.

    Attributes:
        off: (N,) True at stamps in a bend, or on the way back.
        bends: begin and end [s], and by how much the robot turns [rad].
        back: intervals in which it drives the other way than mostly [s].
        straight: intervals in which it drives straight ahead, with the standstills beside them [s].
    """

    off: Mask
    bends: tuple[tuple[Interval, float], ...] = ()
    back: tuple[Interval, ...] = ()
    straight: tuple[Interval, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warning in plain words; empty for a straight course."""
        if not self.bends and not self.back:
            return ()
        turns = [f"{a:.1f} to {b:.1f} s by {abs(np.degrees(angle)):.0f}°" for (a, b), angle in self.bends]
        back = [f"{a:.1f} to {b:.1f} s" for a, b in self.back]
        both = ("turns", turns), ("drives back", back)
        what = [f"{verb} at {_some(cases)}" for verb, cases in both if cases]
        longest = sorted(self.straight, key=lambda s: s[0] - s[1])[:3]
        offered = " or ".join(f"--from {a:.1f} --to {b:.1f}" for a, b in sorted(longest))
        where = f"straight stretches: {offered}" if offered else "no stretch of it is straight"
        return (f"the robot {' and '.join(what)}: {OFF}; {where}",)


def _some(cases: Sequence[str]) -> str:
    return ", ".join(cases[:4]) + (f" and {len(cases) - 4} times more" if len(cases) > 4 else "")


def straightness_of(
    t: Array, yaw_rate: Array, speed: Array, rests: Sequence[Interval], robot: Robot
) -> Straightness:
    """Tell where a robot drives straight ahead.

    Args:
        t: (N,) stamps [s].
        yaw_rate: (N,) without its bias, NaN where it is not known [rad/s].
        speed: (N,) of the wheels [m/s].
        rests: standstills [s].
        robot: with its track, if that is known.
    """
    size = max(round(SMOOTH / float(np.median(np.diff(t)))), 1)
    turning = uniform_filter1d(np.nan_to_num(yaw_rate), size, mode="nearest")
    pace = uniform_filter1d(np.nan_to_num(speed), size, mode="nearest")
    half = 0.5 * (robot.chassis.track if robot.chassis is not None else WIDTH)
    curved = np.abs(turning) * half > SHARE * np.maximum(np.abs(pace), MOVING)
    curved &= ~inside(t, rests)
    angle, off, bends = integral(t, np.nan_to_num(yaw_rate)), np.zeros(t.size, dtype=bool), []
    for a, b in runs(bridged(t, curved, JOINED)):
        by = float(angle[b - 1] - angle[a])
        if abs(by) > TURN:
            off[a:b] = True
            bends.append(((float(t[a]), float(t[b - 1])), by))
    ahead = 1.0 if float(integral(t, pace)[-1]) >= 0 else -1.0
    reverse = bridged(t, ahead * pace < -MOVING, JOINED)
    back = tuple((float(t[a]), float(t[b - 1])) for a, b in runs(reverse) if t[b - 1] - t[a] > SMOOTH)
    off |= reverse
    straight = [(float(t[a]), float(t[b - 1])) for a, b in runs(~off) if t[b - 1] - t[a] >= LEAST]
    driven = tuple((a, b) for a, b in straight if (np.abs(pace[(t >= a) & (t <= b)]) > MOVING).any())
    return Straightness(off, tuple(bends), back, driven)
