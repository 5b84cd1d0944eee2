"""The motion record from the smoother's result, at the IMU's stamps: velocities, slip ratios, phases."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter1d

from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate
from granite_lab.estimation.budget import slip_parts
from granite_lab.estimation.clock import LATENCY
from granite_lab.estimation.commanded import commanded
from granite_lab.estimation.error_model import PD, SIZE, TH, V_FLOOR, D, G, P, S, V, X, std_of
from granite_lab.estimation.motion import NAN, BodyMotion, Health, Motion, PhaseName, Totals, WheelMotion
from granite_lab.estimation.nodes import BAND, QUICK
from granite_lab.estimation.rest import find_rests
from granite_lab.estimation.smoother import Solution
from granite_lab.estimation.straight import straightness_of
from granite_lab.estimation.wheels import Rolling, nearest
from granite_lab.logs.counters import Mask, integral, mad_std, runs
from granite_lab.logs.sensors.standstill import MOVING, Interval, bridged, inside
from granite_lab.logs.trial import Array, Series, Trial, TrialInfo
from granite_lab.parameters import Robot, Variant, load_variants

PHASES: tuple[PhaseName, ...] = ("rest", "accelerate", "steady", "brake")
UP, STEADY, DOWN = 1, 2, 3
"""Places in `PHASES`."""

LEAST_WAY = 0.3
"""Least way of the wheels for a slip ratio of a whole drive [m]: the ends are known to millimetres."""

SETTLED = 0.7
"""A constant velocity that lasts shorter is not steady [s]: slip settles with a time constant of 0.35 s."""

ENTRY = 0.5
"""A standstill ends by this much before the wheels are seen to turn, at most [s]."""

CLEAR = 5.0
"""Speeds this many std from those at rest are motion."""

FEWEST_OF_IMU = 8
"""Samples of an IMU from which on it says something of the body."""


def motion_of(trial: Trial, solution: Solution, health: Health) -> Motion:
    """Add the smoothed drift to the nominal motion and derive slip, phases and variant.

    Raises:
        EstimateError: the velocity or its std is not a number somewhere.
    """
    problem, t, offset = solution.problem, solution.nominal.t, solution.offset
    body = body_motion(solution)
    if not np.isfinite(body.v + body.v_std).all():
        raise EstimateError(
            f"trial '{trial.name}': the filter has become numerically unstable",
            "cut the log with --from and --to",
        )
    pace = body.v if problem.rolling is None else problem.rolling.speed_at(t, offset.value)
    straight = straightness_of(t, solution.nominal.heading_rate, pace, health.rests, problem.robot)
    course = find_phases(t, pace, health.rests, straight.off)
    totals = totals_of(solution, body, course.steady)
    start = command_start(trial.command, offset, course.onset)
    variant, source, doubt = _command(trial, start, offset, replace(course, steady=totals.steady))
    more = [*straight.warnings, *([doubt] if doubt else [])]
    if not np.isfinite(course.steady[0]):
        why = "no straight stretch is long enough" if straight.off.any() else "the wheels hardly turn"
        more.append(f"{why}: the robot's slip ratio is not defined")
    elif not course.constant:
        a, b = course.steady
        more.append(f"never steady: the robot's slip ratio is that of the drive from {a:.2f} s to {b:.2f} s")
    return Motion(
        **vars(body), **vars(wheel_motion(solution, body, health.rests)), **vars(totals),
        trial=trial.name, virtual=trial.info.virtual, t=t, phase=course.name, variant=variant,
        variant_source=source, t_start=start, clock_offset=offset, clock_applied=solution.applied,
        noise=problem.noise.as_dict(), health=health,
        warnings=(*trial.warnings, *map(str, problem.doubts), *more),
    )  # fmt: skip


def body_motion(solution: Solution) -> BodyMotion:
    """Return the nominal motion with the smoothed drift."""
    problem, nodes, drift, nominal = solution.problem, solution.nodes, solution.smoothed, solution.nominal
    t, at_stamps = nominal.t, solution.at_stamps
    # between sparse nodes the vibration is unknown again, so it stays in the velocity and in its std
    sparse = np.ones(t.size, dtype=bool)
    sparse[nodes.index] = False
    sparse &= ~nominal.rest
    v = nominal.v + at_stamps(drift.x[:, V]) - np.where(sparse, 0.0, at_stamps(drift.x[:, PD]))
    x = nominal.x + at_stamps(drift.x[:, X]) - np.where(sparse, 0.0, at_stamps(drift.x[:, P]))
    omega = problem.noise.vibration_omega
    extra = np.where(sparse, problem.noise.vibration / omega, 0.0)
    v_std = np.hypot(at_stamps(std_of(drift.P, {V: 1.0, PD: -1.0})), extra)
    x_std = np.hypot(at_stamps(std_of(drift.P, {X: 1.0, P: -1.0})), extra / omega)
    if any(readings.kind == "reference_x" for readings in problem.reference):
        # the origin of the reference is not that of the motion
        x_std = np.hypot(x_std, x_std[0])
    return BodyMotion(
        x=x - x[0], x_std=x_std, v=v, v_std=np.hypot(v_std, _by_latency(t, v, solution)),
        pitch=nominal.pitch + at_stamps(drift.x[:, TH]), pitch_std=at_stamps(std_of(drift.P, {TH: 1.0})),
    )  # fmt: skip


def wheel_motion(solution: Solution, body: BodyMotion, rests: Sequence[Interval]) -> WheelMotion:
    """Return velocities and slip of the wheels, the latter NaN at rest."""
    nodes, drift, t, rolling = solution.nodes, solution.smoothed, solution.nominal.t, solution.problem.rolling
    v_wheel, v_wheel_std = wheels_at(t, rolling, solution.offset.value)
    ratio, ratio_std = wheel_slip(v_wheel, v_wheel_std, body.v, body.v_std)
    rest = inside(t, rests)
    ratio[rest], ratio_std[rest] = NAN, NAN
    u = nodes.w * (nodes.mean_slip + drift.x[:, S] + drift.x[:, G])
    u_std = np.abs(nodes.w) * std_of(drift.P, {S: 1.0, G: 1.0})
    if rolling is None:
        u, u_std = np.full(u.shape, NAN), np.full(u.shape, NAN)
    return WheelMotion(
        v_wheel=v_wheel, v_wheel_std=v_wheel_std, slip=ratio, slip_std=ratio_std,
        slip_velocity=solution.at_stamps(u), slip_velocity_std=solution.at_stamps(u_std),
    )  # fmt: skip


def totals_of(solution: Solution, body: BodyMotion, steady: Interval) -> Totals:
    """Return both distances, and λ_R by (2) over the `steady` part [s], which is moved to the nearest nodes.

    The covariance of distances at different instants comes from the smoother's gains.
    """
    distance = Estimate(float(body.x[-1]), float(body.x_std[-1]))
    totals = Totals(steady=steady, slip_ratio=Estimate(NAN), distance=distance, distance_wheels=Estimate(NAN))
    if solution.problem.rolling is None:
        return totals
    nodes, drift, x = solution.nodes, solution.smoothed, solution.travelled
    d = nodes.lost + drift.x[:, D]  # rolled minus travelled distance
    total = float(x[-1] + d[-1] - x[0] - d[0])
    whole = Estimate(total, float(std_of(drift.P[-1:], {X: 1.0, D: 1.0, P: -1.0})[0]))
    totals = replace(totals, distance_wheels=whole)
    if not np.isfinite(steady[0]):
        return totals
    i, j = (int(np.argmin(np.abs(nodes.t - edge))) for edge in steady)
    totals = replace(totals, steady=(float(nodes.t[i]), float(nodes.t[j])))
    travelled, slipped = x[j] - x[i], d[j] - d[i]
    rolled = travelled + slipped
    if abs(rolled) < 1e-3:
        return totals
    # λ = slipped / rolled: its gradient towards the difference of the states
    gradient = np.zeros(SIZE)
    gradient[[D, X, P]] = travelled, -slipped, slipped
    gradient /= rolled**2
    slip = Estimate(float(slipped / rolled), drift.std_of_change(gradient, i, j))
    return replace(totals, slip_ratio=slip, slip_parts=slip_parts(solution, gradient, i, j))


def motion_without_imu(trial: Trial, robot: Robot, rolling: Rolling, by_hand: Sequence[Interval]) -> Motion:
    """Report what the wheels alone tell: their velocities and phases, nothing of the body."""
    t = rolling.t
    rests, _ = find_rests(None, rolling, robot.imu_grade, by_hand=by_hand)
    course = find_phases(t, rolling.speed_at(t), rests)
    start = command_start(trial.command, Estimate(0.0), course.onset)
    variant, source, doubt = _command(trial, start, Estimate(0.0), course)
    lacking = "No IMU" if trial.imu is None else "No accelerometer along the robot's x axis"
    if trial.imu is not None and trial.imu.t.size < FEWEST_OF_IMU:
        lacking = f"Only {trial.imu.t.size} IMU samples"
    blank, four, none = np.full(t.size, NAN), np.full((t.size, 4), NAN), np.zeros(0)
    health = Health(
        t=none, kind=(), innovation=none, innovation_std=none, nis={}, accel_bias=blank,
        accel_bias_std=blank, gyro_bias=blank, gyro_bias_std=blank, rests=rests,
        verdict=f"{lacking}: only the wheels are known, neither body velocity nor slip.",
    )  # fmt: skip
    first, last = rolling.mean[np.isfinite(rolling.speed)][[0, -1]]
    rolled = Estimate(float(last - first), rolling.step)
    lost = "body velocity and slip cannot be estimated, only wheel velocities"
    doubt_of_body = f"{lacking[0].lower()}{lacking[1:]}: {lost}"
    return Motion(
        trial=trial.name, virtual=trial.info.virtual, t=t, x=blank, x_std=blank, v=blank, v_std=blank,
        pitch=blank, pitch_std=blank, v_wheel=rolling.velocity, v_wheel_std=rolling.velocity_std, slip=four,
        slip_std=four, slip_velocity=blank, slip_velocity_std=blank, phase=course.name,
        slip_ratio=Estimate(NAN), distance=Estimate(NAN), distance_wheels=rolled,
        steady=course.steady, t_start=start,
        clock_offset=Estimate(0.0), variant=variant, variant_source=source, noise={}, health=health,
        warnings=(*trial.warnings, *map(str, rolling.doubts), doubt_of_body, *([doubt] if doubt else [])),
    )  # fmt: skip


def _by_latency(t: Array, v: Array, solution: Solution) -> Array:
    """(N,) std of the velocity by not knowing whose stamps are late, the IMU's or the wheels' [m/s].

    An IMU that lags by its latency shows a motion later than it was, by acceleration times latency. The
    offset is the difference of the latencies of both sensors; what they have in common is unknown.
    """
    problem, offset = solution.problem, solution.offset
    if problem.slip.far or not np.isfinite(offset.std):
        return np.zeros(t.size)
    late = 0.5 * math.hypot(offset.std, offset.value - solution.applied, LATENCY, problem.stamp_std)
    size = max(round(QUICK / problem.imu.period), 1)
    return np.asarray(late * np.abs(uniform_filter1d(np.gradient(v, t), size)))


def wheels_at(t: Array, rolling: Rolling | None, offset: float) -> tuple[Array, Array]:
    """(N, 4) circumferential velocities and std at instants of the IMU's clock, NaN where unknown."""
    value, std = np.full((t.size, 4), NAN), np.full((t.size, 4), NAN)
    if rolling is None:
        return value, std
    stamps = rolling.t + offset
    period = float(np.median(np.diff(stamps)))
    for i in range(4):
        finite = np.flatnonzero(np.isfinite(rolling.velocity[:, i]))
        if finite.size < 2:
            continue
        known = stamps[finite]
        near = np.abs(known[nearest(known, t)] - t) < 3 * period
        value[near, i] = np.interp(t[near], known, rolling.velocity[finite, i])
        std[near, i] = np.interp(t[near], known, rolling.velocity_std[finite, i])
    return value, std


def wheel_slip(v_o: Array, v_o_std: Array, v: Array, v_std: Array) -> tuple[Array, Array]:
    """Return λ_i by (1) with its floor, (v_o - v) / max(|v_o|, |v|, v_floor), and its std.

    For circumferential velocities (N, 4) and the body's (N,) [m/s], which are taken for independent.
    """
    body, body_std = v[:, None], v_std[:, None]
    size = np.maximum(np.maximum(np.abs(v_o), np.abs(body)), V_FLOOR)
    ratio = (v_o - body) / size
    # dλ = (dv_o - dv) / size - λ dsize / size
    by_wheel = np.where(np.abs(v_o) >= size, np.sign(v_o), 0.0)
    by_body = np.where((np.abs(body) >= size) & (by_wheel == 0), np.sign(body), 0.0)
    d_wheel = (1 - ratio * by_wheel) / size
    d_body = (-1 - ratio * by_body) / size
    return ratio, np.hypot(d_wheel * v_o_std, d_body * body_std)


@dataclass(frozen=True, eq=False)
class Phases:
    """What the wheels did; λ_R is for the second half of their constant part, when slip has settled.

    Where nothing is constant, it is for the longest straight part of the drive, which may be all of it.
    """

    name: tuple[PhaseName, ...]  # (N,) of each stamp
    steady: Interval  # that second half, else all of the drive [s]; NaN where the wheels hardly turn
    plateau: float  # wheel velocity there [m/s]
    onset: Estimate  # instant at which the wheels set off, with std [s]
    acceleration: float  # slope of the wheels' velocity on the way up [m/s^2]
    distance: float  # rolled [m]
    constant: bool = True  # `steady` is part of a constant velocity


def find_phases(t: Array, speed: Array, rests: Sequence[Interval], off: Mask | None = None) -> Phases:
    """Divide a trial into rest, acceleration, steady motion and braking, by the wheels' speed (N,) [m/s].

    Nothing is steady where the robot is `off` (N,) a straight course.
    """
    period = float(np.median(np.diff(t)))
    off = np.zeros(t.size, dtype=bool) if off is None else off
    smooth = uniform_filter1d(speed, max(round(0.05 / period), 1), mode="nearest")
    pace = np.abs(smooth)
    rest = inside(t, rests)
    name = np.zeros(t.size, dtype=int)
    longest: tuple[int, int] = (0, 0)
    onset, acceleration = Estimate(NAN), NAN
    for a, b in runs(~rest):
        if pace[a:b].max() < MOVING:
            name[a:b] = UP if b == t.size else DOWN
            continue
        name[a:b], plateau, (first, last) = _drive(t[a:b], pace[a:b], ~off[a:b], period)
        if last - first > longest[1] - longest[0]:
            longest = (a + first, a + last)
            ramp = slice(a, a + max(first, 1))
            onset, acceleration = _onset(t[ramp], pace[ramp], plateau)
            if not onset.value >= t[a] - ENTRY:
                onset = first_crossing(t, pace, rest, a, plateau)
    i, j = longest
    constant = j - i >= 3 and t[j - 1] - t[i] >= SETTLED
    if not constant:
        steady, plateau = _whole(t, pace, speed, rest, off), float(pace.max())
    else:
        steady = (float(0.5 * (t[i] + t[j - 1])), float(t[j - 1]))
        plateau = float(np.median(speed[(t >= steady[0]) & (t <= steady[1])]))
    distance = float(np.trapezoid(np.where(rest, 0.0, speed), t))
    return Phases(tuple(PHASES[i] for i in name), steady, plateau, onset, acceleration, distance, constant)


def _drive(
    t: Array, pace: Array, straight: Mask, period: float
) -> tuple[npt.NDArray[np.int64], float, tuple[int, int]]:
    """Divide a drive from one standstill to the next into acceleration, steady motion and braking.

    Args:
        t, pace: (n,) instants [s], and magnitudes of the wheels' speed [m/s].
        straight: (n,) where the robot drives straight ahead.
        period: between two instants [s].

    Returns:
        (n,) places in `PHASES`; the speed of the plateau [m/s]; begin and end of its longest stretch.
    """
    plateau = float(np.median(pace[pace > 0.6 * pace.max()]))
    flat = (np.abs(pace - plateau) < BAND * plateau) & straight
    pieces = runs(bridged(np.arange(t.size), flat, round(0.2 / period) + 1.5))
    first, last = max(pieces, key=lambda p: p[1] - p[0], default=(0, 0))
    slow = uniform_filter1d(np.gradient(pace, t), max(round(0.1 / period), 1))
    label = np.where(slow >= 0, UP, DOWN)
    label[:first], label[last:] = UP, DOWN
    for i, j in pieces:
        if j - i > round(0.3 / period):
            label[i:j] = STEADY
    return label, plateau, (first, last)


def _whole(t: Array, pace: Array, speed: Array, rest: Mask, off: Mask) -> Interval:
    """Return the longest drive off which the robot never is [s]; NaN where the wheels hardly turn in it."""
    moving = np.flatnonzero(~rest & (pace > MOVING))
    if moving.size < 2:
        return NAN, NAN
    a, b = max(int(moving[0]) - 1, 0), min(int(moving[-1]) + 1, t.size - 1)
    rolled = integral(t, speed)
    pieces = [(a + i, a + j - 1) for i, j in runs(~off[a : b + 1])]
    first, last = max(pieces, key=lambda piece: rolled[piece[1]] - rolled[piece[0]], default=(a, a))
    return (float(t[first]), float(t[last])) if rolled[last] - rolled[first] > LEAST_WAY else (NAN, NAN)


def first_crossing(t: Array, pace: Array, rest: np.ndarray, begin: int, plateau: float) -> Estimate:
    """Return when the wheels set off, by where their speed leaves its own noise [s]; NaN outside the log.

    Args:
        t, pace, rest: (N,) stamps [s], speed [m/s], and True at standstill.
        begin: first sample that is no standstill.
        plateau: speed that is reached [m/s].
    """
    still = pace[:begin][rest[:begin]]
    noise = mad_std(still) if still.size > 3 else 0.0
    level = min(max(CLEAR * noise, MOVING), 0.5 * plateau)
    over = np.flatnonzero(pace[begin:] > level)
    if over.size == 0 or begin + int(over[0]) == 0:
        return Estimate(NAN)
    k = begin + int(over[0])
    under = np.flatnonzero(pace[:k] <= max(level / 2, 2 * noise))
    if under.size == 0:
        return Estimate(NAN)
    early, late = float(t[under[-1]]), float(t[k])
    # between these two samples, each instant is as likely as the other
    return Estimate((early + late) / 2, max((late - early) / math.sqrt(12), 0.01))


def _command(
    trial: Trial, start: Estimate, offset: Estimate, course: Phases
) -> tuple[Variant, str, str | None]:
    """Return the command, a course or else the trapezoid, with its source and a doubt or None."""
    found = recognise(course, trial.info, load_variants())
    return commanded(trial, start, offset, course.steady, *found[:2]) or found


def _onset(t: Array, pace: Array, plateau: float) -> tuple[Estimate, float]:
    """Extend the straight part of the ramp (15 to 60 % of the plateau) back to zero velocity.

    Returns:
        when the wheels set off [s], and their acceleration [m/s^2]; NaN where no such part rises.
    """
    use = (pace > 0.15 * plateau) & (pace < 0.6 * plateau)
    slope, level = np.polyfit(t[use] - t[0], pace[use], 1) if use.sum() >= 4 else (NAN, NAN)
    if not slope > 0:
        return Estimate(NAN), NAN
    residual = float(np.std(pace[use] - slope * (t[use] - t[0]) - level))
    # the corner of the ramp is rounded by the drive
    std = float(np.hypot(0.01, float(np.median(np.diff(t))) + residual / slope))
    return Estimate(float(t[0] - level / slope), std), float(slope)


def command_start(command: Series | None, offset: Estimate, onset: Estimate) -> Estimate:
    """Return the instant at which the command began: as logged, else when the wheels set off [s].

    A logged command is stamped by the encoders' clock.
    """
    if command is None or command.t.size < 3:
        return onset
    active = np.flatnonzero(np.abs(np.nan_to_num(command.value)) > 1e-6)
    if active.size == 0:
        return onset
    i = int(active[0])
    shift, extra = (value if np.isfinite(value) else 0.0 for value in (offset.value, offset.std))
    step = float(np.median(np.diff(command.t)))
    if i == 0:
        return Estimate(float(command.t[0]) + shift, float(np.hypot(step, extra)))
    # a ramp has already risen at its first sample; a line through the next ones leads back to zero
    begin, std = float(command.t[i]) - 0.5 * step, step / np.sqrt(12.0)
    rise = command.value[i : i + 4]
    if rise.size == 4 and np.all(np.diff(np.abs(rise)) > 0):
        slope = float(np.polyfit(command.t[i : i + 4], np.abs(rise), 1)[0])
        begin = max(float(command.t[i]) - float(np.abs(rise[0])) / slope, float(command.t[i - 1]))
    return Estimate(begin + shift, float(np.hypot(std, extra)))


def recognise(
    phases: Phases, info: TrialInfo, variants: Sequence[Variant]
) -> tuple[Variant, str, str | None]:
    """Say which variant the trial was; the metadata rule where they name the velocity.

    Returns:
        the variant; "given", "recognised" or "measured"; a doubt or None.
    """
    speed, rolled = abs(phases.plateau), abs(phases.distance)
    accelerated = phases.acceleration if np.isfinite(phases.acceleration) else max(speed, 0.02)
    if info.v_desired is not None:
        near = next((v for v in variants if abs(v.velocity - info.v_desired) < 1e-6), None)
        given = Variant(
            velocity=info.v_desired,
            acceleration=info.a_max or (near.acceleration if near else accelerated),
            distance=info.distance or (near.distance if near and info.a_max is None else max(rolled, 0.05)),
        )
        doubt = None
        if np.isfinite(speed) and speed > MOVING and abs(speed - info.v_desired) > 0.15 * info.v_desired:
            doubt = (
                f"the wheels ran at {speed:.3g} m/s, not at the {info.v_desired:g} m/s that the metadata give"
            )
        return given, "given", doubt

    def off(variant: Variant) -> float:
        """How far the motion is from a variant; 1 is the tolerance (8 % of velocity, 20 % of distance)."""
        ratio = np.log(accelerated / variant.acceleration)
        by_speed, by_way = (speed / variant.velocity - 1) / 0.08, (rolled / variant.distance - 1) / 0.2
        return float(np.sqrt(by_speed**2 + by_way**2 + ratio**2 / 2))

    best = min(variants, key=off, default=None)
    if best is not None and off(best) < 1.0:
        return best, "recognised", None
    measured = Variant(
        velocity=max(speed, 0.01), acceleration=max(accelerated, 0.01), distance=max(rolled, 0.05)
    )
    return measured, "measured", "the motion is none of the known variants: taken as measured"
