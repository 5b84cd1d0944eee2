"""What loggers of one kind each make of a log: its stamps, its resolution, its faults."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

Array = npt.NDArray[Any]
Rng = np.random.Generator

COUNTED = 2 * math.pi


@dataclass(frozen=True, eq=False)
class Log:
    """Samples of one logger: IMU (N,), (N, 3) and encoders (M,), (M, 4), each on a clock of its own.

    A stamp is `origin` plus `pace` times the true time [s].
    """

    t: Array
    force: Array
    rate: Array
    t_wheels: Array
    angle: Array
    head: dict[str, Any] = field(default_factory=dict)
    unit: str = "rad"
    digits: int = 6
    origin: float = 0.0
    pace: float = 1.0


def counts(per_rev: int, log: Log, rng: Rng) -> Log:
    ticks = np.floor(log.angle / COUNTED * per_rev + rng.random(4))
    return replace(log, angle=ticks / per_rev * COUNTED)


def counter(per_rev: int, log: Log, rng: Rng) -> Log:
    ticks = np.floor(log.angle / COUNTED * per_rev + rng.random(4))
    return replace(log, angle=ticks, unit="counts", head={**log.head, "enc_counts_per_rev": per_rev})


def wheels_at(rate: float, log: Log, rng: Rng) -> Log:
    t = np.arange(log.t_wheels[0] + rng.random() / rate, log.t_wheels[-1], 1 / rate)
    angle = np.column_stack([np.interp(t, log.t_wheels, a) for a in log.angle.T])
    return replace(log, t_wheels=t, angle=angle)


def rates(per_rev: int, log: Log, rng: Rng) -> Log:
    ticks = counts(per_rev, log, rng).angle
    values = np.diff(ticks, axis=0, prepend=ticks[:1]) / np.median(np.diff(log.t_wheels))
    return replace(log, angle=values, unit="radps")


def batch(size: int, log: Log, rng: Rng) -> Log:
    t, start = log.t, int(rng.integers(size))
    last = np.minimum(((np.arange(t.size) + start) // size + 1) * size - 1 - start, t.size - 1)
    late = rng.exponential(1e-3, t.size)
    return replace(log, t=t[last] + late[last])


def restamped(change: Callable[[Array], Array], log: Log) -> Log:
    """Return a log with other stamps of both sensors."""
    return replace(log, t=change(log.t), t_wheels=change(log.t_wheels))


def both_batched(size: int, log: Log, rng: Rng) -> Log:
    """All rows are stamped when the computer reads the port."""
    step = size * float(np.median(np.diff(log.t)))
    start = step * rng.random()
    return restamped(lambda t: np.ceil((t - start) / step) * step + start, log)


def noise(factor: float, log: Log, rng: Rng) -> Log:
    """White noise of a cheap IMU, 0.02 m/s² and 1 mrad/s a reading, times a factor."""
    n = log.t.size
    return replace(
        log, force=log.force + factor * 0.02 * rng.normal(size=(n, 3)),
        rate=log.rate + factor * 0.001 * rng.normal(size=(n, 3)),
    )  # fmt: skip


def noise_in_motion(factor: float, log: Log, rng: Rng) -> Log:
    """The same, while the wheels turn alone."""
    speed = np.interp(log.t, log.t_wheels, np.abs(np.gradient(log.angle.mean(axis=1), log.t_wheels)))
    on = (speed > 0.1)[:, None]
    loud = noise(factor, log, rng)
    return replace(log, force=np.where(on, loud.force, log.force), rate=np.where(on, loud.rate, log.rate))


def low_pass(corner: float, log: Log, _: Rng) -> Log:
    """A first-order filter in the IMU, of all axes."""
    a = 1 - math.exp(-2 * math.pi * corner * float(np.median(np.diff(log.t))))
    force, rate = (x[0] + lfilter([a], [1, a - 1], x - x[0], axis=0) for x in (log.force, log.rate))
    return replace(log, force=force, rate=rate)


def imu_at(rate: float, mean: bool, log: Log, _: Rng) -> Log:
    few = max(round(1 / rate / float(np.median(np.diff(log.t)))), 1)
    n = log.t.size // few * few
    if not mean:
        return replace(log, t=log.t[:n:few], force=log.force[:n:few], rate=log.rate[:n:few])
    t, force, turn = (x[:n].reshape(n // few, few, -1).mean(axis=1) for x in (log.t, log.force, log.rate))
    return replace(log, t=t[:, 0], force=force, rate=turn)


def jitter(std: float, log: Log, rng: Rng) -> Log:
    return restamped(lambda t: np.sort(t + std * rng.normal(size=t.size)), log)


def late_stamps(mean: float, log: Log, rng: Rng) -> Log:
    """Stamps of arrival: late by an exponential time, in order."""
    return restamped(lambda t: np.maximum.accumulate(t + rng.exponential(mean, t.size)), log)


def kept(imu: Array, wheels: Array, log: Log) -> Log:
    """Return a log with some samples only, of the IMU (N,) and of the encoders (M,)."""
    return replace(
        log, t=log.t[imu], force=log.force[imu], rate=log.rate[imu], t_wheels=log.t_wheels[wheels],
        angle=log.angle[wheels],
    )  # fmt: skip


def dropped(share: float, log: Log, rng: Rng) -> Log:
    return kept(rng.random(log.t.size) > share, rng.random(log.t_wheels.size) > share, log)


def wheels_clock(drift: float, log: Log, rng: Rng) -> Log:
    """The encoders' clock runs fast."""
    return replace(log, t_wheels=log.t_wheels * (1 + drift * rng.choice([-1, 1])))


def burst(share: float, longest: float, log: Log, rng: Rng) -> Log:
    """Stamps of arrival over a network that hangs now and then: what waits comes at once."""

    def late(t: Array) -> Array:
        hangs = np.where(rng.random(t.size) < share, rng.uniform(0.0, longest, t.size), 0.0)
        return np.maximum.accumulate(t + hangs)

    return restamped(late, log)


def repeated(times: int, length: float, log: Log, rng: Rng) -> Log:
    """While the robot moves the IMU's samples are lost some times, and the last one is logged again."""
    force, rate, (first, last) = log.force.copy(), log.rate.copy(), motion_of(log)
    for begin in rng.uniform(first, last - length, times):
        k = np.flatnonzero((log.t >= begin) & (log.t < begin + length))
        force[k], rate[k] = force[k[0]], rate[k[0]]
    return replace(log, force=force, rate=rate)


def hangs(length: float, log: Log, rng: Rng) -> Log:
    """The encoders' bus hangs once in motion: the last angle is logged again, then it goes on."""
    angle, (first, last) = log.angle.copy(), motion_of(log)
    begin = rng.uniform(first, last - length)
    k = np.flatnonzero((log.t_wheels >= begin) & (log.t_wheels < begin + length))
    angle[k] = angle[k[0]]
    return replace(log, angle=angle)


def held(rate: float, log: Log, _: Rng) -> Log:
    """One table at a rate of its own, in each row the last value of each sensor."""
    t = np.arange(max(log.t[0], log.t_wheels[0]), min(log.t[-1], log.t_wheels[-1]), 1.0 / rate)
    i, j = (np.searchsorted(stamps, t, side="right") - 1 for stamps in (log.t, log.t_wheels))
    return replace(log, t=t, force=log.force[i], rate=log.rate[i], t_wheels=t, angle=log.angle[j])


def one_wheel(factor: float, log: Log, rng: Rng) -> Log:
    """One encoder counts by a factor too little, not at all, or backwards."""
    angle = log.angle.copy()
    angle[:, rng.integers(4)] *= factor
    return replace(log, angle=angle)


def own_scales(name: str, std: float, log: Log, rng: Rng) -> Log:
    """The scale of each column of a sensor is off by an error of its own, as of wheels' radii."""
    values = getattr(log, name)
    return replace(log, **{name: values * (1.0 + std * rng.normal(size=values.shape[1]))})


def scaled(name: str, share: float, log: Log, rng: Rng) -> Log:
    """All columns of a sensor are too large, or all too small: of wrong counts of a turn nobody can tell."""
    return replace(log, **{name: getattr(log, name) * (1.0 + share * rng.choice([-1, 1]))})


def imu_clock(drift: float, log: Log, rng: Rng) -> Log:
    factor = 1 + drift * rng.choice([-1, 1])
    return replace(log, t=log.t * factor, pace=factor)


def both_clocks(drift: float, log: Log, rng: Rng) -> Log:
    """The logger's clock runs fast: nobody can tell."""
    factor = 1 + drift * rng.choice([-1, 1])
    return replace(restamped(lambda t: t * factor, log), pace=factor)


def nominal_imu(drift: float, log: Log, rng: Rng) -> Log:
    """Samples of the IMU are stamped by counting them, at the rate of the data sheet."""
    t = log.t[0] + np.arange(log.t.size) * float(np.diff(log.t[[0, -1]])[0]) / (log.t.size - 1)
    factor = 1 + drift * rng.choice([-1, 1])
    return replace(log, t=log.t[0] + (t - log.t[0]) * factor, pace=factor)


def offset(size: float, log: Log, rng: Rng) -> Log:
    return replace(log, t_wheels=log.t_wheels + size * rng.choice([-1, 1]))


def epoch(step: float, log: Log, _: Rng) -> Log:
    return replace(restamped(lambda t: np.round((t + 1.7e9) / step) * step, log), origin=1.7e9)


def dies(log: Log, rng: Rng) -> Log:
    """An encoder stops counting while the wheel turns."""
    angle, i = log.angle.copy(), rng.integers(4)
    angle[:, i] = np.minimum(angle[:, i], rng.uniform(0.2, 0.8) * angle[-1, i])
    return replace(log, angle=angle)


def turned(axis: int, degrees: float, log: Log, rng: Rng) -> Log:
    """The IMU is turned about one of its axes."""
    a = math.radians(degrees) * rng.choice([-1, 1])
    turn = np.eye(3)
    i, j = (k for k in range(3) if k != axis)
    turn[i, i], turn[i, j], turn[j, i], turn[j, j] = math.cos(a), -math.sin(a), math.sin(a), math.cos(a)
    return replace(log, force=log.force @ turn.T, rate=log.rate @ turn.T)


def saturated(share: float, log: Log, _: Rng) -> Log:
    """The accelerometer's range ends at a share of what it reads at most along x."""
    force = log.force.copy()
    top = share * np.abs(force[:, 0]).max()
    force[:, 0] = np.clip(force[:, 0], -top, top)
    return replace(log, force=force)


def rounded(step: float, log: Log, _: Rng) -> Log:
    return replace(
        log, force=np.round(log.force / step) * step, rate=np.round(log.rate / step * 10) * step / 10
    )


def without(what: str, log: Log, _: Rng) -> Log:
    force, rate, angle = log.force.copy(), log.rate.copy(), log.angle.copy()
    if what == "gyro":
        rate[:] = np.nan
    elif what == "other axes":
        force[:, 1:], rate[:, ::2] = np.nan, np.nan
    else:
        angle[:, 1:] = np.nan
    return replace(log, force=force, rate=rate, angle=angle)


def ends(begin: float, end: float, log: Log, _: Rng) -> Log:
    """Standstills of so many seconds at start and end."""
    turns = np.flatnonzero(np.abs(np.diff(log.angle.mean(axis=1))) > 1e-5)
    a, b = log.t_wheels[turns[0]] - begin, log.t_wheels[turns[-1] + 1] + end
    return kept((log.t >= a) & (log.t <= b), (log.t_wheels >= a) & (log.t_wheels <= b), log)


def temperature(drift: float, log: Log, rng: Rng) -> Log:
    """The biases drift: so many m/s² and a tenth of it in rad/s, over the log."""
    share = (log.t - log.t[0]) / (log.t[-1] - log.t[0])
    force, rate = (
        x + d * share[:, None] * rng.normal(size=3) for x, d in ((log.force, drift), (log.rate, drift / 30))
    )
    return replace(log, force=force, rate=rate)


def motion_of(log: Log) -> tuple[float, float]:
    """Return when the wheels begin and cease to turn [s]."""
    turns = log.t_wheels[np.flatnonzero(np.abs(np.diff(log.angle.mean(axis=1))) > 1e-4)]
    return float(turns[0]), float(turns[-1])


def in_motion(log: Log) -> Array:
    """(N,) 1 while the wheels turn, 0 at rest, faded over 0.3 s."""
    begin, end = motion_of(log)
    return np.clip((log.t - begin) / 0.3, 0.0, 1.0) * np.clip((end - log.t) / 0.3, 0.0, 1.0)


def geared(factor: float, log: Log, _: Rng) -> Log:
    return replace(log, angle=log.angle * factor)


def folded(lowest: float, highest: float, size: float, log: Log, rng: Rng) -> Log:
    """A tone of the motors near the sampling rate folds to a slow one [Hz] of an amplitude [m/s²]."""
    tone = np.sin(2.0 * np.pi * rng.uniform(lowest, highest) * log.t + rng.uniform(0.0, 2.0 * np.pi))
    return replace(log, force=log.force + size * (tone * in_motion(log))[:, None] * np.array([1.0, 0.5, 0.5]))


def steps(size: float, log: Log, rng: Rng) -> Log:
    """The accelerometer's biases change once in motion."""
    begin, end = motion_of(log)
    after = log.t > rng.uniform(0.8 * begin + 0.2 * end, 0.2 * begin + 0.8 * end)
    return replace(log, force=log.force + size * after[:, None] * rng.choice([-1, 1], 3))


def rectified(size: float, log: Log, rng: Rng) -> Log:
    """Vibration makes biases that are there in motion only."""
    return replace(log, force=log.force + size * in_motion(log)[:, None] * rng.choice([-1, 1], 3))


def turns_off(share: float, log: Log, rng: Rng) -> Log:
    """The gyro's scale is wrong, of each axis by its own sign."""
    return replace(log, rate=log.rate * (1.0 + share * rng.choice([-1, 1], 3)))


def slips_on_shaft(share: float, log: Log, rng: Rng) -> Log:
    """One encoder slips on its shaft, three times for 0.6 s, and misses a share of all its turns."""
    angle, i, (begin, end) = log.angle.copy(), rng.integers(4), motion_of(log)
    lost = [np.clip((log.t_wheels - at) / 0.6, 0.0, 1.0) for at in rng.uniform(begin, end - 0.7, 3)]
    angle[:, i] -= share / 3.0 * np.ptp(angle[:, i]) * np.sum(lost, axis=0)
    return replace(log, angle=angle)


def late_stamp(late: float, log: Log, rng: Rng) -> Log:
    """One stamp of the encoders in motion is late."""
    t, (begin, end) = log.t_wheels.copy(), motion_of(log)
    t[rng.choice(np.flatnonzero((t > begin) & (t < end)))] += late
    return replace(log, t_wheels=t)


def short_hangs(length: float, log: Log, rng: Rng) -> Log:
    """Five times in motion the computer reads nothing; what waits then comes at once."""
    t, t_wheels, (begin, end) = log.t.copy(), log.t_wheels.copy(), motion_of(log)
    for at in rng.uniform(begin, end - length, 5):
        for stamps in (t, t_wheels):
            stamps[(stamps > at) & (stamps < at + length)] = at + length
    return replace(log, t=t, t_wheels=t_wheels)


def crystal(drift: float, scatter: float, log: Log, rng: Rng) -> Log:
    """The IMU's own crystal changes its rate as it warms up, and its stamps scatter [s]."""
    since = log.t - log.t[0]
    ahead = drift * rng.choice([-1, 1]) * (since - 5.0 * (1.0 - np.exp(-since / 5.0)))
    return replace(log, t=np.sort(log.t + ahead + scatter * rng.normal(size=since.size)))


def bits(g: float, degrees: float, log: Log, _: Rng) -> Log:
    """Readings of 12 bit, of a range of ± g and ± degrees a second."""
    steps_of = 2.0 * 9.80665 * g / 2**12, 2.0 * math.radians(degrees) / 2**12
    force, rate = (np.round(x / step) * step for x, step in zip((log.force, log.rate), steps_of, strict=True))
    return replace(log, force=force, rate=rate)


def coarse_stamps(rate: float, step: float, log: Log, rng: Rng) -> Log:
    """Encoders at a rate [Hz] of their own, stamped in steps [s]."""
    log = wheels_at(rate, log, rng)
    return replace(log, t_wheels=np.round(log.t_wheels / step) * step)


def lost_lines(times: int, length: float, log: Log, rng: Rng) -> Log:
    """Some times in motion all lines are lost."""
    begin, end = motion_of(log)
    imu, wheels = np.ones(log.t.size, dtype=bool), np.ones(log.t_wheels.size, dtype=bool)
    for at in rng.uniform(begin, end - length, times):
        imu &= (log.t < at) | (log.t >= at + length)
        wheels &= (log.t_wheels < at) | (log.t_wheels >= at + length)
    return kept(imu, wheels, log)


def put_down(log: Log, rng: Rng) -> Log:
    """For 2 s before the first standstill hands put the robot down and turn its wheels to and fro."""
    before = [x[0] - 2.0 + np.arange(0.0, 2.0, float(np.median(np.diff(x)))) for x in (log.t, log.t_wheels)]
    grip = [np.sin(0.5 * np.pi * (x - x[0])) for x in before]
    shaken = [
        size * grip[0][:, None] * lfilter([0.1], [1, -0.9], rng.normal(size=(before[0].size, 3)), axis=0)
        for size in (6.0, 1.0)
    ]
    turned = log.angle[0] + (grip[1] ** 2 * rng.uniform(0.5, 3.0))[:, None]
    return replace(
        log, t=np.append(before[0], log.t), force=np.concatenate([log.force[0] + shaken[0], log.force]),
        rate=np.concatenate([log.rate[0] + shaken[1], log.rate]),
        t_wheels=np.append(before[1], log.t_wheels), angle=np.concatenate([turned, log.angle]),
    )  # fmt: skip


def clock_steps(size: float, log: Log, rng: Rng) -> Log:
    """The encoders' clock is set once in motion."""
    return replace(
        log,
        t_wheels=log.t_wheels + size * rng.choice([-1, 1]) * (log.t_wheels > rng.uniform(*motion_of(log))),
    )


def smooth_rates(time: float, log: Log, _: Rng) -> Log:
    """Rates behind a first-order filter."""
    dt = float(np.median(np.diff(log.t_wheels)))
    a = 1.0 - math.exp(-dt / time)
    return replace(
        log, angle=lfilter([a], [1, a - 1], np.gradient(log.angle, axis=0) / dt, axis=0), unit="radps"
    )


Kind = Callable[[Log, Rng], Log]


def both(*kinds: Kind) -> Kind:
    def change(log: Log, rng: Rng) -> Log:
        for kind in kinds:
            log = kind(log, rng)
        return log

    return change


TURNS = ((0, 180), (1, 8), (1, 90), (2, 5), (2, 90), (2, 180))
RESTS = ((0.5, 0.5), (0.4, 3), (3, 0.4), (0, 3), (3, 0))

KINDS: dict[str, Kind] = {
    "as logged": lambda log, _: log,
    **{f"{n} counts": partial(counts, n) for n in (256, 512, 1024, 2048, 4096)},
    **{f"counter of {n} a turn": partial(counter, n) for n in (360, 1000)},
    **{f"encoders at {n} Hz": partial(wheels_at, n) for n in (10, 20, 200)},
    **{f"512 counts at {n} Hz": both(partial(wheels_at, n), partial(counts, 512)) for n in (10, 20, 200)},
    **{f"rates of {n} counts": partial(rates, n) for n in (512, 4096)},
    **{f"IMU in batches of {n}": partial(batch, n) for n in (2, 4, 8, 16)},
    **{f"all in batches of {n}": partial(both_batched, n) for n in (2, 4, 8)},
    **{f"noise x{n}": partial(noise, n) for n in (1, 3, 10)},
    **{f"noise x{n} in motion": partial(noise_in_motion, n) for n in (3, 10, 30)},
    **{f"low-pass {n} Hz": partial(low_pass, n) for n in (2, 5, 10, 20, 50)},
    **{f"IMU at {n} Hz, mean": partial(imu_at, n, True) for n in (10, 20, 50)},
    **{f"IMU at {n} Hz, picked": partial(imu_at, n, False) for n in (10, 20, 50)},
    **{f"jitter {1e3 * s:g} ms": partial(jitter, s) for s in (0.001, 0.003, 0.01)},
    **{f"late by {1e3 * s:g} ms": partial(late_stamps, s) for s in (0.003, 0.01)},
    **{f"hangs of up to {1e3 * s:g} ms": partial(burst, p, s) for p, s in ((0.05, 0.05), (0.01, 0.2))},
    **{f"{n} x {s:g} s repeated": partial(repeated, n, s) for n, s in ((5, 0.05), (5, 0.2))},
    **{f"encoders hang for {s:g} s": partial(hangs, s) for s in (0.1, 0.6)},
    **{f"one table at {n} Hz": partial(held, n) for n in (50, 100, 500)},
    **{f"{100 * s:g} % dropped": partial(dropped, s) for s in (0.02, 0.1, 0.3)},
    **{f"encoder clock {100 * s:g} %": partial(wheels_clock, s) for s in (0.005, 0.01, 0.02, 0.03)},
    **{f"IMU clock {100 * s:g} %": partial(imu_clock, s) for s in (0.005, 0.01, 0.02, 0.03)},
    "IMU counted, 2 %": partial(nominal_imu, 0.02),
    "both clocks 2 %": partial(both_clocks, 0.02),
    **{f"offset {s:g} s": partial(offset, s) for s in (0.05, 0.2, 2.0)},
    "epoch, 1 ms": partial(epoch, 0.001), "epoch, 10 ms": partial(epoch, 0.01),
    "dead wheel": partial(one_wheel, 0.0), "reversed wheel": partial(one_wheel, -1.0), "encoder dies": dies,
    "radii 1 %": partial(own_scales, "angle", 0.01), "encoder loses 20 %": partial(one_wheel, 0.8),
    **{f"IMU turned {d} deg about {'xyz'[a]}": partial(turned, a, d) for a, d in TURNS},
    "range 70 %": partial(saturated, 0.7), "range 40 %": partial(saturated, 0.4),
    **{f"accelerometer {100 * s:g} %": partial(scaled, "force", s) for s in (0.02, 0.05)},
    **{f"axes {100 * s:g} %": partial(own_scales, "force", s) for s in (0.01, 0.03)},
    "steps of 0.01": partial(rounded, 0.01), "steps of 0.1": partial(rounded, 0.1),
    "no gyro": partial(without, "gyro"), "one axis each": partial(without, "other axes"),
    "one wheel": partial(without, "wheels"),
    **{f"rest {a:g} s and {b:g} s": partial(ends, a, b) for a, b in RESTS},
    "drift 0.05": partial(temperature, 0.05), "drift 0.2": partial(temperature, 0.2),
    "counts a turn 3 % off": partial(scaled, "angle", 0.03),
    **{f"angles x{f:g}": partial(geared, f) for f in (0.25, 2.0, 4.0)},
    **{f"biases step by {s:g}, no end": both(partial(steps, s), partial(ends, 3, -1)) for s in (0.02, 0.1)},
    **{f"tone at {a:g} to {b:g} Hz": partial(folded, a, b, 1.0) for a, b in ((0.3, 1.5), (5.0, 12.0))},
    "IMU at 20 Hz, tone": both(partial(imu_at, 20, False), partial(folded, 0.3, 1.5, 1.0)),
    **{f"biases step by {s:g}": partial(steps, s) for s in (0.02, 0.1)},
    "rectified 0.1": partial(rectified, 0.1),
    **{f"gyro {100 * s:g} %": partial(turns_off, s) for s in (0.03, 0.1)},
    "slips on shaft, 15 %": partial(slips_on_shaft, 0.15),
    "stamp late by 100 ms": partial(late_stamp, 0.1), "hangs of 48 ms": partial(short_hangs, 0.048),
    "crystal 1 %": partial(crystal, 0.01, 0.001), "12 bit": partial(bits, 16.0, 2000.0),
    "37 Hz, stamps in 10 ms": partial(coarse_stamps, 37.0, 0.01),
    "4 x 0.2 s lost": partial(lost_lines, 4, 0.2),
    "put down by hand": put_down, "encoder clock steps by 50 ms": partial(clock_steps, 0.05),
    "rates smoothed over 0.2 s": partial(smooth_rates, 0.2),
    "cheap": both(partial(counts, 1024), partial(noise, 3), partial(low_pass, 20), partial(jitter, 0.003)),
}  # fmt: skip
"""Name of a kind to what it makes of a log."""
