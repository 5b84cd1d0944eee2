"""Wheel encoders: rolled distances, circumferential velocities and their noise.

Everything here is on the encoders' own clock. Distances are of the tread, angle times radius.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from granite_lab.estimation.wheel_speeds import speeds_of
from granite_lab.logs.counters import integral, interpolated, mad_std, mean_known, repeated, runs
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.sensors.standstill import MOVING, bridged
from granite_lab.logs.trial import Array, WheelStream
from granite_lab.parameters import WHEELS, Robot

MEET = 2.5
"""Confidence intervals of slopes reach this many std to either side."""

STUCK_AFTER = 0.25
"""A wheel without a count for this long [s], while the others roll, is taken for a dead encoder."""

COUNTS = 3.0
"""Fewest counts that a dead encoder misses."""

FEWEST = 3
"""Fewest successive samples of a wheel by which its speed is found."""

SHARED, SLOWEST = 0.2, 1.0e-3
"""Samples share the error of the last count for this long [s] at most, of wheels this fast [m/s] at least:
slower ones are about to stand."""


@dataclass(frozen=True, eq=False)
class Rolling:
    """Wheel motion at the encoders' stamps."""

    t: Array  # (M,) [s]
    distance: Array  # (M, 4) rolled distance of each wheel since the first sample [m], NaN where unknown
    mean: Array  # (M,) rolled distance, mean of the left and right sides [m]
    velocity: Array  # (M, 4) circumferential velocity v_o of each wheel [m/s]
    velocity_std: Array
    speed: Array  # (M,) velocity of `mean` [m/s], as logged if by_rate
    sample_std: Array  # (M,) std of one sample of `mean` [m], or of `speed` [m/s] if by_rate
    rates: Array | None  # (M, 4) velocities as logged; distances are their integrals and not measurements
    resolution: tuple[float, ...]  # (4,) of each distance [m] (of each velocity [m/s] if by_rate)
    doubts: tuple[Doubt, ...] = ()

    @property
    def by_rate(self) -> bool:
        """Whether the logger gave rates."""
        return self.rates is not None

    @property
    def step(self) -> float:
        """The coarsest resolution of the four [m] or [m/s]."""
        return max(self.resolution)

    @property
    def path_length(self) -> float:
        """How far the wheels roll in all, forward or back [m]."""
        return float(integral(self.t, np.abs(np.nan_to_num(self.speed)))[-1])

    def speed_at(self, t: Array | float, offset: float = 0.0) -> Array:
        """Return `speed` at instants of a clock that the encoders' lies behind by `offset` [s]."""
        return interpolated(t, self.t + offset, self.speed)


def rolling_of(stream: WheelStream, robot: Robot) -> Rolling:
    """Turn encoder angles into rolled distances and velocities with their std.

    The noise of one sample is q^2/12 (which makes q^2/(6 dt^2) in a difference) and, while rolling,
    the velocity times the scatter of the stamps, found from how the distances scatter about a
    locally smooth motion; the robot's file is the floor of the former.
    """
    t, counts = stream.t, robot.encoders.counts
    usual = 2 * np.pi / counts if counts and stream.rate is None else 0.0
    resolution = tuple((step or usual) * robot.wheels.radius for step in stream.resolution)
    if stream.rate is not None:
        return _roll_rates(t, bridge(t, stream.rate) * robot.wheels.radius, resolution)
    distance = bridge(t, stream.angle) * robot.wheels.radius
    increment, doubts = mask_dead(t, distance, resolution)
    mean_step = side_mean(increment)
    lost = ~np.isfinite(mean_step)
    lost[0] = False
    mean = np.cumsum(np.nan_to_num(mean_step))
    mean[lost] = np.nan
    quantum = max(*resolution, 1e-6)
    n_live = np.maximum(np.isfinite(increment).sum(axis=1), 1)
    rough = local_slope(t, np.nan_to_num(mean, nan=0.0), np.full(t.size, quantum / np.sqrt(12)))
    jitter = stamp_scatter(t, mean, rough, quantum)

    period = float(np.median(np.diff(t)))

    def sigma(wheels: np.ndarray | int, pace: Array) -> Array:
        """Std of one sample of a rolled distance [m]: quantisation per wheel, stamps common to all.

        Samples between two counts share their error; so many of them tell as much as one.
        """
        shared = np.clip(quantum / np.maximum(np.abs(pace), SLOWEST) / period, 1.0, max(SHARED / period, 1.0))
        return np.asarray(np.sqrt(quantum**2 / 12.0 * shared / wheels + (jitter * pace) ** 2))

    speed = local_slope(t, np.nan_to_num(mean), sigma(n_live, rough))
    sample_std = sigma(n_live, speed)
    known = np.isfinite(increment)
    known[1:-1] &= known[:-2] | known[2:]
    known[0] = np.isfinite(distance[0]) & known[1:2].any(axis=0)
    way = np.cumsum(np.nan_to_num(increment), axis=0)
    velocity, velocity_std = speeds_where(known, t, way, sigma(1, speed))
    speed[~np.isfinite(mean)] = np.nan
    first = np.nan_to_num(distance[np.isfinite(distance).argmax(axis=0), np.arange(distance.shape[1])])
    return Rolling(
        t=t, distance=np.where(np.isfinite(increment), distance - first, np.nan), mean=mean,
        velocity=velocity, velocity_std=velocity_std, speed=speed, sample_std=sample_std,
        rates=None, resolution=resolution, doubts=tuple(doubts),
    )  # fmt: skip


def _roll_rates(t: Array, velocity: Array, resolution: tuple[float, ...]) -> Rolling:
    """Take logged rates, as velocities (M, 4) [m/s]; the distances are their integrals."""
    dt, none = np.diff(t, prepend=t[0]), (0.0,) * velocity.shape[1]
    increment, doubts = mask_dead(t, np.cumsum(dt[:, None] * np.nan_to_num(velocity), axis=0), none)
    velocity = np.where(np.isfinite(increment) | (dt == 0)[:, None], velocity, np.nan)
    speed = side_mean(velocity)
    finite = np.isfinite(speed)
    bend = np.abs(np.diff(np.nan_to_num(speed), n=2, prepend=0.0, append=0.0))
    scatter = mad_std(bend[finite], 0.0) / np.sqrt(6.0) if finite.any() else 0.0
    floor = max(max(resolution) / np.sqrt(12.0), scatter, 1e-3)
    mean = integral(t, interpolated(t, t, speed) if finite.any() else np.zeros_like(speed))
    known = np.isfinite(velocity)
    distance = np.where(known, np.cumsum(dt[:, None] * np.nan_to_num(velocity), axis=0), np.nan)
    smooth, smooth_std = speeds_where(known, t, velocity, np.full(speed.size, floor), rates=True)
    # samples that read the same share their error, so that all of them tell as much as one
    alike = np.nan_to_num(mean_known(np.stack([repeated(rate) for rate in velocity.T], axis=1)), nan=1.0)
    return Rolling(
        t=t, distance=distance, mean=mean, velocity=smooth, velocity_std=smooth_std, speed=speed,
        sample_std=floor * np.sqrt(alike), rates=velocity, resolution=resolution, doubts=tuple(doubts),
    )  # fmt: skip


def speeds_where(
    known: np.ndarray, t: Array, y: Array, sigma: Array, *, rates: bool = False
) -> tuple[Array, Array]:
    """Return (M, 4) speeds and their std as `speeds_of` does, NaN where a wheel is not `known` (M, 4).

    Wheels that are known at the same samples are smoothed together.
    """
    speed, std = np.full_like(y, np.nan), np.full_like(y, np.nan)
    alike: dict[tuple[int, int], list[int]] = {}
    for i, known_of_wheel in enumerate(known.T):
        for run in runs(known_of_wheel):
            alike.setdefault(run, []).append(i)
    for (a, b), wheels in alike.items():
        if b - a >= FEWEST:
            found, found_std = speeds_of(t[a:b], y[a:b, wheels], sigma[a:b], rates=rates)
            speed[a:b, wheels], std[a:b, wheels] = found, found_std[:, None]
    return speed, std


def bridge(t: Array, angle: Array) -> Array:
    """Fill the cells of wheels that are sampled at other rows; longer gaps than 3 periods stay NaN."""
    filled = angle.copy()
    for wheel in filled.T:
        finite = np.isfinite(wheel)
        if 1 < finite.sum() < t.size:
            between = bridged(t, finite, 3.0 * float(np.median(np.diff(t[finite])))) & ~finite
            wheel[between] = interpolated(t[between], t, wheel)
    return filled


def mask_dead(t: Array, distance: Array, resolution: Sequence[float]) -> tuple[Array, list[Doubt]]:
    """Blank a wheel where it gives no count, or jumps, while the others roll; also warn.

    Args:
        t: (M,) stamps [s].
        distance: (M, 4) rolled distances [m].
        resolution: (4,) their smallest steps [m], below which no count is expected.

    Returns:
        (M, 4) increments to each sample from the one before [m], NaN where not to be used; doubts.
    """
    step = np.diff(distance, axis=0, prepend=np.full((1, distance.shape[1]), np.nan))
    dt = np.diff(t, prepend=t[0] - 1.0)
    doubts = []
    with np.errstate(invalid="ignore"):
        live = np.isfinite(step).sum(axis=1)
        wild = np.abs(step - _median(step)[:, None]) > 3.0 * dt[:, None] + 0.05
    step[wild & (live >= 3)[:, None]] = np.nan
    for i, wheel in enumerate(WHEELS):
        if not np.isfinite(step[:, i]).any():
            continue
        others = np.nan_to_num(_median(np.delete(step, i, axis=1)))
        rolling = np.abs(others) > MOVING * dt
        dead = 0.0
        for a, b in runs(np.nan_to_num(step[:, i]) == 0.0):
            at = np.arange(a, b)[rolling[a:b]]
            silent, rolled = float(dt[at].sum()), abs(float(others[at].sum()))
            if silent >= STUCK_AFTER and rolled > COUNTS * resolution[i]:
                step[a : b + 1, i] = np.nan  # the sample after it may hold the missed counts at once
                dead += silent
        if dead > 0:
            silent_for = f"encoder {wheel} gives no counts for {dead:.2f} s while the others turn"
            doubts.append(Doubt(silent_for, remedy="not used there"))
    return step, doubts


def _median(values: Array) -> Array:
    """Median over the wheels, NaN where none is known."""
    finite = np.isfinite(values).any(axis=1)
    median = np.full(finite.size, np.nan)
    median[finite] = np.nanmedian(values[finite], axis=1)
    return median


def side_mean(values: Array) -> Array:
    """Mean of the left and right sides' means, so that a missing wheel does not look like a turn."""
    return mean_known(np.stack([mean_known(values[:, side::2]) for side in (0, 1)], axis=1))


def nearest(t: Array, at: Array) -> np.ndarray:
    """(K,) places of the stamps t (M,) nearest to instants `at` (K,); of two that are as near, the later."""
    after = np.clip(np.searchsorted(t, at), 1, t.size - 1)
    return np.asarray(after - (at - t[after - 1] < t[after] - at))


def local_slope(t: Array, y: Array, sigma: Array) -> Array:
    """Differentiate y (M,) by local straight lines, the window as wide as the motion allows.

    At each sample the windows of 5, 9 and 17 samples are tried in turn; one is kept as long as
    its confidence interval meets those of all narrower ones (Goldenshluger & Nemirovski 1997), so
    corners stay sharp and steady motion is smooth. `sigma` (M,) is the std of the samples.
    """
    m = t.size
    low, high = np.full(m, -np.inf), np.full(m, np.inf)
    best = np.full(m, np.nan)
    going = np.ones(m, dtype=bool)
    for half in (2, 4, 8):
        value, std = _line(t, y, sigma, min(half, m - 1))
        low, high = np.maximum(low, value - MEET * std), np.minimum(high, value + MEET * std)
        going &= low <= high
        best = np.where(going, value, best)
    return best


def _line(t: Array, y: Array, sigma: Array, half: int) -> tuple[Array, Array]:
    """Slope of the least squares line through 2 half + 1 samples (fewer at the ends), and its std."""
    index = np.arange(t.size)[:, None] + np.arange(-half, half + 1)
    inside = (index >= 0) & (index < t.size)
    index = np.clip(index, 0, t.size - 1)
    tt, yy = (t[index] - t[:, None]) * inside, (y[index] - y[:, None]) * inside
    n = inside.sum(axis=1)
    tc = (tt - (tt.sum(axis=1) / n)[:, None]) * inside
    squares = (tc**2).sum(axis=1)
    squares = np.where(squares > 0, squares, np.inf)
    return (tc * yy).sum(axis=1) / squares, sigma / np.sqrt(squares)


def stamp_scatter(t: Array, mean: Array, speed: Array, quantum: float) -> float:
    """Std of the stamps [s]: scatter of the distance about cubics, over the velocity.

    Fourth differences cancel any motion that is cubic over five samples; their variance is 70 times
    that of one sample, on evenly spaced stamps.
    """
    fast = np.abs(speed) > 0.3 * max(float(np.nanmax(np.abs(speed), initial=0.0)), MOVING)
    width = 5
    index = np.arange(mean.size - width + 1)[:, None] + np.arange(width)
    ok = fast[index].all(axis=1) & np.isfinite(mean[index]).all(axis=1)
    if ok.sum() < 8:
        return 0.0
    tt = t[index[ok]] - t[index[ok][:, 2]][:, None]
    # divided differences handle stamps that are not even
    apart = tt[:, :, None] - tt[:, None, :] + np.eye(width)
    weights = np.divide.reduce(apart, axis=2, initial=1.0)
    contrast = (weights * mean[index[ok]]).sum(axis=1) / np.sqrt((weights**2).sum(axis=1))
    scatter = mad_std(contrast, 0.0)
    typical = float(np.median(np.abs(speed[fast])))
    return float(np.sqrt(max(scatter**2 - quantum**2 / 12.0 / 4.0, 0.0)) / typical)
