"""An IMU that restarted between two standstills, and comes back with other biases."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from granite_lab.estimation.rest import Interval, inside
from granite_lab.logs.trial import Array, ImuStream
from granite_lab.parameters import ImuGrade


@dataclass(frozen=True)
class Restart:
    """Biases that changed between two standstills.

    Attributes:
        begin, end: when it happened: a gap, or all the time between the standstills [s].
        accel, gyro: std of the change, as far as `step` does not tell it [m/s^2], [rad/s].
        step: change of the gyro's readings, sensor axes [rad/s].
        gap: it happened in a gap of the samples.
    """

    begin: float
    end: float
    accel: float
    gyro: float
    step: tuple[float, float, float]
    gap: bool


def find_restarts(
    stream: ImuStream, rests: Sequence[Interval], doubt: np.ndarray, gaps: Sequence[Interval], grade: ImuGrade
) -> tuple[Restart, ...]:
    """Compare the gyro and the size of specific force of each standstill with the next one's.

    Pitch may differ between two standstills, so only what it cannot explain counts.

    Args:
        stream: samples in the sensor's axes.
        rests: standstills [s].
        doubt: (N,) samples that cannot be trusted.
        gaps: (start, end) of missing samples [s], in which a restart is looked for first.
        grade: how much biases usually wander.
    """
    found = []
    level: list[tuple[Array, Array, float]] = []
    doubts: list[tuple[float, float]] = []
    for rest in rests:
        at = inside(stream.t, [rest]) & ~doubt
        if not at.any():
            return ()
        (force, force_std), (rate, rate_std) = (
            _level(v[at]) for v in (stream.specific_force, stream.angular_rate)
        )
        level.append((force, rate, float(rest[1] - rest[0])))
        doubts.append((force_std, rate_std))
    for i in range(len(rests) - 1):
        (force, rate, time), (force_2, rate_2, time_2) = level[i], level[i + 1]
        shaken = np.hypot(doubts[i], doubts[i + 1])
        begin, end = rests[i][1], rests[i + 1][0]
        share = np.sqrt(1.0 / max(time, 0.1) + 1.0 / max(time_2, 0.1))
        apart = np.sqrt(2.0 * (end - begin + 0.5 * (time + time_2)) / grade.instability_time)
        turn, size = rate_2 - rate, float(np.linalg.norm(force_2) - np.linalg.norm(force))
        usual_turn = np.hypot(grade.gyro_noise * share, grade.gyro_instability * min(apart, 1.5))
        usual_size = np.hypot(grade.accel_noise * share, 2.0 * grade.accel_instability * min(apart, 1.5))
        usual_turn, usual_size = np.hypot(usual_turn, shaken[1]), np.hypot(usual_size, shaken[0])
        if np.abs(turn).max() < 6.0 * usual_turn and abs(size) < 6.0 * usual_size + 0.01:
            continue
        accel = max(grade.accel_bias, float(np.linalg.norm(force_2 - force)))
        gyro = max(float(np.abs(turn).max()), 3.0 * float(usual_turn))
        places = sorted((g for g in gaps if begin <= g[0] and g[1] <= end), key=lambda g: g[0] - g[1])
        step = (float(turn[0]), float(turn[1]), float(turn[2]))
        if len(places) == 1:  # then it is known when, and the standstills tell by how much
            gyro = 3.0 * float(usual_turn)
        for k, (a, b) in enumerate(places or [(begin, end)]):
            found.append(Restart(a, b, accel, gyro, step if k == 0 else (0.0, 0.0, 0.0), bool(places)))
    return tuple(found)


def _level(values: Array) -> tuple[Array, float]:
    """Return the mean (3,) of samples at standstill, and its std by the means of tenths of them."""
    parts = np.array([part.mean(axis=0) for part in np.array_split(values, min(10, values.shape[0]))])
    std = float(np.nanmax(np.std(parts, axis=0), initial=0.0))
    return np.nan_to_num(values.mean(axis=0)), std / float(np.sqrt(max(parts.shape[0] - 1, 1)))


def without_steps(stream: ImuStream, restarts: Sequence[Restart]) -> ImuStream:
    """Take the changes of the gyro's bias out of its readings: in the (longest) gap, else gradually."""
    rate = stream.angular_rate.copy()
    for restart in restarts:
        length = max(restart.end - restart.begin, 1e-9)
        passed = np.clip((stream.t - restart.begin) / length, 0.0, 1.0)
        rate -= passed[:, None] * np.array(restart.step)
    return dataclasses.replace(stream, angular_rate=rate)
