"""The last look at an estimate: what wheels, ground and clocks allow, whatever the filter says of itself."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from granite_lab.estimate import Estimate
from granite_lab.estimation.error_model import SlipModel
from granite_lab.estimation.health import sentence
from granite_lab.estimation.motion import TELLING, Motion, slips_of
from granite_lab.logs.counters import integral, mean_known
from granite_lab.logs.sensors.doubt import Doubt, Grade
from granite_lab.logs.sensors.standstill import Interval
from granite_lab.logs.trial import WheelStream
from granite_lab.parameters import GRAVITY, WHEELS, Soil

CONTRADICTS = 3.0
"""A slip ratio more than this many std outside of what is possible contradicts its std."""

RADIUS = 0.04
"""Std of the effective wheel radius against the robot's file, as a share: deflection, wear and lugs of a tyre
change the rolling radius by some per cent (Wong, Theory of Ground Vehicles, section 1.2)."""

UNFIT = 4.0
"""Innovations this many times as large as predicted (rms) show a noise model that does not fit the log."""

UNMATCHED = Doubt(
    "the ramps of the wheels are not found in the IMU: their clocks may be apart by any time", grade="poor"
)
"""Also says that the time offset does not show."""


def guard(motion: Motion, soil: Soil, limits: Sequence[Doubt] = ()) -> Motion:
    """Return the motion with the grade, and the std, that everything known beside the filter allows.

    Args:
        motion: as estimated.
        soil: what the robot drives on; its slip ratio counts where the soil states one.
        limits: what was put right or could not be judged while the motion was estimated.
    """
    doubts = [*limits, *_doubts(motion, soil, clocks=UNMATCHED not in limits)]
    if not doubts:
        return motion
    order: tuple[Grade, ...] = ("poor", "fair", "good")
    grade = min((motion.health.grade, *(doubt.grade for doubt in doubts)), key=order.index)
    reasons = tuple(dict.fromkeys([*map(str, doubts), *motion.health.reasons]))
    health = replace(motion.health, grade=grade, reasons=reasons, verdict=sentence(grade, reasons))
    motion = _widened(motion, max(doubt.std for doubt in doubts))
    for doubt in doubts:
        motion = _rolled(_farther(motion, doubt.way, doubt.after), doubt.rolled)
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
        way = float(np.interp(0.5 * (begin + end), motion.t, np.abs(motion.v))) * (end - begin)
        if way > motion.distance.std and between <= 1:
            yield Doubt(
                f"all sensors stop for {end - begin:.3g} s at {begin:.2f} s: samples are missing, or the "
                "clock was set forward",
                grade="fair", way=math.sqrt(0.5) * way, after=end,
            )  # fmt: skip


def _doubts(motion: Motion, soil: Soil, *, clocks: bool) -> Iterator[Doubt]:
    """Yield what contradicts an estimate of body velocity; `clocks`: their offset is judged, too."""
    if not np.isfinite(motion.v).any():
        return
    if clocks and motion.distance_wheels.value and not math.isfinite(motion.clock_offset.std):
        yield Doubt("the time offset of IMU and encoders does not show", grade="fair")
    for kind, nis in motion.health.nis.items():
        if nis > UNFIT**2:
            far = f"innovations ({kind}) are {math.sqrt(nis):.1f} times as large as predicted"
            yield Doubt(far, grade="poor")
    if odd := _odd_wheel(motion):
        yield odd
    stated = soil.slip_std < 1.0
    usual = soil.slip if stated else SlipModel.steady
    if motion.slip_ratio.std > TELLING:
        vague = f"the slip ratio is known to ± {100 * motion.slip_ratio.std:.0f} points only"
        yield Doubt(vague, grade="fair")
    for slip, where in slips_of(motion):
        low = -SlipModel.per_acceleration * GRAVITY * max(_downhill(motion), 0.0)
        beyond = max(low - slip.value, slip.value - 1.0)
        contradicted = beyond > CONTRADICTS * math.hypot(slip.std, RADIUS)
        if contradicted:
            yield Doubt(
                f"a slip ratio of {100 * slip.value:.0f} ± {100 * slip.std:.0f} % {where} is outside of what "
                "rolling wheels allow",
                grade="poor", std=0.5 * abs(slip.value - usual),
            )  # fmt: skip
        elif stated and abs(slip.value - usual) > CONTRADICTS * math.hypot(slip.std, soil.slip_std):
            yield Doubt(
                f"a slip ratio of {100 * slip.value:.1f} ± {100 * slip.std:.1f} % {where} contradicts the "
                f"soil's {100 * soil.slip:.1f} ± {100 * soil.slip_std:.1f} %",
                grade="poor", std=0.5 * abs(slip.value - usual),
            )  # fmt: skip


def _odd_wheel(motion: Motion) -> Doubt | None:
    """Return the doubt about a wheel that rolls another way than three that agree, in the steady part.

    They agree within the std of their radii, and it is beyond three of these. Three wheels alike show that
    the robot does not turn. Which is right, the one or the three, no log tells.
    """
    inside = (motion.t >= motion.steady[0]) & (motion.t <= motion.steady[1])
    ways = np.abs(np.nansum(motion.v_wheel[inside], axis=0)) if inside.any() else np.zeros(4)
    usual = float(np.median(ways))
    if usual == 0.0 or not np.isfinite(motion.v_wheel[inside]).all():
        return None
    far = ways / usual - 1.0
    *near, odd = np.argsort(np.abs(far))
    if abs(far[odd]) < CONTRADICTS * RADIUS or np.ptp(far[near]) > RADIUS:
        return None
    way = "more" if far[odd] > 0 else "less"
    why = "its encoder counts wrongly, or it slips by itself"
    seen = f"wheel {WHEELS[odd]} rolls {100 * abs(far[odd]):.0f} % {way} than the others, which agree: {why}"
    return Doubt(seen, grade="fair", rolled=abs(far[odd]) / len(WHEELS))


def _rolled(motion: Motion, share: float) -> Motion:
    """Return the motion whose wheels' distance has an error of the std `share` [-] more."""
    if share == 0.0:
        return motion
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
    moving = np.array([phase != "rest" for phase in motion.phase])
    if not moving.any():
        return 0.0
    ahead = math.copysign(1.0, motion.distance_wheels.value)
    return float(np.mean(ahead * motion.pitch[moving] + 2.0 * motion.pitch_std[moving]))


def _farther(motion: Motion, way: float, after: float) -> Motion:
    """Return the motion whose distance has an error of the std `way` [m] more `after` an instant."""
    if way == 0.0:
        return motion
    x_std = np.where(motion.t >= after, np.hypot(motion.x_std, way), motion.x_std)
    distance, rolled = (
        replace(travelled, std=math.hypot(travelled.std, way))
        for travelled in (motion.distance, motion.distance_wheels)
    )
    return replace(motion, x_std=x_std, distance=distance, distance_wheels=rolled)


def _widened(motion: Motion, std: float) -> Motion:
    """Return the motion whose std covers an error of the slip ratio of `std` [-], in all that follows it."""
    if std == 0.0:
        return motion
    pace = np.abs(np.nan_to_num(mean_known(motion.v_wheel)))
    way = integral(motion.t, pace)

    def least(estimate: Estimate, by: float) -> Estimate:
        return replace(estimate, std=max(estimate.std, by))

    return replace(
        motion, v_std=np.maximum(motion.v_std, std * pace), x_std=np.maximum(motion.x_std, std * way),
        slip_std=np.maximum(motion.slip_std, std),
        slip_velocity_std=np.maximum(motion.slip_velocity_std, std * pace),
        slip_ratio=least(motion.slip_ratio, std), distance=least(motion.distance, std * float(way[-1])),
    )  # fmt: skip
