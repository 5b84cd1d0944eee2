"""Kalman filter and Rauch-Tung-Striebel smoother over the nodes, and the passes over one trial."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaincinv

from granite_lab.estimate import Estimate
from granite_lab.estimation.error_model import BA, BG, SIZE, TAU, TH, UNKNOWN, C, D, S
from granite_lab.estimation.nodes import Nodes, Problem, build, pace_of
from granite_lab.estimation.nominal import Nominal, integrate, quieten
from granite_lab.logs.trial import Array

BLOCK = 2000
"""Nodes whose matrices are inverted at once."""

SETTLED = 0.02
"""Pitch corrections below this need no other pass: its sine is linear to 2e-6 of g [rad]."""

PASSES = 4
"""Passes at most."""

NOISY = ("wheel", "specific_force", "zero_rate")
"""Measurements whose noise grows where they miss their prediction. A standstill or a tape is exact: there the
prediction is to blame."""


@dataclass(frozen=True, eq=False)
class Innovations:
    """What each scalar measurement (U in all) brought, in the order the filter took them.

    Attributes:
        node: (U,) at which node.
        kind: (U,) which measurement.
        value: (U,) measurement minus prediction.
        variance: (U,) predicted variance of it.
        noise: (U,) variance of the measurement alone.
        gain: (U, 14) of the filter.
    """

    node: np.ndarray
    kind: tuple[str, ...]
    value: Array
    variance: Array
    noise: Array
    gain: Array

    @property
    def log_likelihood(self) -> float:
        """Log-likelihood, counted so that a measurement as good as its noise, and none at all, give 0.

        Then filters over slightly different sets of measurements can be compared.
        """
        ratio = self.value**2 / self.variance
        return float(-0.5 * np.sum(ratio - 1.0 + np.log(self.variance / self.noise)))

    def fresh(self, kind: str) -> np.ndarray:
        """(U,) True for the measurements of a kind that tell anything new.

        At rest the state is frozen: zero-velocity updates after the first repeat it.
        """
        return np.array([k == kind for k in self.kind], dtype=bool) & (
            (kind != "zero_velocity") | (self.variance > 4.0 * self.noise)
        )


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Joint estimate of the drift.

    Attributes:
        x: (K, 14) smoothed states.
        P: (K, 14, 14) their covariance.
        gains: (K, 14, 14) smoother gains; the covariance of nodes i < j is
            gains[i] ... gains[j - 1] P[j], but for `common`.
        innovations: of the filter.
        common: (K, 14) one std of an error that all nodes share and the filter does not know; in P already.
    """

    x: Array
    P: Array
    gains: Array
    innovations: Innovations
    common: Array

    def cross(self, i: int, j: int) -> Array:
        """(14, 14) covariance of the states at nodes i <= j."""
        total = np.eye(SIZE)
        for k in range(i, j):
            total = total @ self.gains[k]
        one, other = self.common[i], self.common[j]
        return np.asarray(total @ (self.P[j] - np.outer(other, other)) + np.outer(one, other))


@dataclass(frozen=True, eq=False)
class Solution:
    """The last pass: nominal motion, nodes and smoothed drift.

    Attributes:
        offset: of the encoders' clock [s].
        applied: how much of it was known beforehand [s]; the rest was left to the filter.
        compliance: by which the displacement between wheels and body walked [s^2].
    """

    nominal: Nominal
    nodes: Nodes
    smoothed: Smoothed
    offset: Estimate
    applied: float
    compliance: float


def forward(nodes: Nodes) -> tuple[Array, Array, Innovations]:
    """Filter over all nodes; states (K, 14) and covariances (K, 14, 14) after each, innovations as they came.

    Measurements are scalar, so no matrix is inverted. Rounding makes the covariance unsymmetric, more
    so with each node, and after half an hour indefinite, unless it is made symmetric again.
    """
    n = nodes.t.size
    x, P = nodes.x0[:, 0].copy(), nodes.P0.copy()
    xs, Ps = np.empty((n, SIZE)), np.empty((n, SIZE, SIZE))
    places: list[tuple[int, str]] = []
    came: list[tuple[float, float, float]] = []
    gains: list[Array] = []
    for k, (F, Q, updates) in enumerate(zip(nodes.F, nodes.Q, nodes.updates, strict=True)):
        if k:
            x = F.dot(x)
            P = F.dot(P).dot(F.T)
            P += Q
            P = P + P.T
            P *= 0.5
        for update in updates:
            h = update.H[0]
            Ph = P.dot(h)
            variance = float(h.dot(Ph)) + update.R
            innovation = update.z - float(h.dot(x))
            gain = Ph / variance
            x = x + gain * innovation
            P = P - Ph[:, None] * gain
            places.append((k, update.kind))
            came.append((innovation, variance, update.R))
            gains.append(gain)
        xs[k], Ps[k] = x, P
    node, kind = np.array([k for k, _ in places], dtype=int), tuple(kind for _, kind in places)
    value, variances, noise = np.array(came, dtype=float).reshape(-1, 3).T
    gained = np.array(gains, dtype=float).reshape(-1, SIZE)
    return xs, Ps, Innovations(node, kind, value, variances, noise, gained)


def merged(nodes: Nodes) -> Nodes:
    """Return nodes of which each, but for the first, measures something: steps between them are put together.

    The filter finds the same in them, sooner.
    """
    ends = np.flatnonzero([k == 0 or len(updates) > 0 for k, updates in enumerate(nodes.updates)])
    begins = np.concatenate([[0], ends[:-1] + 1])
    F, Q = nodes.F[begins], nodes.Q[begins]
    for j in range(1, int(np.max(ends - begins)) + 1):
        longer = begins + j <= ends
        step = nodes.F[begins[longer] + j]
        F[longer] = step @ F[longer]
        Q[longer] = step @ Q[longer] @ step.transpose(0, 2, 1) + nodes.Q[begins[longer] + j]
    names = ("index", "t", "moving", "lost", "mean_slip", "w")
    kept = {name: getattr(nodes, name)[ends] for name in names}
    return replace(nodes, F=F, Q=Q, updates=tuple(nodes.updates[k] for k in ends), **kept)


def run(nodes: Nodes) -> Smoothed:
    """Filter forwards, smooth backwards (Rauch, Tung & Striebel 1965); F and Q lead *into* each node."""
    x, P, innovations = forward(nodes)
    n = x.shape[0]
    gains = np.zeros_like(P)
    for end in range(n - 1, 0, -BLOCK):
        begin = max(end - BLOCK, 0)
        F = nodes.F[begin + 1 : end + 1]
        lifted = P[begin:end] @ F.transpose(0, 2, 1)
        ahead = F @ lifted + nodes.Q[begin + 1 : end + 1]
        # variances differ by many powers of ten
        scale = 1.0 / np.sqrt(np.diagonal(ahead, axis1=1, axis2=2))
        weight = scale[:, :, None] * scale[:, None, :]
        gains[begin:end] = lifted @ (np.linalg.inv(ahead * weight) * weight)
        predicted = (F @ x[begin:end, :, None])[:, :, 0]
        for k in range(end - 1, begin - 1, -1):
            gain = gains[k]
            x[k] += gain.dot(x[k + 1] - predicted[k - begin])
            P[k] += gain.dot(P[k + 1] - ahead[k - begin]).dot(gain.T)
    return Smoothed(x=x, P=P, gains=gains, innovations=innovations, common=np.zeros_like(x))


def with_steady_slip(nodes: Nodes, found: Smoothed) -> Smoothed:
    """Add the effect of a steady slip ratio of the std `UNKNOWN`, which the filter leaves out (Schmidt 1966).

    The estimate is linear in its measurements: it is made again from those that the error alone would give,
    and what it misses of the error is added to the covariance.
    """
    error = np.zeros((nodes.t.size, SIZE))
    error[:, S] = UNKNOWN
    slipped = np.where(nodes.moving, nodes.w, 0.0) * np.diff(nodes.t, prepend=nodes.t[0])
    error[:, D] = UNKNOWN * np.cumsum(slipped)
    updates = tuple(
        tuple(replace(update, z=float(update.H[0] @ state)) for update in several)
        for several, state in zip(nodes.updates, error, strict=True)
    )
    missed = run(replace(nodes, updates=updates, x0=np.zeros((SIZE, 1)))).x - error
    return replace(found, P=found.P + missed[:, :, None] * missed[:, None, :], common=missed)


def first_velocity(problem: Problem, offset: float) -> float:
    """Velocity to start the integration from: zero at rest, else the wheels' [m/s]."""
    t0 = problem.imu.t[0]
    if problem.rolling is None or any(begin <= t0 + 0.05 for begin, _ in problem.rests):
        return 0.0
    known = np.isfinite(problem.rolling.speed)
    return float(np.interp(t0, problem.rolling.t[known] + offset, problem.rolling.speed[known]))


def nominal_of(problem: Problem, offset: float) -> Nominal:
    """Integrate the IMU of a trial, or of a part of one, with no bias known beforehand."""
    velocity = first_velocity(problem, offset)
    return integrate(problem.imu, problem.robot, problem.rests, problem.faults, velocity=velocity)


def solve(
    problem: Problem, offset: Estimate, *, near: float | None = None, distance: Estimate | None = None,
    robust: bool = True,
) -> Solution:  # fmt: skip
    """Filter and smooth, each pass about the last one's result.

    Relinearising matters for gravity's share of a large pitch; one or two passes settle it. Another one
    follows where the first shows that the wheels turn ahead of the body as thrust grows, or that a kind of
    measurement misses its prediction by more than its noise, which then grows by as much. What is too large
    in the last pass too widens the std of everything.

    `offset` of the wheels' clock is as expected; what is left of it is a state of the filter (nothing by a
    std of NaN). All stamps of the wheels are moved by `near` [s], by default as expected. Without `robust` no
    noise grows, so that likelihoods can be compared.
    """
    accel_bias, gyro_bias, pitch = 0.0, None, 0.0
    at, std = offset.value if near is None else near, offset.std if np.isfinite(offset.std) else 1e-6
    velocity = first_velocity(problem, at)
    for i in range(PASSES):
        nominal = integrate(
            problem.imu, problem.robot, problem.rests, problem.faults, accel_bias=accel_bias,
            gyro_bias=gyro_bias, pitch=pitch, velocity=velocity,
        )  # fmt: skip
        if problem.rolling is not None:
            steady = pace_of(problem.rolling, at, nominal.t).steady
            nominal = quieten(nominal, steady, problem.noise.vibration_frequency)
        nodes = build(problem, nominal, at, Estimate(offset.value - at, std), distance)
        found = run(nodes)
        level = float(np.max(np.abs(found.x[:, TH]))) < SETTLED
        # a compliance beyond what the walk allows for calls for another pass
        compliance = abs(float(found.x[-1, C]))
        stiff = compliance < problem.compliance
        sizes = mismatch(found.innovations) if robust else {}
        too_large = {kind: sizes[kind] for kind in NOISY if sizes.get(kind, 1.0) > 1.0}
        if i == PASSES - 1 or (level and stiff and not too_large):
            break
        louder = {kind: nis * problem.louder.get(kind, 1.0) for kind, nis in too_large.items()}
        problem = replace(problem, louder={**problem.louder, **louder})
        if not stiff:
            problem = replace(problem, compliance=compliance)
        if not level:
            middle = found.x[found.x.shape[0] // 2]
            accel_bias += float(middle[BA])
            gyro_bias = nominal.gyro_bias + float(middle[BG])
            pitch += float(found.x[0, TH])
    found = replace(found, P=found.P * widening(found.innovations))
    refined = Estimate(at + float(found.x[-1, TAU]), float(np.sqrt(found.P[-1, TAU, TAU])))
    return Solution(nominal, nodes, found, refined, offset.value, problem.compliance)


def mismatch(came: Innovations) -> dict[str, float]:
    """Return how much larger than predicted the innovations of each kind are, squared; 1 within chance.

    It is the mean normalised innovation squared without the largest hundredth; successive innovations
    correlate, so one in ten counts.
    """
    found = {}
    for kind in dict.fromkeys(came.kind):
        counts = came.fresh(kind)
        ratio = np.sort(came.value[counts] ** 2 / came.variance[counts])
        ratio = ratio[: ratio.size - ratio.size // 100]
        nis = float(np.mean(ratio)) if ratio.size else 1.0
        found[kind] = nis if nis > usual(max(ratio.size // 10, 1)) else 1.0
    return found


def widening(came: Innovations) -> float:
    """Factor on all variances, by the kind of measurement that misses its prediction most."""
    return max(mismatch(came).values(), default=1.0)


def usual(n: int) -> float:
    """Mean of n squared standard normal numbers that one in a thousand exceeds."""
    return float(2.0 * gammaincinv(0.5 * n, 0.999) / n)
