"""Where the robot stands still: its wheels give no counts, and its IMU reads as it does at rest.

One detector for all: what `inspect` lists, `check` demands and the filter's zero-velocity updates go by. Its
limits are what the log's own noise at rest makes of a window with the probability `FALSE_ALARM`, by a test of
the variance about the window's mean [1], or of that mean against the level of the standstill.

What a sensor cannot see is no standstill. A wheel may creep below a count: when the counts have stopped, a
robot that comes to rest is no faster than a count over the time since. A standstill begins when that is below
`CREEP`, or at half of the time without counts, and the velocity that may be left then goes into the std of
the zero-velocity update. An IMU does not see a constant velocity at all: without wheels a standstill begins
at half of the time in which it is quiet.

[1] I. Skog, P. Händel, J.-O. Nilsson, J. Rantakokko, Zero-velocity detection - an algorithm evaluation, IEEE
Trans. Biomed. Eng. 57 (2010).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d
from scipy.special import chdtri, ndtri

from granite_lab.logs.counters import Mask, quantum, runs
from granite_lab.logs.trial import Array, ImuStream, Trial, WheelStream
from granite_lab.parameters import ImuGrade, Robot

COAST = 0.01
"""Slip velocity goes with the wheel speed down to this [m/s]: below, play and settling move the body. A
body whose wheels coast to rest is then as slow as they are."""

LONGEST_GAP = 0.5
"""IMU samples missing for longer than this [s] while the robot moves cannot be bridged."""

MOVING = 0.02
"""Wheel velocity [m/s] above which a wheel certainly rolls."""

Interval = tuple[float, float]

LEAST_REST = 0.3
"""A standstill shorter than this [s] says too little about biases to be used."""

CREEP = 1.0e-4
"""Velocity [m/s] below which the robot counts as standing. A robot whose motors cannot brake coasts out over
seconds, and a zero-velocity update at 1 mm/s there shifts the whole trial by that much."""

ZERO_VELOCITY = 3.0e-4
"""Std of the zero-velocity update [m/s]: what a robot that stands may still move."""

FALSE_ALARM = 1.0e-4
"""Probability with which a window of white noise at rest is taken for motion."""

WINDOW = 0.2
"""Length of the window in which stillness is judged [s]."""

SWING, SAMPLES, CALM = 0.5, 5, 0.3
"""A swing of 2 Hz or faster on the tyres shows in a window of this length [s], by so many means of samples.
At rest a window is called restless with the last probability; one calm window nearby is enough."""

GENTLE = 0.05
"""A robot that sets off more gently than this [m/s^2] needs 10 s for 0.5 m/s."""

LOUD = 3.0
"""An IMU that is this many times as loud as its grade may be moving."""

SLOW = 0.1
"""Logged rates at rest are below this share of the usual ones."""

BRIDGED = 0.06
"""A standstill is interrupted by more than so much [s]."""

ROUNDED = 12.0**-0.5
"""Std of a rounding error, in steps."""


@dataclass(frozen=True, eq=False)
class WheelTravel:
    """Rolled distances of the wheels (M samples), by which standstills are found.

    Attributes:
        t: (M,) stamps [s].
        distance: (M, 4) rolled distance [m], NaN where unknown.
        velocity: (M, 4) where the logger gives rates [m/s]; these are judged then.
        resolution: (4,) smallest step of each wheel's distance [m], or of its velocity [m/s].
    """

    t: Array
    distance: Array
    velocity: Array | None
    resolution: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Still:
    """Samples at which a sensor sees no motion.

    Attributes:
        at: (N,) True there.
        unseen: (N,) std of the velocity that the sensor cannot see [m/s]; 0 from the log's start on.
        turns: (N,) True where it sees motion.
    """

    at: Mask
    unseen: Array
    turns: Mask


def travel_of(wheels: WheelStream, robot: Robot) -> WheelTravel:
    """Return the rolled distances of a log's wheels, angle times radius."""
    radius = robot.wheels.radius
    velocity = None if wheels.rate is None else wheels.rate * radius
    resolution = tuple(step * radius for step in wheels.resolution)
    return WheelTravel(wheels.t, wheels.angle * radius, velocity, resolution)


def standstills(trial: Trial, robot: Robot) -> list[Interval]:
    """Return the standstills [s] of a trial by its sensors as logged."""
    wheels, imu = trial.wheels, trial.imu
    if imu is not None and (imu.t.size < 8 or np.isnan(imu.specific_force).all()):
        imu = None
    turning = None if wheels is None or wheels.t.size <= 2 else travel_of(wheels, robot)
    if imu is None and turning is None:
        return []
    return find_standstills(imu, turning, robot.imu_grade)[0]


def find_standstills(
    imu: ImuStream | None, wheels: WheelTravel | None, grade: ImuGrade, *, offset: float = 0.0
) -> tuple[list[Interval], Array]:
    """Find the standstills by the sensors that there are, one of them at least.

    Both wheels and IMU must be still where both exist. A wrong clock offset between them only
    shortens the intervals (or lets a coasting end in, whose velocity the update's std covers).

    Args:
        imu: without spikes, with its `grade`.
        wheels: on their own clock, which lies behind the IMU's by `offset` [s].

    Returns:
        the standstills [s]; (N,) std of the velocity that no sensor can see at the first sample of each
        [m/s], else 0. Both are on the IMU's clock and at its samples, else on the wheels'.
    """
    if imu is None:
        assert wheels is not None
        t, stands = wheels.t + offset, wheels_still(wheels)
        still, unseen = stands.at, stands.unseen
    else:
        t, unseen = imu.t, np.full(imu.t.size, np.inf)
        still = imu_quiet(imu, grade)
        if wheels is not None:
            stands = at_stamps(wheels_still(wheels, still, imu.t - offset), wheels.t + offset, t)
            unseen = stands.unseen
            still = stands.at & imu_quiet(imu, grade, stands.at)
        still = without_swings(imu, still, grade)
        if wheels is None:
            still = late_halves(imu, still)
    rests, creep, dt = list[Interval](), np.zeros(t.size), float(np.median(np.diff(t)))
    for a, b in runs(bridged(t, still, max(BRIDGED, 2.5 * dt))):
        begin, end = float(t[a]), float(t[b - 1])
        if end - begin >= 0.5 * LEAST_REST:
            rests.append((begin, end))
            hidden = np.inf if imu is None else unseen_by_imu(imu, a, b)
            creep[a] = 1.0 / np.hypot(1.0 / max(unseen[a], 1e-9), 1.0 / hidden) if unseen[a] > 0 else 0.0
    return rests, creep


def wheels_still(wheels: WheelTravel, quiet: Mask | None = None, quiet_t: Array | None = None) -> Still:
    """Say where no wheel turns faster than a creep.

    The noise of logged rates is learnt where the IMU is `quiet` (N,), at `quiet_t` on the wheels' clock [s].
    """
    if wheels.velocity is None:
        return _by_counts(wheels)
    certain = np.zeros(wheels.t.size, dtype=bool)
    if quiet is not None and quiet_t is not None:
        place = np.clip(np.searchsorted(quiet_t, wheels.t), 0, quiet.size - 1)
        certain = quiet[place]
    return _by_rates(wheels, wheels.velocity, certain)


def _by_counts(wheels: WheelTravel) -> Still:
    """Say where the wheels stand, by distances (M, 4) in whole counts.

    A count is larger than a creep in `LEAST_REST`. One that is taken back at once is no motion. What the
    wheel of the finest counts does not show, the body does not do.
    """
    t, count = wheels.t, np.inf
    turns, logged = np.zeros(t.size, dtype=bool), np.isfinite(wheels.distance)
    stand = np.asarray(logged.any(axis=1))
    first = int(stand.argmax())
    for distance, finite, resolution in zip(wheels.distance.T, logged.T, wheels.resolution, strict=True):
        if not finite.any():
            continue
        place, smallest = np.flatnonzero(finite), max(resolution, CREEP * LEAST_REST)
        step = np.diff(np.rint((distance[place] - distance[place[0]]) / smallest))
        count = min(count, smallest) if step.any() else count
        changed = np.flatnonzero(step)
        back = np.zeros(changed.size, dtype=bool)
        back[1:] = (step[changed[1:]] == -step[changed[:-1]]) & (np.abs(step[changed[1:]]) == 1)
        back[:-1] |= back[1:]
        counted, stands = np.zeros(t.size, dtype=bool), ~finite
        counted[place[changed[~back] + 1]] = True
        for a, b in _without_counts(t, counted, smallest / ZERO_VELOCITY):
            stands[a:b] = True
        turns |= counted
        stand &= stands
    count = count if np.isfinite(count) else max(*wheels.resolution, CREEP * LEAST_REST)
    still, unseen = np.zeros(t.size, dtype=bool), np.full(t.size, np.inf)
    for a, b in runs(stand):
        length, since, left = t[b - 1] - t[a], t[a:b] - t[a], t[b - 1] - t[a:b]
        # the IMU's clock may be off, too
        waits = min(max(ROUNDED * count / CREEP, 0.5 * WINDOW), 0.5 * length) if a > first else 0.0
        sets_off = max(float(np.sqrt(2.0 * count / GENTLE)), 0.5 * WINDOW)
        leaves = min(sets_off, 0.25 * length) if b < t.size else 0.0
        still[a:b] = (since >= waits) & (left >= leaves) & (length >= LEAST_REST)
        unseen[a:b] = ROUNDED * count / np.maximum(since, 1e-9) if a > first else 0.0
    return Still(still, unseen, turns)


def _without_counts(t: Array, counted: Mask, lasting: float) -> list[tuple[int, int]]:
    """Return the stretches of samples without counts that are standstills.

    Two that a single count parts are one standstill if the first lasts so long that the robot stands all the
    same, `lasting` [s]; else the robot creeps in it, unless the log begins with it.
    """
    edges = np.flatnonzero(counted)
    stretches: list[tuple[int, int]] = []
    for a, b in zip([0, *edges], [*edges, t.size], strict=True):
        length = t[b - 1] - t[a]
        first, parted = stretches[-1] if stretches else (0, -1)
        if parted == a and t[a - 1] - t[first] >= lasting and (length >= LEAST_REST or b == t.size):
            stretches[-1] = (first, b)
        elif length >= LEAST_REST:
            if parted == a and first > 0:
                stretches.pop()
            stretches.append((a, b))
    return stretches


def _by_rates(wheels: WheelTravel, velocity: Array, certain: Mask) -> Still:
    """Say where the wheels stand, by velocities (M, 4) [m/s], whose noise is learnt from the slow of them.

    These are those at which the robot stands for `certain` (M,), by its IMU. Where none tells, they are the
    windows whose mean is zero within their own scatter for as long as a standstill lasts: a wheel that is
    reversed passes through zero, and its change of speed is no noise.
    """
    t, logged = wheels.t, np.isfinite(velocity)
    size = max(round(WINDOW / float(np.median(np.diff(t)))), 1) | 1
    still = np.asarray(logged.any(axis=1))
    unseen = np.zeros(t.size)
    for rate, finite, resolution in zip(velocity.T, logged.T, wheels.resolution, strict=True):
        if not finite.any():
            continue
        clean = np.interp(t, t[finite], rate[finite])
        power, mean = (uniform_filter1d(x, size, mode="nearest") for x in (clean**2, clean))
        usual = float(np.quantile(np.abs(clean), 0.9))
        slow = np.abs(mean) < SLOW * usual
        scatter = np.sqrt(np.maximum(power - mean**2, 0.0) / size)
        pool = certain & slow
        if pool.sum() <= size:
            pool = _lasting(t, slow & (np.abs(mean) <= 3.0 * scatter))
        floor = max(1.01 * resolution, 3.0 * CREEP) ** 2
        limit = floor
        if pool.any():
            # four wheels, over a rest of some seconds that must not fall apart
            limit = max(floor, _noise(power[pool], size, 0.25) ** 2 * _highest(size, 0.01 * FALSE_ALARM))
        still &= (power <= limit) | ~finite
        # what lies between none and the smallest rate that is ever logged reads as none, however long
        least = float(np.abs(rate[finite & (rate != 0.0)]).min(initial=np.inf))
        hidden = ROUNDED * least if np.isfinite(least) else 0.0
        unseen = np.maximum(unseen, np.hypot(np.sqrt(limit / size), hidden))
    blind, turns = float(unseen.max(initial=0.0)), ~still
    for a, b in runs(still):
        if t[b - 1] - t[a] < LEAST_REST:
            still[a:b] = False
        elif a > 0 and blind > CREEP:
            still[a : (a + b) // 2] = False
        if a == 0:
            unseen[:b] = 0.0
    return Still(still, unseen, turns)


def _lasting(t: Array, mask: Mask) -> Mask:
    """(M,) `mask` without what is shorter than a standstill, at stamps t [s]."""
    left = np.zeros(mask.size, dtype=bool)
    for a, b in runs(mask):
        left[a:b] = t[b - 1] - t[a] >= LEAST_REST
    return left


def _noise(power: Array, dof: float, share: float) -> float:
    """Return the std of white noise whose windows have the same quantile, `share`, as `power` (N,)."""
    return float(np.sqrt(np.quantile(np.maximum(power, 0.0), share) * dof / chdtri(dof, 1.0 - share)))


def _highest(dof: float, chance: float = FALSE_ALARM) -> float:
    """Mean square of a window of white noise of std 1 that is exceeded by `chance`."""
    return float(chdtri(dof, chance) / dof)


def rolls(wheels: WheelTravel, t: Array) -> Mask:
    """(N,) True at instants t where a wheel certainly rolls: faster than `SLOW` of what is usual."""
    rolling = np.zeros(t.size, dtype=bool)
    reach = 0.5 * WINDOW
    for distance in wheels.distance.T:
        finite = np.isfinite(distance)
        if finite.sum() > 1:
            ahead, behind = (np.interp(t + s, wheels.t[finite], distance[finite]) for s in (reach, -reach))
            speed = np.abs(ahead - behind) / WINDOW
            rolling |= speed > SLOW * float(np.quantile(speed, 0.9))
    return rolling


def coasting(wheels: WheelTravel | None, begin: float, end: float) -> bool:
    """Whether every wheel turns more slowly than `COAST` on the average of an interval [s]."""
    if wheels is None or not wheels.t[0] <= begin < end <= wheels.t[-1]:
        return False
    counted = [(wheels.t[seen], d[seen]) for d in wheels.distance.T if (seen := np.isfinite(d)).sum() > 1]
    ways = [abs(float(np.diff(np.interp([begin, end], *samples))[0])) for samples in counted]
    return bool(ways) and max(ways) < COAST * (end - begin)


def unbridged(
    gaps: Sequence[Interval], rests: Sequence[Interval], wheels: WheelTravel | None, offset: float = 0.0
) -> list[Interval]:
    """Return the gaps [s] over `LONGEST_GAP` in which the robot neither stands nor coasts to rest.

    The wheels' clock lies behind that of gaps and standstills by `offset` [s].
    """
    return [
        (a, b)
        for a, b in gaps
        if b - a > LONGEST_GAP
        and not any(begin - 0.02 <= a and b <= end + 0.02 for begin, end in rests)
        and not coasting(wheels, a - offset, b - offset)
    ]


def at_stamps(still: Still, stamps: Array, t: Array) -> Still:
    """Return at instants t (N,) what was found at `stamps` (M,): both samples beside must agree."""
    after = np.clip(np.searchsorted(stamps, t), 1, stamps.size - 1)
    near = (t >= stamps[0] - WINDOW) & (t <= stamps[-1] + WINDOW)
    at, turns = (mask[after] & mask[after - 1] for mask in (still.at, still.turns))
    return Still(at & near, still.unseen[after], turns)


def restlessness(values: Array, size: int, few: int = 1) -> Array:
    """(N, 3) variance of each column (N, 3) in a sliding window of `size` samples; 0 where it is not known.

    The samples are averaged over a `few` before.
    """
    logged = np.where(np.isfinite(values).any(axis=0), values, 0.0)
    centred = np.nan_to_num(logged - np.nanmedian(logged, axis=0))
    clean = uniform_filter1d(centred, few, axis=0, mode="nearest")
    power, level = (uniform_filter1d(x, size, axis=0, mode="nearest") for x in (clean**2, clean))
    return np.asarray(np.maximum(power - level**2, 0.0))


def period_of(imu: ImuStream) -> float:
    """Median time between two samples [s]."""
    return float(np.median(np.diff(imu.t)))


def imu_quiet(imu: ImuStream, grade: ImuGrade, stand: Mask | None = None, window: float = WINDOW) -> Mask:
    """(N,) True where the IMU is as quiet as it ever is in this log.

    The quiet level is the lower quartile over the samples where the wheels `stand`, or a low
    percentile of all where there are none, so a motor that hums or a table that shakes is allowed
    for; the grade's noise and half a step of the values are the floor. Without wheels, a log that is louder
    than the grade and no louder at any other time may be all steady motion: then nothing is called quiet.
    """
    quiet, dt = np.ones(imu.t.size, dtype=bool), period_of(imu)
    few = max(round(window / SAMPLES / dt), 1) if window > WINDOW else 1
    size = max(round(window / dt), 3)
    floors = (grade.accel_noise, grade.gyro_noise)
    for values, density in zip((imu.specific_force, imu.angular_rate), floors, strict=True):
        axes = restlessness(values, size, few)
        if not axes.any():
            continue
        power = axes.sum(axis=1)
        step = max(step_of(values).max(), 0.0)
        least = max(density / np.sqrt(few * dt), 0.5 * step)
        pool = power[stand] if stand is not None and stand.sum() * dt > LEAST_REST else power
        # axes of unlike noise count as less than three (Satterthwaite 1946)
        usual = np.median(axes, axis=0)
        unlike = float(usual.sum()) ** 2 / max(float(usual @ usual), 1e-300)
        dof = (max(size // few, 3) - 1) * max(unlike, 1.0)
        base = _noise(pool, dof, 0.25 if pool is not power else 0.05)
        loudest = float(np.sqrt(np.quantile(power, 0.9)))
        if stand is None and base > LOUD * least and loudest < LOUD * base:
            return np.zeros(imu.t.size, dtype=bool)
        chance = FALSE_ALARM if few == 1 else CALM
        quiet &= power <= max(base, least) ** 2 * _highest(dof, chance)
    return quiet


def step_of(values: Array) -> Array:
    """(3,) smallest step of each column of an IMU's samples (N, 3); 0 where none shows."""
    return np.array([quantum(column[np.isfinite(column)]) for column in values.T])


def without_swings(imu: ImuStream, still: Mask, grade: ImuGrade) -> Mask:
    """(N,) `still` without the time in which the body yet swings on its tyres.

    What a slow swing adds to the noise shows in a longer window, in which the samples are averaged first. A
    standstill begins with its longest calm part, or is none. What is calm the quietest standstill tells,
    where the others are not as calm for a quarter of the time.
    """
    dt = period_of(imu)
    few, size = max(round(SWING / SAMPLES / dt), 1), max(round(SWING / dt), 3)
    force = np.sqrt(restlessness(imu.specific_force, size, few).sum(axis=1))
    stands = [(a, b) for a, b in runs(still) if (b - a) * dt >= 0.5 * LEAST_REST]
    if not stands:
        return still
    a, b = min(stands, key=lambda run: float(np.median(force[slice(*run)])))
    left, quietest = still.copy(), np.zeros(still.size, dtype=bool)
    quietest[a:b] = True
    loud = float(np.percentile(force[still], 25)) > 1.5 * float(np.median(force[a:b]))
    calm = imu_quiet(imu, grade, quietest if loud else still, SWING)
    calm = maximum_filter1d(calm, max(round(SWING / dt), 1))
    for a, b in stands:
        begin, end = max(runs(calm[a:b]), key=lambda run: run[1] - run[0], default=(0, 0))
        left[a : a + begin if (end - begin) * dt >= 0.5 * LEAST_REST else b] = False
    return left


def late_halves(imu: ImuStream, still: Mask) -> Mask:
    """(N,) `still` as an IMU alone can tell it.

    A body that gains or loses speed shows it by a specific force unlike that of the standstill's other half.
    What does not show is left out with the first half of what is left, where motion precedes it.
    """
    dt, left = period_of(imu), np.zeros(still.size, dtype=bool)
    for a, b in runs(bridged(imu.t, still, max(BRIDGED, 2.5 * dt))):
        begin, end, force = a, b, imu.specific_force[a:b]
        if a > 0:
            begin += _unlike(force, dt)
            begin = (begin + b) // 2
        if b < still.size:
            end -= _unlike(force[begin - a :][::-1], dt)
        left[begin:end] = (b - a) * dt >= LEAST_REST
    return left


def _unlike(force: Array, dt: float) -> int:
    """Return how many of the first samples (N, 3) are not on the level of the second half, over `SWING`."""
    half = len(force) // 2
    if half < 2:
        return 0  # too few samples to be compared
    size, off = max(min(round(SWING / dt), half // 2), 1), np.zeros(half, dtype=bool)
    for signal in force.T[np.isfinite(force).all(axis=0)]:
        noise = max(float(np.std(np.diff(signal))) / np.sqrt(2.0), 0.5 * quantum(signal))
        limit = -ndtri(FALSE_ALARM) * noise * np.sqrt(1.0 / size + 1.0 / max(half, 1))
        mean = uniform_filter1d(signal, size, mode="nearest")[:half]
        off |= np.abs(mean - signal[half:].mean()) > limit
    return int(np.flatnonzero(off)[-1]) + 1 if off.any() else 0


def unseen_by_imu(imu: ImuStream, a: int, b: int) -> float:
    """Std of the velocity [m/s] that a body may lose from sample a to b without that its IMU shows it.

    White noise hides the change of a velocity that grows with the root of the time, rounding one that grows
    with the time.
    """
    force = imu.specific_force[a:b]
    force = force[:, np.isfinite(force).all(axis=0)]
    if len(force) < 3 or force.shape[1] == 0:
        return np.inf
    dt, length = period_of(imu), float(imu.t[b - 1] - imu.t[a])
    noise = float(np.max(np.std(np.diff(force, axis=0), axis=0))) / np.sqrt(2.0)
    step = float(step_of(force).max())
    hidden = ROUNDED * step * length if noise < 0.5 * step else 0.0
    return float(np.hypot(noise * np.sqrt(dt * length), hidden)) + 1e-9


def bridged(t: np.ndarray, mask: Mask, longest: float) -> Mask:
    """(N,) mask without the interruptions whose neighbours are at most `longest` apart [unit of t]."""
    closed = mask.copy()
    for a, b in runs(~mask):
        if a > 0 and b < mask.size and t[b] - t[a - 1] <= longest:
            closed[a:b] = True
    return closed


def inside(t: Array, intervals: Sequence[Interval]) -> np.ndarray:
    """(N,) True where a stamp lies in one of the intervals."""
    mask = np.zeros(t.size, dtype=bool)
    for begin, end in intervals:
        mask |= (t >= begin) & (t <= end)
    return mask
