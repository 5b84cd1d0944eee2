"""The desired motion, a trapezoid of velocity (section 4, Table 2) or any course, and k_92 along it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import casadi as ca
import numpy as np

from granite_lab.logs.trial import Array
from granite_lab.model.symbols import ModelParameters
from granite_lab.parameters import Course, Variant, course_of, towing
from granite_lab.parameters.course import ALIKE, MOVING

V_FLOOR = 0.02
"""Velocity [m/s] below which slip and shear fade into standstill; above it the equations are exact."""


Kind = Literal["trapezoid", "path", "wheels", "sides"]
"""How a run is driven: motors follow a trapezoid or any path of velocity, or the wheels are turned, left and
right alike or each side by itself."""

TURNED: tuple[Kind, ...] = ("wheels", "sides")
"""Kinds whose wheels are turned."""

LEVEL, _ABOUT = 0.05, 0.1
"""A velocity is steady that changes by less than this share of the fastest within twice the time [s]."""


def smoothstep(s: Any) -> Any:
    """Rise from 0 to 1 over s in [0, 1] with flat ends: s^2 (3 - 2 s)."""
    s = ca.fmin(1, ca.fmax(0, s))
    return s * s * (3 - 2 * s)


def magnitude(x: Any, rounding: float) -> Any:
    """Return |x| without its corner at 0: sqrt(x^2 + rounding^2) - rounding."""
    return ca.sqrt(x**2 + rounding**2) - rounding


def relaxed(target: Any, mean: Any, speed: Any, length: Any) -> Any:
    """Return the rate of a mean over a length of travel [m] that follows a target; see `V_FLOOR` [m/s]."""
    return (target - mean) * ca.sqrt(speed**2 + V_FLOOR**2) / length


def peak_velocity(variant: Variant) -> float:
    """Return the largest desired velocity [m/s]; below v_Ru where the distance is too short for it.

    Of a trapezoid of symbols it is an expression, and so is the `duration`.
    """
    if isinstance(variant, Course):
        return variant.peak
    peak: float = ca.fmin(variant.velocity, ca.sqrt(variant.acceleration * variant.distance))
    return peak


def reference_velocity(variant: Variant) -> float:
    """Return the desired velocity [m/s] at which a k_92 of the run is stated: that of the steady part."""
    return variant.velocity if isinstance(variant, Course) else peak_velocity(variant)


def duration(variant: Variant) -> float:
    """Return the time from the start of the command to its end [s]."""
    if isinstance(variant, Course):
        return variant.end
    v = peak_velocity(variant)
    return variant.distance / v + v / variant.acceleration


def steady_interval(variant: Variant) -> tuple[float, float]:
    """Return start and end of the part with constant desired velocity [s after command start].

    Of a course it is the stretch over which slip is measured, constant or not.
    """
    if isinstance(variant, Course):
        return variant.stretch
    ramp = peak_velocity(variant) / variant.acceleration
    return ramp, duration(variant) - ramp


def corners(variant: Variant) -> tuple[float, ...]:
    """Return when the desired acceleration jumps [s after command start], in order."""
    if isinstance(variant, Course):
        return tuple(t for t, *_ in (variant.wheels or variant.path))
    t1, t2 = steady_interval(variant)
    return 0.0, t1, t2, duration(variant)


def steady_part(variant: Variant) -> tuple[float, float]:
    """Return the part over which λ_R is taken: the second half of `steady_interval` [s].

    Of a course it is the whole interval.
    """
    start, end = steady_interval(variant)
    return (start, end) if isinstance(variant, Course) else ((start + end) / 2, end)


def phase_of(t: Array, variant: Variant) -> list[str]:
    """Return the commanded phase at each t [s after command start]."""
    if isinstance(variant, Course):
        v, change = variant.velocity_at(t), variant.velocity_at(t + _ABOUT) - variant.velocity_at(t - _ABOUT)
        slow, level = v < MOVING * variant.peak, np.abs(change) < LEVEL * variant.peak
        kinds = zip(slow.tolist(), level.tolist(), (change > 0).tolist(), strict=True)
        return ["rest" if a else "steady" if b else "accelerate" if c else "brake" for a, b, c in kinds]
    t1, t2 = steady_interval(variant)
    end = duration(variant)
    return [
        "rest" if x < 0 or x > end else "accelerate" if x < t1 else "steady" if x <= t2 else "brake"
        for x in t
    ]


def kind_of(variant: Variant) -> Kind:
    """Return which of the graphs a run needs."""
    if not isinstance(variant, Course):
        return "trapezoid"
    return "path" if not variant.wheels else "sides" if variant.split else "wheels"


def velocities_at(t: Array, variant: Variant) -> Array:
    """Return v_Rd [m/s] at each t [s after command start]."""
    if isinstance(variant, Course):
        return variant.velocity_at(t)
    return np.array([float(desired_velocity(float(x), variant)) for x in t])


def path_of(variant: Variant) -> tuple[Array, Array]:
    """Return the (K,) corners [s after command start] of a desired velocity, and its values there [m/s]."""
    if isinstance(variant, Course):
        return variant.corners
    t = np.array(corners(variant))
    return t, velocities_at(t, variant)


def hauling(
    variant: Variant,
    tow: Sequence[tuple[float, float]],
    height: float,
    stretch: tuple[float, float] | None = None,
) -> Course:
    """Return a command under a towed load.

    Args:
        variant: the command; a trapezoid becomes the course that it is.
        tow: (time since the start [s], force [N]), in order; a force counts up to the end of the command.
        height: where it pulls, above the wheel centres [m].
        stretch: of a trapezoid, over which λ_R is taken; by default `steady_part`.
    """
    if not isinstance(variant, Course):
        variant = course_of(*path_of(variant), stretch or steady_part(variant))
    end = variant.end
    return towing(variant, [(min(t, end), force) for t, force in tow if t <= end or force], height)


def alike(a: Variant, b: Variant) -> bool:
    """Say whether two commands are repetitions: velocity and load differ nowhere by more than `ALIKE`."""
    t = np.linspace(0.0, max(duration(a), duration(b)), 500)
    apart = np.abs(velocities_at(t, a) - velocities_at(t, b))
    loads = [v.pull_at(t) if isinstance(v, Course) else np.zeros_like(t) for v in (a, b)]
    loaded = np.abs(loads[0] - loads[1]).max() <= ALIKE * np.max(loads)
    return bool(loaded and apart.max() <= ALIKE * max(peak_velocity(a), peak_velocity(b)))


def distances_at(t: Array, variant: Variant) -> Array:
    """Return s_Rxd [m] at each t [s after command start]."""
    if isinstance(variant, Course):
        return variant.distance_at(t)
    return np.array([float(desired_distance(float(x), variant)) for x in t])


def desired_velocity(t: Any, variant: Variant) -> Any:
    """Return v_Rd [m/s] at time t [s after command start] as an expression."""
    a, end = variant.acceleration, duration(variant)
    return ca.fmax(0, ca.fmin(peak_velocity(variant), ca.fmin(a * t, a * (end - t))))


def desired_distance(t: Any, variant: Variant) -> Any:
    """Return s_Rxd [m], the integral of `desired_velocity`, as an expression."""
    v, a, end = peak_velocity(variant), variant.acceleration, duration(variant)
    ramp = v / a
    clipped = ca.fmax(0, ca.fmin(t, end))
    rising = a * ca.fmin(clipped, ramp) ** 2 / 2
    level = v * ca.fmax(0, ca.fmin(clipped, end - ramp) - ramp)
    falling = ca.fmax(0, clipped - (end - ramp))
    return rising + level + falling * (v - a * falling / 2)


def contact_angle_ratio(v_d: Any, p: ModelParameters) -> Any:
    """Return k_92 at the desired velocity of the moment.

    The exponential law is (5). A constant k_92 (Table 3) is reached from k_92 = 1 at rest within
    V_FLOOR, because a robot that stands still has equal contact angles (below (4)).
    """
    exponential = ca.exp(-p.a_theta * v_d)
    constant = 1 + (p.k92_constant - 1) * smoothstep(v_d / V_FLOOR)
    return p.k92_is_constant * constant + (1 - p.k92_is_constant) * exponential
