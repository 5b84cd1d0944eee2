"""Planar multi-body dynamics of the robot: equations (19)-(23).

The state holds the centre of mass in the ground frame O; the pitch Θ is positive nose down.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from granite_lab.parameters import GRAVITY, Chassis


@dataclass(frozen=True)
class BodyState:
    """Position and velocity of the centre of mass in O, and the pitch; all expressions [m, rad, s]."""

    x: Any
    z: Any
    pitch: Any
    x_rate: Any
    z_rate: Any
    pitch_rate: Any


@dataclass(frozen=True)
class PointMotion:
    """Position and velocity of a point of the body, in O [m], [m/s]."""

    x: Any
    z: Any
    x_rate: Any
    z_rate: Any


@dataclass(frozen=True)
class BodyLoad:
    """All that acts on the robot.

    Attributes:
        x, z: sum of the forces in O, without gravity [N].
        moment: about the centre of mass, positive nose down [N m].
        gravity_x, gravity_z: acceleration of gravity in O [m/s^2].
    """

    x: Any
    z: Any
    moment: Any
    gravity_x: Any = 0.0
    gravity_z: Any = -GRAVITY


@dataclass(frozen=True)
class BodyAcceleration:
    """Accelerations of the centre of mass in O [m/s^2] and of the pitch [rad/s^2]."""

    x: Any
    z: Any
    pitch: Any


def to_robot(pitch: Any, x: Any, z: Any) -> tuple[Any, Any]:
    """Turn a vector from O into R, (19)."""
    return ca.cos(pitch) * x - ca.sin(pitch) * z, ca.sin(pitch) * x + ca.cos(pitch) * z


def to_ground(pitch: Any, x: Any, z: Any) -> tuple[Any, Any]:
    """Turn a vector from R into O, the inverse of (19)."""
    return ca.cos(pitch) * x + ca.sin(pitch) * z, -ca.sin(pitch) * x + ca.cos(pitch) * z


def point(body: BodyState, chassis: Chassis, x: Any, z: Any) -> PointMotion:
    """Return the motion of the body's point at (x, z) in R."""
    dx, dz = to_ground(body.pitch, x - chassis.com_x, z - chassis.com_z)
    return PointMotion(
        body.x + dx, body.z + dz, body.x_rate + body.pitch_rate * dz, body.z_rate - body.pitch_rate * dx
    )


def ground_load(body: BodyState, chassis: Chassis, axles: list[tuple[Any, Any, Any]]) -> BodyLoad:
    """Sum the ground reactions on the wheel pairs, (20)-(22).

    Args:
        body: the state.
        chassis: masses and dimensions.
        axles: per pair the position of its axle in R [m], and F_Ax, F_Az of one wheel in O [N].
    """
    X = Z = M = 0.0
    for x_axle, F_x, F_z in axles:
        RF_x, RF_z = to_robot(body.pitch, F_x, F_z)
        X += 2 * F_x
        Z += 2 * F_z
        M += -2 * RF_x * chassis.com_z - 2 * RF_z * (x_axle - chassis.com_x)  # (22)
    return BodyLoad(X, Z, M)


def towed(load: BodyLoad, chassis: Chassis, force: Any, height: Any) -> BodyLoad:
    """Add a towed load that pulls back along the ground, `height` [m] above the wheel centres.

    The pitch is small: the lever arm is that of the level robot.
    """
    return replace(load, x=load.x - force, moment=load.moment - force * (height - chassis.com_z))


def accelerations(chassis: Chassis, load: BodyLoad) -> BodyAcceleration:
    """Return the accelerations, (20)-(22) written in O, where they need no rotation."""
    m = chassis.total_mass
    return BodyAcceleration(
        load.x / m + load.gravity_x, load.z / m + load.gravity_z, load.moment / chassis.pitch_inertia
    )


def specific_force(
    body: BodyState, acceleration: BodyAcceleration, load: BodyLoad, chassis: Chassis, x: Any, z: Any
) -> tuple[Any, Any]:
    """Return what an accelerometer at (x, z) in R reads along x and z of R [m/s^2].

    The lever arm from the centre of mass adds the terms with Θ̈ and Θ̇^2.
    """
    f_x, f_z = to_robot(body.pitch, acceleration.x - load.gravity_x, acceleration.z - load.gravity_z)
    ρ_x, ρ_z = x - chassis.com_x, z - chassis.com_z
    α, q = acceleration.pitch, body.pitch_rate
    return f_x + α * ρ_z - q**2 * ρ_x, f_z - α * ρ_x - q**2 * ρ_z
