"""Velocity to the left, which a turning robot feeds into its forward acceleration.

In robot axes, with yaw rate r and specific force f,

    dv_x/dt = f_x + g sin(pitch) + r v_y        dv_y/dt = f_y - g sin(roll) - r v_x

A car that drifts has v_y of a metre a second; r v_y is then as large as the thrust. Turning also makes
v_y observable: what was sideways a moment ago is forwards now, where the wheels measure it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from filterpy.kalman import KalmanFilter

from granite_lab.estimation.mounting import BodyImu
from granite_lab.logs.trial import Array

VX, VY, BX, BY, SLIP = range(5)

STEP = 0.02
"""Spacing of the grid [s]; turning is slower."""

MOST = 60_000
"""A grid of more points than this is made sparser: 60 ms in an hour, which a robot's turns still outlast."""

ASIDE = 0.15
"""Mean sideways velocity over one second, as a share of the forward velocity (std)."""

BIAS_WALK = 0.05
"""Random walk of biases, with the part of pitch and roll that the gyros lose [m/s^2/sqrt(s)]."""

NO_TURN = 0.02
"""With a yaw rate of less rms than this [rad/s] the robot drives straight."""

MEMORY = 0.5
"""Correlation time of the error [s]."""


@dataclass(frozen=True, eq=False)
class Sideways:
    """Velocity to the left at the IMU's stamps (N,), and its std [m/s]."""

    velocity: Array
    std: Array

    def part(self, keep: np.ndarray) -> Sideways:
        """Return the samples where keep holds."""
        return Sideways(self.velocity[keep], self.std[keep])

    def noise(self, yaw_rate: Array) -> Array:
        """(N,) white noise that its error makes of the forward acceleration [m/s^2 sqrt(s)]."""
        return np.asarray(np.abs(yaw_rate) * self.std * np.sqrt(2.0 * MEMORY))


def find(
    imu: BodyImu, still: np.ndarray, wheel: Array, *, accel: float, scatter: float, time: float
) -> Sideways | None:
    """Smooth forward and sideways velocity together over the plane.

    Args:
        imu: samples in robot axes.
        still: (N,) True at standstill.
        wheel: (N,) wheel speed less the slip that is expected [m/s].
        accel: white noise of the accelerations [m/s^2 sqrt(s)].
        scatter, time: std [-] and correlation time [s] of the slip ratio.

    Returns:
        None for a robot that drives straight, or whose lateral acceleration or yaw rate was not logged.
    """
    if not (np.isfinite(imu.left).any() and np.isfinite(imu.yaw_rate).any()) or not imu.t.size > 8:
        return None
    rates = [np.nan_to_num(rate) for rate in (imu.roll_rate, imu.pitch_rate, imu.yaw_rate)]
    middle = np.mean if not still.any() else (lambda rate: np.mean(rate[still]))
    roll_rate, pitch_rate = (rate - middle(rate) for rate in rates[:2])
    yaw = rates[2] - (float(np.mean(rates[2][still])) if still.any() else 0.0)
    if float(np.sqrt(np.mean(yaw**2))) < NO_TURN:
        return None
    t, step = imu.t, np.diff(imu.t, prepend=imu.t[0])
    force = [_known(t, imu.forward), _known(t, imu.left)]
    force[0] = force[0] + imu.gravity * np.sin(np.cumsum(pitch_rate * step))
    force[1] = force[1] - imu.gravity * np.sin(np.cumsum(roll_rate * step))
    # means over the grid's steps, from integrals
    spacing = max(STEP, float(np.median(np.diff(t))), float(t[-1] - t[0]) / MOST)
    grid = np.arange(t[0], t[-1] + STEP, spacing)
    gained = [np.diff(np.interp(grid, t, np.cumsum(f * step)), prepend=0.0) for f in force]
    turned = np.diff(np.interp(grid, t, np.cumsum(yaw * step)), prepend=0.0)
    velocity, std = _smooth(
        grid, gained[0], gained[1], turned, np.interp(grid, t, wheel), np.interp(grid, t, still) > 0.99,
        accel, scatter, time,
    )  # fmt: skip
    return Sideways(np.interp(t, grid, velocity), np.interp(t, grid, std))


def _known(t: Array, signal: Array) -> Array:
    good = np.isfinite(signal)
    return np.interp(t, t[good], signal[good])


def _smooth(
    t: Array, forward: Array, left: Array, turned: Array, wheel: Array, still: np.ndarray, accel: float,
    scatter: float, time: float,
) -> tuple[Array, Array]:  # fmt: skip
    """Return sideways velocity and std on the grid; inputs are gains of velocity and heading per step."""
    n, dt = t.size, float(t[1] - t[0])
    fast = max(float(np.sqrt(np.mean(wheel[~still] ** 2))) if (~still).any() else 0.0, 0.05)
    F = np.zeros((n, 5, 5))
    F[:] = np.eye(5)
    F[:, VX, VX] = F[:, VY, VY] = np.cos(turned)
    F[:, VX, VY], F[:, VY, VX] = np.sin(turned), -np.sin(turned)
    F[:, VX, BX] = F[:, VY, BY] = -dt
    keep = np.exp(-dt / time)
    F[:, SLIP, SLIP] = keep
    walk = BIAS_WALK**2 * dt
    Q = np.zeros((n, 5, 5))
    Q[:] = np.diag([accel**2 * dt, accel**2 * dt, walk, walk, (1 - keep**2) * scatter**2]) + 1e-12 * np.eye(5)
    kf = KalmanFilter(dim_x=5, dim_z=1)
    kf.x = np.array([[wheel[0]], [0.0], [0.0], [0.0], [0.0]])
    kf.P = np.diag([0.3 * fast, 0.2 * fast, 0.3, 0.3, max(scatter, 1e-3)]) ** 2
    kf.B = np.eye(5)
    xs, Ps = np.empty((n, 5, 1)), np.empty((n, 5, 5))
    aside = np.array([[0.0, 1.0, 0.0, 0.0, 0.0]])
    for k in range(n):
        if k:
            kf.predict(F=F[k], Q=Q[k], u=np.array([[forward[k]], [left[k]], [0.0], [0.0], [0.0]]))
        H = np.array([[1.0, 0.0, 0.0, 0.0, wheel[k]]])
        kf.update(np.array([[wheel[k]]]), R=np.array([[(0.02 * fast) ** 2]]), H=H)
        R = 1e-6 if still[k] else (ASIDE * fast) ** 2 / dt
        kf.update(np.zeros((1, 1)), R=np.array([[R]]), H=aside)
        xs[k], Ps[k] = kf.x, kf.P
    return _backwards(xs, Ps, F, Q, forward, left)


def _backwards(xs: Array, Ps: Array, F: Array, Q: Array, forward: Array, left: Array) -> tuple[Array, Array]:
    """Rauch-Tung-Striebel smoother with the known input, which FilterPy's leaves out."""
    n = xs.shape[0]
    value, variance = np.empty(n), np.empty(n)
    x, P = xs[-1], Ps[-1]
    value[-1], variance[-1] = x[VY, 0], P[VY, VY]
    for k in range(n - 2, -1, -1):
        ahead = F[k + 1] @ xs[k]
        ahead[VX, 0] += forward[k + 1]
        ahead[VY, 0] += left[k + 1]
        spread = F[k + 1] @ Ps[k] @ F[k + 1].T + Q[k + 1]
        gain = Ps[k] @ F[k + 1].T @ np.linalg.inv(spread)
        x = xs[k] + gain @ (x - ahead)
        P = Ps[k] + gain @ (P - spread) @ gain.T
        value[k], variance[k] = x[VY, 0], P[VY, VY]
    return value, np.sqrt(np.maximum(variance, 0.0))
