"""Kinematics and balances (18)-(22) of the body, written for a compiler and without one.

States are numbered as in `granite_lab.hidden.model`: place, height and pitch of the centre of mass, their
rates, then angles, rates and currents of front and rear wheels.
"""

from __future__ import annotations

from math import cos, sin

import numpy as np

from granite_lab.hidden.contact import Array


def newton(
    y: Array, f_x: Array, f_z: Array, arm_x: Array, arm_z: float,
    push_x: float, push_z: float, moment: float, mass: float, inertia: float,
) -> Array:  # fmt: skip
    """Return the first twelve rates (12,), those of wheels and currents left at zero but for dθ/dt = ω.

    Args:
        y: state.
        f_x, f_z: (2,) forces of the ground on a wheel of each axle, along O's axes [N].
        arm_x, arm_z: wheel centres from the centre of mass, in R [m].
        push_x, push_z, moment: what else acts on the centre of mass [N], [N m].
        mass, inertia: of the robot [kg], [kg m^2].
    """
    dy = np.zeros(12)
    s, c = sin(y[2]), cos(y[2])
    turning = moment
    for i in range(2):
        f_rx, f_rz = c * f_x[i] - s * f_z[i], s * f_x[i] + c * f_z[i]  # (19)
        turning += 2.0 * (arm_z * f_rx - arm_x[i] * f_rz)  # (22)
        dy[6 + i] = y[8 + i]
    dy[0], dy[1], dy[2] = y[3], y[4], y[5]
    dy[3] = (2.0 * (f_x[0] + f_x[1]) + push_x) / mass  # (20) and (21), seen from O
    dy[4] = (2.0 * (f_z[0] + f_z[1]) + push_z) / mass
    dy[5] = turning / inertia
    return dy


def standing(y: Array, r: float, rolling: Array, arm_x: Array, arm_z: float) -> Array:
    """Return circumferential velocity, velocity, sinkage and its rate of both axles, (4, 2)."""
    out = np.empty((4, 2))
    s, c = sin(y[2]), cos(y[2])
    for i in range(2):
        out[0, i] = y[8 + i] * rolling[i]
        out[1, i] = c * y[3] - s * y[4] + y[5] * arm_z
        out[2, i] = r - (y[1] - s * arm_x[i] + c * arm_z)
        out[3, i] = y[5] * (c * arm_x[i] + s * arm_z) - y[4]
    return out
