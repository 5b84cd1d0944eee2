"""What is wrong with the IMU's samples: gaps, plateaus, spikes, restarts; and how much that leaves open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from granite_lab.logs.counters import runs
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.sensors.imu import rail
from granite_lab.logs.sensors.stamps import gaps_in
from granite_lab.logs.sensors.standstill import Interval, bridged, inside
from granite_lab.logs.trial import Array, ImuStream
from granite_lab.parameters import GRAVITY, ImuGrade
from granite_lab.rounding import plural

UNSEEN = 1.5
"""Acceleration that may go unseen while samples are missing and no wheel tells [m/s^2]."""


@dataclass(frozen=True, eq=False)
class Faults:
    """Samples that cannot be trusted."""

    doubt: np.ndarray  # (N,) a reading is thrown off, or stands at the sensor's limit
    rate_doubt: np.ndarray  # (N,) the same, where the gyro is concerned
    gaps: tuple[Interval, ...]  # missing samples [s]
    plateaus: tuple[Interval, ...]  # saturation [s]
    beyond: tuple[float, ...]  # per plateau, how far the truth may lie beyond [m/s^2]; 0 if only a gyro's
    spikes: np.ndarray  # (N,) single readings thrown off
    thrown: Array  # (N,) by how much they are [m/s^2]
    restarts: tuple[Restart, ...] = ()  # biases that changed

    def doubts(self) -> list[Doubt]:
        """Return what is wrong, in words."""

        def grows(what: str) -> Doubt:
            return Doubt(what, remedy="uncertainty grows there", grade="fair")

        doubts = []
        if self.gaps:
            total = sum(end - begin for begin, end in self.gaps)
            count = plural(len(self.gaps), "gap")
            doubts.append(grows(f"{count} in the IMU's samples, {total:.3f} s in all"))
        if self.plateaus:
            times = plural(len(self.plateaus), "time")
            doubts.append(grows(f"the IMU stands at its limit {times}"))
        if self.spikes.any():
            n = int(np.count_nonzero(self.spikes))
            thrown = f"{plural(n, 'single reading')} of the IMU thrown off"
            doubts.append(Doubt(thrown, remedy="replaced"))
        for restart in self.restarts:
            place = f"in the gap at {restart.begin:.2f} s" if restart.gap else f"after {restart.begin:.2f} s"
            doubts.append(grows(f"the IMU's biases changed {place}, as after a restart"))
        return doubts

    def hide(self, begin: float, end: float) -> bool:
        """Whether samples are missing or at their limit in an interval [s]."""
        return any(a < end and b > begin for a, b in (*self.gaps, *self.plateaus))

    def touch(self, begin: float, end: float) -> bool:
        """Whether they are, or biases change."""
        return self.hide(begin, end) or any(r.begin < end and r.end > begin for r in self.restarts)


def find_faults(stream: ImuStream, grade: ImuGrade, spikes: np.ndarray, thrown: Array) -> Faults:
    """Find gaps longer than three median periods and plateaus at the sensor's limits.

    `stream` is complete and in the sensor's axes, in which it saturates; `spikes` and by how much they are
    `thrown` [m/s^2] come from `despike`.
    """
    t = stream.t
    at_limit = _at_limit(stream.specific_force, grade.accel_range)
    turning = np.asarray(_at_limit(stream.angular_rate, grade.gyro_range).any(axis=1))
    clipped = np.logical_or(at_limit.any(axis=1), turning)
    force = np.nan_to_num(stream.specific_force)
    reach = np.maximum(np.abs(force - np.median(force, axis=0)), UNSEEN)
    beyond = np.where(at_limit, reach, 0.0).max(axis=1)
    # clipped vibration touches the rail again and again: one plateau
    spans = runs(bridged(np.arange(t.size), clipped, 6.5))
    return Faults(
        doubt=clipped | spikes,
        rate_doubt=turning | spikes,
        gaps=tuple(gaps_in(t)),
        plateaus=tuple((float(t[a]), float(t[b - 1])) for a, b in spans),
        beyond=tuple(float(beyond[a:b].max()) for a, b in spans),
        spikes=spikes,
        thrown=thrown,
    )


def _at_limit(values: Array, limit: float) -> np.ndarray:
    """(N, 3) True where an axis is near the sensor's limit, or at a rail of its own."""
    rails = np.stack([rail(axis) for axis in values.T], axis=1)
    return np.asarray((np.abs(np.nan_to_num(values)) >= 0.99 * limit) | rails)


@dataclass(frozen=True)
class Restart:
    """Biases that changed between two standstills."""

    begin: float  # when it happened: a gap, or all the time between the standstills [s]
    end: float
    accel: float  # std of the change [m/s^2]
    gyro: float  # the same, as far as `step` does not tell it [rad/s]
    step: tuple[float, float, float]  # change of the gyro's readings, sensor axes [rad/s]
    gap: bool  # it happened in a gap of the samples

    def passed(self, t: Array) -> Array:
        """(N,) part of the change that has happened by each sample: all at once in a gap, else gradually."""
        return np.asarray(np.clip((t - self.begin) / max(self.end - self.begin, 1e-9), 0.0, 1.0))


def find_restarts(
    stream: ImuStream, rests: Sequence[Interval], doubt: np.ndarray, gaps: Sequence[Interval], grade: ImuGrade
) -> tuple[Restart, ...]:
    """Compare the gyro and the size of specific force of each standstill with the next one's.

    Pitch may differ between two standstills, so only what it cannot explain counts. A restart is looked for
    in the gaps first. The stream is in the sensor's axes.
    """
    restarts = []
    places = [inside(stream.t, [rest]) & ~doubt for rest in rests]
    if not all(at.any() for at in places):
        return ()
    forces, rates = ([_level(v[at]) for at in places] for v in (stream.specific_force, stream.angular_rate))
    for first, second in pairwise(zip(rests, forces, rates, strict=True)):
        ((start, begin), (force, force_std), (rate, rate_std)) = first
        ((end, stop), (force_2, force_std_2), (rate_2, rate_std_2)) = second
        time, time_2 = begin - start, stop - end
        share = np.sqrt(1.0 / max(time, 0.1) + 1.0 / max(time_2, 0.1))
        apart = np.sqrt(2.0 * (end - begin + 0.5 * (time + time_2)) / grade.instability_time)
        turn, size = rate_2 - rate, float(np.linalg.norm(force_2) - np.linalg.norm(force))
        usual_turn = np.hypot(grade.gyro_noise * share, grade.gyro_instability * min(apart, 1.5))
        usual_size = np.hypot(grade.accel_noise * share, 2.0 * grade.accel_instability * min(apart, 1.5))
        usual_turn = np.hypot(usual_turn, np.hypot(rate_std, rate_std_2))
        usual_size = np.hypot(usual_size, np.hypot(force_std, force_std_2))
        # where the frame lies otherwise than before, the same bias has another share along gravity
        sizes = np.linalg.norm([force, force_2], axis=1)
        tilted = float(np.linalg.norm(force_2 / sizes[1] - force / sizes[0]))
        bias = max(grade.accel_bias, float(np.abs(sizes - GRAVITY).max()))
        usual_size = np.hypot(usual_size, bias * tilted)
        if np.abs(turn).max() < 6.0 * usual_turn and abs(size) < 6.0 * usual_size + 0.01:
            continue
        accel = max(grade.accel_bias, float(np.linalg.norm(force_2 - force)))
        gyro = max(float(np.abs(turn).max()), 3.0 * float(usual_turn))
        within = sorted((g for g in gaps if begin <= g[0] and g[1] <= end), key=lambda g: g[0] - g[1])
        step = (float(turn[0]), float(turn[1]), float(turn[2]))
        if len(within) == 1:  # then it is known when, and the standstills tell by how much
            gyro = 3.0 * float(usual_turn)
        for k, (a, b) in enumerate(within or [(begin, end)]):
            restarts.append(Restart(a, b, accel, gyro, step if k == 0 else (0.0, 0.0, 0.0), bool(within)))
    return tuple(restarts)


def _level(values: Array) -> tuple[Array, float]:
    """Return the mean (3,) of samples at standstill, and its std by the means of tenths of them."""
    parts = np.array([part.mean(axis=0) for part in np.array_split(values, min(10, values.shape[0]))])
    std = float(np.nanmax(np.std(parts, axis=0), initial=0.0))
    return np.nan_to_num(values.mean(axis=0)), std / float(np.sqrt(max(parts.shape[0] - 1, 1)))


def without_steps(stream: ImuStream, restarts: Sequence[Restart]) -> ImuStream:
    """Take the changes of the gyro's bias out of its readings: in the (longest) gap, else gradually."""
    rate = stream.angular_rate.copy()
    for restart in restarts:
        rate -= restart.passed(stream.t)[:, None] * np.array(restart.step)
    return replace(stream, angular_rate=rate)
