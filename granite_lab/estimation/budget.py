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
from collections import defaultdict
from collections.abc import Mapping

import numpy as np

from granite_lab.estimate import Kind, Part
from granite_lab.estimation import error_model as model
from granite_lab.estimation.error_model import BA, BG, BM, PD, TAU, TH, C, D, G, K, P, S, V, X
from granite_lab.estimation.nodes import Nodes
from granite_lab.estimation.problem import Problem
from granite_lab.estimation.smoother import GYRO_SCALE, STEADY_SLIP, Smoothed, Solution, adjoint, widening
from granite_lab.logs.sensors.standstill import ZERO_VELOCITY
from granite_lab.logs.trial import Array

LEVEL, TURN, ONLY = "accelerometer bias with mounting tilt", "gyro bias", "bias that is there only in motion"
WHITE, RATE, COUNTS = "accelerometer noise", "gyro noise", "encoder counts and stamps"
VARYING, SHAKING = "slip that varies along the way", "vibration of the frame"
SOFT, SCALE = "compliance between wheels and body", "scale error of the accelerometer"
LATE = "time offset of encoders and IMU"

COMMON = {STEADY_SLIP, GYRO_SCALE, SCALE}
"""Sources whose error is the same in all trials of one robot on one ground."""

MEASURED = {
    "specific_force": WHITE, "zero_rate": RATE, "wheel": COUNTS, "zero_velocity": "standstill not perfect",
    "distance": "measured distance", "reference_v": "external reference", "reference_x": "external reference",
}  # fmt: skip
"""Source of the noise of each kind of measurement."""

BEGUN = {
    X: "start of the filter", D: COUNTS, V: "start of the filter", TH: LEVEL, BA: LEVEL, BG: TURN, BM: ONLY,
    S: VARYING, G: VARYING, TAU: LATE, K: SCALE, C: SOFT, P: SHAKING, PD: SHAKING,
}  # fmt: skip
"""Source of the uncertainty of each state at the start."""

WALKING = {
    BA: "drift of the accelerometer's bias", BG: "drift of the gyro's bias", BM: ONLY, TAU: LATE, K: SCALE,
    C: SOFT,
}  # fmt: skip
"""Source of the noise of states that have one of their own."""


def slip_parts(solution: Solution, towards: Array, i: int, j: int) -> tuple[Part, ...]:
    """Split the variance of λ_R between nodes i and j into its sources, largest first.

    Squares of the contributions add up to the variance that `outcome.totals_of` states; parts below a
    millionth of it are left out. `towards` (14,) is the gradient of λ_R towards the difference of the states.
    """
    nodes, smoothed = solution.nodes, solution.smoothed
    widened = widening(smoothed.innovations)  # as `smooth` did
    variances = {name: widened * v for name, v in _variances(nodes, smoothed, towards, i, j).items()}
    for name, error in smoothed.common.items():
        variances[name] = float(towards @ (error[j] - error[i])) ** 2
    sources = _sources(nodes, solution.problem)
    parts = []
    for name, variance in sorted(variances.items(), key=lambda item: -item[1]):
        if variance > 1e-6 * sum(variances.values()):
            kind, unit, std = sources[name]
            shape = "rectangular" if name in (COUNTS, STEADY_SLIP) else "normal"
            parts.append(Part(name, kind, shape, unit, std, math.sqrt(variance), name in COMMON))
    return tuple(parts)


def _sources(nodes: Nodes, problem: Problem) -> Mapping[str, tuple[Kind, str, float]]:
    """Return how each source was evaluated, its unit, and its std in the filter."""
    noise, start = problem.noise, np.sqrt(np.diagonal(nodes.P0))
    accel = math.hypot(noise.accel, max(noise.accel_motion, noise.accel_stamps))
    ticks = np.sqrt(nodes.updates.R[nodes.updates.kind == "wheel"])
    return {
        LEVEL: ("B", "m/s²", float(start[BA])),
        TURN: ("B", "rad/s", float(start[BG])),
        ONLY: ("B", "m/s²", noise.motion_bias),
        WHITE: ("A", "m/s²/√Hz", accel),
        RATE: ("A", "rad/s/√Hz", math.hypot(noise.gyro, noise.gyro_motion)),
        COUNTS: ("B", "m", float(np.median(ticks)) if ticks.size else 0.0),
        VARYING: ("A", "1", problem.slip.scatter),
        STEADY_SLIP: ("B", "1", model.ANY_SLIP),
        GYRO_SCALE: ("B", "1", noise.gyro_scale),
        SHAKING: ("A", "m/s²", noise.vibration),
        LATE: ("B", "s", float(start[TAU])),
        SOFT: ("B", "s²", float(start[C])),
        SCALE: ("B", "1", float(start[K])),
        MEASURED["zero_velocity"]: ("B", "m/s", ZERO_VELOCITY),
        MEASURED["distance"]: ("B", "m", 0.0),
        MEASURED["reference_v"]: ("B", *_reference(nodes)),
        BEGUN[V]: ("B", "m/s", float(start[V])),
        WALKING[BA]: ("B", "m/s²/√s", noise.accel_walk),
        WALKING[BG]: ("B", "rad/s/√s", noise.gyro_walk),
    }


def _reference(nodes: Nodes) -> tuple[str, float]:
    """Return unit and std of an external reference: of its velocity if it has one, else of its position."""
    for kind, unit in (("reference_v", "m/s"), ("reference_x", "m")):
        variances = nodes.updates.R[nodes.updates.kind == kind]
        if variances.size:
            return unit, math.sqrt(float(np.median(variances)))
    return "m/s", 0.0


def _variances(nodes: Nodes, smoothed: Smoothed, towards: Array, i: int, j: int) -> dict[str, float]:
    """Return the variance of ``towards @ (x_j - x_i)`` by source, before any widening.

    With the noise w of the step that leads to the next node, the error of the smoothed state is
    e_k + A_k (e_s,k+1 + w - F e_k), e the filter's: weights pass forwards in time.
    """
    n, updates = nodes.t.size, nodes.updates
    weights, behind = np.zeros((2, n, model.SIZE))
    weights[i] -= towards
    weights[j] += towards
    for k in range(n - 1):
        behind[k + 1] = weights[k].dot(smoothed.gains[k])
        weights[k + 1] += behind[k + 1]
    weights[:-1] -= (behind[1:, None] @ nodes.F[1:])[:, 0]
    _, c, of_updates = adjoint(nodes, smoothed.innovations.gain, np.zeros(updates.R.size), weights)
    shares: dict[str, float] = defaultdict(float)
    for kind in dict.fromkeys(updates.kind.tolist()):
        of_kind = updates.kind == kind
        shares[MEASURED[kind]] += float(np.sum(of_updates[of_kind] ** 2 * updates.R[of_kind]))
    begun, origin = np.diagonal(nodes.P0).copy(), -float(nodes.P0[X, D])
    begun[[X, D]] -= origin  # of a reference's position, which both have in common
    shares[MEASURED["reference_x"]] += float((c[0, X] - c[0, D]) ** 2 * origin)
    for place, variance in enumerate(begun):
        shares[BEGUN[place]] += float(c[0, place] ** 2 * variance)
    _add_steps(shares, nodes, (behind - c)[1:])
    return shares


def _add_steps(shares: dict[str, float], nodes: Nodes, c: Array) -> None:
    """Add the shares of the noise of all steps, of weights c (K - 1, 14); its blocks are independent."""
    F, Q, w, dt = nodes.F[1:], nodes.Q[1:], nodes.w[1:], np.diff(nodes.t)

    def share(noise: Array, *states: int) -> float:
        weights = c[:, states]
        return float(np.einsum("ki,kij,kj->", weights, noise[:, states][:, :, states], weights))

    for place, name in WALKING.items():
        shares[name] += share(Q, place)
    shares[SHAKING] += share(Q, P, PD)
    # the distance that wheels turn ahead of the body is independent of the slip ratio
    by_slip = (np.abs(Q[:, D, S]) + np.abs(Q[:, D, G])) * 2.0 / 3.0 * np.abs(w) * dt
    ahead = float(np.sum(c[:, D] ** 2 * np.fmax(Q[:, D, D] - by_slip, 0.0)))
    shares[SOFT] += ahead
    shares[VARYING] += share(Q, D, S, G) - ahead
    turning, by_gyro = np.fmax(Q[:, TH, TH] - model.TINY[TH] ** 2, 0.0), np.zeros_like(Q)
    model.add_noise(by_gyro, turning, {TH: 1.0, V: F[:, V, TH], X: F[:, V, TH] * dt})
    rate = share(by_gyro, X, V, TH)
    shares[RATE] += rate
    shares[WHITE] += share(Q, X, V, TH) - rate
