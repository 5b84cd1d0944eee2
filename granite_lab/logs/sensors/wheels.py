"""The wheels of a log: a first estimate of the motion, and checks of units, dead wheels and currents."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from granite_lab.logs.counters import integral, interpolated, quantum, runs
from granite_lab.logs.layouts import Log
from granite_lab.logs.quantities import CURRENTS, ENCODERS, factors
from granite_lab.logs.sensors.encoders import top_rate
from granite_lab.logs.trial import Array, CurrentStream, ImuStream, Trial, WheelStream
from granite_lab.parameters import WHEELS, Robot, Variant, load_variants

_WHOLE = 1e-6  # numbers that were converted are whole within this
_POINT = 0.01  # an error of the wheels' rate by this share is one point of slip ratio
_TOO_FAST = 30.0  # no ground robot whose motors are not known drives faster [m/s]
# A free wheel turns this many times as fast as the others, which agree to this share, for so long [s]; one
# whose encoder slips on its shaft seems to turn so many times as slowly.
_FREE, _ALIKE, _FREE_FOR = 1.3, 0.05, 0.3
_LIKE, _UNLIKE = 0.8, 0.5  # two signals share most of their variance (64 %), or little of it (25 %)
_GAINED = 0.08  # less speed says nothing [m/s]
_APART = 0.3  # the clocks of IMU and wheels may be so far apart [s]
_BRIEF = 20.0  # an IMU's speed is that of the body for so long [s]
# Bounds of the speed that driven wheels gain on driving off, over that of the body: 1 within the errors of
# both, and the slip on sand, 15 % and as much again for each m/s^2.
_GRIPS, _SLIPS = 0.9, 1.5


@dataclass(frozen=True)
class MotionGuess:
    """A first look at the motion, from the wheels alone (so slip is not taken off)."""

    velocity: float  # plateau of the wheels' circumferential velocity [m/s]
    acceleration: float  # slope of the ramp up [m/s^2], NaN if there is none
    distance: float  # way of the circumference [m]
    variant: Variant | None  # of Table 2, the one that comes closest, if any is close
    confidence: float  # 0 to 1


def _smooth(values: Array, t: Array) -> Array:
    """Average over about a fifth of a second, against quantisation."""
    n = max(1, int(0.2 / float(np.median(np.diff(t)))))
    return np.convolve(np.pad(values, (n // 2, n - 1 - n // 2), "edge"), np.full(n, 1 / n), mode="valid")


def look(trial: Trial, robot: Robot) -> MotionGuess | None:
    """Guess plateau, ramp and variant from the wheels; None without wheels or motion."""
    t, raw = mean_speed(trial.wheels, robot)
    speed = np.abs(_smooth(raw, t)) if len(t) >= 10 else np.zeros(1)
    top = float(np.quantile(speed, 0.95))
    if top < 0.01:
        return None
    plateau = float(np.mean(speed[speed > 0.7 * top]))
    rising = np.flatnonzero(speed > 0.8 * plateau)[0]
    low = np.flatnonzero(speed[:rising] < 0.2 * plateau)
    ramp = math.nan
    if len(low) and t[rising] > t[low[-1]]:
        ramp = float((speed[rising] - speed[low[-1]]) / (t[rising] - t[low[-1]]))
    distance = float(np.sum(speed[1:] * np.diff(t)))
    best = min(load_variants(), key=lambda v: abs(math.log(plateau / v.velocity)))
    # The wheels follow the desired velocity closely; variants lie 40 % and more apart.
    off = abs(math.log(plateau / best.velocity)) / 0.08
    off_distance = abs(math.log(max(distance, 1e-3) / best.distance)) / 0.3
    confidence = math.exp(-(off**2) / 2 - off_distance**2 / 8)
    return MotionGuess(plateau, ramp, distance, best if off < 2 else None, confidence if off < 2 else 0.0)


def mean_speed(wheels: WheelStream | None, robot: Robot) -> tuple[Array, Array]:
    """Return stamps (M,) [s] and the wheels' mean circumferential speed (M,) [m/s]; none without wheels."""
    angle = None if wheels is None else _mean_at(wheels.t, wheels.t, wheels.angle)
    if wheels is None or angle is None:
        return np.zeros(0), np.zeros(0)
    speed = np.diff(angle) / np.diff(wheels.t) * robot.wheels.radius
    return (wheels.t[1:] + wheels.t[:-1]) / 2, np.asarray(speed)


def _mean_at(t: Array, stamps: Array, columns: Array) -> Array | None:
    """Return the mean of the wheels' columns (M, 4) at instants t (N,); None where none was logged.

    A wheel may have rows of its own; in between its value is a straight line.
    """
    known = [column for column in columns.T if np.count_nonzero(np.isfinite(column)) > 1]
    return np.asarray(np.mean([interpolated(t, stamps, x) for x in known], axis=0)) if known else None


def check_wheels(wheels: WheelStream, imu: ImuStream | None, log: Log) -> WheelStream:
    """Check the wheels' unit against the speed that the IMU gains while the robot drives off.

    Of the IMU only how fast it accelerates is used, in any direction. Returns the stream in a corrected unit.
    """
    t, speed = mean_speed(wheels, log.robot)
    if len(t) < 10:
        return wheels
    wheels = _without_dead(wheels, imu, log)
    t, speed = mean_speed(wheels, log.robot)
    if imu is not None:
        _refuse_other_kind(wheels, imu, log)
    ratio = _ratio(t, speed, imu) if imu is not None else math.nan
    if not (math.isnan(ratio) or 0.3 < ratio < 8):
        declared, gain = log.unit(*ENCODERS), f"gain {ratio:.3g} times the speed that the IMU gains"
        fits, others = _fitting(declared, ratio, log.robot.wheels.radius)
        if len(fits) == 1:
            ((unit, factor),) = fits.items()
            units = " or in ".join([unit, *others])
            seen = f"the encoders, declared in {declared}, {gain}: they are in {units}"
            log.convert(ENCODERS, unit, seen, unsure=bool(others))
            if (left := ratio * factor) > _SLIPS:
                more = f"in {unit} the wheels still gain {left:.2g} times the speed that the IMU gains"
                why = "the gear ratio or the counts of a turn may be wrong instead"
                remedy = "state the unit in a column map"
                rolled = math.sqrt(0.5) * (left - 1.0)
                log.doubt(f"{more}: {why}", remedy=remedy, grade="poor", rolled_std=rolled)
            resolution = tuple(step * factor for step in wheels.resolution)
            return wheels.changed(lambda values: values * factor, resolution=resolution)
        remedy = "check wheel radius, gear, counts per revolution and units"
        log.doubt(f"the wheels {gain}", remedy=remedy, grade="poor")
    return wheels


def _fitting(declared: str, ratio: float, radius: float) -> list[dict[str, float]]:
    """Return units in which the wheels gain about the speed of the IMU, with their size in the declared one.

    The first ones are of the turning of a wheel, as the declared one; the others of the way of its rim, whose
    radius is given [m]: which of both it is no log tells. In the declared one the wheels gain `ratio` times
    the speed of the IMU.
    """
    sizes, rim = factors("angle"), factors("length")
    if declared not in sizes:
        sizes, rim = factors("angular rate"), factors("speed")
    kinds = sizes, {unit: size / radius for unit, size in rim.items()}
    changes = [{u: x / sizes.get(declared, math.nan) for u, x in k.items() if u != declared} for k in kinds]
    ranges = (0.7, 3.0), (_GRIPS, _SLIPS)
    return [
        {unit: x for unit, x in of.items() if low < ratio * x < high}
        for of, (low, high) in zip(changes, ranges, strict=True)
    ]


def _refuse_other_kind(wheels: WheelStream, imu: ImuStream, log: Log) -> None:
    """Refuse a rate that is read as an angle, or an angle as a rate: what the IMU gains tells them apart.

    From one standstill to the next the speed by the IMU is compared with what is logged and with how that
    changes. Of the IMU only the direction is used along which the acceleration changes most.
    """
    t, force, is_angle = imu.t, imu.specific_force, wheels.rate is None
    value = _mean_at(t, wheels.t, wheels.angle if wheels.rate is None else wheels.rate)
    if np.isnan(force).any() or value is None or len(t) < 100:
        return
    moves = [np.flatnonzero(np.abs(value - value[edge]) > 0.01 * np.ptp(value)) for edge in (0, -1)]
    if not all(x.size for x in moves):
        return
    begin, end = t[moves[0][0]] - _APART, t[moves[1][-1]] + _APART
    if begin < t[0] or end > t[-1] or not 1.0 < end - begin < _BRIEF:  # no standstill at both ends
        return
    inside = slice(*np.searchsorted(t, (begin, end)).tolist())
    slow = np.column_stack([_smooth(x, t[inside]) for x in (*force[inside].T, value[inside])])
    gained = slow[:, :3] - slow[:, :3].mean(axis=0)
    speed = integral(t[inside], gained @ np.linalg.svd(gained, full_matrices=False)[2][0])
    if np.ptp(speed) < _GAINED:
        return
    signals = (slow[:, 3], np.gradient(slow[:, 3], t[inside]))
    like = [abs(float(np.corrcoef(speed, x)[0, 1])) for x in signals]
    if like[not is_angle] > _LIKE and like[is_angle] < _UNLIKE:
        seen, other = ("speed", "way") if is_angle else ("way", "speed")
        unit = 'a rate (unit = "rad/s", "rpm" or "m/s"' if is_angle else 'an angle (unit = "rad"'
        raise log.refuse(
            next(channel for channel in ENCODERS if channel in log.columns),
            f", declared in {log.unit(*ENCODERS)}, follows the {seen} by the IMU and not its {other}",
            f"it is {unit} in a column map), and so are those of the other wheels",
        )


def _ratio(t: Array, speed: Array, imu: ImuStream) -> float:
    """Return speed gained by the wheels over speed gained by the IMU on driving off, NaN if unknown."""
    plateau = float(np.quantile(np.abs(speed), 0.9))
    moving = np.abs(speed) > 0.1 * plateau
    if plateau == 0 or moving[:3].any() or not moving.any():
        return math.nan
    start = float(t[int(np.argmax(moving))])
    fast = np.abs(speed) > 0.8 * plateau
    reached = float(t[int(np.argmax(fast & (t >= start)))])
    begin, end = start - _APART, reached + _APART
    force = imu.specific_force
    if reached - start > 3 or begin - imu.t[0] < 0.2 or end > imu.t[-1] or np.isnan(force).any():
        return math.nan
    rest = force[imu.t < begin].mean(axis=0)
    ramp = (imu.t >= begin) & (imu.t <= end)
    size = float(np.linalg.norm(np.trapezoid(force[ramp] - rest, imu.t[ramp], axis=0)))
    # What a tilt by one degree or the bias could feign must stay far below.
    feigned = 0.17 * (end - begin)
    return plateau / size if size > max(_GAINED, 0.5 * feigned) else math.nan


def _without_dead(wheels: WheelStream, imu: ImuStream | None, log: Log) -> WheelStream:
    """Leave out wheels that stand while the others turn; a whole side may, where the robot turns about it."""
    spans = np.array([np.ptp(a[np.isfinite(a)]) if np.isfinite(a).any() else np.nan for a in wheels.angle.T])
    if not np.nanmax(spans) > 1.0:
        return wheels
    still = spans < 0.01 * np.nanmax(spans)
    yaw = np.nan_to_num(imu.angular_rate) if imu is not None else np.zeros((1, 3))
    turned = float(np.abs(np.median(yaw, axis=0) - yaw).max())
    if turned > 0.2 and still.tolist() in ([True, False, True, False], [False, True, False, True]):
        return wheels
    for name, stands in zip(WHEELS, still, strict=True):
        if stands:
            seen = f"encoder {name} stands still while the others turn, as if not connected"
            log.doubt(seen, remedy="left out", dead=True)
    return wheels.changed(lambda values: np.where(still, np.nan, values))


def report_absent(log: Log) -> None:
    """Report wheels without an encoder, and what is not known without them."""
    absent = [name for name, channel in zip(WHEELS, ENCODERS, strict=True) if channel not in log.columns]
    if not absent:
        return
    left = [name for name in WHEELS if name not in absent]
    same_side = len({name[1] for name in left}) == 1
    turning = "; how the robot turns the wheels do not tell" if same_side else ""
    slip = f"the robot's slip is by {', '.join(left)} alone"
    log.doubt(f"no encoder {', '.join(absent)} in the log: no slip of these wheels, {slip}{turning}")


def refuse_counts_and_speed(wheels: WheelStream, log: Log) -> None:
    """Refuse an angle [rad] in whole numbers, and wheels faster than the motors at their highest voltage."""
    radius, top = log.robot.wheels.radius, top_rate(log.robot)
    counts = 'unit = "counts" and counts_per_rev = …'
    whose = f"{log.robot.name}'s motors"
    if math.isinf(top):
        top, whose = _TOO_FAST / radius, "a ground robot"
    for channel, logged in zip(ENCODERS, wheels.angle.T, strict=True):
        finite = np.isfinite(logged)
        angle, t = logged[finite], wheels.t[finite]
        if len(angle) < 20:
            continue
        whole = wheels.rate is None and (angle == np.rint(angle)).all() and len(np.unique(angle)) > 20
        if whole and quantum(angle) >= 1:
            numbers = f"only whole numbers up to {np.abs(angle).max():.0f}"
            message = f": {numbers}, expected an angle in rad: they look like counts"
            raise log.refuse(channel, message, f"{counts} in a column map")
        fast = float(np.quantile(np.abs(np.diff(angle) / np.diff(t)), 0.75))
        if fast > 1.5 * top:
            turns = f"the wheel turns with {fast:.3g} rad/s ({fast * radius:.2g} m/s)"
            hint = f"counts need {counts} in a column map; or name the robot (its wheel radius and motors)"
            raise log.refuse(channel, f": {turns}, expected at most {top:.3g} rad/s of {whose}", hint)


def doubt_whole_rates(wheels: WheelStream, log: Log) -> None:
    """Report rates in whole numbers of a unit that are too small for it not to matter how they were made.

    They are rounded, or, as by a cast in C, cut off: each is as likely, and the latter reads half a unit less
    on the average.
    """
    unit, radius = log.unit(*ENCODERS), log.robot.wheels.radius
    units = factors("angular rate") | {name: x / radius for name, x in factors("speed").items()}
    if wheels.rate is None or unit not in units:
        return
    numbers = np.abs(wheels.rate[np.isfinite(wheels.rate)]) / units[unit]
    if not numbers.any() or np.abs(numbers - np.rint(numbers)).max() > _WHOLE:
        return
    usual = float(np.quantile(numbers, 0.9))
    share = 0.5 * math.sqrt(0.5) / max(usual, 1.0)
    if share > _POINT:
        seen = f"rates are whole numbers of {unit}, some {usual:.0f} usually"
        log.doubt(f"{seen}: rounded or cut off", remedy="log decimals", grade="fair", rolled_std=share)


def without_free_wheels(wheels: WheelStream, log: Log) -> WheelStream:
    """Leave a wheel out where it turns much faster or more slowly than the other three, which agree."""
    dt = float(np.median(np.diff(wheels.t)))
    n = max(round(0.1 / dt), 1)
    if wheels.rate is not None or not np.isfinite(wheels.angle).all() or len(wheels.t) < 4 * n:
        return wheels
    span = wheels.t[n:] - wheels.t[:-n]
    speed = np.abs(wheels.angle[n:] - wheels.angle[:-n]) / span[:, None]
    angle = wheels.angle.copy()
    low, middle, high, top = np.sort(speed, axis=1).T
    rolls = middle > 0.1 * float(np.quantile(middle, 0.95))
    free = (top > _FREE * middle) & (high - low < _ALIKE * middle) & rolls
    slips = (low > 0.0) & (_FREE * low < high) & (top - middle < _ALIKE * high) & rolls
    for at, odd, usual, as_if in (
        (free, speed.argmax(axis=1), middle, "off the ground"),
        (slips, speed.argmin(axis=1), high, "its encoder slipped on the shaft"),
    ):
        for i, channel in enumerate(ENCODERS):
            of_wheel = at & (odd == i)
            long = [(a, b) for a, b in runs(of_wheel) if (b - a) * dt >= _FREE_FOR]
            for a, b in long:
                angle[a : b + n, i] = np.nan
            if long:
                ratio = float(np.median(speed[of_wheel, i] / usual[of_wheel]))
                since = f"from t = {wheels.t[long[0][0]]:.2f} s on"
                seen = f"the wheel turns {ratio:.2g} times as fast as the others {since}"
                log.doubt(f"{seen}, as if {as_if}", log.column(channel), "left out there")
    return dataclasses.replace(wheels, angle=angle)


def check_currents(currents: CurrentStream, wheels: WheelStream | None, log: Log) -> CurrentStream:
    """Convert currents beyond what the motors can draw from mA; report those that never change."""
    drive = log.robot.drive
    limit = drive.voltage_max / drive.resistance if drive else 300.0
    shown = np.abs(currents.current[np.isfinite(currents.current)])
    if len(shown) and (high := float(np.quantile(shown, 0.95))) > 3 * limit:
        first = next((channel for channel in CURRENTS if channel in log.columns), "currents")
        much = f"{high:.4g} A, more than the motors can draw ({limit:.3g} A)"
        log.convert(CURRENTS, "mA", f"{log.column(first)} and its like: {much}: they are in mA")
        currents = CurrentStream(currents.t, currents.current / 1000)
    t, speed = mean_speed(wheels, log.robot)
    if len(t) < 20:
        return currents
    speed = np.interp(currents.t, t, speed)
    going = np.abs(speed) > 0.3 * float(np.abs(speed).max())
    values = currents.current
    finite = np.isfinite(values)
    live = [i for i in range(4) if finite[:, i].sum() > 20 and finite[going, i].any()]
    for i in (i for i in live if not np.ptp(values[finite[:, i], i])):
        seen = f"constant at {np.nanmax(values[:, i]):g} A, as if not connected"
        log.doubt(seen, log.column(CURRENTS[i]), dead=True)
    return currents
