"""What the wheel encoders say: rolled distances, circumferential velocities and their noise.

Everything here is on the encoders' own clock. Distances are of the tread, angle times radius.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from granite_lab.estimation.differentiation import MOVING, slope, stamp_scatter
from granite_lab.logs.trial import Array, WheelStream
from granite_lab.parameters import WHEELS, Robot

STUCK_AFTER = 0.25
"""A wheel without a count for this long [s], while the others roll, is taken for a dead encoder."""


@dataclass(frozen=True, eq=False)
class Rolling:
    """Wheel motion at the encoders' stamps.

    Attributes:
        t: (M,) stamps [s].
        distance: (M, 4) rolled distance of each wheel since the first sample [m], NaN where unknown.
        mean: (M,) rolled distance, mean of the left and right sides [m].
        mean_std: (M,) std of one sample of `mean` [m] (quantisation and stamps).
        velocity, velocity_std: (M, 4) circumferential velocity v_o of each wheel [m/s].
        speed, speed_std: (M,) velocity of `mean` [m/s].
        by_rate: the logger gave rates; distances are their integrals and not measurements.
        step: smallest step of a wheel's distance [m] (of its velocity [m/s] if by_rate).
        jitter: std of the stamps, from the scatter of the distances about a smooth motion [s].
        warnings: doubts, one line each.
    """

    t: Array
    distance: Array
    mean: Array
    mean_std: Array
    velocity: Array
    velocity_std: Array
    speed: Array
    speed_std: Array
    by_rate: bool
    step: float
    jitter: float
    warnings: tuple[str, ...] = ()

    def shifted(self, offset: float) -> Array:
        """(M,) stamps on the IMU's clock [s], when the encoders' clock lies behind by `offset`."""
        return self.t + offset

    def part(self, keep: np.ndarray | slice) -> Rolling:
        """Return some of the samples."""
        rows = ("t", "distance", "mean", "mean_std", "velocity", "velocity_std", "speed", "speed_std")
        return replace(self, **{name: getattr(self, name)[keep] for name in rows})

    def thinned(self, apart: float) -> Rolling:
        """Return every so many samples, at least `apart` [s] from each other."""
        return self.part(slice(None, None, max(round(apart / float(np.median(np.diff(self.t)))), 1)))


def bridge(t: Array, angle: Array) -> Array:
    """Fill the cells of wheels that are sampled at other rows; longer gaps than 3 periods stay NaN."""
    filled = angle.copy()
    for i in range(angle.shape[1]):
        known = np.flatnonzero(np.isfinite(angle[:, i]))
        if known.size < 2 or known.size == t.size:
            continue
        period = float(np.median(np.diff(t[known])))
        after = np.searchsorted(known, np.arange(t.size))
        inside = (after > 0) & (after < known.size)
        gap = np.full(t.size, np.inf)
        gap[inside] = t[known[after[inside]]] - t[known[after[inside] - 1]]
        use = inside & (gap <= 3.0 * period) & ~np.isfinite(angle[:, i])
        filled[use, i] = np.interp(t[use], t[known], angle[known, i])
    return filled


def mask_dead(t: Array, distance: Array) -> tuple[Array, list[str]]:
    """Blank a wheel where it gives no count, or jumps, while the others roll.

    Returns:
        (M, 4) increments to each sample from the one before [m], NaN where not to be used; warnings.
    """
    step = np.diff(distance, axis=0, prepend=np.full((1, distance.shape[1]), np.nan))
    dt = np.diff(t, prepend=t[0] - 1.0)
    warnings = []
    with np.errstate(invalid="ignore"):
        live = np.isfinite(step).sum(axis=1)
        middle = _median(step)
        wild = np.abs(step - middle[:, None]) > 3.0 * dt[:, None] + 0.05
    step[wild & (live >= 3)[:, None]] = np.nan
    for i, wheel in enumerate(WHEELS):
        if not np.isfinite(step[:, i]).any():
            continue
        others = np.delete(step, i, axis=1)
        rolling = np.nan_to_num(_median(others)) > MOVING * dt
        rolling |= np.nan_to_num(-_median(others)) > MOVING * dt
        stuck = (np.abs(np.nan_to_num(step[:, i], nan=0.0)) == 0.0) & rolling
        begin, end = runs(stuck)
        dead = 0.0
        for a, b in zip(begin, end, strict=True):
            if t[b - 1] - t[max(a - 1, 0)] >= STUCK_AFTER:
                step[a : b + 1, i] = np.nan  # the sample after it may hold the missed counts at once
                dead += t[b - 1] - t[max(a - 1, 0)]
        if dead > 0:
            warnings.append(
                f"encoder {wheel} gives no counts for {dead:.2f} s while the others turn: not used there"
            )
    return step, warnings


def _median(values: Array) -> Array:
    """Median over the wheels, NaN where none is known, without a warning."""
    ordered = np.sort(values, axis=1)  # NaN last
    n = np.isfinite(values).sum(axis=1)
    rows = np.arange(values.shape[0])
    low = ordered[rows, np.maximum((n - 1) // 2, 0)]
    high = ordered[rows, np.minimum(n // 2, values.shape[1] - 1)]
    return np.where(n > 0, 0.5 * (low + high), np.nan)


def runs(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return first indices and one-past-last indices of the stretches where mask holds."""
    edge = np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))
    return np.flatnonzero(edge == 1), np.flatnonzero(edge == -1)


def side_mean(values: Array) -> Array:
    """Mean of the left and right sides' means, so that a missing wheel does not look like a turn."""
    left, right = _mean(values[:, [0, 2]]), _mean(values[:, [1, 3]])
    both = np.stack([left, right], axis=1)
    return _mean(both)


def _mean(values: Array) -> Array:
    n = np.isfinite(values).sum(axis=1)
    total = np.where(np.isfinite(values), values, 0.0).sum(axis=1)
    return np.where(n > 0, total / np.maximum(n, 1), np.nan)


def roll(stream: WheelStream, robot: Robot) -> Rolling:
    """Turn encoder angles into rolled distances and velocities with their std.

    The noise of one sample is q^2/12 (which makes q^2/(6 dt^2) in a difference) and, while rolling,
    the velocity times the scatter of the stamps, found from how the distances scatter about a
    locally smooth motion; the robot's file is the floor of the former.
    """
    radius, t = robot.wheels.radius, stream.t
    q = (
        stream.step
        if stream.step > 0
        else 2 * np.pi / robot.encoders.counts
        if robot.encoders.counts
        else 0.0
    )
    by_rate = stream.rate is not None
    if stream.rate is not None:
        return _roll_rates(stream, robot, q * radius)
    distance = bridge(t, stream.angle) * radius
    increment, warnings = mask_dead(t, distance)
    mean_step = side_mean(increment)
    lost = ~np.isfinite(mean_step)
    lost[0] = False
    mean = np.cumsum(np.nan_to_num(mean_step))
    mean[lost] = np.nan
    q *= radius
    quantum = max(q, 1e-6)
    n_live = np.maximum(np.isfinite(increment).sum(axis=1), 1)
    rough, _ = slope(t, np.nan_to_num(mean, nan=0.0), np.full(t.size, quantum / np.sqrt(12)))
    jitter = stamp_scatter(t, mean, rough, quantum)
    speed, speed_std = slope(t, np.nan_to_num(mean), _sigma(quantum, n_live, jitter, rough))
    sigma = _sigma(quantum, n_live, jitter, speed)
    velocity, velocity_std = np.full_like(distance, np.nan), np.full_like(distance, np.nan)
    for i in range(distance.shape[1]):
        use = np.isfinite(increment[:, i])
        use[1:-1] &= use[:-2] | use[2:]
        use[0] = np.isfinite(distance[0, i]) and use[1:2].any()
        for a, b in zip(*runs(use), strict=True):
            if b - a < 3:
                continue
            part = slice(a, b)
            one = _sigma(quantum, 1, jitter, speed[part])
            own = np.concatenate([[0.0], np.cumsum(increment[a + 1 : b, i])])
            velocity[part, i], velocity_std[part, i] = slope(t[part], own, one)
    speed[~np.isfinite(mean)] = np.nan
    return Rolling(
        t=t, distance=np.where(np.isfinite(increment), distance - _first(distance), np.nan), mean=mean,
        mean_std=sigma, velocity=velocity, velocity_std=velocity_std, speed=speed, speed_std=speed_std,
        by_rate=by_rate, step=q, jitter=jitter, warnings=tuple(warnings),
    )  # fmt: skip


def _roll_rates(stream: WheelStream, robot: Robot, step: float) -> Rolling:
    """Take logged rates as velocities; the distances are their integrals."""
    assert stream.rate is not None
    velocity = bridge(stream.t, stream.rate) * robot.wheels.radius
    speed = side_mean(velocity)
    known = np.isfinite(speed)
    bend = np.abs(np.diff(np.nan_to_num(speed), n=2, prepend=0.0, append=0.0))
    scatter = 1.4826 * float(np.median(bend[known])) / np.sqrt(6.0) if known.any() else 0.0
    floor = max(step / np.sqrt(12.0), scatter, 1e-3)
    dt = np.diff(stream.t, prepend=stream.t[0])
    filled = np.interp(stream.t, stream.t[known], speed[known]) if known.any() else np.zeros_like(speed)
    mean = np.cumsum(dt * 0.5 * (filled + np.concatenate([[filled[0]], filled[:-1]])))
    std = np.full(speed.size, floor)
    distance = np.cumsum(dt[:, None] * np.nan_to_num(velocity), axis=0)
    distance[~np.isfinite(velocity)] = np.nan
    return Rolling(
        t=stream.t, distance=distance, mean=mean, mean_std=np.full(speed.size, np.nan), velocity=velocity,
        velocity_std=np.where(np.isfinite(velocity), floor, np.nan), speed=speed, speed_std=std,
        by_rate=True, step=step, jitter=0.0,
    )  # fmt: skip


def _first(distance: Array) -> Array:
    """First known value of each column."""
    first = np.zeros(distance.shape[1])
    for i in range(distance.shape[1]):
        known = np.flatnonzero(np.isfinite(distance[:, i]))
        first[i] = distance[known[0], i] if known.size else 0.0
    return first


def _sigma(quantum: float, wheels: np.ndarray | int, jitter: float, speed: Array) -> Array:
    """Std of one sample of a rolled distance [m]: quantisation per wheel, stamps common to all."""
    return np.asarray(np.sqrt(quantum**2 / 12.0 / wheels + (jitter * speed) ** 2))
