"""A command whose start or course is not stated: by how much it leads the wheels that it turned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from granite_lab.logs.trial import Array
from granite_lab.model.command import kind_of
from granite_lab.model.pieces import NUMBERS, numbers_at, spin, turnings
from granite_lab.parameters import Course, Robot, Variant

LASTING = 1 / 3
"""Time over which the error of a loop on the angle of a wheel comes and goes [s], where the robot's file
states no such loop: k_D/k_P of (26), of the paper's robot."""

LEADS = ("lead", "lasting lead")
"""Times by which v_d leads the wheels [s]: of the acceleration at once, as in a loop on the speed, and of the
acceleration low-passed by k_D/k_P, as in a loop on the angle, too. A stated command of which the wheels alone
tell the start has the first one: they follow it late, so that it was given earlier."""


def is_free(variant: Variant) -> bool:
    """Say whether the wheels are turned and the command is not stated."""
    return isinstance(variant, Course) and bool(variant.wheels) and not variant.commanded


def count_of(variant: Variant) -> int:
    """Return how many of `LEADS` change a run."""
    if is_free(variant):
        return len(LEADS)
    return int(isinstance(variant, Course) and bool(variant.wheels) and not variant.stamped)


def led(variant: Variant, leads: Sequence[float], robot: Robot) -> Variant:
    """Return a course whose desired velocity leads its wheels; a command of known start stays as it is.

    A loop on the speed with a gain leaves an error that is proportional to the acceleration. One that holds
    the angle, too, takes it away: for wheels whose voltage goes by the EMF (24), (26) give

        v_d - v_o = k_e n_d / k_P · (acceleration, low-passed by k_D / k_P).

    Args:
        variant: any; returned as it is where no lead changes its runs, see `count_of`.
        leads: times by `LEADS` [s].
        robot: whose wheels turn.
    """
    count = count_of(variant)
    if not any(leads[:count]):
        return variant
    assert isinstance(variant, Course)
    if not is_free(variant):
        return _earlier(variant, leads[0])
    t, ahead = _ahead(variant, robot.wheels.radius, lasting_of(robot))
    v = variant.velocity_at(t) + np.asarray(leads) @ ahead
    v[[0, -1]] = 0.0
    return replace(variant, path=tuple(zip(t.tolist(), v.tolist(), strict=True)))


def _earlier(course: Course, lead: float) -> Course:
    """Return a course whose command begins earlier [s]; its wheels turn, and it ends, as they did."""
    t, v = course.corners
    known = [instant for instant, *_ in course.wheels]
    at = np.clip(t - lead, known[0], course.end)
    # between two instants lies one cubic, so that more of them change nothing; behind them the wheels stand
    fresh = np.setdiff1d(at[at < known[-1]], known)
    path = list(zip(at.tolist(), v.tolist(), strict=True))
    if at[-1] < course.end:
        path.append((course.end, float(v[-1])))
    numbers = dict(zip(NUMBERS[kind_of(course)], numbers_at(fresh, course), strict=True))
    sides = ("split_f", "split_r") if course.split else ()
    spun = (spin(fresh, numbers, axle) for axle in ("f", "r", *sides))
    front, rear, *apart = (turnings(s.angle, s.rate, s.acceleration) for s in spun)
    order = np.argsort([*known, *fresh]).tolist()
    wheels = [*course.wheels, *zip(fresh.tolist(), front, rear, strict=True)]
    split = [*course.split, *zip(*apart, strict=True)]
    return replace(
        course, path=tuple(path), wheels=tuple(wheels[k] for k in order),
        split=tuple(split[k] for k in order) if split else (),
    )  # fmt: skip


def lasting_of(robot: Robot) -> float:
    """Return k_D/k_P of the robot's file [s], or `LASTING`."""
    drive = robot.drive
    return drive.gain_d / drive.gain_p if drive and drive.gain_p > 0 and drive.gain_d > 0 else LASTING


@lru_cache(maxsize=64)
def _ahead(course: Course, radius: float, lasting: float) -> tuple[Array, Array]:
    """Return the (K,) instants of the wheels [s], and (2, K) their acceleration there, by `LEADS` [m/s^2].

    The second one is low-passed by the time `lasting` [s].
    """
    t = np.array([instant for instant, *_ in course.wheels])
    a = radius * np.array([(front.acceleration + rear.acceleration) / 2 for _, front, rear in course.wheels])
    slow = np.zeros_like(a)
    for k in range(1, t.size):  # exact for an acceleration that is linear between the instants
        rise = lasting * (a[k] - a[k - 1]) / (t[k] - t[k - 1])
        slow[k] = a[k] - rise + (slow[k - 1] - a[k - 1] + rise) * np.exp(-(t[k] - t[k - 1]) / lasting)
    return t, np.stack([a, slow])
