"""The true motion of a robot as its sensors meet it, from a run of the truth's simulator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import fftconvolve

from granite_lab.hidden.contact import Array
from granite_lab.hidden.model import CURRENT, PITCH, VX, VZ, Q, Truth, X
from granite_lab.hidden.simulator import Result

DT = 0.001
"""Spacing of the truth [s]."""


@dataclass(frozen=True, eq=False)
class Body:
    """True motion at `t` (N,), evenly spaced by DT.

    Attributes:
        x, v, a: distance along R's x [m], velocity [m/s] and its derivative [m/s^2].
        w: velocity of R along R's z [m/s]; dw: its derivative.
        pitch, roll, yaw_rate: attitude [rad] (pitch positive nose down) and heading rate [rad/s].
        v_wheel: (N, 4) circumferential velocity of each wheel [m/s].
        force: (N, 4) longitudinal force each wheel transmits [N], for the currents where those are
            not known; current: (N, 4) of the motors [A] where they are.
        start, stop: of the command [s]; steady: settled half of its constant part [s].
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
    force: Array
    start: float
    stop: float
    steady: tuple[float, float]
    current: Array | None = None


def wander(rng: np.random.Generator, size: int, step: float, length: float) -> Array:
    """Return a Gaussian random function of unit variance with correlation `length`, sampled every `step`."""
    reach = max(1, int(np.ceil(4 * length / step)))
    kernel = np.exp(-((np.arange(-reach, reach + 1) * step / length) ** 2))
    kernel /= np.sqrt((kernel**2).sum())
    return np.asarray(fftconvolve(rng.standard_normal(size + 2 * reach), kernel, mode="valid"))


def body_from_run(run: Result, *, steady: tuple[float, float], radius: float) -> Body:
    """Return the motion of a run of the reference simulator, its first sample moved to t = 0.

    Args:
        run: with samples dense enough for cubic interpolation (5 ms or less).
        steady: settled interval in the run's own time [s].
        radius: of the wheels [m].
    """
    origin = float(run.t[0])
    t = np.asarray(DT * np.arange(int((run.t[-1] - origin) / DT + 1e-6) + 1))

    def fine(signal: Array) -> Array:
        return np.asarray(CubicSpline(run.t - origin, signal)(t))

    v, pitch, zeros = fine(run.v), fine(run.pitch) - run.rise, np.zeros(t.size)
    w = fine(run.w)
    still = np.flatnonzero(run.v_d > 0)
    both = [0, 0, 1, 1]
    return Body(
        t=t,
        x=fine(run.x) - run.x[0],
        v=v,
        a=np.gradient(v, DT),
        w=w,
        dw=np.gradient(w, DT),
        pitch=pitch,
        roll=zeros,
        yaw_rate=zeros,
        v_wheel=np.stack([radius * fine(run.read_rate[:, i]) for i in both], axis=1),
        force=np.stack([fine((run.F + run.R)[:, i]) for i in both], axis=1),
        current=np.stack([np.interp(t, run.t - origin, run.current[:, i]) for i in both], axis=1),
        start=-origin,
        stop=float(run.t[still[-1]]) - origin,
        steady=(steady[0] - origin, steady[1] - origin),
    )


def body_from_states(truth: Truth, t: Array, state: Array) -> Body:
    """Return the motion from the states (N, 12 or more) at `t` (N,), DT apart, moved to t = 0.

    The steady part is not looked for.
    """
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
        force=np.zeros((t.size, 4)),
        current=state[:, CURRENT][:, both],
        start=float(-t[0]),
        stop=float(truth.command.end - t[0]),
        steady=(float("nan"), float("nan")),
    )
