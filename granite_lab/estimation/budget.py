"""What the standard deviation of λ_R is made of: the filter's own sources of error, one by one.

The smoothed drift is a linear function of everything that is random in the filter's model: its initial state,
the noise of each step and the noise of each measurement. Its adjoint gives the weight of each of them on λ_R,
so that the variance of λ_R is the sum of their shares, without a remainder [1].

References:
    [1] JCGM 100:2008, Evaluation of measurement data: guide to the expression of uncertainty in measurement,
        5.1.2.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from granite_lab.estimate import Kind, Part
from granite_lab.estimation import smoother
from granite_lab.estimation.nodes import Nodes
from granite_lab.estimation.noise import Noise
from granite_lab.estimation.passes import mismatch
from granite_lab.estimation.process import (
    BA,
    BG,
    BM,
    PD,
    SIZE,
    TAU,
    TH,
    TINY,
    C,
    D,
    G,
    K,
    P,
    S,
    SlipModel,
    V,
    X,
)
from granite_lab.estimation.smoother import Smoothed
from granite_lab.logs.trial import Array


@dataclass(frozen=True)
class _Source:
    name: str
    kind: Kind
    unit: str
    std: float
    distribution: str = "normal"


def slip_parts(
    nodes: Nodes, found: Smoothed, noise: Noise, model: SlipModel, slip: float, rolled: Array, i: int, j: int
) -> tuple[Part, ...]:
    """Split the variance of λ_R between two nodes into its sources.

    Args:
        nodes: of the filter, in its last pass.
        found: what the smoother made of them; its covariance may have been widened.
        noise: that the filter worked with.
        model: of the slip ratio.
        slip: λ_R; NaN where it could not be had.
        rolled: (K,) distance that the wheels rolled at the nodes [m].
        i, j: the nodes, i < j.

    Returns:
        the parts, largest first, those below a millionth of the variance left out; the squares of their
        contributions add up to the variance that `slip.robot_slip` states.
    """
    if not math.isfinite(slip):
        return ()
    length = float(rolled[j] - rolled[i])
    towards = np.zeros(SIZE)  # λ = slipped / rolled: its gradient towards the difference of the states
    towards[D] = (1.0 - slip) / length
    towards[[X, P]] = -slip / length, slip / length
    variances = _shares(nodes, found, towards, i, j)
    widened = max(mismatch(found.innovations).values(), default=1.0)  # as `passes.solve` did
    whole = widened * sum(variances.values())
    tick = [math.sqrt(u.R) for several in nodes.updates for u in several if u.kind == "wheel"]
    sources = _sources(nodes, noise, model.scatter, float(np.median(tick)) if tick else 0.0)
    merged: dict[_Source, float] = {}
    for key, variance in variances.items():
        source = sources.get(key) or _Source(key, "B", "1", math.nan)
        merged[source] = merged.get(source, 0.0) + variance * widened
    ranked = sorted(merged.items(), key=lambda item: -item[1])
    return tuple(
        Part(s.name, s.kind, s.distribution, s.unit, s.std, math.sqrt(variance))
        for s, variance in ranked
        if variance > 1e-6 * whole
    )


def _sources(nodes: Nodes, noise: Noise, scatter: float, tick: float) -> Mapping[str, _Source]:
    """Return the source of each share, with the standard uncertainty that the filter gave it."""
    start = np.sqrt(np.diagonal(nodes.P0))
    accel = math.hypot(noise.accel, max(noise.accel_motion, noise.accel_stamps))
    gyro = math.hypot(noise.gyro, noise.gyro_motion)
    level = _Source("accelerometer bias with mounting tilt", "B", "m/s²", float(start[BA]))
    turn = _Source("gyro bias", "B", "rad/s", float(start[BG]))
    encoders = _Source("encoder counts and stamps", "B", "m", tick, "rectangular")
    varying = _Source("slip that varies along the way", "A", "1", scatter)
    shaking = _Source("vibration of the frame", "A", "m/s²", noise.vibration)
    soft = _Source("compliance between wheels and body", "B", "s²", float(start[C]))
    white = _Source("accelerometer noise", "A", "m/s²/√Hz", accel)
    rate = _Source("gyro noise", "A", "rad/s/√Hz", gyro)
    other = _Source("start of the filter", "B", "m/s", float(start[V]))
    return {
        "accel": white, "gyro": rate, "specific_force": white, "zero_rate": rate,
        "zero_velocity": _Source("standstill not perfect", "B", "m/s", 3e-4),
        "wheel": encoders, "distance": _Source("measured distance", "B", "m", 0.0),
        f"state {BM}": _Source("bias that is there only in motion", "B", "m/s²", noise.motion_bias),
        f"start {BM}": _Source("bias that is there only in motion", "B", "m/s²", noise.motion_bias),
        f"state {BA}": _Source("drift of the accelerometer's bias", "B", "m/s²/√s", noise.accel_walk),
        f"state {BG}": _Source("drift of the gyro's bias", "B", "rad/s/√s", noise.gyro_walk),
        f"start {BA}": level, f"start {TH}": level, f"start {BG}": turn,
        f"state {S}": varying, f"start {S}": varying, f"start {G}": varying,
        f"state {P}": shaking, f"start {P}": shaking, f"start {PD}": shaking,
        f"state {D}": soft, f"state {C}": soft, f"start {C}": soft,
        f"start {TAU}": _Source("time offset of encoders and IMU", "B", "s", float(start[TAU])),
        f"state {TAU}": _Source("time offset of encoders and IMU", "B", "s", float(start[TAU])),
        f"start {K}": _Source("scale error of the accelerometer", "B", "1", float(start[K])),
        f"state {K}": _Source("scale error of the accelerometer", "B", "1", float(start[K])),
        f"start {X}": other, f"start {V}": other, f"start {D}": encoders,
    }  # fmt: skip


def _shares(nodes: Nodes, found: Smoothed, towards: Array, i: int, j: int) -> dict[str, float]:
    """Return the variance of ``towards @ (x_j - x_i)`` by source, before any widening."""
    weights, behind = _smoother_adjoint(nodes, found, towards, i, j)
    gains = _filter_gains(nodes)
    shares: dict[str, float] = {}

    def add(key: str, variance: float) -> None:
        shares[key] = shares.get(key, 0.0) + variance

    c = np.zeros(SIZE)  # weight of the error of the filtered state
    for k in range(nodes.t.size - 1, -1, -1):
        c = c + weights[k]
        for update, gain in zip(reversed(nodes.updates[k]), reversed(gains[k]), strict=True):
            w = float(gain @ c)
            add(update.kind, w * w * update.R)
            c = c - update.H[0] * w
        if k:
            _add_step(add, nodes, behind[k] - c, k)
            c = nodes.F[k].T @ c
    for place, variance in enumerate(np.diagonal(nodes.P0)):
        add(f"start {place}", float(c[place] ** 2 * variance))
    return shares


def _smoother_adjoint(nodes: Nodes, found: Smoothed, towards: Array, i: int, j: int) -> tuple[Array, Array]:
    """Return the weights (K, 14) of the errors of the filtered states, and those of the steps' noise.

    With the noise w of the step that leads to the next node, the error of the smoothed state is
    e_k + A_k (e_s,k+1 + w - F e_k): weights pass forwards in time.
    """
    n = nodes.t.size
    weights, behind = np.zeros((n, SIZE)), np.zeros((n, SIZE))
    for k in range(n):
        own = behind[k] + towards * (float(k == j) - float(k == i))
        weights[k] = own
        if k < n - 1:
            behind[k + 1] = found.gains[k].T @ own
            weights[k] -= nodes.F[k + 1].T @ behind[k + 1]
    return weights, behind


def _filter_gains(nodes: Nodes) -> list[list[Array]]:
    """Return the filter's gain (14,) for each measurement at each node."""
    gains: list[list[Array]] = []
    after = smoother.forward(nodes)[1]
    P = nodes.P0
    for k, updates in enumerate(nodes.updates):
        if k:
            P = nodes.F[k] @ after[k - 1] @ nodes.F[k].T + nodes.Q[k]
        gains.append([])
        for update in updates:
            Ph = P @ update.H[0]
            gain = Ph / (float(update.H[0] @ Ph) + update.R)
            P = P - np.outer(gain, Ph)
            gains[-1].append(gain)
    return gains


def _add_step(add: Callable[[str, float], None], nodes: Nodes, c: Array, k: int) -> None:
    """Add the shares of one step's noise, whose blocks are independent of each other."""
    Q, dt = nodes.Q[k], float(nodes.t[k] - nodes.t[k - 1])
    inertial, slipping, ringing = [X, V, TH], [D, S, G], [P, PD]
    for place in (BA, BG, BM, TAU, K, C):
        add(f"state {place}", float(c[place] ** 2 * Q[place, place]))
    add(f"state {P}", float(c[ringing] @ Q[np.ix_(ringing, ringing)] @ c[ringing]))
    # the distance that wheels turn ahead of the body is independent of the slip ratio
    varying = float(c[slipping] @ Q[np.ix_(slipping, slipping)] @ c[slipping])
    ahead = _compliance(Q, nodes.w[k], dt)
    add(f"state {D}", float(c[D] ** 2 * ahead))
    add(f"state {S}", varying - float(c[D] ** 2 * ahead))
    whole = float(c[inertial] @ Q[np.ix_(inertial, inertial)] @ c[inertial])
    turning = _gyro(Q, nodes.F[k], dt)
    by_gyro = float(c[inertial] @ turning @ c[inertial])
    add("gyro", by_gyro)
    add("accel", whole - by_gyro)


def _compliance(Q: Array, w: float, dt: float) -> float:
    """Return the variance of D in a step that is not the slip ratio's [m^2]."""
    by_slip = float(abs(Q[D, S]) + abs(Q[D, G])) * 2.0 / 3.0 * abs(w) * dt
    return max(float(Q[D, D]) - by_slip, 0.0)


def _gyro(Q: Array, F: Array, dt: float) -> Array:
    """Return the (3, 3) noise of distance, velocity and pitch in a step that the gyro makes."""
    if dt <= 0.0:
        return np.zeros((3, 3))
    density = max(float(Q[TH, TH]) - float(TINY[TH]) ** 2, 0.0) / dt
    coupling = float(F[V, TH]) / dt
    g = np.array([coupling * dt**2.5 / 6.0, coupling * dt**1.5 / 2.0, dt**0.5])
    block: Array = density * np.outer(g, g)
    block[0, 0] = density * coupling**2 * dt**5 / 20
    block[1, 1] = density * coupling**2 * dt**3 / 3
    block[0, 1] = block[1, 0] = density * coupling**2 * dt**4 / 8
    return block
