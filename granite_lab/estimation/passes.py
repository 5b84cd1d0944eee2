"""The passes over one trial: offset from the onset of motion, then filter and smoother, relinearised."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.special import gammaincinv

from granite_lab.estimate import Estimate
from granite_lab.estimation import nodes as layout
from granite_lab.estimation import smoother
from granite_lab.estimation.clock import coarse_offset, refine_offset
from granite_lab.estimation.faults import Faults
from granite_lab.estimation.integration import Nominal, integrate
from granite_lab.estimation.lateral import Sideways
from granite_lab.estimation.mounting import BodyImu
from granite_lab.estimation.nodes import Nodes
from granite_lab.estimation.noise import Noise
from granite_lab.estimation.process import BA, BG, TH, C, SlipModel
from granite_lab.estimation.quieting import quieten
from granite_lab.estimation.rest import Interval, wheels_still
from granite_lab.estimation.roll import roll_angle
from granite_lab.estimation.rolling import Rolling
from granite_lab.estimation.smoother import Smoothed
from granite_lab.parameters import Robot

STILL, MOVED = 0.25, 0.5
"""How much of the log judges a clock offset on the standing and the moving side of a change [s]."""


HIDDEN = 0.015
"""Std of an offset that rests on changes during which samples are missing or at the rail [s]."""

BLUR = 0.25
"""Std of an offset by the moments' being spread over an IMU's sample [share of its period]."""

SETTLED = 0.02
"""Pitch corrections below this need no other pass: its sine is linear to 2e-6 of g [rad]."""


NOISY = ("wheel", "specific_force", "zero_rate")
"""Measurements whose noise grows where they miss their prediction. A standstill or a tape is exact: there the
prediction is to blame."""

STIFF = 1.0
"""A compliance beyond this many times what the walk allows for calls for another pass."""

LATENCY = 0.01
"""Filters, buses and logging delay one sensor against the other by up to this [s]. A smaller offset is not
applied but left to the filter, with this std."""

CLEAR = 5.0
"""An offset of more than twice that is applied where it is clear by this many std."""

UNUSUAL = 8.0
"""And where it makes the trial more likely by this factor's logarithm than an ordinary latency does: one
logger in a hundred is that far off, by an amount anywhere in 0.4 s, against 0.01 s for the others."""


@dataclass(frozen=True, eq=False)
class Problem:
    """A trial ready for the filter; see `nodes.build` for the fields."""

    imu: BodyImu
    rolling: Rolling | None
    robot: Robot
    rests: tuple[Interval, ...]
    faults: Faults
    noise: Noise
    slip: SlipModel
    aside: Sideways | None = None
    compliance: float = layout.LOOSE
    soft: float = layout.COMPLIANCE
    louder: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Solution:
    """The last pass: nominal motion, nodes and smoothed drift.

    Attributes:
        offset: of the encoders' clock, as it is reported [s].
        compliance: by which the displacement between wheels and body walked [s^2].
    """

    nominal: Nominal
    nodes: Nodes
    smoothed: Smoothed
    offset: Estimate
    compliance: float = layout.LOOSE


def lay_out(
    problem: Problem, nominal: Nominal, offset: float, offset_std: float, distance: Estimate | None = None
) -> Nodes:
    """Build the nodes of a problem about a nominal motion."""
    _, roll_std = roll_angle(problem.imu, nominal.rest, problem.robot)
    return layout.build(
        problem.imu, problem.rolling, nominal, problem.noise, problem.faults, problem.slip,
        offset=offset, offset_std=offset_std, roll_std=roll_std, distance=distance, aside=problem.aside,
        compliance=problem.compliance, soft=problem.soft, louder=problem.louder,
    )  # fmt: skip


def first_velocity(problem: Problem, offset: float) -> float:
    """Velocity to start the integration from: zero at rest, else the wheels'."""
    t0 = problem.imu.t[0]
    if problem.rolling is None or any(begin <= t0 + 0.05 for begin, _ in problem.rests):
        return 0.0
    known = np.isfinite(problem.rolling.speed)
    return float(np.interp(t0, problem.rolling.t[known] + offset, problem.rolling.speed[known]))


def solve(
    problem: Problem,
    offset: Estimate,
    *,
    distance: Estimate | None = None,
    passes: int = 4,
    robust: bool = True,
) -> Solution:
    """Filter and smooth, each pass about the last one's result.

    Relinearising matters for gravity's share of a large pitch; one or two passes settle it. Another one
    follows where the first shows that the wheels turn ahead of the body as thrust grows, or that a kind of
    measurement misses its prediction by more than its noise, which then grows by as much. What is too large
    in the last pass too widens the std of everything.

    Args:
        problem: the trial.
        offset: by which all stamps of the wheels are moved; its std is that of what is left, a state.
        distance: measured total distance [m].
        passes: at most.
        robust: noise grows where measurements miss their prediction; not where likelihoods are compared.
    """
    accel_bias, gyro_bias, pitch = 0.0, None, 0.0
    velocity = first_velocity(problem, offset.value)
    std = offset.std if np.isfinite(offset.std) else 1e-6
    for i in range(passes):
        nominal = integrate(
            problem.imu, problem.robot, problem.rests, problem.faults, accel_bias=accel_bias,
            gyro_bias=gyro_bias, pitch=pitch, velocity=velocity,
            aside=None if problem.aside is None else problem.aside.velocity,
        )  # fmt: skip
        if problem.rolling is not None:
            steady = layout.pace_of(problem.rolling, offset.value, nominal.t).steady
            nominal = quieten(nominal, steady, problem.noise.vibration_frequency)
        nodes = lay_out(problem, nominal, offset.value, std, distance)
        found = smoother.run(nodes)
        level = float(np.max(np.abs(found.x[:, TH]))) < SETTLED
        stiff = abs(found.x[-1, C]) < STIFF * problem.compliance
        sizes = mismatch(found.innovations) if robust else {}
        too_large = {kind: sizes[kind] for kind in NOISY if sizes.get(kind, 1.0) > 1.0}
        if i == passes - 1 or (level and stiff and not too_large):
            break
        louder = {kind: nis * problem.louder.get(kind, 1.0) for kind, nis in too_large.items()}
        problem = dataclasses.replace(problem, louder={**problem.louder, **louder})
        if not stiff:
            problem = dataclasses.replace(problem, compliance=abs(float(found.x[-1, C])))
        if not level:
            middle = found.x[found.x.shape[0] // 2]
            accel_bias += float(middle[BA])
            gyro_bias = nominal.gyro_bias + float(middle[BG])
            pitch += float(found.x[0, TH])
    found = dataclasses.replace(found, P=found.P * max(mismatch(found.innovations).values(), default=1.0))
    return Solution(nominal, nodes, found, offset, problem.compliance)


def mismatch(came: smoother.Innovations) -> dict[str, float]:
    """Return how much larger than predicted the innovations of each kind are, squared; 1 within chance.

    It is the mean normalised innovation squared without the largest hundredth; successive innovations
    correlate, so one in ten counts.
    """
    kinds, found = np.array(came.kind, dtype=object), {}
    for kind in dict.fromkeys(came.kind):
        # at rest the state is frozen: updates after the first repeat it
        counts = (kinds == kind) & ((kind != "zero_velocity") | (came.variance > 4.0 * came.noise))
        ratio = np.sort(came.value[counts] ** 2 / came.variance[counts])
        ratio = ratio[: ratio.size - ratio.size // 100]
        nis = float(np.mean(ratio)) if ratio.size else 1.0
        found[kind] = nis if nis > usual(max(ratio.size // 10, 1)) else 1.0
    return found


def usual(n: int) -> float:
    """Mean of n squared standard normal numbers that one in a thousand exceeds."""
    return float(2.0 * gammaincinv(0.5 * n, 0.999) / n)


def cut(problem: Problem, begin: float, end: float, offset: float) -> Problem:
    """Return the part of a problem between two instants of the IMU's clock."""
    imu, rolling = problem.imu, problem.rolling
    keep = (imu.t >= begin) & (imu.t <= end)
    fields = ("t", "forward", "left", "up", "roll_rate", "pitch_rate", "yaw_rate")
    part = dataclasses.replace(imu, **{name: getattr(imu, name)[keep] for name in fields})
    faults = problem.faults.part(keep)
    if rolling is not None:
        near = (rolling.t + offset >= begin - 0.5) & (rolling.t + offset <= end + 0.5)
        rolling = rolling.part(near)
    rests = tuple((max(a, begin), min(b, end)) for a, b in problem.rests if b > begin and a < end)
    aside = None if problem.aside is None else problem.aside.part(keep)
    return dataclasses.replace(problem, imu=part, rolling=rolling, rests=rests, faults=faults, aside=aside)


def changes(problem: Problem, offset: float, most: int = 2) -> list[Interval]:
    """Windows around the first onsets of motion and the first stops, given a rough clock offset [s]."""
    assert problem.rolling is not None
    begin, end = problem.imu.t[0], problem.imu.t[-1]
    turning = problem.rolling.t[~wheels_still(problem.rolling)] + offset
    starts, stops = [], []
    for a, b in problem.rests:
        if b - a < STILL:
            continue
        # the IMU may go on shaking for a while after the wheels have stopped, and never before
        ahead, behind = turning[turning > b - 2 * STILL], turning[turning < a + STILL]
        if b < end - MOVED and ahead.size:
            starts.append((b - STILL, max(b, float(ahead[0])) + MOVED))
        if a > begin + MOVED and behind.size:
            stops.append((min(a, float(behind[-1])) - MOVED, a + STILL))
    return starts[:most] + stops[:most]


@dataclass(frozen=True)
class ClockOffset:
    """The offset of the encoders' clock.

    Attributes:
        found: as the trial shows it [s]; std NaN: nothing shows it.
        applied: what the wheels' stamps are moved by: 0 for an ordinary latency [s]. Its std is that of what
            is left to the filter.
    """

    found: Estimate
    applied: Estimate


def find_offset(problem: Problem) -> ClockOffset:
    """Find the clock offset by correlation, then by the likelihood of onsets and stops.

    A body that follows its wheels by tyres, play or a soft mount looks like an offset when it sets off. So
    the whole trial must prefer a large offset to an ordinary latency, and where it shows such compliance the
    moments of onset and stop are judged again with the displacement that it allows.
    """
    coarse = coarse_offset(problem.imu, problem.rolling) if problem.rolling is not None else Estimate(0.0)
    if not np.isfinite(coarse.std):
        return ClockOffset(coarse, coarse)
    first = by_changes(problem, coarse)
    if first is None:
        return ClockOffset(coarse, coarse)
    candidates = [Estimate(0.0, LATENCY)]
    if abs(first.value) > max(2.0 * LATENCY, CLEAR * first.std):
        candidates.append(Estimate(first.value, LATENCY))
    solved = [solve(problem, candidate, robust=False) for candidate in candidates]
    likely = [one.smoothed.innovations.log_likelihood for one in solved]
    place = int(likely[-1] - likely[0] > UNUSUAL)
    applied, compliance = candidates[place], solved[place].compliance
    found = first
    if compliance > problem.compliance:
        about = Estimate(applied.value, coarse.std)
        found = by_changes(dataclasses.replace(problem, compliance=compliance), about) or first
    if applied.value == 0.0:  # an ordinary latency, then
        weight = LATENCY**2 / (LATENCY**2 + found.std**2)
        found = Estimate(weight * found.value, float(np.sqrt(weight)) * found.std)
    return ClockOffset(found, applied)


def by_changes(problem: Problem, coarse: Estimate) -> Estimate | None:
    """Refine an offset by the likelihood of onsets and stops; None where there are none."""
    windows = changes(problem, coarse.value)
    if not windows:
        return None
    hidden = (*problem.faults.gaps, *problem.faults.plateaus)  # there the moment itself is not seen
    clear = [(a, b) for a, b in windows if not any(begin < b and end > a for begin, end in hidden)]
    windows, doubt = (clear, 0.0) if clear else (windows, HIDDEN)
    # these moments alone would take a part of any offset for compliance
    problem = dataclasses.replace(problem, soft=problem.compliance)
    parts = [cut(problem, begin, end, coarse.value) for begin, end in windows]
    nominal = [
        integrate(p.imu, p.robot, p.rests, p.faults, velocity=first_velocity(p, coarse.value)) for p in parts
    ]

    def log_likelihood(offset: float) -> float:
        return sum(
            smoother.filter_only(lay_out(p, n, offset, 1e-6)) for p, n in zip(parts, nominal, strict=True)
        )

    found = refine_offset(coarse, log_likelihood)
    blurred = BLUR * float(np.median(np.diff(problem.imu.t)))
    return Estimate(found.value, float(np.sqrt(found.std**2 + doubt**2 + blurred**2)))
