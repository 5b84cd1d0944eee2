"""What is wrong with the IMU's samples: gaps, plateaus, spikes; and how much that leaves open."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from granite_lab.estimation.mounting import BodyImu
from granite_lab.estimation.process import BA, BG, TH, V, X
from granite_lab.estimation.rest import Interval
from granite_lab.estimation.restarts import Restart
from granite_lab.estimation.rolling import runs
from granite_lab.logs.trial import Array, ImuStream
from granite_lab.parameters import ImuGrade

UNSEEN = 1.5
"""Acceleration that may go unseen while samples are missing and no wheel tells [m/s^2]."""

UNEXPLAINED = 0.3
"""Acceleration of the body that the wheels' own, steady or not, does not suggest [m/s^2]."""

SPIKE = (1.0, 0.3)
"""A single reading nearer than this to its neighbours is no spike [m/s^2], [rad/s]."""


@dataclass(frozen=True, eq=False)
class Faults:
    """Samples that cannot be trusted.

    Attributes:
        doubt: (N,) True for a sample that is missing a value, is a spike, or stands at the sensor's limit.
        rate_doubt: (N,) the same, where the gyro is concerned.
        gaps: (start, end) of missing samples [s].
        plateaus: (start, end) of saturation [s].
        beyond: per plateau, how far the truth may lie beyond it [m/s^2]; 0 if only a gyro saturated.
        spikes: (N,) True for single readings thrown off.
        restarts: biases that changed.
    """

    doubt: np.ndarray
    rate_doubt: np.ndarray
    gaps: tuple[Interval, ...]
    plateaus: tuple[Interval, ...]
    beyond: tuple[float, ...]
    spikes: np.ndarray
    restarts: tuple[Restart, ...] = ()

    def part(self, keep: np.ndarray) -> Faults:
        """Return the faults of some of the samples."""
        return dataclasses.replace(
            self, doubt=self.doubt[keep], rate_doubt=self.rate_doubt[keep], spikes=self.spikes[keep]
        )


def despike(stream: ImuStream) -> tuple[ImuStream, np.ndarray]:
    """Replace single readings far off both neighbours; a knock lasts longer than one or two samples.

    Returns:
        the stream, and (N,) True for the samples that were replaced in any axis. Where more than one
        sample in a hundred would go, the frame really shakes like that, and none is touched.
    """
    hit = np.zeros(stream.t.size, dtype=bool)
    clean: list[Array] = []
    for values, least in ((stream.specific_force, SPIKE[0]), (stream.angular_rate, SPIKE[1])):
        clean.append(values.copy())
        for axis in range(3):
            signal = values[:, axis]
            if stream.t.size < 50 or not np.isfinite(signal).all():
                continue
            middle = median_filter(signal, 5, mode="nearest")
            off = np.abs(signal - middle)
            spike = off > max(least, 5.0 * float(np.percentile(off, 90)))
            clean[-1][spike, axis] = middle[spike]
            hit |= spike
    if not hit.any() or hit.mean() > 0.01:
        return stream, np.zeros(stream.t.size, dtype=bool)
    return dataclasses.replace(stream, specific_force=clean[0], angular_rate=clean[1]), hit


def find_faults(imu: BodyImu, stream: ImuStream, grade: ImuGrade, spikes: np.ndarray) -> Faults:
    """Find gaps longer than three median periods and plateaus at the sensor's limits.

    Args:
        imu: samples in robot axes.
        stream: the same in the sensor's axes, in which it saturates.
        grade: its ranges.
        spikes: (N,) by `despike`.
    """
    t = imu.t
    period = float(np.median(np.diff(t)))
    bad = ~np.isfinite(imu.forward)
    gaps = [(float(t[i]), float(t[i + 1])) for i in np.flatnonzero(np.diff(t) > 3.0 * period)]
    for a, b in zip(*runs(bad), strict=True):
        if b - a > 2:
            gaps.append((float(t[max(a - 1, 0)]), float(t[min(b, t.size - 1)])))
    clipped, turning = np.zeros((2, t.size), dtype=bool)
    beyond = np.zeros(t.size)
    for values, limit, accel in (
        (stream.specific_force, grade.accel_range, True),
        (stream.angular_rate, grade.gyro_range, False),
    ):
        for axis in values.T:
            if np.isfinite(axis).any():
                at_limit = (np.abs(np.nan_to_num(axis)) >= 0.99 * limit) | rail(axis)
                clipped |= at_limit
                if not accel:
                    turning |= at_limit
                elif at_limit.any():
                    reach = np.abs(axis - float(np.nanmedian(axis)))
                    beyond = np.where(at_limit, np.maximum(beyond, np.maximum(reach, UNSEEN)), beyond)
    # clipped vibration touches the rail again and again: one plateau
    joined = clipped.copy()
    for a, b in zip(*runs(~clipped), strict=True):
        if a > 0 and b < t.size and b - a <= 5:
            joined[a:b] = True
    spans = list(zip(*runs(joined), strict=True))
    return Faults(
        doubt=bad | clipped | spikes,
        rate_doubt=turning | spikes,
        gaps=tuple(sorted(gaps)),
        plateaus=tuple((float(t[a]), float(t[b - 1])) for a, b in spans),
        beyond=tuple(float(beyond[a:b].max()) for a, b in spans),
        spikes=spikes,
    )


def rail(axis: Array) -> np.ndarray:
    """Mark the samples at an axis's largest or smallest reading, where that is a rail.

    A rail is met by three samples in a row, more than the axis repeats itself elsewhere (a logger
    that holds the last value does so everywhere), and away from the usual reading.
    """
    mark = np.zeros(axis.size, dtype=bool)
    known = axis[np.isfinite(axis)]
    if known.size < 8:
        return mark
    centre = float(np.median(known))
    change = np.abs(np.diff(known))
    moved = change[change > 0]
    if moved.size == 0:
        return mark
    step = float(moved.min())
    scatter = 1.4826 * float(np.median(np.abs(known - centre)))
    usual = known.size / (moved.size + 1.0)
    for extreme in (float(known.max()), float(known.min())):
        if abs(extreme - centre) <= max(3.0 * step, 1.5 * scatter):
            continue
        at_limit = axis == extreme
        begin, end = runs(at_limit)
        if (end - begin).max() >= 3.0 * max(usual, 1.0):
            mark |= at_limit
    return mark


def inflate(
    Q: Array, t: Array, dt: Array, moving: np.ndarray, faults: Faults, imu: BodyImu, rest: np.ndarray,
    growth: Array | None,
) -> None:  # fmt: skip
    """Let velocity, pitch and biases drift over the faults, in place, by as much as may go unseen.

    Args:
        Q: (K, 14, 14) process noise.
        t, dt: (K,) nodes and steps [s].
        moving: (K,) False where the step lies within a standstill.
        imu, rest: (N,) samples, and which of them are at rest.
        growth: (K,) acceleration of the wheels [m/s^2], or None without wheels.
    """
    active = ~rest & ~faults.doubt
    period = float(np.median(np.diff(imu.t)))
    enough = active.sum() > 2
    shake = 1.4826 * float(np.median(np.abs(np.diff(imu.forward[active])))) if enough else 1.0
    turning = float(np.std(imu.pitch_rate[active])) if enough and imu.has_pitch_rate else 0.0

    def drift(begin: float, end: float, force: float | None, turn: float) -> None:
        span = (t > begin) & (t - dt < end) & moving
        if not span.any():
            return
        length = max(end - begin, period)
        if force is None:
            force = UNSEEN
            if growth is not None:  # the body follows the wheels within a quarter of a second
                near = (t > begin - 0.25) & (t < end + 0.1)
                force = float(np.hypot(UNEXPLAINED, 1.2 * np.abs(growth[near]).max(initial=0.0)))
        # what shakes comes back within some hundredths of a second
        unknown = np.hypot(force * length, shake * min(length, 0.03))
        share = dt[span] / max(float(dt[span].sum()), 1e-9)
        Q[span, V, V] += unknown**2 * share
        Q[span, X, X] += (unknown * dt[span]) ** 2 / 3
        Q[span, X, V] += unknown**2 * share * dt[span] / 2
        Q[span, V, X] += unknown**2 * share * dt[span] / 2
        Q[span, TH, TH] += (turn * length) ** 2 * share

    turn = max(0.02, 2.0 * turning)
    for begin, end in faults.gaps:
        drift(begin, end, None, turn)
    for (begin, end), beyond in zip(faults.plateaus, faults.beyond, strict=True):
        at = (imu.t >= begin) & (imu.t <= end)
        drift(begin, end, beyond, 2.0 if faults.rate_doubt[at].any() else 0.0)
    for instant in imu.t[faults.spikes]:
        drift(float(instant) - period, float(instant), 0.0, turn)
    for jump in faults.restarts:
        span = (t > jump.begin) & (t - dt < jump.end) & moving
        share = dt[span] / max(float(dt[span].sum()), 1e-9)
        Q[span, BA, BA] += jump.accel**2 * share
        Q[span, BG, BG] += jump.gyro**2 * share
