"""Integration of the truth with LSODA or Radau, and the true motion as sensors meet it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
import scipy

from granite_lab.hidden.contact import Array
from granite_lab.hidden.model import CURRENT, PITCH, VX, VZ, DigsInError, Q, Truth, X

DT = 0.001
"""Spacing of the truth [s]."""


RELATIVE, ABSOLUTE = 3e-6, 1e-7
"""Tolerances of the integration: the velocity is then within 0.05 mm/s of that at 1e-9."""

LEAST_WAY = 0.35
"""Share of the commanded distance that a robot covers unless it digs itself in."""


@dataclass(frozen=True, eq=False)
class Body:
    """True motion at `t` (N,), evenly spaced by DT.

    Attributes:
        x, v, a: distance along R's x [m], velocity [m/s] and its derivative [m/s^2].
        w: velocity of R along R's z [m/s]; dw: its derivative.
        pitch, roll, yaw_rate: attitude [rad] (pitch positive nose down) and heading rate [rad/s].
        v_wheel: (N, 4) circumferential velocity of each wheel [m/s].
        current: (N, 4) of the motors [A].
        start: of the command [s].
    """

    t: Array
    x: Array
    v: Array
    a: Array
    w: Array
    dw: Array
    pitch: Array
    roll: Array
    yaw_rate: Array
    v_wheel: Array
    current: Array
    start: float


def solve(truth: Truth, t: Array, *, rtol: float = 1e-7, atol: float = 1e-9) -> Array:
    """Integrate from rest at the first instant and return the states (N, 12 or more) at `t` (N,), increasing.

    Raises:
        DigsInError: the integrator gave up.
    """
    marks = [m for m in truth.marks() if t[0] < m < t[-1]]
    edges = [float(t[0]), *marks, float(t[-1])]
    y = truth.rest()
    pieces = []
    # restarted at each corner of the command: the error control of a multistep method ends there
    for start, stop in pairwise(edges):
        inside = t[(t >= start) & (t < stop)]
        part = scipy.integrate.solve_ivp(
            truth.derivative, (start, stop), y, method=truth.method, rtol=rtol, atol=atol,
            t_eval=np.append(inside, stop), max_step=0.05, jac=partial(jacobian, truth),
        )  # fmt: skip
        if not part.success:
            raise DigsInError(part.message)
        y = part.y[:, -1]
        pieces.append(part.y[:, :-1])
    return np.asarray(np.concatenate([*pieces, y[:, None]], axis=1).T)


def drive(truth: Truth, before: float, after: float) -> Body:
    """Return the motion under the truth's command, with standstills `before` and `after` it [s].

    Raises:
        DigsInError: the integrator gave up, or the robot covers too little of its way.
    """
    steps = np.arange(-round(before / DT), round((truth.command.end + after) / DT) + 1)
    t = np.asarray(steps * DT)
    state = solve(truth, t, rtol=RELATIVE, atol=ABSOLUTE)
    body = body_from_states(truth, t, state)
    if not np.isfinite(state).all() or body.x[-1] < LEAST_WAY * truth.command.distance:
        raise DigsInError("the robot digs itself in")
    return body


def jacobian(truth: Truth, t: float, y: Array) -> Array:
    """Return the (n, n) derivatives of the rates (n,) by the states (n,), by differences.

    All states are one call, which takes little longer than that of one state. SciPy's own differences widen
    the step of a state on which nothing depends, such as the distance driven, ten times at each use; after
    some three hundred the step overflows, and the integration creeps or is lost.
    """
    steps = 1e-8 * np.maximum(1.0, np.abs(y))
    rates = truth.derivative(t, np.column_stack([y, y[:, None] + np.diag(steps)]))
    return np.asarray((rates[:, 1:] - rates[:, :1]) / steps)


def body_from_states(truth: Truth, t: Array, state: Array) -> Body:
    """Return the motion from the states (N, 12 or more) at `t` (N,), DT apart, moved to t = 0."""
    s, c, q = np.sin(state[:, PITCH]), np.cos(state[:, PITCH]), state[:, Q]
    rx, rz = -truth.chassis.com_x, -truth.chassis.com_z  # from the centre of mass to R, in R
    v = c * state[:, VX] - s * state[:, VZ] + q * rz
    w = s * state[:, VX] + c * state[:, VZ] - q * rx
    both, zeros = [0, 0, 1, 1], np.zeros(t.size)
    x = state[:, X] + c * rx + s * rz
    return Body(
        t=t - t[0],
        x=x - x[0],
        v=v,
        a=np.gradient(v, DT),
        w=w,
        dw=np.gradient(w, DT),
        pitch=state[:, PITCH] - truth.rise,
        roll=zeros + truth.bank,
        yaw_rate=zeros,
        v_wheel=truth.r * truth.reading(state.T)[1][both].T,
        current=state[:, CURRENT][:, both],
        start=float(-t[0]),
    )
