"""The paper's method: (1)-(26) with fixed-step Runge-Kutta of fourth order at 0.05 ms, compiled.

Section 4 of the paper names the solver and the step. The equations are written down once more
here, in scalar loops that numba compiles and in the axes of the robot, so that this is also a
third implementation to hold the others against.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
import numpy.typing as npt
from scipy.optimize import fsolve

from granite_lab.parameters import GRAVITY, Robot, Soil, Variant

Array = npt.NDArray[np.float64]

STEP, STRIDE = 5e-5, 100
"""The paper's time step [s], and how many of them lie between two states that are returned."""

V_FLOOR = 0.02
"""Velocity [m/s] below which slip and shear displacement fade to standstill."""

STATES = ("x", "z", "pitch", "u", "w", "q", "theta_f", "theta_r", "omega_f", "omega_r", "i_f", "i_r")
"""Centre of mass in O, pitch, velocity of the centre of mass in R, pitch rate, wheels, rotor currents."""

NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)

compiled: Any = numba.njit(cache=False)


@dataclass(frozen=True, eq=False)
class Trace:
    """What the fixed-step method computed: `t` (N,), states (N, 12) in the order of STATES, `v` (N,) of R."""

    t: Array
    state: Array
    v: Array


@compiled
def _step3(s):  # type: ignore[no-untyped-def]
    s = min(1.0, max(0.0, s))
    return s * s * (3.0 - 2.0 * s)


@compiled
def _wheel(p, z0, dz0, v_o, v, k92):  # type: ignore[no-untyped-def]
    """Return F_x, F_z in O and M of one wheel, (6)-(18)."""
    r, b, k, n, c, tan_phi, K, mu, c_t = p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8]
    if z0 <= 0.0:
        return 0.0, 0.0, 0.0
    fastest = max(abs(v_o), abs(v))
    slip = (v_o - v) / max(fastest, V_FLOOR)
    fade = _step3(fastest / V_FLOOR)
    front = math.acos(1.0 - z0 / r)
    half, middle = 0.5 * (1.0 + k92) * front, 0.5 * (1.0 - k92) * front
    sin_front = math.sin(front)
    load, resistance, thrust, moment = 0.0, 0.0, 0.0, 0.0
    for m in range(NODES.size):
        a = middle + half * NODES[m]
        sin_a, cos_a = math.sin(a), math.cos(a)
        depth = z0 - r * (1.0 - cos_a)
        if depth <= 0.0:
            continue
        sigma = k * depth**n
        reach = sin_front - sin_a
        j = r * (fade * (front - a - reach) + slip * reach)
        tau = min(mu * sigma, c + sigma * tan_phi) * (1.0 - math.exp(-abs(j) / K))
        if j < 0.0:
            tau = -tau
        weight = WEIGHTS[m]
        load += weight * (sigma * cos_a + tau * sin_a)
        resistance -= weight * sigma * sin_a
        thrust += weight * tau * cos_a
        moment -= weight * tau
    area = half * b * r
    return area * (thrust + resistance), max(area * load + c_t * dz0, 0.0), area * r * moment


@compiled
def _command(t, v_u, a, distance):  # type: ignore[no-untyped-def]
    """Return s_d and v_d of the trapezoid."""
    ramp = v_u / a
    end = distance / v_u + ramp
    if t <= 0.0:
        return 0.0, 0.0
    if t < ramp:
        return 0.5 * a * t * t, a * t
    if t < end - ramp:
        return v_u * (t - 0.5 * ramp), v_u
    if t < end:
        return distance - 0.5 * a * (end - t) ** 2, a * (end - t)
    return distance, 0.0


@compiled
def _rates(t, y, p, out):  # type: ignore[no-untyped-def]
    """Write dy/dt into `out`."""
    r = p[0]
    mass, inertia, arm_f, arm_r, down, wheel_inertia = p[9], p[10], p[11], p[12], p[13], p[14]
    L_d, R_d, k_e, k_m, n_d, eta = p[15], p[16], p[17], p[18], p[19], p[20]
    k_p, k_d, u_min, u_max = p[21], p[22], p[23], p[24]
    s_d, v_d = _command(t, p[25], p[26], p[27])
    k92 = math.exp(-p[28] * v_d) if p[29] > 0.5 else 1.0 + (p[28] - 1.0) * _step3(v_d / V_FLOOR)
    s, c = math.sin(y[2]), math.cos(y[2])
    u, w, q = y[3], y[4], y[5]
    v = u - down * q  # along x, the same for both wheel centres
    force_x, force_z, turn = 0.0, 0.0, 0.0
    for axle in range(2):
        arm = arm_f if axle == 0 else arm_r
        rising = w - arm * q  # of the wheel centre, along R's z
        z0 = r - (y[1] - s * arm - c * down)
        dz0 = s * v - c * rising
        f_x, f_z, moment = _wheel(p, z0, dz0, y[8 + axle] * r, v, k92)
        f_rx, f_rz = c * f_x - s * f_z, s * f_x + c * f_z  # (19)
        force_x += 2.0 * f_rx
        force_z += 2.0 * f_rz
        turn -= 2.0 * (f_rx * down + f_rz * arm)  # (22)
        omega, current = y[8 + axle], y[10 + axle]
        voltage = k_p * (s_d / r - y[6 + axle]) + k_d * (v_d / r - omega)
        voltage = min(u_max, max(u_min, voltage))
        out[6 + axle] = omega
        out[8 + axle] = (eta * n_d * k_m * current + moment) / wheel_inertia  # (23)
        out[10 + axle] = (voltage - k_e * n_d * omega - R_d * current) / L_d  # (24)
    out[0], out[1], out[2] = c * u + s * w, c * w - s * u, q
    out[3] = force_x / mass + GRAVITY * s - q * w  # (20), the axes turn with the robot
    out[4] = force_z / mass - GRAVITY * c + q * u  # (21)
    out[5] = turn / inertia


@compiled
def _integrate(y, p, begin, steps):  # type: ignore[no-untyped-def]
    """Return every `STRIDE`-th state of `steps` Runge-Kutta steps."""
    kept = np.empty((steps // STRIDE + 1, y.size))
    kept[0] = y
    k1, k2, k3, k4 = np.empty(y.size), np.empty(y.size), np.empty(y.size), np.empty(y.size)
    for n in range(steps):
        t = begin + n * STEP
        _rates(t, y, p, k1)
        _rates(t + 0.5 * STEP, y + 0.5 * STEP * k1, p, k2)
        _rates(t + 0.5 * STEP, y + 0.5 * STEP * k2, p, k3)
        _rates(t + STEP, y + STEP * k3, p, k4)
        y = y + STEP / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        if (n + 1) % STRIDE == 0:
            kept[(n + 1) // STRIDE] = y
    return kept


def parameters(
    variant: Variant, robot: Robot, soil: Soil, *, k92: float | None = None, a_theta: float | None = None
) -> Array:
    """Return the numbers of the model in the order the compiled code expects.

    Raises:
        ValueError: chassis or drive is missing, or not exactly one of k92 and a_theta is given.
    """
    ch, d = robot.chassis, robot.drive
    if ch is None or d is None or (k92 is None) == (a_theta is None):
        raise ValueError("a robot with chassis and drive, and either k92 or a_theta, are needed")
    b = robot.wheels.width
    law = (a_theta, 1.0) if a_theta is not None else (k92, 0.0)
    ground = (
        robot.wheels.radius, b, soil.cohesive_modulus / b + soil.frictional_modulus, soil.exponent,
        soil.cohesion, math.tan(math.radians(soil.friction_angle)), soil.shear_modulus, soil.tyre_friction,
        ch.contact_damping,
    )  # fmt: skip
    body = (
        ch.total_mass, ch.pitch_inertia, 0.5 * ch.wheel_base - ch.com_x, -0.5 * ch.wheel_base - ch.com_x,
        ch.com_z, ch.wheel_inertia,
    )  # fmt: skip
    drive = (
        d.inductance, d.resistance, d.emf_constant, d.torque_constant, d.gear_ratio, d.gear_efficiency,
        d.gain_p, d.gain_d, d.voltage_min, d.voltage_max,
    )  # fmt: skip
    motion = (variant.velocity, variant.acceleration, variant.distance)
    return np.array([*ground, *body, *drive, *motion, *law], dtype=float)


def rest(p: Array) -> Array:
    """Return the state of equilibrium at standstill, R at x = 0."""

    def unbalanced(u: Array) -> Array:
        y, rates = np.zeros(len(STATES)), np.empty(len(STATES))
        y[1], y[2] = u
        _rates(-1.0, y, p, rates)
        return rates[4:6]

    r, up = p[0], p[13]
    z, pitch = fsolve(unbalanced, [r + up - 0.01, 0.0], xtol=1e-13)
    y = np.zeros(len(STATES))
    y[:3] = -0.5 * (p[11] + p[12]) * math.cos(pitch) + up * math.sin(pitch), z, pitch
    return y


def simulate(
    variant: Variant,
    robot: Robot,
    soil: Soil,
    *,
    k92: float | None = None,
    a_theta: float | None = None,
    settle: float = 1.0,
    after: float = 1.0,
) -> Trace:
    """Run one motion from rest.

    Args:
        variant: the trapezoid.
        robot: with chassis and drive.
        soil: the ground.
        k92, a_theta: exactly one of them.
        settle, after: time before the command and after its end [s].

    Raises:
        ValueError: see `parameters`.
    """
    p = parameters(variant, robot, soil, k92=k92, a_theta=a_theta)
    end = variant.distance / variant.velocity + variant.velocity / variant.acceleration
    y = rest(p)
    steps = STRIDE * math.ceil((settle + after + end) / (STEP * STRIDE))
    state = _integrate(y, p, -settle, steps)
    t = -settle + STEP * STRIDE * np.arange(state.shape[0])
    return Trace(t, state, state[:, 3] - p[13] * state[:, 5])
