"""A motion that is no trapezoid: any desired velocity, and wheels that turn as they were measured to."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from granite_lab.parameters.records import Variant

Array = npt.NDArray[np.float64]

DriveBy = Literal["auto", "wheels", "command"]
"""What drives the simulation of a trial: its wheels as they were measured, its command, or, by "auto", the
command where it is stated and the wheels follow it, else the wheels."""

ALIKE = 0.02
"""Commands whose velocities differ nowhere by more than this share of the fastest are repetitions."""

ENOUGH = 0.001
"""A path passes this close to the points that it leaves out [m/s]: a tenth of what wheels are known to."""

MOVING = 0.05
"""Slower than this share of its fastest velocity a command is about to start or to stop."""


@dataclass(frozen=True, kw_only=True)
class Turning:
    """How one axle turns at one instant: angle θ [rad], rate ω [rad/s] and acceleration [rad/s^2]."""

    angle: float
    rate: float
    acceleration: float


@dataclass(frozen=True, kw_only=True)
class Course(Variant):
    """A desired velocity that is linear between instants; where `wheels` are given they turn, unasked.

    `velocity` is the mean over `stretch`, each velocity weighted by the way that it takes, to three digits;
    `acceleration` the largest; `distance` the whole.

    Attributes:
        path: (time since the start [s], desired velocity [m/s]) of each corner, in order.
        stretch: begin and end of the part over which λ_R is taken [s since the start].
        wheels: (time since the start [s], front, rear) of the wheels, means of left and right; between them
            ω is a cubic.
        split: at the same instants (front, rear) half of what the right wheel turns more than the left one;
            empty where the sides turn alike.
        commanded: False where the desired velocity is that of the wheels, because no other is stated.
        stamped: False where only the wheels show when a command that they follow was given.
        tow: (time since the start [s], force [N], height [m]) with which a load pulls back while the robot
            drives, linear between, none before and after; the height is that above the wheel centres, the
            same at all times. Its times are among the corners.
    """

    path: tuple[tuple[float, float], ...]
    stretch: tuple[float, float]
    wheels: tuple[tuple[float, Turning, Turning], ...] = ()
    split: tuple[tuple[Turning, Turning], ...] = ()
    commanded: bool = True
    stamped: bool = True
    tow: tuple[tuple[float, float, float], ...] = ()

    def __hash__(self) -> int:
        """Return the hash, which is made once: each simulation asks for it several times."""
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash((self.path, self.stretch, self.wheels, self.split, self.tow))

    @cached_property
    def corners(self) -> tuple[Array, Array]:
        """(K,) times [s] and velocities [m/s] of the path."""
        t, v = np.array(self.path).T
        return t, v

    @cached_property
    def peak(self) -> float:
        """Largest desired velocity [m/s]."""
        return float(self.corners[1].max())

    @property
    def end(self) -> float:
        """When command and wheels have ended [s since the start]."""
        return max(self.path[-1][0], self.wheels[-1][0] if self.wheels else 0.0)

    def velocity_at(self, t: Array | float) -> Array:
        """Return v_d [m/s] at times [s since the start]; 0 before and after."""
        return np.asarray(np.interp(t, *self.corners, left=0.0, right=0.0))

    def pull_at(self, t: Array) -> Array:
        """Return the force of the towed load [N] at times [s since the start]."""
        if not self.tow:
            return np.zeros_like(t)
        times, forces, _ = np.array(self.tow).T
        return np.asarray(np.interp(t, times, forces, left=0.0, right=0.0))

    @property
    def hitch(self) -> float:
        """Where a towed load pulls, above the wheel centres [m]."""
        return self.tow[0][2] if self.tow else 0.0

    def distance_at(self, t: Array | float) -> Array:
        """Return s_d [m] at times [s since the start]."""
        corners, v = self.corners
        way = _way(corners, v)
        t = np.clip(t, corners[0], corners[-1])
        k = np.clip(np.searchsorted(corners, t, side="right") - 1, 0, corners.size - 2)
        return np.asarray(way[k] + (t - corners[k]) * (v[k] + np.interp(t, corners, v)) / 2)


def course_of(t: Array, v: Array, stretch: tuple[float, float] | None = None) -> Course:
    """Return the course of (N,) desired velocities [m/s] at instants [s since the start].

    Velocities that lie on a line through their neighbours, within `ENOUGH`, are left out.

    Args:
        t, v: two or more, t increasing.
        stretch: over which λ_R is taken; by default all of it that moves.
    """
    keep = corners_of(t, v, ENOUGH)
    if stretch is None:
        moving = np.flatnonzero(v > MOVING * v.max())
        stretch = float(t[moving[0]]), float(t[moving[-1]])
    fine = np.linspace(*stretch, 1000)
    speed = np.interp(fine, t, v)
    slopes = np.abs(np.diff(v[keep]) / np.diff(t[keep]))
    gained = float(np.trapezoid(speed, fine))
    mean = float(np.trapezoid(speed**2, fine)) / gained if gained > 0 else float(v.max())
    return Course(
        velocity=float(f"{mean:.3g}"),  # repetitions have one
        acceleration=max(float(slopes.max()), 1e-3),
        distance=float(_way(t, v)[-1]),
        path=tuple(zip(t[keep].tolist(), v[keep].tolist(), strict=True)),
        stretch=stretch,
    )


def towing(course: Course, tow: Sequence[tuple[float, float]], hitch: float) -> Course:
    """Return a course with a towed load, whose corners become corners of the course.

    Args:
        course: without one.
        tow: (time since the start [s], force [N]), in order.
        hitch: where it pulls, above the wheel centres [m].
    """
    corners, _ = course.corners
    inside = [t for t, _ in tow if corners[0] < t < corners[-1]]
    times = np.unique(np.concatenate([corners, inside]))
    path = tuple(zip(times.tolist(), course.velocity_at(times).tolist(), strict=True))
    return replace(course, path=path, tow=tuple((t, force, hitch) for t, force in tow))


def _way(t: Array, v: Array) -> Array:
    """Return (N,) how far velocities [m/s] have led at instants t [s], the integral of lines between them."""
    return np.concatenate([[0.0], np.cumsum(np.diff(t) * (v[1:] + v[:-1]) / 2)])


def corners_of(t: Array, v: Array, within: float) -> npt.NDArray[np.int64]:
    """Return which points of a line through (N,) points suffice to pass all of them `within` its unit.

    The method is Douglas and Peucker's (Cartographica 10, 1973, 112-122), along v.
    """
    keep, todo = {0, t.size - 1}, [(0, t.size - 1)]
    while todo:
        a, b = todo.pop()
        if b - a < 2:
            continue
        line = v[a] + (v[b] - v[a]) * (t[a : b + 1] - t[a]) / (t[b] - t[a])
        off = np.abs(v[a : b + 1] - line)
        worst = a + int(np.argmax(off))
        if off[worst - a] > within:
            keep.add(worst)
            todo += [(a, worst), (worst, b)]
    return np.array(sorted(keep))


def is_driven(variant: Variant) -> bool:
    """Say whether the wheels are turned, so that no motor drives them."""
    return isinstance(variant, Course) and bool(variant.wheels)


def parse_path(text: str) -> tuple[tuple[float, float], ...]:
    """Return (time [s], velocity [m/s]) of a text as ``0:0, 1:0.3, 5:0.3, 6:0``.

    Raises:
        ValueError: it is none, or its times do not increase.
    """
    pairs = [part.split(":") for part in text.replace(",", " ").split()]
    path = tuple((float(t), float(v)) for t, v in pairs)
    later = all(a[0] < b[0] for a, b in itertools.pairwise(path))
    if len(path) < 2 or not later or not all(math.isfinite(v) for _, v in path):
        raise ValueError(text)
    return path
