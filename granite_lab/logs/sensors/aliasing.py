"""Counters that move by nearly half their range, or more, between two samples: forward, or back by the rest?

The short way round is right while a wheel turns by less than half the range between two samples. Where it
may turn faster, the counter can also be read as a motion that goes on smoothly from a standstill. Both
readings are compared with the other wheels or with the IMU, as aliased velocities are in weather radar [1].

[1] W. R. Bergen, S. C. Albers, Two- and three-dimensional de-aliasing of Doppler radar velocities, J.
Atmospheric and Oceanic Technology 5 (1988).
"""

from __future__ import annotations

import dataclasses

import numpy as np

from granite_lab.errors import InputError
from granite_lab.logs.counters import integral, interpolated, runs, short_way
from granite_lab.logs.layouts import Log
from granite_lab.logs.quantities import ENCODERS
from granite_lab.logs.sensors.imu import mounted
from granite_lab.logs.sensors.stamps import GAP_PERIODS
from granite_lab.logs.trial import Array, ImuStream, WheelStream

_CLEAR = 0.25  # a step up to this share of the range is read the short way round
_NEARLY = 0.4  # a doubt is reported from this share on
_APART = 0.35  # a reading fits steps that differ from it by less than this share; two readings differ by 1
_STOOD = 0.3  # a counter that rests for so long [s] stands: no wheel turns by whole ranges at each sample
_RECENT = 4  # the motion goes on at the mean rate of so many samples
_DRIFTS = 30.0  # an IMU integrates its way from standstill to standstill for so long [s]


def resolve_aliases(wheels: WheelStream, imu: ImuStream | None, log: Log) -> WheelStream:
    """Read the counters whose steps may be read in two ways; report how.

    Raises:
        InputError: the readings cannot be told apart.
    """
    near = [i for i in range(len(ENCODERS)) if wheels.span[i] and _largest_step(wheels, i) > _CLEAR]
    if not near:
        return wheels
    angle = wheels.angle.copy()
    witness, speed = _witness(wheels, near, imu, log)
    for i in near:
        finite, width = np.isfinite(angle[:, i]), wheels.span[i]
        t, short = wheels.t[finite], angle[finite, i]
        expected = None if speed is None else np.diff(integral(wheels.t, speed)[finite])
        chosen = _choose(t, short, width, expected)
        if chosen is None:
            evidence = f"{witness} fits neither reading" if witness else "nothing else tells which"
            moved = f"{_largest_step(wheels, i):.0%} of its range or more from sample to sample"
            message = f"the counter moves by {moved}, forward or back by the rest: {evidence}"
            hint = "log faster, or a wider counter; wrap = … in a column map states another range"
            raise InputError(f"{log.where}: {log.column(ENCODERS[i])}: {message}", hint)
        share = float(np.abs(np.diff(chosen)).max()) / width
        if share > _NEARLY:
            fits = f", which {witness} confirms" if witness else ""
            moved = f"moves by up to {share:.0%} of its range from sample to sample"
            read = f"read as a motion that goes on{fits}"
            log.doubt(f"the counter {moved}: {read}", log.column(ENCODERS[i]), "log faster")
        angle[finite, i] = chosen
    return dataclasses.replace(wheels, angle=angle)


def _largest_step(wheels: WheelStream, i: int) -> float:
    """Return the largest step of a counter as a share of its range."""
    angle = wheels.angle[np.isfinite(wheels.angle[:, i]), i]
    return float(np.abs(np.diff(angle)).max(initial=0.0)) / wheels.span[i]


def _choose(t: Array, short: Array, width: float, expected: Array | None) -> Array | None:
    """Return the reading (N,) [rad] that fits the `expected` steps (N-1,) [rad], None if none does."""
    onward = continued(t, short, width)
    readings = [short] if onward is None else [onward, short]
    if expected is None:
        return onward
    jumps = np.diff(t) > GAP_PERIODS * float(np.median(np.diff(t)))

    def apart(reading: Array) -> float:
        steps = np.diff(reading)
        # An encoder may count backwards.
        both = [np.abs(sign * steps - expected) / width for sign in (1, -1)]
        return min(max(float(np.quantile(x, 0.95)), float(x[jumps].max(initial=0.0))) for x in both)

    best = min(readings, key=apart)
    return best if apart(best) < _APART else None


def continued(t: Array, short: Array, width: float) -> Array | None:
    """Return a counter's angle (N,) [rad] by steps that go on like those before them, from a standstill on.

    None if it stands nowhere, changes its step by more than can be told, or does not come to rest again.
    """
    raw, dt = np.diff(short), np.diff(t)
    moved = np.abs(short_way(raw, width)) > 1e-6 * width
    stands = np.zeros(len(raw), dtype=bool)
    for a, b in runs(~moved):
        stands[a:b] = t[b] - t[a] >= _STOOD and b - a >= _RECENT
    gap = dt > GAP_PERIODS * float(np.median(dt))
    if not stands.any():
        return None
    steps = raw.copy()
    first = int(np.argmax(stands))
    for order in (range(first + 1, len(raw)), range(first - 1, -1, -1)):
        step = 1 if order.step > 0 else -1
        for k in order:
            near = slice(max(k - _RECENT, 0), k) if step > 0 else slice(k + 1, k + 1 + _RECENT)
            guess = steps[near].sum() / dt[near].sum() * dt[k]
            left = float(short_way(raw[k : k + 1] - guess, width)[0])
            if stands[k]:
                left = -guess
                if abs(guess) > _NEARLY * width:
                    return None
            if abs(left) > _NEARLY * width or (gap[k] and abs(guess) > _NEARLY * width):
                return None
            steps[k] = guess + left
    return np.asarray(short[0] + np.concatenate(([0.0], np.cumsum(steps))))


def _witness(
    wheels: WheelStream, near: list[int], imu: ImuStream | None, log: Log
) -> tuple[str, Array | None]:
    """Return another source of the wheels' speed, and that speed (M,) [rad/s] at their stamps."""
    t = wheels.t
    clear = [i for i in range(len(ENCODERS)) if i not in near and np.isfinite(wheels.angle[:, i]).sum() > 1]
    if clear:
        rates = [np.gradient(interpolated(t, t, wheels.angle[:, i]), t) for i in clear]
        return "the other wheels", np.asarray(np.mean(rates, axis=0))
    body = None if imu is None else _by_imu(wheels, near, imu, log)
    return ("the IMU", body) if body is not None else ("", None)


def _by_imu(wheels: WheelStream, near: list[int], imu: ImuStream, log: Log) -> Array | None:
    """Return the body's speed over the wheels' radius (M,) [rad/s], from standstill to standstill."""
    if log.robot.imu.forward == "find":
        return None
    forward = mounted(log.robot).apply(np.nan_to_num(imu.specific_force))[:, 0]
    t, still = imu.t, np.ones(len(imu.t), dtype=bool)
    for i in near:
        filled = interpolated(t, wheels.t, wheels.angle[:, i])
        moved = np.abs(np.diff(filled, prepend=filled[0])) > 1e-9
        still &= ~moved
    rests = [(a, b) for a, b in runs(still) if t[b - 1] - t[a] >= _STOOD]
    if not rests or not forward.any():
        return None
    at_rest = np.concatenate([np.arange(a, b) for a, b in rests])
    speed = integral(t, forward - float(np.mean(forward[at_rest])))
    # What is left at the standstills is drift, which grows evenly between two of them.
    edges = np.diff(np.concatenate(([t[0]], t[at_rest], [t[-1]])))
    if edges.max() > _DRIFTS:
        return None
    speed = speed - np.interp(t, t[at_rest], speed[at_rest])
    return np.asarray(np.interp(wheels.t, t, speed) / log.robot.wheels.radius)
