"""Runs of the truth's model with all their signals, and forces on one wheel as the paper prints them."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.integrate import quad
from scipy.interpolate import CubicSpline

from granite_lab.hidden.command import trapezoid
from granite_lab.hidden.contact import V_FLOOR, Array, Contact, smoothstep
from granite_lab.hidden.model import ANGLE, CURRENT, OMEGA, PITCH, VX, VZ, Q, Setup, Truth, X
from granite_lab.hidden.parts import Law, exponential_k92
from granite_lab.hidden.simulator import DT, Body, body_from_states, solve
from granite_lab.parameters import Robot, Soil, Variant, Wheels, load_robot, load_soil

SPACING = 0.005
"""Of the samples of a run [s]."""


def interpolated(at: Array | float, t: Array, signal: Array) -> Array:
    """Return a signal (N,) or (N, K) at instants, linear between samples."""
    columns = np.reshape(signal, (t.size, -1)).T
    found = np.stack([np.interp(at, t, column) for column in columns], axis=-1)
    return np.asarray(found[..., 0] if np.ndim(signal) == 1 else found)


class Result(SimpleNamespace):
    """Signals of one run at `t` (N,), SI units; (N, 2) where front and rear differ.

    Attributes:
        truth: what was integrated.
        state: (N, 12) or wider, in the order of `granite_lab.hidden.model`.
        x: position of R along O; v: its velocity along R's x.
        pitch, pitch_rate, pitch_acceleration: of the body; acceleration: (N, 2) of R along R's x and z.
        slip, sinkage, W, R, F, M, normal: as in `granite_lab.hidden.contact.Contact`; k92: in force.
        v_o, omega, angle, rolled: motion of the wheels, rolled the integral of v_o; v_wheel: (N, 2, 2)
            velocity of the wheel centres along O's x and z; read_rate: that the encoders tell.
        current, voltage, torque: of the drives.
        v_d, s_d: desired velocity and distance.
    """

    def at(self, t: float, name: str) -> Array:
        """Return a signal at an instant, linear between samples."""
        return interpolated(t, self.t, getattr(self, name))

    def slip_ratio(self, start: float, stop: float) -> float:
        """Return λ_R (2) between two instants; the desired distance is the mean of what the wheels rolled."""
        travelled = self.at(stop, "x") - self.at(start, "x")
        return float(1.0 - travelled / (self.at(stop, "rolled") - self.at(start, "rolled")).mean())


def integrate(truth: Truth, t: Array, *, rtol: float = 1e-7, atol: float = 1e-9) -> Result:
    """Integrate from rest at the first instant and return the signals at `t` (N,), increasing."""
    state = solve(truth, t, rtol=rtol, atol=atol)
    samples = list(zip(t, state, strict=True))
    k92 = np.array([truth.k92(ti, yi) for ti, yi in samples])
    with patch.object(truth, "k92", return_value=k92):  # all samples at once: half of the time
        wheels = vars(truth.contact(0.0, state.T))
    each = zip(*(signal.T for signal in wheels.values()), strict=True)
    rates = np.array([truth.rates(ti, yi, Contact(*x)) for (ti, yi), x in zip(samples, each, strict=True)])
    s, c, q, dq = np.sin(state[:, PITCH]), np.cos(state[:, PITCH]), state[:, Q], rates[:, Q]
    rx, rz = -truth.chassis.com_x, -truth.chassis.com_z  # from the centre of mass to R, in R
    v_wheel = np.empty((t.size, 2, 2))
    for i, arm in enumerate(truth.arm_x):
        v_wheel[:, i, 0] = state[:, VX] + q * (c * truth.arm_z - s * arm)
        v_wheel[:, i, 1] = state[:, VZ] - q * (c * arm + s * truth.arm_z)
    a_x = c * rates[:, VX] - s * rates[:, VZ] + dq * rz - q**2 * rx
    a_z = s * rates[:, VX] + c * rates[:, VZ] - dq * rx - q**2 * rz
    return Result(
        truth=truth,
        t=t,
        state=state,
        x=state[:, X] + c * rx + s * rz,
        v=truth.velocity(state.T),
        pitch=state[:, PITCH],
        pitch_rate=q,
        pitch_acceleration=dq,
        acceleration=np.stack([a_x, a_z], axis=1),
        v_wheel=v_wheel,
        v_o=state[:, OMEGA] * truth.r,
        omega=state[:, OMEGA],
        angle=state[:, ANGLE],
        rolled=state[:, ANGLE] * truth.r,
        current=state[:, CURRENT],
        voltage=np.array([truth.voltage(ti, yi) for ti, yi in samples]),
        torque=truth.torque(state.T).T,
        k92=k92,
        v_d=np.array([truth.command.velocity(ti) for ti in t]),
        s_d=np.array([truth.command.position(ti) for ti in t]),
        read_rate=truth.reading(state.T)[1].T,
        **{name: signal.T for name, signal in wheels.items()},
    )


def constant_k92(value: float) -> Law:
    """Return k_92(v_d) of Table 3: constant while driving, 1 at rest, blended below v_floor."""
    return lambda v_d: 1.0 + (value - 1.0) * float(smoothstep(v_d / V_FLOOR))


def build(
    variant: Variant,
    *,
    k92: float | None = None,
    a_theta: float = 0.0,
    robot: Robot | None = None,
    soil: Soil | None = None,
    intervals: int = 32,
) -> Truth:
    """Return the model of one motion, with a constant k_92 or (5); by default the paper's robot and soil."""
    law = exponential_k92(a_theta) if k92 is None else constant_k92(k92)
    command = trapezoid(variant.velocity, variant.acceleration, variant.distance)
    return Truth(Setup(robot or load_robot(), soil or load_soil(), law, intervals=intervals), command)


def simulate(variant: Variant, *, settle: float = 1.0, after: float = 1.0, **given: Any) -> Result:
    """Run one motion; t = 0 is the start of the command.

    Args:
        variant: the command.
        settle, after: rest before the command and time after its end [s].
        given: as for `build`.
    """
    truth = build(variant, **given)
    steps = int(np.floor((settle + truth.command.end + after) / SPACING + 1e-9))
    return integrate(truth, np.asarray(-settle + SPACING * np.arange(steps + 1)))


@dataclass(frozen=True, eq=False)
class Driven(Body):
    """A true motion with the end of its command [s], and the settled half of its constant part [s]."""

    stop: float
    steady: tuple[float, float]


def body_from_run(run: Result, *, steady: tuple[float, float]) -> Driven:
    """Return the motion of a run, its first sample moved to t = 0.

    Args:
        run: with samples dense enough for cubic interpolation (5 ms or less).
        steady: settled interval in the run's own time [s].
    """
    origin = float(run.t[0])
    t = np.asarray(origin + DT * np.arange(int((run.t[-1] - origin) / DT + 1e-6) + 1))
    body = body_from_states(run.truth, t, CubicSpline(run.t, run.state)(t))
    end = float(run.truth.command.end - origin)
    return Driven(**vars(body), stop=end, steady=(steady[0] - origin, steady[1] - origin))


def forces(
    wheels: Wheels,
    soil: Soil,
    *,
    v_o: float,
    v: float,
    z: float,
    k92: float,
    harden: float = 0.0,
    radius: float | None = None,
) -> tuple[float, float, float, float]:
    """Return W, R, F [N] and M [N m] without damping.

    Args:
        wheels, soil: whose numbers are used.
        v_o, v: velocity of the circumference and of the wheel's centre [m/s].
        z: sinkage [m].
        k92: ratio of the contact angles.
        harden: by which the pressure grows with the logarithm of the arc's speed into the soil over 0.02 m/s.
        radius: of the arc in the soil, where it is not that of the wheel [m].
    """
    b, arc = wheels.width, radius or wheels.radius
    modulus = soil.cohesive_modulus / b + soil.frictional_modulus
    tan_phi = math.tan(math.radians(soil.friction_angle))
    fastest = max(abs(v_o), abs(v))
    slip, s = (v_o - v) / max(fastest, 0.02), min(1.0, fastest / 0.02)
    fade = s * s * (3 - 2 * s)
    front = math.acos(1 - z / arc)

    def stresses(a: float) -> tuple[float, float]:
        sigma = modulus * max(z - arc * (1 - math.cos(a)), 0.0) ** soil.exponent
        sigma *= 1 + harden * math.log1p(abs(v) * max(math.sin(a), 0.0) / 0.02)
        entered = math.sin(front) - math.sin(a)
        j = arc * (fade * ((front - a) - entered) + slip * entered)
        limit = min(soil.tyre_friction * sigma, soil.cohesion + sigma * tan_phi)
        return sigma, math.copysign(limit * (1 - math.exp(-abs(j) / soil.shear_modulus)), j)

    def integral(weight: Callable[[float, float, float], float]) -> float:
        whole = quad(lambda a: weight(a, *stresses(a)), -k92 * front, front, epsabs=1e-9, limit=400)
        return b * arc * float(whole[0])

    return (
        integral(lambda a, sigma, tau: sigma * math.cos(a) + tau * math.sin(a)),
        integral(lambda a, sigma, _: -sigma * math.sin(a)),
        integral(lambda a, _, tau: tau * math.cos(a)),
        -wheels.radius * integral(lambda _a, _sigma, tau: tau),
    )
