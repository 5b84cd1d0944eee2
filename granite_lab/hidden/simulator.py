"""Integration of the truth with LSODA or Radau, and the signals of a run."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from granite_lab.hidden.command import Trapezoid
from granite_lab.hidden.contact import Array
from granite_lab.hidden.model import (
    ANGLE,
    CURRENT,
    OMEGA,
    PITCH,
    VX,
    VZ,
    Q,
    Truth,
    X,
    Z,
)
from granite_lab.hidden.parts import Method, constant_k92, exponential_k92
from granite_lab.parameters import Robot, Soil, load_robot, load_soil


@dataclass(frozen=True, eq=False)
class Result:
    """Signals of one run at `t` (N,), SI units; (N, 2) where front and rear differ.

    Attributes:
        state: (N, 12) or wider, in the order of `granite_lab.hidden.model`.
        x, height: position of R in O; v, w: components of its velocity along R's x and z.
        read_rate: (N, 2) rate that the encoders tell.
        rise: of the ground [rad].
        acceleration: (N, 2) inertial acceleration of R along R's x and z.
        rolled: (N, 2) integral of v_o; s_d: that of v_d.
        v_wheel: (N, 2, 2) velocity of front and rear wheel centre along O's x and z.
    """

    t: Array
    state: Array
    x: Array
    v: Array
    w: Array
    height: Array
    pitch: Array
    pitch_rate: Array
    pitch_acceleration: Array
    acceleration: Array
    v_wheel: Array
    v_o: Array
    omega: Array
    angle: Array
    rolled: Array
    slip: Array
    sinkage: Array
    W: Array
    R: Array
    F: Array
    M: Array
    normal: Array
    current: Array
    voltage: Array
    torque: Array
    k92: Array
    v_d: Array
    s_d: Array
    read_rate: Array
    rise: float = 0.0

    def at(self, t: float, name: str) -> Array:
        """Return a signal at an instant, linear between samples."""
        signal = np.asarray(getattr(self, name))
        if signal.ndim == 1:
            return np.asarray(np.interp(t, self.t, signal))
        return np.array([np.interp(t, self.t, column) for column in signal.T])

    def slip_ratio(self, start: float, stop: float) -> float:
        """Return λ_R (2) between two instants; the desired distance is the mean of what the wheels rolled."""
        travelled = self.at(stop, "x") - self.at(start, "x")
        return float(1.0 - travelled / (self.at(stop, "rolled") - self.at(start, "rolled")).mean())


def solve(
    truth: Truth, t: Array, *, method: Method | None = None, rtol: float = 1e-7, atol: float = 1e-9
) -> Array:
    """Integrate from rest at the first instant and return the states (N, 12 or more) at `t` (N,), increasing.

    Raises:
        RuntimeError: the integrator gave up.
    """
    marks = [m for m in truth.marks() if t[0] < m < t[-1]]
    edges = [float(t[0]), *marks, float(t[-1])]
    y = truth.rest()
    pieces = []
    chosen = method or truth.method
    implicit: dict[str, Any] = {} if chosen == "LSODA" else {"jac": partial(jacobian, truth)}
    # restarted at each corner of the command: the error control of a multistep method ends there
    for start, stop in pairwise(edges):
        inside = t[(t >= start) & (t < stop)]
        part = solve_ivp(
            truth.derivative, (start, stop), y, method=chosen, rtol=rtol, atol=atol,
            t_eval=np.append(inside, stop), max_step=0.05, **implicit,
        )  # fmt: skip
        if not part.success:
            raise RuntimeError(part.message)
        y = part.y[:, -1]
        pieces.append(part.y[:, :-1])
    return np.asarray(np.concatenate([*pieces, y[:, None]], axis=1).T)


def jacobian(truth: Truth, t: float, y: Array) -> Array:
    """Return the (n, n) derivatives of the rates (n,) by the states (n,), by differences.

    SciPy's own widens the step of a state on which nothing depends, such as the distance driven, ten times
    at each use; after some three hundred it overflows, and the integration creeps or is lost.
    """
    steps = np.diag(1e-8 * np.maximum(1.0, np.abs(y)))
    here = truth.derivative(t, y)
    return np.stack([(truth.derivative(t, y + h) - here) / h.sum() for h in steps], axis=1)


def integrate(
    truth: Truth, t: Array, *, method: Method | None = None, rtol: float = 1e-7, atol: float = 1e-9
) -> Result:
    """Integrate from rest at the first instant and return the signals at `t` (N,), increasing."""
    return signals(truth, t, solve(truth, t, method=method, rtol=rtol, atol=atol))


def signals(truth: Truth, t: Array, state: Array) -> Result:
    """Return all signals of the states (N, 12) at `t` (N,)."""
    samples = list(zip(t, state, strict=True))
    wheels = [truth.contact(ti, yi) for ti, yi in samples]
    rates = np.array([truth.rates(ti, yi, wheel) for (ti, yi), wheel in zip(samples, wheels, strict=True)])
    s, c, q, dq = np.sin(state[:, PITCH]), np.cos(state[:, PITCH]), state[:, Q], rates[:, Q]
    rx, rz = -truth.chassis.com_x, -truth.chassis.com_z  # from the centre of mass to R, in R
    v_wheel = np.empty((t.size, 2, 2))
    for i, arm in enumerate(truth.arm_x):
        v_wheel[:, i, 0] = state[:, VX] + q * (c * truth.arm_z - s * arm)
        v_wheel[:, i, 1] = state[:, VZ] - q * (c * arm + s * truth.arm_z)
    a_x = c * rates[:, VX] - s * rates[:, VZ] + dq * rz - q**2 * rx
    a_z = s * rates[:, VX] + c * rates[:, VZ] - dq * rx - q**2 * rz
    forces = {
        name: np.array([getattr(wheel, name) for wheel in wheels])
        for name in ("slip", "sinkage", "W", "R", "F", "M", "normal")
    }
    return Result(
        t=t,
        state=state,
        x=state[:, X] + c * rx + s * rz,
        v=np.array([truth.velocity(yi) for yi in state]),
        w=s * state[:, VX] + c * state[:, VZ] - q * rx,
        height=state[:, Z] - s * rx + c * rz,
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
        torque=np.array([truth.torque(yi) for yi in state]),
        k92=np.array([truth.k92(ti, yi) for ti, yi in samples]),
        v_d=np.array([truth.command.velocity(ti) for ti in t]),
        s_d=np.array([truth.command.position(ti) for ti in t]),
        read_rate=np.array([truth.reading(yi)[1] for yi in state]),
        rise=truth.rise,
        **forces,
    )


def build(
    *,
    velocity: float,
    acceleration: float,
    distance: float,
    k92: float | None = None,
    a_theta: float | None = None,
    robot: Robot | None = None,
    soil: Soil | None = None,
    intervals: int = 32,
) -> Truth:
    """Return the model of one motion, with a constant k_92 or (5); by default the paper's robot and soil."""
    if (k92 is None) == (a_theta is None):
        raise ValueError("give either k92 or a_theta")
    law = constant_k92(k92) if k92 is not None else exponential_k92(float(a_theta or 0.0))
    command = Trapezoid(velocity, acceleration, distance)
    return Truth(robot or load_robot(), soil or load_soil(), command, law, intervals)


def simulate(
    *,
    velocity: float,
    acceleration: float,
    distance: float,
    k92: float | None = None,
    a_theta: float | None = None,
    robot: Robot | None = None,
    soil: Soil | None = None,
    dt: float = 0.005,
    settle: float = 1.0,
    after: float = 1.0,
    method: Method | None = None,
    rtol: float = 1e-7,
    atol: float = 1e-9,
) -> Result:
    """Run one motion; t = 0 is the start of the command.

    Args:
        velocity, acceleration, distance: the trapezoid [m/s], [m/s^2], [m].
        k92, a_theta: exactly one of them.
        robot, soil: records; the paper's when not given.
        dt: spacing of the returned samples [s].
        settle, after: rest before the command and time after its end [s].
        method, rtol, atol: of `scipy.integrate.solve_ivp`; the model knows its method.
    """
    truth = build(
        velocity=velocity, acceleration=acceleration, distance=distance,
        k92=k92, a_theta=a_theta, robot=robot, soil=soil,
    )  # fmt: skip
    steps = int(np.floor((settle + truth.command.end + after) / dt + 1e-9))
    t = np.asarray(-settle + dt * np.arange(steps + 1))
    return integrate(truth, t, method=method, rtol=rtol, atol=atol)
