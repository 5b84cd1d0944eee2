"""A course between its corners: the numbers of each piece, and what they give as expressions of time.

The graph holds symbols for the numbers of one piece; a run gives them new values from each corner on.
"""

from __future__ import annotations

import itertools
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from granite_lab.logs.trial import Array
from granite_lab.model.command import Kind
from granite_lab.parameters import Course, Turning, Variant

_NAMES = ("begin", "velocity", "slope", "distance", "pull", "pull_slope", "hitch")
_AXLE = ("angle", "rate", "linear", "square", "cube")
NUMBERS: dict[Kind, tuple[str, ...]] = {
    "trapezoid": (),
    "path": _NAMES,
    "wheels": (*_NAMES, *(f"{name}_{axle}" for axle in "fr" for name in _AXLE)),
    "sides": (*_NAMES, *(f"{name}_{axle}" for axle in ("f", "r", "split_f", "split_r") for name in _AXLE)),
}
"""Names of the numbers of a piece: its begin [s], v_d = velocity + slope τ [m/s], s_d [m] there; force of a
towed load = pull + pull_slope τ [N] and the height at which it pulls [m]; of each axle θ [rad] there and
ω = rate + linear τ + square τ² + cube τ³ [rad/s], τ the time since the begin; the same of half the difference
of its right and its left wheel."""


def desired(t: Any, u: dict[str, Any]) -> tuple[Any, Any]:
    """Return v_d [m/s] and s_d [m] of a piece at time t."""
    τ = t - u["begin"]
    return u["velocity"] + u["slope"] * τ, u["distance"] + τ * (u["velocity"] + u["slope"] * τ / 2)


def pulled(t: Any, u: dict[str, Any]) -> tuple[Any, Any]:
    """Return force [N] and height [m] of a towed load in a piece at time t."""
    return u["pull"] + u["pull_slope"] * (t - u["begin"]), u["hitch"]


def spin(t: Any, u: dict[str, Any], axle: str) -> Turning:
    """Return how an axle, "f" or "r", turns at time t of a piece; "split_f": half of how its sides differ."""
    τ = t - u["begin"]
    angle, rate, a, b, c = (u[f"{name}_{axle}"] for name in _AXLE)
    return Turning(
        angle=angle + τ * (rate + τ * (a / 2 + τ * (b / 3 + τ * c / 4))),
        rate=rate + τ * (a + τ * (b + τ * c)),
        acceleration=a + τ * (2 * b + τ * 3 * c),
    )


def turnings(angle: Any, rate: Any, acceleration: Any) -> list[Turning]:
    """Return how an axle turns at each of some instants, given as (K,) arrays [rad], [rad/s], [rad/s^2]."""
    rows = zip(angle.tolist(), rate.tolist(), acceleration.tolist(), strict=True)
    return [Turning(angle=a, rate=b, acceleration=c) for a, b, c in rows]


def symbols_of_piece(kind: Kind) -> tuple[Any, dict[str, Any]]:
    """Return the symbols of a piece as one column, and each by its name."""
    u = ca.SX.sym("u", len(NUMBERS[kind]))
    return u, dict(zip(NUMBERS[kind], ca.vertsplit(u) if NUMBERS[kind] else (), strict=True))


@lru_cache(maxsize=64)
def pieces(variant: Variant) -> tuple[Array, Array]:
    """Return the (K,) corners of a course [s], and (K + 1, U) numbers of the pieces about them.

    Before the first corner and after the last one the robot is to stand. Of a trapezoid there are none.
    """
    if not isinstance(variant, Course):
        return np.zeros(0), np.zeros((1, 0))
    corners = np.array([t for t, *_ in variant.wheels]) if variant.wheels else variant.corners[0]
    v, s = np.interp(corners, *variant.corners), variant.distance_at(corners)
    pull, hitch = variant.pull_at(corners), variant.hitch
    rows = [np.zeros(len(_NAMES))]
    for k in range(corners.size - 1):
        h = corners[k + 1] - corners[k]
        slope, pull_slope = (v[k + 1] - v[k]) / h, (pull[k + 1] - pull[k]) / h
        rows.append(np.array([corners[k], v[k], slope, s[k], pull[k], pull_slope, hitch]))
    rows.append(np.array([corners[-1], 0.0, 0.0, s[-1], 0.0, 0.0, hitch]))
    if variant.wheels:
        rows = [np.concatenate([row, turning]) for row, turning in zip(rows, _turnings(variant), strict=True)]
    return corners, np.array(rows)


def _turnings(course: Course) -> list[Array]:
    """Return the numbers of the wheels, for each piece."""
    splits = course.split or ((),) * len(course.wheels)
    instants = [(t, (*axles, *split)) for (t, *axles), split in zip(course.wheels, splits, strict=True)]
    rest = [
        np.array([angle for axle in axles for angle in (axle.angle, 0, 0, 0, 0)])
        for _, axles in (instants[0], instants[-1])
    ]
    turnings = [rest[0]]
    for (t0, here), (t1, there) in itertools.pairwise(instants):
        turnings.append(np.concatenate([_cubic(a, b, t1 - t0) for a, b in zip(here, there, strict=True)]))
    return [*turnings, rest[1]]


def _cubic(a: Turning, b: Turning, h: float) -> Array:
    """Return angle, rate and the three coefficients of Hermite's cubic between two instants h [s] apart."""
    rise = (b.rate - a.rate) / h
    square = (3 * rise - 2 * a.acceleration - b.acceleration) / h
    cube = (a.acceleration + b.acceleration - 2 * rise) / h**2
    return np.array([a.angle, a.rate, a.acceleration, square, cube])


def numbers_at(t: Array, variant: Variant) -> Array:
    """Return the (U, N) numbers of the piece at each of (N,) instants [s]."""
    corners, table = pieces(variant)
    return np.ascontiguousarray(table[np.searchsorted(corners, t, side="right")].T)
