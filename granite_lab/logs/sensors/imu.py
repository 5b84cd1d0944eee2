"""Checks of the inertial samples: units, rails, dead axes, exchanged axes.

Gravity fixes the accelerometer's unit, and the turning of the gravity vector the gyroscope's: unmistakable
evidence corrects it, with a warning; the rest is refused or reported. An axis is judged by the other sensors.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial.transform import Rotation

from granite_lab.errors import InputError
from granite_lab.logs.counters import Mask, mad_std, runs
from granite_lab.logs.layouts import Log
from granite_lab.logs.quantities import ACCELERATION, RATE, SENSORS, STANDARD_GRAVITY, factors, gravity_unit
from granite_lab.logs.sensors.pitch_rate import contradicted
from granite_lab.logs.sensors.standstill import Interval, inside
from granite_lab.logs.trial import Array, ImuStream
from granite_lab.parameters import GRAVITY, Robot

_WINDOW = 0.5  # length [s] of the windows over which vibration is averaged away
# Angle by the gyroscope over that by gravity. Above it deg/s were read as rad/s; below a hundredth of it,
# rad/s were read as deg/s.
_TURNED = 2.0
_FASTEST = 60.0  # no ground robot's gyroscope reads more [rad/s]
_OFF_AXIS = 45.0  # gravity at rest farther than this [deg] from the robot's z axis stands on another axis
_FILLED = 0.1  # three axes that read the same in so many samples hold no readings
_TOUCHES = 5  # a rail is touched so often, and judged by so many values beside it
_HANGS = 0.5  # all axes of a sensor that repeat themselves for longer [s] hang
_SPIKE = (1.0, 0.3)  # a single reading nearer than this to its neighbours is no spike [m/s^2], [rad/s]


class Windows(NamedTuple):
    """What K windows of an IMU show."""

    period: float  # of the samples [s]
    mean: Array  # (K, 3) specific force [m/s^2]
    std: Array  # (K,) of the specific force [m/s^2]
    turned: Array  # (K-1, 3) turning from one window to the next [rad]
    noise: Array  # (K,) std of the rates [rad/s]


def check_units(imu: ImuStream, log: Log) -> tuple[ImuStream, ImuStream]:
    """Check units, rails and dead axes; return the IMU in corrected units, and the same without spikes.

    An accelerometer in no unit that fits gravity is refused.
    """
    clean = despike(imu)[0]
    seen = _windows(clean)
    a, removed = (1.0, imu.gravity_removed) if seen is None else _acceleration(imu, seen, log)
    g = _rate(clean.angular_rate, removed, seen, log)
    imu, clean = (
        dataclasses.replace(
            samples,
            specific_force=samples.specific_force * a,
            angular_rate=samples.angular_rate * g,
            gravity_removed=removed,
        )
        for samples in (imu, clean)
    )
    _report_rails(imu, log)
    return imu, clean


def despike(stream: ImuStream) -> tuple[ImuStream, Mask]:
    """Replace single readings far off both neighbours; return the stream, and which samples (N,) they were.

    A knock lasts longer than one or two samples. Where more than one sample in a hundred would go, the frame
    really shakes like that, and none is touched.
    """
    hit = np.zeros(stream.t.size, dtype=bool)
    both = np.hstack([stream.specific_force, stream.angular_rate])
    for axis, signal in enumerate(both.T.copy()):
        if stream.t.size < 50 or not np.isfinite(signal).all():
            continue
        middle = median_filter(signal, 5, mode="nearest")
        off = np.abs(signal - middle)
        spike = off > max(_SPIKE[axis // 3], 5.0 * float(np.percentile(off, 90)))
        both[spike, axis] = middle[spike]
        hit |= spike
    if not hit.any() or hit.mean() > 0.01:
        return stream, np.zeros(stream.t.size, dtype=bool)
    return dataclasses.replace(stream, specific_force=both[:, :3], angular_rate=both[:, 3:]), hit


def mounted(robot: Robot) -> Rotation:
    """Return the rotation of the robot's file: the sensor's axes are R's, turned by roll, pitch, yaw.

    Intrinsic z-y-x, so that ``rotation.apply(sensor vector)`` is the vector in robot axes.
    """
    roll, pitch, yaw = robot.imu.rotation
    return Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True)


def with_forward_axis(imu: ImuStream, log: Log) -> ImuStream:
    """Leave an accelerometer out, with a warning, whose axis that points forward was not logged."""
    absent = np.isnan(imu.specific_force).all(axis=0)
    forward = np.abs(mounted(log.robot).as_matrix()[0]) > 0.5
    needed = absent & (forward | (log.robot.imu.forward == "find"))
    if absent.all() or not needed.any():
        return imu
    axis = "xyz"[int(np.argmax(needed))]
    why = f"axis {axis} is not in the log, and it points forward or may"
    log.doubt(why, "accelerometer", "the accelerometer is not used")
    return dataclasses.replace(imu, specific_force=np.full_like(imu.specific_force, np.nan))


def refuse_axes(imu: ImuStream, still: Sequence[Interval], rolls: Mask, log: Log) -> None:
    """Refuse axes that are dead, exchanged or turned, in a log whose wheels move.

    The IMU is without spikes, in units that were checked; `still` are standstills [s], and the wheels turn at
    the samples `rolls` (N,).
    """
    mounting = mounted(log.robot).as_matrix()
    _refuse_dead(imu, mounting, rolls, log)
    complete = not np.isnan(imu.specific_force).any()
    if complete and not imu.gravity_removed and log.robot.imu.forward != "find":
        _refuse_gravity(imu, mounting, still, log)
        _refuse_pitch_rate(imu, mounting, still, log)


def _windows(imu: ImuStream) -> Windows | None:
    """Average the stream over windows; None where it is too short or an axis is missing."""
    dt = float(np.median(np.diff(imu.t)))
    n = max(int(_WINDOW / dt), 3)
    count = len(imu.t) // n
    if count < 4 or np.isnan(imu.specific_force).any():
        return None
    force = imu.specific_force[: count * n].reshape(count, n, 3)
    rate = np.nan_to_num(imu.angular_rate)
    rate = rate - np.median(rate, axis=0)
    angle = np.cumsum(rate, axis=0) * dt
    middle = angle[n // 2 : count * n : n][:count]
    noise = rate[: count * n].reshape(count, n, 3).std(axis=1).mean(axis=1)
    return Windows(dt, force.mean(axis=1), force.std(axis=1).max(axis=1), np.diff(middle, axis=0), noise)


def _acceleration(imu: ImuStream, seen: Windows, log: Log) -> tuple[float, bool]:
    """Compare the mean specific force with gravity; return its factor to SI and whether gravity is out."""
    removed = imu.gravity_removed
    norm = np.linalg.norm(seen.mean, axis=1)
    calm = seen.std <= np.quantile(seen.std, 0.3)
    g, std = float(np.median(norm[calm])), float(np.median(seen.std[calm]))
    if abs(g / STANDARD_GRAVITY - 1) < 0.12:
        if removed:
            log.doubt(
                "gravity is declared as removed, but the accelerometer measures it", remedy="it is used"
            )
        elif abs(g / STANDARD_GRAVITY - 1) > 0.06:
            log.doubt(f"the accelerometer reads {g:.2f} m/s^2 at rest, expected 9.81: scale error?")
        return 1.0, False
    if removed:
        return 1.0, True
    declared, sizes = log.unit(*ACCELERATION), factors("acceleration")
    raw = g / sizes[declared]
    unit = gravity_unit(raw, 0.08)
    change = sizes[unit or declared] / sizes[declared]
    reads = f"the accelerometer, declared in {declared}, reads {raw:.4g} at rest"
    # In the right unit vibration at the calmest stays below gravity.
    if unit and std * change < 0.5 * STANDARD_GRAVITY:
        log.convert(ACCELERATION, unit, f"{reads}: it is in {unit}")
        return change, False
    if g < 0.8:
        gone = "the logger has removed gravity, so that pitch cannot be levelled"
        log.doubt(f"the accelerometer reads {g:.2g} m/s^2 at rest: {gone}")
        return 1.0, True
    message = f"{log.where}: {reads}, expected 9.81 m/s^2, 1 g, 1000 mg or, with gravity removed, 0"
    alike = (imu.specific_force == imu.specific_force[:, :1]).all(axis=1)
    if alike.mean() > _FILLED:
        filler = f"all axes read {np.median(imu.specific_force[alike]):g} again and again"
        raise InputError(f"{message}; {filler}", "leave cells empty where the sensor gave no value")
    named = log.column(*(channel for channel in ACCELERATION if channel in log.columns))
    fits = f"unit = … or scale = {STANDARD_GRAVITY / g:.4g}" if g > 0 else "unit = … or scale = …"
    raise InputError(message, f"give {named} the unit that the logger uses, in a column map by {fits}")


def _rate(rate: Array, removed: bool, seen: Windows | None, log: Log) -> float:
    """Compare the gyroscope with the turning of gravity and the grade's noise; return its factor to SI."""
    if np.isnan(rate).all():
        return 1.0
    declared, peak = log.unit(*RATE), float(np.nanmax(np.abs(rate)))
    turning = math.nan if removed or seen is None else _turning_ratio(seen)
    # The turning of the gravity vector, as the accelerometer sees it, contains all of the true turning:
    # a ratio beyond 1 is impossible. Vibration and acceleration lower it to a few hundredths on flat ground
    # (0.06 to 1.1 in logs of a rover on sand, a Husky on sand and snow, and a car).
    too_large = turning > _TURNED or (math.isnan(turning) and peak > _FASTEST)
    too_small = turning < _TURNED / 100 and seen is not None and not _noise_ratio(seen, log.robot) > 1 / 15
    why = f"it turns {turning:.3g} times as far as gravity does"
    why = f"it reads up to {peak:.0f} rad/s" if math.isnan(turning) else why
    if (too_large and declared == "rad/s") or (too_small and declared == "deg/s"):
        sizes, unit = factors("angular rate"), "deg/s" if too_large else "rad/s"
        log.convert(RATE, unit, f"the gyroscope, declared in {declared}, is in {unit} ({why})")
        return sizes[unit] / sizes[declared]
    if too_large:
        log.doubt(f"the gyroscope, declared in {declared}, reads far too much ({why}): wrong unit?")
    return 1.0


def _turning_ratio(seen: Windows) -> float:
    """Return how far the gyroscope turns relative to the gravity vector, NaN if unknown.

    The larger of two comparisons, by root mean square and by median: on smooth ground a few ramps
    would drown the turning in the first, while the noise of rest and steady drive rules the second.
    """
    up = seen.mean / np.linalg.norm(seen.mean, axis=1, keepdims=True)
    moved = np.diff(up, axis=0)
    # Only turning about axes across gravity moves the gravity vector.
    across = np.cross(seen.turned, (up[1:] + up[:-1]) / 2)
    turned, tilted = np.linalg.norm(across, axis=1), np.linalg.norm(moved, axis=1)
    if np.median(tilted) < 1e-6 or np.median(turned) < 1e-12:
        return math.nan  # a dead sensor says nothing about units
    by_square = float(np.sqrt((turned**2).mean() / (tilted**2).mean()))
    return max(by_square, float(np.median(turned) / np.median(tilted)))


def _noise_ratio(seen: Windows, robot: Robot) -> float:
    """Return the gyroscope's noise at rest over that of the robot's grade, NaN without a rest."""
    grade, quietest = robot.imu_grade, float(np.quantile(seen.noise, 0.1))
    # Without a rest the quietest windows are hardly quieter than the others.
    if grade.gyro_noise == 0 or not 0 < quietest <= 0.3 * float(np.median(seen.noise)):
        return math.nan
    white = grade.gyro_noise * math.sqrt(0.5 / seen.period)
    return quietest / math.hypot(white, grade.gyro_step / math.sqrt(12))


def _report_rails(imu: ImuStream, log: Log) -> None:
    """Report axes that stay at the end of their range, and axes that never change."""
    grade = log.robot.imu_grade
    limits, units = (grade.accel_range, grade.gyro_range), ("m/s^2", "rad/s")
    for (name, _, values), unit, limit in zip(_sensors(imu), units, limits, strict=True):
        for axis, column in zip("xyz", values.T, strict=True):
            if np.isnan(column).all():
                continue
            if np.ptp(column) == 0 and len(column) > 10:
                seen = f"constant at {column[0]:g} {unit}, as if not connected"
                log.doubt(seen, f"{name} {axis}", dead=True)
            elif (at_rail := (np.abs(column) >= 0.999 * limit) | rail(column)).any():
                log.doubt(
                    f"saturated at {column[at_rail][0]:.4g} {unit} in {int(at_rail.sum())} samples, first at "
                    f"t = {imu.t[int(np.argmax(at_rail))]:.3f} s",
                    f"{name} {axis}",
                )


def _sensors(imu: ImuStream) -> tuple[tuple[str, tuple[str, ...], Array], ...]:
    """Return name, channels and samples of both sensors."""
    kinds = ((SENSORS["acceleration"], imu.specific_force), (SENSORS["rate"], imu.angular_rate))
    return tuple((sensor.name, sensor.channels, values) for sensor, values in kinds)


def rail(axis: Array) -> Mask:
    """Mark the samples (N,) at an axis's largest or smallest reading, where that is a rail.

    A rail is met by three samples in a row, more than the axis repeats itself elsewhere (a logger
    that holds the last value does so everywhere), and away from the usual reading. Vibration may touch it for
    a sample at a time: then the axis reads it far oftener than the values next to it, which in a signal with
    room to swing are the more frequent ones.
    """
    mark = np.zeros(axis.size, dtype=bool)
    finite = axis[np.isfinite(axis)]
    change = np.abs(np.diff(finite))
    moved = change[change > 0]
    if finite.size < 8 or moved.size == 0:
        return mark
    usual = finite.size / (moved.size + 1.0)
    values, counts = np.unique(finite, return_counts=True)
    for extreme, often in ((float(values[-1]), counts[::-1]), (float(values[0]), counts)):
        at_limit = axis == extreme
        at = runs(at_limit)
        stays = max(at, key=lambda run: run[1] - run[0])
        long = stays[1] - stays[0] >= 3.0 * max(usual, 1.0) and _cut_off(axis, *stays, float(moved.min()))
        again = len(at) >= _TOUCHES and often[0] > 3 * often[1 : 1 + _TOUCHES].max(initial=1)
        if long or again:
            centre = float(np.median(finite))
            scatter = mad_std(finite, centre)
            if abs(extreme - centre) > max(3.0 * float(moved.min()), 1.5 * scatter):
                mark |= at_limit
    return mark


def _cut_off(axis: Array, begin: int, end: int, step: float) -> bool:
    """Whether a signal (N,) comes to a plateau, or leaves it, by more than the `step` of coarse values."""
    beside = [axis[k] for k in (begin - 1, end) if 0 <= k < axis.size]
    return any(abs(float(value) - float(axis[begin])) > 1.5 * step for value in beside)


def _refuse_dead(imu: ImuStream, mounting: Array, rolls: Mask, log: Log) -> None:
    """Refuse an axis that never changes and that velocity or pitch need.

    A sensor may read the same at rest, by rounding or by a dead band. While the wheels turn it hangs.
    """
    turn = np.abs(mounting) > 0.5
    both, needed = _sensors(imu), ((0, 2), (1,))
    for (name, channels, values), (_, _, other), rows in zip(both, both[::-1], needed, strict=True):
        equal = (np.diff(values, axis=0) == 0).all(axis=1)
        same = runs(equal & rolls[1:])
        first, last = max(same, key=lambda run: run[1] - run[0], default=(0, 0))
        begin, end = float(imu.t[first]), float(imu.t[last])
        changes = f"expected readings of the {name} that change"
        if end - begin > _HANGS and last - first > 50 and np.count_nonzero(equal) < 0.9 * len(imu.t):
            repeats = f": every sample from t = {begin:.3f} s to {end:.3f} s is the same, {changes}: it hangs"
            raise log.refuse(channels, repeats, "cut the log there (--from, --to)")
        constant = np.array([np.isfinite(v).all() and np.ptp(v) == 0 for v in values.T])
        silent = np.isnan(other).all() or not np.ptp(other, axis=0).any()
        if silent and constant[np.isfinite(values).any(axis=0)].all():
            return  # nothing is connected: the rails' warning says so
        for j in np.flatnonzero(constant):
            if log.robot.imu.forward == "find" or any(turn[row, j] for row in rows):
                same_value = f": every sample is {values[0, j]:.6g}, {changes}"
                raise log.refuse(channels[j], f"{same_value}: the sensor hangs or is not connected")


def _refuse_gravity(imu: ImuStream, mounting: Array, still: Sequence[Interval], log: Log) -> None:
    """Refuse an accelerometer whose gravity, at rest or else on average, is not on the robot's z axis."""
    rest = inside(imu.t, [(begin + 0.1, end - 0.1) for begin, end in still])
    when = "at rest" if rest.any() else "on average"
    mean = imu.specific_force[rest if rest.any() else slice(None)].mean(axis=0)
    size = float(np.linalg.norm(mean))
    up = mounting @ mean / max(size, 1e-9)
    if 0.5 * GRAVITY < size < 1.5 * GRAVITY and up[2] < np.cos(np.radians(_OFF_AXIS)):
        j, expected = int(np.argmax(np.abs(mean))), int(np.argmax(np.abs(mounting[2])))
        place = f"gravity is on it, expected on '{log.name(ACCELERATION[expected])}' upwards"
        hint = "exchange the axes in a column map (or scale = -1), or give [imu] rotation in the robot's file"
        raise log.refuse(ACCELERATION[j], f" reads {mean[j]:+.2f} m/s^2 {when}: {place}", hint)


def _refuse_pitch_rate(imu: ImuStream, matrix: Array, still: Sequence[Interval], log: Log) -> None:
    """Refuse a pitch rate that motions between standstills contradict, where another reading of axes fits."""
    contradiction = contradicted(imu, matrix, still, log.robot.imu_grade)
    if contradiction is not None:
        logged, best = contradiction
        forward = log.name(ACCELERATION[int(np.argmax(np.abs(matrix[0])))])
        sign_of = f"its sign or that of '{forward}' is wrong"
        cause = sign_of if best.name == "-y" else f"the rate about {best.name[1]} fits: axes exchanged"
        left_over = f"{logged.speed:.2f} m/s are left at standstill, with {best.name} {best.speed:.2f} m/s"
        remedy = "scale = -1 in a column map turns a sign, 'to' exchanges axes"
        channel = RATE[int(np.argmax(np.abs(matrix[1])))]
        hint = f"{remedy}; pitch rate is positive nose down"
        raise log.refuse(channel, f": with it as pitch rate {left_over}: {cause}", hint)
