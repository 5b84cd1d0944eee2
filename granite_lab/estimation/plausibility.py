"""Plausibility of an estimate: what wheels, ground and clocks allow, beside the filter's own checks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from granite_lab.estimate import Estimate, Part
from granite_lab.estimation.closure import CONTRADICTS, FOLLOWS
from granite_lab.estimation.error_model import SlipModel
from granite_lab.estimation.health import scattering, sentence
from granite_lab.estimation.motion import LEAST_WAY, TELLING, Motion, slips_of
from granite_lab.estimation.straight import WIDTH
from granite_lab.logs.counters import Mask, integral, mean_known, runs
from granite_lab.logs.sensors.doubt import Doubt, Grade
from granite_lab.logs.sensors.signs import TURNING
from granite_lab.logs.sensors.standstill import MOVING, Interval, inside
from granite_lab.logs.trial import Array, WheelStream
from granite_lab.parameters import GRAVITY, WHEELS, Robot, Soil

RADIUS = 0.04
"""Std of the effective wheel radius against the robot's file, as a share: deflection, wear and lugs of a tyre
change the rolling radius by some per cent (Wong, Theory of Ground Vehicles, section 1.2)."""

UNLIKE = 0.01
"""Std of the ways of wheels that roll alike, as a share: what tyres of one size and their loads differ by, a
quarter of `RADIUS`, the std against a file that may be of another tyre."""

BY_RADIUS = "wheel radius"
"""Part of the std of a slip ratio."""

FEWEST, OUTLIERS = 10, 0.05
"""At least so many means over `FOLLOWS` are judged; chance makes fewer than this share of them contradict."""

UNEVEN = 0.01 * GRAVITY
"""Acceleration of a body on steady wheels that uneven sand explains [m/s^2]: sand resists with about a tenth
of the weight, and its friction differs by 5 to 11 % from place to place (Phoon and Kulhawy, Canadian
Geotechnical J. 36, 1999)."""

UNFIT = 4.0
"""Innovations this many times as large as predicted (rms) show a noise model that does not fit the log."""

HALF = 0.5
"""Slip ratio that wheels seem to have at least whose angles are two or more times too large."""


def with_plausibility(motion: Motion, soil: Soil, limits: Sequence[Doubt] = ()) -> Motion:
    """Return the motion with the grade, and the std, that everything known beside the filter allows.

    Args:
        motion: as estimated.
        soil: what the robot drives on; its slip ratio counts where the soil states one.
        limits: what was put right or could not be judged while the motion was estimated.
    """
    least = max((doubt.std for doubt in limits), default=0.0)
    doubts = [*limits, *_doubts(motion, soil, least)]
    if not doubts:
        return motion
    order: tuple[Grade, ...] = ("poor", "fair", "good")
    grade = min((motion.health.grade, *(doubt.grade for doubt in doubts)), key=order.index)
    reasons = tuple(dict.fromkeys([*map(str, doubts), *motion.health.reasons]))
    health = replace(motion.health, grade=grade, reasons=reasons, verdict=sentence(grade, reasons))
    motion = _with_slip_std(motion, max(doubt.std for doubt in doubts))
    for doubt in doubts:
        motion = _with_distance_std(motion, doubt.distance_std, doubt.after)
        motion = _with_rolled_std(motion, doubt.rolled_std)
    return replace(motion, health=health)


def common_gaps(motion: Motion, gaps: Sequence[Interval], wheels: WheelStream | None) -> Iterator[Doubt]:
    """Yield the gaps [s] in the samples of all sensors that may be no time at all.

    Where samples are missing while the robot moves, or where the clock was set forward, the stamps look the
    same. Counters of the wheels go on in the first case only; without them both are equally probable.
    """
    if wheels is not None and wheels.rate is None:
        return
    stamps = np.empty(0) if wheels is None else wheels.t + motion.clock_offset.value
    for begin, end in gaps:
        between = np.count_nonzero((stamps > begin) & (stamps < end))
        bridged = float(np.interp(0.5 * (begin + end), motion.t, np.abs(motion.v))) * (end - begin)
        if bridged > motion.distance.std and between <= 1:
            yield Doubt(
                f"all sensors stop for {end - begin:.3g} s at {begin:.2f} s: samples are missing, or the "
                "clock was set forward",
                grade="fair", distance_std=math.sqrt(0.5) * bridged, after=end,
            )  # fmt: skip


def missing_rates(motion: Motion, wheels: WheelStream | None) -> Iterator[Doubt]:
    """Yield the time of the steady part in which no wheel's rate was logged.

    A counter goes on meanwhile; the distance that a wheel rolled without one is assumed, and so is the slip.
    """
    if wheels is None or wheels.rate is None:
        return
    steady = inside(motion.t, [motion.steady])
    silent = ~np.isfinite(motion.v_wheel[steady]).any(axis=1)
    share = float(np.mean(silent)) if steady.any() else 0.0
    if share > OUTLIERS:
        lasts = share * (motion.steady[1] - motion.steady[0])
        yield Doubt(
            f"no rate of a wheel for {lasts:.2g} s of the steady part: the slip ratio is assumed there",
            grade="fair", std=share * SlipModel.steady,
        )  # fmt: skip


def open_end_changes(motion: Motion, open_ends: Sequence[str]) -> Iterator[Doubt]:
    """Yield the change of slip in a motion that begins or ends without a standstill.

    A bias that changes in motion looks like that, and no standstill tells them apart: each is as likely.
    """
    wheels, body, _ = _steady_speeds(motion)
    rolls = np.abs(wheels) > MOVING
    if not open_ends or np.count_nonzero(rolls) < FEWEST:
        return
    first, *_, last = np.array_split(1.0 - body[rolls] / wheels[rolls], 3)
    changes = math.sqrt(0.5) * abs(float(np.mean(last) - np.mean(first)))
    if changes > motion.slip_ratio.std:
        seen = f"the slip ratio changes by {100 * math.sqrt(2.0) * changes:.0f} points, or a bias does"
        yield Doubt(f"{seen}: no standstill at the {' and '.join(open_ends)} tells which", std=changes)


@dataclass(frozen=True, eq=False)
class SteadyPart:
    """How wheels and body go while the wheels turn steadily, and which slip ratios wheels and soil allow.

    Attributes:
        wheels, body, std: (M,) means over `FOLLOWS` of both speeds, and of the std of the body's [m/s].
        low: the least slip ratio of driven wheels: below 0 where the robot drives downhill.
        usual: the soil's slip ratio, or that of sand where it is not `stated`.
    """

    wheels: Array
    body: Array
    std: Array
    low: float
    usual: float
    stated: bool


def _doubts(motion: Motion, soil: Soil, least: float) -> Iterator[Doubt]:
    """Yield what contradicts an estimate of body velocity, whose slip ratio has at `least` this std [-]."""
    stated = soil.slip_std < 1.0
    low = -SlipModel.per_acceleration * GRAVITY * max(_downhill(motion), 0.0)
    usual = soil.slip if stated else SlipModel.steady
    steady = SteadyPart(*_steady_speeds(motion), low, usual, stated)
    for kind, nis in motion.health.nis.items():
        if nis > UNFIT**2:
            yield Doubt(scattering(kind, nis), grade="poor")
    yield from _differing_wheel(motion)
    std = max(motion.slip_ratio.std, least)  # NaN where no slip ratio is defined
    if std > TELLING:
        points = 100.0 * std
        known = f"known to ± {points:.0f} points only" if points < 100.0 else "not known at all"
        yield Doubt(f"the slip ratio is {known}", grade="fair")
    yield from _faster_than_wheels(steady)
    yield from _oscillating(steady)
    yield from _scaled_angles(motion, steady)
    for slip, where in slips_of(motion):
        seen = f"a slip ratio of {100 * slip.value:.1f} ± {100 * slip.std:.1f} % {where}"
        wrong = 0.5 * abs(slip.value - usual)
        if max(low - slip.value, slip.value - 1.0) > CONTRADICTS * math.hypot(slip.std, RADIUS):
            seen = f"a slip ratio of {100 * slip.value:.0f} ± {100 * slip.std:.0f} % {where}"
            yield Doubt(f"{seen} is outside of what rolling wheels allow", grade="poor", std=wrong)
        elif low - slip.value > CONTRADICTS * slip.std:
            why = "radius or counts of a turn are not those of the robot's file"
            seen = f"{seen}: wheels that drive do not slip backward, so that {why}"
            yield Doubt(seen, remedy="roll ten turns on a hard floor", grade="fair", std=RADIUS)
        elif stated and abs(slip.value - usual) > CONTRADICTS * math.hypot(slip.std, soil.slip_std):
            states = f"{100 * soil.slip:.1f} ± {100 * soil.slip_std:.1f} %"
            yield Doubt(f"{seen} contradicts the soil's {states}", grade="poor", std=wrong)


def _faster_than_wheels(steady: SteadyPart) -> Iterator[Doubt]:
    """Yield the doubt about a body that is faster, or goes the other way, than its steady wheels allow.

    The slip ratio over all may look usual while vibration that the IMU folds to slow frequencies, or a bias
    that changes, swings the velocity. It is judged over `FOLLOWS`, from `low` to 1 within its std.
    """
    rolls = np.abs(steady.wheels) > MOVING  # not where they are unknown
    wheels = steady.wheels[rolls]
    slip, unsure = 1.0 - steady.body[rolls] / wheels, steady.std[rolls] / np.abs(wheels)
    beyond = np.maximum(steady.low - slip, slip - 1.0)
    contradicted = beyond > CONTRADICTS * np.hypot(unsure, RADIUS)
    if slip.size >= FEWEST and np.count_nonzero(contradicted) > OUTLIERS * slip.size:
        worst = float(slip[np.argmax(beyond)])
        seen = f"the slip ratio reaches {100 * worst:.0f} % while the wheels turn steadily"
        why = "which rolling wheels do not allow"
        yield Doubt(f"{seen}, {why}", grade="poor", std=0.5 * abs(worst - steady.usual))


def _oscillating(steady: SteadyPart) -> Iterator[Doubt]:
    """Yield the doubt about a body that goes faster and slower on steady wheels than uneven sand makes it.

    Vibration that is folded to a slow frequency looks like that. It also leaves an error of the velocity that
    does not change, since the body stood when it began: of any size up to the swing, so that the rms of the
    swing is the std. A jump of the slip swings once: the median of all accelerations tells.
    """
    slip_velocity = steady.wheels - steady.body
    gained = np.abs(np.diff(slip_velocity))
    if gained.size >= FEWEST and float(np.median(gained)) > UNEVEN * FOLLOWS:
        swing = float(np.std(slip_velocity) / max(float(np.mean(np.abs(steady.wheels))), MOVING))
        seen = f"the slip ratio swings by ± {100 * swing:.0f} points while the wheels turn steadily"
        why = "uneven ground, or vibration that is folded to slow frequencies"
        remedy = "mount the IMU stiffly, with its low-pass on, and log it faster"
        yield Doubt(f"{seen}: {why}", remedy=remedy, grade="fair", std=swing)


def _scaled_angles(motion: Motion, steady: SteadyPart) -> Iterator[Doubt]:
    """Yield the doubt about wheels that seem to slip by half at least, whenever they turn steadily.

    Angles that are too large by a whole number, by a gear or by the edges of a count, look like that. Wheels
    that slip so much by themselves grip now and then, or turn while the body stands; those that never do are
    as likely to be the one as the other.
    """
    slip, wheels = motion.slip_ratio, steady.wheels
    at_rest = np.abs(np.nan_to_num(mean_known(motion.v_wheel)))[_in_phase(motion, "rest")]
    if steady.stated or not slip.value + CONTRADICTS * slip.std > HALF or (at_rest > MOVING).any():
        return
    surely = np.sign(wheels) * steady.body - CONTRADICTS * steady.std
    grips = surely > (1.0 - HALF) * np.maximum(np.abs(wheels), MOVING)
    factor = round((1.0 - steady.usual) / max(1.0 - slip.value, 1e-3))
    if factor < 2 or np.count_nonzero(grips) > OUTLIERS * grips.size:
        return
    seen = f"a slip ratio of {100 * slip.value:.0f} ± {100 * slip.std:.0f} % whenever wheels turn steadily"
    why = f"or gear ratio, counts of a turn or unit are wrong by a factor, such as {factor}"
    remedy = "roll ten turns on a hard floor; if the wheels do slip so much, state it in the soil's file"
    yield Doubt(f"{seen}, {why}", remedy=remedy, grade="poor", rolled_std=math.sqrt(0.5) * (factor - 1))


def _differing_wheel(motion: Motion) -> Iterator[Doubt]:
    """Yield the doubt about a wheel that rolls another way than three that agree, in the steady part.

    They agree within the std of their radii, and it is beyond three of these: over all, or over `FOLLOWS`
    now and then, by which it adds up to more than the std of the slip ratio. Three wheels alike show that the
    robot does not turn. Which is right, the one or the three, no log tells.
    """
    steady = inside(motion.t, [motion.steady])
    if not steady.any() or not np.isfinite(motion.v_wheel[steady]).all():
        return
    far = _differing_share(np.sum(motion.v_wheel[steady], axis=0, keepdims=True))
    how = f"{'more' if far.sum() > 0 else 'less'} than the others, which agree"
    if not far.any():
        far = _differing_share(_means(motion, motion.v_wheel, steady))
        far *= np.abs(far) > len(WHEELS) * motion.slip_ratio.std
        how = "unlike the others, which agree, in some moments"
    if far.any():
        wheel, share = int(np.argmax(np.abs(far))), float(np.max(np.abs(far)))
        seen = f"wheel {WHEELS[wheel]} rolls {100 * share:.0f} % {how}"
        why = "its encoder counts wrongly, or it slips by itself"
        yield Doubt(f"{seen}: {why}", grade="fair", rolled_std=share / len(WHEELS))


def disagreeing_wheels(motion: Motion, yaw_rate: Array | None, robot: Robot) -> Iterator[Doubt]:
    """Yield the doubt about wheels that roll unlike each other in the steady part, if it is not a bend.

    Different counts of a turn, lost counts and wheels that slip by themselves look alike, and any one of the
    wheels is as likely to be right: the way of all is off by the std of the single ways about it. One below
    the std of the slip ratio, or below what tyres differ by, changes little.

    Args:
        motion: as estimated.
        yaw_rate: (N,) by the gyro, without its bias, positive to the left [rad/s]; None: not known.
        robot: with its track. Sides differ where it turns; skidding takes a part of the turn.
    """
    steady = inside(motion.t, [motion.steady])
    t = motion.t[steady]
    # NaN of a wheel that is not known all along
    ways = np.asarray(np.trapezoid(motion.v_wheel[steady], t, axis=0))
    if np.count_nonzero(np.isfinite(ways)) < 2:
        return
    usual = float(np.nanmean(ways))
    left, right = (mean_known(ways[side::2], axis=0) for side in (0, 1))
    track = robot.chassis.track if robot.chassis is not None else WIDTH
    turned = math.nan if yaw_rate is None else float(integral(t, yaw_rate[steady])[-1])
    if not turned * track * np.sign(right - left) <= TURNING * abs(right - left):  # a bend, or not known
        ways = ways - np.where(np.arange(len(WHEELS)) % 2 == 0, left, right) + usual
    share = float(np.nanstd(ways)) / max(abs(usual), LEAST_WAY)
    if share > max(motion.slip_ratio.std, UNLIKE):
        apart = zip(WHEELS, (ways / usual - 1.0).tolist(), strict=True)
        each = ", ".join(f"{name} {by:+.1%}" for name, by in apart if math.isfinite(by))
        why = "counts of a turn differ or are lost, or wheels slip by themselves"
        seen = f"the wheels roll unlike each other while the robot drives straight ({each})"
        yield Doubt(f"{seen}: {why}", grade="fair", rolled_std=share)


def _differing_share(distances: Array) -> Array:
    """(4,) ways by which each wheel is at odds with three that agree, over the usual way of all (M, 4)."""
    usual = np.median(np.abs(distances), axis=1)
    far = np.abs(distances) / np.maximum(usual, MOVING)[:, None] - 1.0
    by_size = np.take_along_axis(far, np.argsort(np.abs(far), axis=1), axis=1)
    agree = (np.ptp(by_size[:, :-1], axis=1) <= RADIUS) & (usual > MOVING)
    odd = agree[:, None] & (np.abs(far) >= CONTRADICTS * RADIUS)
    return np.asarray((odd * far * usual[:, None]).sum(axis=0) / max(float(usual.sum()), MOVING))


def _in_phase(motion: Motion, name: str) -> Mask:
    """(N,) where a motion is in a phase."""
    return np.array([phase == name for phase in motion.phase])


def _steady_speeds(motion: Motion) -> tuple[Array, Array, Array]:
    """Steady speed of the wheels, speed of the body and its std, each (M,) as `_means` [m/s]."""
    where, wheels = _in_phase(motion, "steady"), mean_known(motion.v_wheel)
    return _means(motion, wheels, where), _means(motion, motion.v, where), _means(motion, motion.v_std, where)


def _means(motion: Motion, values: Array, where: Mask) -> Array:
    """(M, ...) means of values (N, ...) over `FOLLOWS` each, in the stretches `where` (N,) is True."""
    size = max(round(FOLLOWS / float(np.median(np.diff(motion.t)))), 1)
    parts = [values[k : k + size].mean(axis=0) for a, b in runs(where) for k in range(a, b - size + 1, size)]
    return np.array(parts).reshape(-1, *values.shape[1:])


def with_radius(motion: Motion, robot: Robot) -> Motion:
    """Return the motion whose std contains that of the wheel radius, where the robot's file states one.

    It is the same error in all trials, so that a fit to several of them counts it apart.
    """
    share = robot.wheels.radius_std / robot.wheels.radius
    if share == 0.0 or not math.isfinite(motion.slip_ratio.value):
        return motion
    made = share * abs(1.0 - motion.slip_ratio.value)
    part = Part(BY_RADIUS, "B", "normal", "m", robot.wheels.radius_std, made, common=True)
    parts = sorted([*motion.slip_parts, part], key=lambda one: -one.contribution)
    return replace(_with_rolled_std(motion, share), slip_parts=tuple(parts))


def _with_rolled_std(motion: Motion, share: float) -> Motion:
    """Return the motion whose wheels' distance has an error of the std `share` [-] more."""
    slip, rolled = motion.slip_ratio, motion.distance_wheels
    pace = share * np.abs(np.nan_to_num(mean_known(motion.v_wheel)))
    return replace(
        motion,
        slip_ratio=replace(slip, std=math.hypot(slip.std, share * (1.0 - slip.value))),
        distance_wheels=replace(rolled, std=math.hypot(rolled.std, share * rolled.value)),
        slip_velocity_std=np.hypot(motion.slip_velocity_std, pace),
    )


def _downhill(motion: Motion) -> float:
    """Return the slope by which the robot drives down [rad]: the upper bound of the mean pitch in motion."""
    moving = ~_in_phase(motion, "rest")
    if not moving.any():
        return 0.0
    ahead = math.copysign(1.0, motion.distance_wheels.value)
    return float(np.mean(ahead * motion.pitch[moving] + 2.0 * motion.pitch_std[moving]))


def _with_distance_std(motion: Motion, std: float, after: float) -> Motion:
    """Return the motion whose distance has an error of this std [m] more `after` an instant [s]."""
    x_std = np.where(motion.t >= after, np.hypot(motion.x_std, std), motion.x_std)
    distance, rolled = (
        replace(travelled, std=math.hypot(travelled.std, std))
        for travelled in (motion.distance, motion.distance_wheels)
    )
    return replace(motion, x_std=x_std, distance=distance, distance_wheels=rolled)


def _with_slip_std(motion: Motion, std: float) -> Motion:
    """Return the motion whose std covers an error of the slip ratio of `std` [-], in all that follows it."""
    pace = np.abs(np.nan_to_num(mean_known(motion.v_wheel)))
    rolled = integral(motion.t, pace)

    def least(estimate: Estimate, by: float) -> Estimate:
        return replace(estimate, std=max(estimate.std, by))

    return replace(
        motion, v_std=np.maximum(motion.v_std, std * pace), x_std=np.maximum(motion.x_std, std * rolled),
        slip_std=np.maximum(motion.slip_std, std),
        slip_velocity_std=np.maximum(motion.slip_velocity_std, std * pace),
        slip_ratio=least(motion.slip_ratio, std), distance=least(motion.distance, std * float(rolled[-1])),
    )  # fmt: skip
