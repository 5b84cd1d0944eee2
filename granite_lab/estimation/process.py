"""The linear model of the drift: states, transition and process noise between two nodes.

The states are corrections to the nominal motion of `integration`, so they change slowly:

    x  = x_nominal + X - P          distance of R, without the frame's vibration
    v  = v_nominal + V - PD         velocity of R
    pitch = pitch_nominal + TH

    dV/dt  = g cos(pitch) TH - BA - BM - K a   accelerometer bias with mounting tilt; motion-only bias;
                                               scale error K times the acceleration a
    dTH/dt = -BG
    dD/dt  = (S + G) w                         D: rolled minus travelled distance, w: wheel speed
                                               (what the onset's mean slip ratio makes is taken out)
    P'' + 2 zeta omega P' + omega^2 P = noise  vibration: bounded, so its integral is bounded too

The rolled distance is x + D + C F: where tyres twist, gears have play or the mount is soft, the wheels turn
ahead of the body by the compliance C [s^2] times the thrust over mass F [m/s^2].

Slip velocity is (S + G) w: a slip ratio that wanders (S a random walk, G coloured about it) while
the wheels turn, and no slip velocity at rest. It is not assumed to be small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from granite_lab.logs.trial import Array

X, D, V, TH, BA, BG, BM, S, G, TAU, K, C, P, PD = range(14)
SIZE = 14

TINY = np.array([1e-8, 1e-8, 1e-7, 1e-9, 1e-9, 1e-10, 1e-8, 1e-7, 1e-7, 1e-8, 1e-9, 1e-9, 1e-9, 1e-8])
"""Std added per step, so that no predicted covariance is singular, in each state's own unit."""

V_FLOOR = 0.02
"""v_floor of (1) [m/s]."""


@dataclass(frozen=True)
class SlipModel:
    """How the slip ratio may change.

    Attributes:
        steady, per_acceleration: expected slip ratio on soft ground, steady [-] and more for each
            m/s^2 that the wheels gain [s^2/m]: resistance there is about a tenth of the weight, so an
            acceleration of a tenth of g takes as much thrust, and slip, again; and braking gives it back.
        onset: std about the expected value after a standstill [-].
        walk: random walk of S [1/sqrt(s)] in steady motion.
        ramp: walk added per square root of relative change of wheel speed [-].
        scatter, time: std [-] and correlation time [s] of G.
        bounded: S is stationary: it reverts to 0 within `limit_time` [s] with the std `limit` [-].
            Only for long motion, which a random walk would lose; otherwise S is free.
        limit, limit_time: see above; `limit` also caps one step's noise.
        thrust: more slip ratio for each m/s^2 of specific force along x, which is thrust over mass [s^2/m].
        memory: slip velocity goes with the wheel speed of the last and next seconds, `memory` in all [s],
            so that a change of the wheels' speed says nothing about a steady slip ratio; 0: with the
            present speed.
    """

    steady: float = 0.15
    per_acceleration: float = 0.15
    onset: float = 0.35
    walk: float = 0.005
    ramp: float = 0.25
    scatter: float = 0.06
    time: float = 2.0
    bounded: bool = False
    limit: float = 0.5
    limit_time: float = 300.0
    thrust: float = 0.0
    memory: float = 0.0

    def expected(self, growth: Array) -> Array:
        """(K,) slip ratio expected while the wheels' speed grows by `growth` (K,) [m/s^2]."""
        return np.clip(self.steady + self.per_acceleration * growth, -0.3, 0.5)


def transitions(
    dt: Array,
    coupling: Array,
    moving: np.ndarray,
    w: Array,
    slip: SlipModel,
    gyro: np.ndarray | None,
    omega: float,
    zeta: float,
    gain: Array,
) -> Array:
    """(K, 14, 14) transition matrices into each node from the one before.

    Args:
        dt: (K,) steps, dt[0] = 0 [s].
        coupling: (K,) g cos(pitch) [m/s^2].
        moving: (K,) False where the step lies within a standstill.
        w: (K,) wheel speed by which the slip ratio is multiplied [m/s], signed.
        slip: model of the slip ratio.
        gyro: None, or False where no pitch gyro carries the pitch.
        omega, zeta: natural frequency [rad/s] and damping of the vibration.
        gain: (K,) velocity that the accelerometer adds in the step [m/s].
    """
    F = np.zeros((dt.size, SIZE, SIZE))
    F[:] = np.eye(SIZE)
    on = moving.astype(float)
    F[:, X, V] = on * dt
    F[:, X, TH] = on * coupling * dt**2 / 2
    F[:, X, BA] = F[:, X, BM] = -on * dt**2 / 2
    F[:, X, BG] = -on * coupling * dt**3 / 6
    F[:, V, TH] = on * coupling * dt
    F[:, V, BA] = F[:, V, BM] = -on * dt
    F[:, V, BG] = -on * coupling * dt**2 / 2
    F[:, TH, BG] = -on * dt
    F[:, V, K], F[:, X, K] = -on * gain, -0.5 * on * gain * dt
    F[:, D, S] = F[:, D, G] = on * w * dt
    F[:, BM, BM] = on
    F[:, S, S] = on * (np.exp(-dt / slip.limit_time) if slip.bounded else 1.0)
    F[:, G, G] = on * np.exp(-dt / slip.time)
    F[:, P:, P:] = on[:, None, None] * resonator(dt, omega, zeta)
    if gyro is not None:
        F[:, TH, BG] = F[:, V, BG] = F[:, X, BG] = 0.0
    return F


def resonator(dt: Array, omega: float, zeta: float) -> Array:
    """(K, 2, 2) exact transition of displacement and velocity of a damped oscillator (zeta < 1)."""
    damped = omega * np.sqrt(1 - zeta**2)
    decay, c, s = np.exp(-zeta * omega * dt), np.cos(damped * dt), np.sin(damped * dt)
    k = zeta * omega / damped
    return np.asarray(
        np.moveaxis(np.array([[c + k * s, s / damped], [-(omega**2) / damped * s, c - k * s]]) * decay, 2, 0)
    )


def noises(
    dt: Array,
    coupling: Array,
    moving: np.ndarray,
    *,
    accel: Array,
    gyro: Array,
    accel_walk: float,
    gyro_walk: float,
) -> Array:
    """(K, 14, 14) process noise of the inertial states over each step.

    Args:
        dt, coupling, moving: as in `transitions`.
        accel, gyro: (K,) white noise densities in force over the step.
        accel_walk, gyro_walk: random walks of the biases.
    """
    Q = np.zeros((dt.size, SIZE, SIZE))
    Q[:, range(SIZE), range(SIZE)] = TINY**2
    on = moving.astype(float)
    a2, g2 = on * accel**2, on * gyro**2
    Q[:, V, V] += a2 * dt + coupling**2 * g2 * dt**3 / 3
    Q[:, X, X] += a2 * dt**3 / 3 + coupling**2 * g2 * dt**5 / 20
    Q[:, X, V] += a2 * dt**2 / 2 + coupling**2 * g2 * dt**4 / 8
    Q[:, TH, TH] += g2 * dt
    Q[:, V, TH] += coupling * g2 * dt**2 / 2
    Q[:, X, TH] += coupling * g2 * dt**3 / 6
    Q[:, BA, BA] += accel_walk**2 * dt
    Q[:, BG, BG] += gyro_walk**2 * dt
    for i, j in ((X, V), (V, TH), (X, TH)):
        Q[:, j, i] = Q[:, i, j]
    return Q


def add_slip(
    Q: Array, dt: Array, moving: np.ndarray, onset: np.ndarray, w: Array, unrest: Array, slip: SlipModel
) -> None:
    """Add the noise of the slip ratio to Q in place.

    Args:
        onset: (K,) True for the step that leaves a standstill.
        w: (K,) wheel speed [m/s].
        unrest: (K,) relative change of the wheel speed, with a short memory [1/s].
    """
    on = moving.astype(float)
    walk = slip.walk**2 + 2 * slip.limit**2 / slip.limit_time * slip.bounded + slip.ramp**2 * unrest
    s2 = on * np.minimum(walk * dt, slip.limit**2) + onset * slip.onset**2
    g2 = on * (1 - np.exp(-2 * dt / slip.time)) * slip.scatter**2
    g2 = np.where(onset, slip.scatter**2, g2)
    Q[:, S, S] += s2
    Q[:, G, G] += g2
    both = on * (s2 * ~onset + g2 * ~onset) * dt * w
    Q[:, D, S] += 0.5 * on * s2 * ~onset * dt * w
    Q[:, D, G] += 0.5 * on * g2 * ~onset * dt * w
    Q[:, S, D], Q[:, G, D] = Q[:, D, S], Q[:, D, G]
    Q[:, D, D] += both * dt * w / 3


def add_vibration(Q: Array, F: Array, dt: Array, moving: np.ndarray, size: Array, omega: float) -> None:
    """Add the noise that keeps the oscillator at its rms, which grows with the wheels' speed.

    Args:
        Q, F: noise (changed in place) and transitions.
        size: (K,) rms of the vibration's acceleration [m/s^2].
        omega: natural frequency [rad/s].
    """
    stationary = np.zeros((dt.size, 2, 2))
    stationary[:, 0, 0] = (size / omega**2) ** 2
    stationary[:, 1, 1] = (size / omega) ** 2
    A = F[:, P:, P:]
    Q[:, P:, P:] += np.where(moving[:, None, None], stationary - A @ stationary @ A.transpose(0, 2, 1), 0.0)
