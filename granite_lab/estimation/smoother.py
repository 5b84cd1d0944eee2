"""Kalman filter and Rauch-Tung-Striebel smoother over the nodes, and the passes over one trial."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any

import numpy as np
from filterpy.kalman import KalmanFilter
from scipy.linalg import blas
from scipy.special import gammaincinv

from granite_lab.estimate import Estimate
from granite_lab.estimation import error_model as model
from granite_lab.estimation.error_model import ANY_SLIP, BA, BG, SIZE, TAU, TH, C, D, S, Updates, V, X
from granite_lab.estimation.nodes import Nodes, build, pace_of
from granite_lab.estimation.nominal import AT_REST, Nominal, Start, integrate, quieten
from granite_lab.estimation.problem import Problem
from granite_lab.logs.trial import Array

_blas: Any = blas  # its types want keywords, with which a call takes up to three times as long
daxpy, ddot, dgemm, dgemv = _blas.daxpy, _blas.ddot, _blas.dgemm, _blas.dgemv
dsymm, dsymv, dsyr = _blas.dsymm, _blas.dsymv, _blas.dsyr

LOWER, UPPER = np.tril_indices(SIZE, -1)
"""Places of one triangle of a covariance."""

BLOCK = 2000
"""Nodes that are smoothed at once: their predicted covariances take 3 MB."""

SETTLED = 0.02
"""Pitch corrections below this need no other pass: its sine is linear to 2e-6 of g [rad]."""

PASSES = 4
"""Passes at most."""

WANDERS = 3.0
"""Slow innovations whose mean square is this many times the predicted one are no chance."""

STEADY_SLIP, GYRO_SCALE = "steady slip that no standstill shows", "scale error of the gyro"
"""Sources of errors that the filter leaves out."""

REFERENCES = ("reference_v", "reference_x")
"""Measurements of the body by an external reference."""

NOISY = ("wheel", "specific_force", "zero_rate", *REFERENCES)
"""Measurements whose noise grows where they miss their prediction. A standstill or a tape is exact: there the
prediction is to blame."""

WANDERING = ("wheel", "specific_force", "zero_rate")
"""Measurements whose slow innovations count, too: of wheels that wander against the IMU, of biases that drift
faster than their grade says. A reference bounds what these do to the velocity; its own errors are slow by
nature."""


@dataclass(frozen=True, eq=False)
class Innovations:
    """What each scalar measurement (U in all) brought.

    Attributes:
        updates: the measurements.
        value: (U,) measurement minus prediction.
        variance: (U,) predicted variance of it.
        gain: (U, 14) of the filter.
    """

    updates: Updates
    value: Array
    variance: Array
    gain: Array

    @property
    def log_likelihood(self) -> float:
        """Log-likelihood minus that of innovations which equal the std of their own measurement.

        So it does not depend on how many there are: filters over slightly different sets can be compared.
        """
        ratio = self.value**2 / self.variance
        return float(-0.5 * np.sum(ratio - 1.0 + np.log(self.variance / self.updates.R)))

    def fresh(self, kind: str) -> np.ndarray:
        """(U,) True for the measurements of a kind that tell anything new.

        At rest the state is frozen: zero-velocity updates after the first repeat it.
        """
        new = (kind != "zero_velocity") | (self.variance > 4.0 * self.updates.R)
        return np.asarray((self.updates.kind == kind) & new)


@dataclass(frozen=True, eq=False)
class Filtered:
    """States (K, 14) and covariances (K, 14, 14) after the measurements of each node; the innovations."""

    x: Array
    P: Array
    innovations: Innovations


@dataclass(frozen=True, eq=False)
class Smoothed(Filtered):
    """The same after all measurements.

    Attributes:
        gains: (K, 14, 14) smoother gains; the covariance of nodes i < j is
            gains[i] ... gains[j - 1] P[j], but for `common`.
        common: by its source, (K, 14) one std of an error that all nodes share and the filter does not know;
            in P already.
    """

    gains: Array
    common: Mapping[str, Array] = field(default_factory=dict)

    def cross(self, i: int, j: int) -> Array:
        """(14, 14) covariance of the states at nodes i <= j."""
        total = np.eye(SIZE)
        for k in range(i, j):
            total = total @ self.gains[k]
        shared = np.reshape([error[[i, j]] for error in self.common.values()], (-1, 2, SIZE))
        first, second = shared[:, 0], shared[:, 1]
        return np.asarray(total @ (self.P[j] - second.T @ second) + first.T @ second)

    def std_of_change(self, weights: Array, i: int, j: int) -> float:
        """Return the std of ``weights @ (x[j] - x[i])``, for `weights` (14,) and nodes i <= j."""
        cross = self.cross(i, j)
        variance = weights @ (self.P[i] + self.P[j] - cross - cross.T) @ weights
        return float(np.sqrt(max(variance, 0.0)))


@dataclass(frozen=True, eq=False)
class Settled:
    """The last pass, not smoothed yet.

    Attributes:
        problem: what the filter was given, with the variances and the compliance of this pass.
        nominal, nodes, by_filter: nominal motion, nodes about it, and what the filter found.
        near: by which the wheels' stamps were moved [s].
    """

    problem: Problem
    nominal: Nominal
    nodes: Nodes
    by_filter: Filtered
    near: float


@dataclass(frozen=True, eq=False)
class Solution(Settled):
    """The last pass, smoothed.

    Attributes:
        smoothed: the drift.
        offset: of the encoders' clock [s].
        applied: how much of it was known beforehand [s]; the rest was left to the filter.
    """

    smoothed: Smoothed
    offset: Estimate
    applied: float = 0.0

    @property
    def travelled(self) -> Array:
        """(K,) distance of the body at the nodes [m]."""
        drift = self.smoothed.x
        return np.asarray(self.nominal.x[self.nodes.index] + drift[:, X] - drift[:, model.P])

    def at_stamps(self, values: Array) -> Array:
        """(N,) values at the IMU's stamps, from those at the nodes (K,)."""
        return np.interp(self.nominal.t, self.nodes.t, values)


def forward(nodes: Nodes) -> Filtered:
    """Filter over all nodes, eight times as fast as `filtered`: for likelihoods, offsets and passes.

    Measurements are scalar, so no matrix is inverted. BLAS works on one triangle of each covariance, in
    place; the other is filled in at the end, so that rounding cannot make a covariance unsymmetric.
    """
    n, updates = nodes.t.size, nodes.updates
    xs, Ps, lifted = np.zeros((n, SIZE)), nodes.Q.copy(), np.empty_like(updates.H)
    xs[0], Ps[0] = nodes.x0[:, 0], nodes.P0
    came = []
    measured = zip(updates.H, updates.z.tolist(), updates.R.tolist(), lifted, strict=True)
    steps = zip(xs, *(m.transpose(0, 2, 1) for m in (Ps, nodes.F)), updates.counts(n), strict=True)
    x0, P0 = xs[0], Ps[0].T
    for k, (x, P, F, count) in enumerate(steps):
        if k:  # BLAS counts columns first: F is the transpose of the transition
            dgemv(1.0, F, x0, 0.0, x, 0, 1, 0, 1, 1, 1)  # F x
            dgemm(1.0, F, dsymm(1.0, P0, F), 1.0, P, 1, 0, 1)  # F P F^T + Q
        for h, z, R, Ph in islice(measured, count):
            dsymv(1.0, P, h, 0.0, Ph, 0, 1, 0, 1, 0, 1)
            variance, innovation = ddot(h, Ph) + R, z - ddot(h, x)
            daxpy(Ph, x, SIZE, innovation / variance)
            dsyr(-1.0 / variance, Ph, 0, 1, 0, SIZE, P, 1)
            came.append((innovation, variance))
        x0, P0 = x, P
    Ps[:, UPPER, LOWER] = Ps[:, LOWER, UPPER]
    value, variance = np.array(came, dtype=float).reshape(-1, 2).T
    return Filtered(xs, Ps, Innovations(updates, value, variance, lifted / variance[:, None]))


def adjoint(nodes: Nodes, gain: Array, given: Array, added: Array) -> tuple[Array, Array, Array]:
    """Pass weights backwards through the filter, from each node to the one before.

    Of the measurements `gain` (U, 14) is the filter's, `given` (U,) a weight beside that by their gain.

    Returns:
        (K, 14) weights of the states after the measurements of each node, with those that are `added`
        (K, 14) there, and of the states before them; (U,) weights of the measurements.
    """
    after, weights_of = added.copy(), given.copy()
    before = np.empty_like(after)
    measured = zip(range(weights_of.size - 1, -1, -1), nodes.updates.H[::-1], gain[::-1], strict=True)
    turned, counts = nodes.F.transpose(0, 2, 1), nodes.updates.counts(len(after))
    for k in range(len(after) - 1, -1, -1):
        weight = before[k]
        weight[:] = after[k]
        for j, h, gains in islice(measured, counts[k]):
            weights_of[j] += ddot(gains, weight)
            daxpy(h, weight, SIZE, -weights_of[j])
        if k:
            dgemv(1.0, turned[k], weight, 1.0, after[k - 1], 0, 1, 0, 1, 0, 1)  # F^T
    return after, before, weights_of


def smoothed_states(nodes: Nodes, by_filter: Filtered) -> Array:
    """(K, 14) smoothed states alone, without inverting a matrix (Bryson & Frazier 1963)."""
    came = by_filter.innovations
    weights, _, _ = adjoint(nodes, came.gain, came.value / came.variance, np.zeros_like(by_filter.x))
    return np.asarray(by_filter.x - (by_filter.P @ weights[:, :, None])[:, :, 0])


def filtered(nodes: Nodes, innovations: Innovations) -> Filtered:
    """Filter over all nodes by filterpy, for the published estimate; `innovations` are those of `forward`.

    Measurements are scalar: the inverse of their variance is its reciprocal.
    """
    n, updates = nodes.t.size, nodes.updates
    kalman = KalmanFilter(dim_x=SIZE, dim_z=1)
    kalman.x, kalman.P, kalman.inv = nodes.x0.copy(), nodes.P0.copy(), np.reciprocal
    xs, Ps = np.empty((n, SIZE)), np.empty((n, SIZE, SIZE))
    H, z, R = updates.H[:, None], updates.z[:, None, None], updates.R[:, None, None]
    measured = zip(z, R, H, strict=True)
    for k, count in enumerate(updates.counts(n)):
        if k:
            kalman.predict(F=nodes.F[k], Q=nodes.Q[k])
        for measurement in islice(measured, count):
            kalman.update(*measurement)
        xs[k], Ps[k] = kalman.x[:, 0], kalman.P
    return Filtered(xs, Ps, innovations)


def backward(nodes: Nodes, by_filter: Filtered) -> Smoothed:
    """Smooth backwards by filterpy (Rauch, Tung & Striebel 1965); F and Q lead *into* each node.

    Blocks of nodes share their first and last one, so that predicted covariances need no memory.
    """
    kalman = KalmanFilter(dim_x=SIZE, dim_z=1)
    x, P = by_filter.x.copy(), by_filter.P.copy()
    n = x.shape[0]
    gains = np.zeros_like(P)
    for end in range(n, 1, -BLOCK):
        part = slice(max(end - BLOCK - 1, 0), end)
        F, Q = nodes.F[part], nodes.Q[part]
        # filterpy asks for the inverses one by one, from the last on; all at once they are found sooner
        inverses = iter(_inverses(F[1:] @ P[part][:-1] @ F[1:].transpose(0, 2, 1) + Q[1:])[::-1])
        x[part], _, gain, _ = kalman.rts_smoother(x[part], P[part], F, Q, lambda _: next(inverses))  # noqa: B023
        gains[part][:-1] = gain[:-1]
        _smooth(P[part], gain[:-1], F[1:], Q[1:])
    P = 0.5 * (P + P.transpose(0, 2, 1))
    return Smoothed(x, P, by_filter.innovations, gains)


def _smooth(P: Array, gains: Array, F: Array, Q: Array) -> None:
    """Smooth covariances (K, 14, 14) in place by (K-1, 14, 14) gains.

    The sum of three products stays positive. The usual difference of two covariances does not where they are
    nearly alike, as at the first nodes.
    """
    left = np.eye(SIZE) - gains @ F
    P[:-1] = left @ P[:-1] @ left.transpose(0, 2, 1) + gains @ Q @ gains.transpose(0, 2, 1)
    for k in range(len(gains) - 1, -1, -1):
        P[k] += gains[k] @ P[k + 1] @ gains[k].T


def _inverses(covariances: Array) -> Array:
    """(K, 14, 14) inverses of covariances whose variances differ by many powers of ten."""
    scale = 1.0 / np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    weight = scale[:, :, None] * scale[:, None, :]
    return np.asarray(np.linalg.inv(covariances * weight) * weight)


def with_steady_slip(solution: Solution) -> Solution:
    """Add the effect of a steady slip ratio, std `ANY_SLIP`, which the filter leaves out."""
    nodes = solution.nodes
    error = np.zeros((nodes.t.size, SIZE))
    error[:, S] = ANY_SLIP
    slipped = np.where(nodes.moving, nodes.w, 0.0) * np.diff(nodes.t, prepend=nodes.t[0])
    error[:, D] = ANY_SLIP * np.cumsum(slipped)
    return with_common(solution, STEADY_SLIP, error)


def with_gyro_scale(solution: Solution, scale: float) -> Solution:
    """Add the effect of a scale error of the pitch gyro, of the std `scale` [-], which the filter leaves out.

    The pitch is off by this share of its change since the start, by which gravity drives the velocity.
    """
    nodes, pitch = solution.nodes, solution.nominal.pitch[solution.nodes.index]
    error = np.zeros((nodes.t.size, SIZE))
    error[:, TH] = scale * (pitch - pitch[0])
    middle = 0.5 * (error[1:, TH] + error[:-1, TH])
    error[1:, V] = np.cumsum(nodes.F[1:, V, TH] * middle)
    error[1:, X] = np.cumsum(nodes.F[1:, X, TH] * middle + nodes.F[1:, X, V] * error[:-1, V])
    return with_common(solution, GYRO_SCALE, error)


def with_common(solution: Solution, source: str, error: Array) -> Solution:
    """Add the effect of an `error` (K, 14), one std of it, that the filter leaves out (Schmidt 1966).

    The estimate is linear in its measurements: it is made again from those that the error alone would give,
    and what it misses of the error is added to the covariance.
    """
    nodes, smoothed, given = solution.nodes, solution.smoothed, solution.nodes.updates
    updates = replace(given, z=np.vecdot(given.H, error[given.node]))
    missed = smoothed_states(nodes, forward(replace(nodes, updates=updates, x0=np.zeros((SIZE, 1))))) - error
    P = smoothed.P + missed[:, :, None] * missed[:, None, :]
    return replace(solution, smoothed=replace(smoothed, P=P, common={**smoothed.common, source: missed}))


def nominal_of(problem: Problem, offset: float, start: Start = AT_REST) -> Nominal:
    """Integrate the IMU of a trial, or of a part of one: from rest, else from the wheels' velocity."""
    t0 = problem.imu.t[0]
    if problem.rolling is not None and not any(begin <= t0 + 0.05 for begin, _ in problem.rests):
        start = start._replace(velocity=float(problem.rolling.speed_at(t0, offset)))
    return integrate(problem.imu, problem.robot, problem.rests, problem.faults, start)


def settle(
    problem: Problem, offset: Estimate, *, near: float | None = None, distance: Estimate | None = None,
    robust: bool = True,
) -> Settled:  # fmt: skip
    """Filter, each pass about the last one's result.

    Relinearising matters for gravity's share of a large pitch; one or two passes settle it. Another one
    follows where the first shows that the wheels turn ahead of the body as thrust grows, or that a kind of
    measurement misses its prediction by more than its noise, which then grows by as much.

    `offset` of the wheels' clock is as expected; what is left of it is a state of the filter (nothing by a
    std of NaN). All stamps of the wheels are moved by `near` [s], by default as expected. Without `robust` no
    noise grows, so that likelihoods can be compared.
    """
    start = AT_REST
    at, std = offset.value if near is None else near, offset.std if np.isfinite(offset.std) else 1e-6
    for more in range(PASSES - 1, -1, -1):
        nominal = nominal_of(problem, at, start)
        if problem.rolling is not None:
            steady = pace_of(problem.rolling, at, nominal.t).steady
            nominal = quieten(nominal, steady, problem.noise.vibration_frequency)
        nodes = build(problem, nominal, at, Estimate(offset.value - at, std), distance)
        by_filter = forward(nodes)
        x = smoothed_states(nodes, by_filter)
        level = float(np.max(np.abs(x[:, TH]))) < SETTLED
        # a compliance beyond what the walk allows for calls for another pass
        compliance = max(abs(float(x[-1, C])), problem.compliance)
        sizes = mismatch(by_filter.innovations) if robust else {}
        grown = {kind: sizes[kind] for kind in NOISY if sizes.get(kind, 1.0) > 1.0}
        if not more or (level and compliance == problem.compliance and not grown):
            break
        factors = problem.variance_factors
        factors = {**factors, **{kind: nis * factors.get(kind, 1.0) for kind, nis in grown.items()}}
        problem = replace(problem, variance_factors=factors, compliance=compliance)
        if not level:
            middle = x[x.shape[0] // 2]
            start = Start(
                accel_bias=start.accel_bias + float(middle[BA]),
                gyro_bias=nominal.gyro_bias + float(middle[BG]),
                pitch=start.pitch + float(x[0, TH]),
            )
    return Settled(problem, nominal, nodes, by_filter, at)


def smooth(last: Settled) -> Solution:
    """Smooth the last pass; innovations larger than expected widen every std."""
    smoothed = backward(last.nodes, filtered(last.nodes, last.by_filter.innovations))
    smoothed = replace(smoothed, P=smoothed.P * widening(smoothed.innovations))
    offset = Estimate(last.near + float(smoothed.x[-1, TAU]), float(np.sqrt(smoothed.P[-1, TAU, TAU])))
    return Solution(**vars(last), smoothed=smoothed, offset=offset)


def mismatch(came: Innovations) -> dict[str, float]:
    """Return how much larger than predicted the innovations of each kind are, squared; 1 within chance.

    It is the mean normalised innovation squared without the largest hundredth; successive innovations
    correlate, so one in ten counts.
    """
    sizes = {}
    for kind in dict.fromkeys(came.updates.kind.tolist()):
        counts = came.fresh(kind)
        ratio = np.sort(came.value[counts] ** 2 / came.variance[counts])
        ratio = ratio[: ratio.size - ratio.size // 100]
        nis = float(np.mean(ratio)) if ratio.size else 1.0
        sizes[kind] = nis if nis > usual(max(ratio.size // 10, 1)) else 1.0
    return sizes


def widening(came: Innovations) -> float:
    """Factor on all variances, by the kind of measurement that misses its prediction most."""
    sizes, wander = mismatch(came), 0.0
    if not sizes.keys() & {*REFERENCES}:
        ratio = came.value / np.sqrt(came.variance)
        wander = max(slow_excess(ratio[came.fresh(kind)]) for kind in WANDERING)
    return max([*sizes.values(), wander if wander > WANDERS else 1.0])


def slow_excess(ratio: Array) -> float:
    """Mean square of slow innovations over the predicted one, by normalised ones (U,) in their order.

    Where successive ones correlate by r, as autoregressive noise does, their density at low frequencies is
    (1 + r) / (1 - r) times that of white noise, which is what adds up over many samples.
    """
    r = min(correlation(ratio), 0.999)
    if np.isnan(r):
        return 0.0
    if abs(r) < 3.0 / np.sqrt(ratio.size):  # of white noise by chance
        r = 0.0
    return float(np.mean(ratio**2)) * (1.0 + r) / (1.0 - r)


def correlation(ratio: Array, lag: int = 1) -> float:
    """Correlation of normalised innovations a lag apart; 0 is white, NaN for fewer than eight."""
    if ratio.size < 8 or not np.any(ratio):
        return float("nan")
    return float(np.sum(ratio[lag:] * ratio[:-lag]) / np.sum(ratio**2))


def usual(n: int) -> float:
    """Mean of n squared standard normal numbers that one in a thousand exceeds."""
    return float(2.0 * gammaincinv(0.5 * n, 0.999) / n)
