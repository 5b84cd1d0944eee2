"""The motion record from the smoother's result, at the IMU's stamps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from granite_lab.estimate import Estimate, Part
from granite_lab.estimation import phases, slip
from granite_lab.estimation.budget import slip_parts
from granite_lab.estimation.motion import Health, Motion
from granite_lab.estimation.nodes import QUICK
from granite_lab.estimation.passes import LATENCY, Problem, Solution
from granite_lab.estimation.process import PD, TH, D, P, V, X
from granite_lab.estimation.rest import Interval, find_rests, inside
from granite_lab.estimation.rolling import Rolling
from granite_lab.logs.trial import Array, Trial
from granite_lab.parameters import ImuGrade, Robot, Variant

NAN = float("nan")


def motion_of(
    trial: Trial,
    problem: Problem,
    solution: Solution,
    health: Health,
    variants: Sequence[Variant],
    warnings: tuple[str, ...],
) -> Motion:
    """Add the smoothed drift to the nominal motion and derive slip, phases and variant."""
    nodes, found, nominal = solution.nodes, solution.smoothed, solution.nominal
    t, rolling, offset = nominal.t, problem.rolling, solution.offset

    def spread(values: Array) -> Array:
        return np.interp(t, nodes.t, values)

    # between sparse nodes the vibration is unknown again, so it stays in the velocity and in its std
    sparse = np.ones(t.size, dtype=bool)
    sparse[nodes.index] = False
    sparse &= ~nominal.rest
    v = nominal.v + spread(found.x[:, V]) - np.where(sparse, 0.0, spread(found.x[:, PD]))
    x = nominal.x + spread(found.x[:, X]) - np.where(sparse, 0.0, spread(found.x[:, P]))
    omega = 2 * np.pi * problem.noise.vibration_frequency
    extra = np.where(sparse, problem.noise.vibration / omega, 0.0)
    v_std = np.hypot(spread(slip.velocity_std(found)), extra)
    x_std = np.hypot(spread(slip.distance_std(found)), extra / omega)
    v_std = np.hypot(v_std, _by_latency(t, v, problem, offset))
    pitch = nominal.pitch + spread(found.x[:, TH])
    pitch_std = spread(np.sqrt(np.maximum(found.P[:, TH, TH], 0.0)))
    u, u_std = slip.slip_velocity(found, nodes.w, nodes.mean_slip)
    v_wheel, v_wheel_std = wheels_at(t, rolling, offset.value)
    rest = inside(t, health.rests)
    ratio, ratio_std = slip.wheel_slip(v_wheel, v_wheel_std, v, v_std)
    ratio[rest], ratio_std[rest] = NAN, NAN
    if rolling is not None:
        known = np.isfinite(rolling.speed)
        pace = np.interp(t, rolling.t[known] + offset.value, rolling.speed[known])
    else:
        pace, u, u_std = v, np.full(u.shape, NAN), np.full(u.shape, NAN)
    course = phases.find(t, pace, health.rests)
    variant, source, doubt = phases.recognise(course, trial.info, variants)
    distance = Estimate(float(x[-1] - x[0]), float(x_std[-1]))
    slip_ratio, rolled, parts = Estimate(NAN), Estimate(NAN), tuple[Part, ...]()
    if rolling is not None:
        travelled = nominal.x[nodes.index] + found.x[:, X] - found.x[:, P]
        lost = nodes.lost + found.x[:, D]
        total = float(travelled[-1] + lost[-1] - travelled[0] - lost[0])
        rolled = Estimate(total, rolled_std(found.P[-1]))
        if np.isfinite(course.steady[0]):
            i, j = (int(np.argmin(np.abs(nodes.t - edge))) for edge in course.steady)
            slip_ratio = slip.robot_slip(found, travelled, lost, i, j)
            parts = slip_parts(
                nodes, found, problem.noise, problem.slip, slip_ratio.value, travelled + lost, i, j
            )
            course = replace(course, steady=(float(nodes.t[i]), float(nodes.t[j])))
    more = [doubt] if doubt else []
    if not np.isfinite(course.steady[0]):
        more.append("no steady part: the robot's slip ratio is not defined")
    return Motion(
        trial=trial.name, virtual=trial.info.virtual, t=t, x=x - x[0], x_std=x_std, v=v, v_std=v_std,
        pitch=pitch, pitch_std=pitch_std, v_wheel=v_wheel, v_wheel_std=v_wheel_std, slip=ratio,
        slip_std=ratio_std, slip_velocity=spread(u), slip_velocity_std=spread(u_std), phase=course.name,
        slip_ratio=slip_ratio, distance=distance, distance_wheels=rolled, steady=course.steady,
        t_start=phases.command_start(trial.command, offset, course.onset), clock_offset=offset,
        variant=variant, variant_source=source, noise=problem.noise.as_dict(), health=health,
        warnings=(*trial.warnings, *warnings, *more), slip_parts=parts,
    )  # fmt: skip


def _by_latency(t: Array, v: Array, problem: Problem, offset: Estimate) -> Array:
    """(N,) std of the velocity by not knowing whose stamps are late, the IMU's or the wheels' [m/s].

    An IMU that lags by its latency shows a motion later than it was, by acceleration times latency.
    """
    if problem.slip.memory or not np.isfinite(offset.std):
        return np.zeros(t.size)
    late = float(np.hypot(offset.std, offset.value if abs(offset.value) < LATENCY else 0.0))
    size = max(round(QUICK / float(np.median(np.diff(t)))), 1)
    return np.asarray(late * np.abs(uniform_filter1d(np.gradient(v, t), size)))


def rolled_std(P_end: Array) -> float:
    """Std of the rolled distance at a node [m]."""
    h = np.zeros(P_end.shape[0])
    h[[X, D, P]] = 1.0, 1.0, -1.0
    return float(np.sqrt(max(float(h @ P_end @ h), 0.0)))


def wheels_at(t: Array, rolling: Rolling | None, offset: float) -> tuple[Array, Array]:
    """(N, 4) circumferential velocities and std at instants of the IMU's clock, NaN where unknown."""
    value, std = np.full((t.size, 4), NAN), np.full((t.size, 4), NAN)
    if rolling is None:
        return value, std
    stamps = rolling.t + offset
    period = float(np.median(np.diff(stamps)))
    for i in range(4):
        known = np.flatnonzero(np.isfinite(rolling.velocity[:, i]))
        if known.size < 2:
            continue
        after = np.clip(np.searchsorted(stamps[known], t), 1, known.size - 1)
        near = np.minimum(np.abs(stamps[known[after]] - t), np.abs(t - stamps[known[after - 1]])) < 3 * period
        value[near, i] = np.interp(t[near], stamps[known], rolling.velocity[known, i])
        std[near, i] = np.interp(t[near], stamps[known], rolling.velocity_std[known, i])
    return value, std


def motion_without_imu(
    trial: Trial, robot: Robot, rolling: Rolling, variants: Sequence[Variant], by_hand: Sequence[Interval]
) -> Motion:
    """Report what the wheels alone tell: their velocities and phases, nothing of the body."""
    t = rolling.t
    grade = robot.imu_grade
    assert isinstance(grade, ImuGrade)
    rests = find_rests(None, rolling, grade, by_hand=by_hand)
    known = np.isfinite(rolling.speed)
    course = phases.find(t, np.interp(t, t[known], rolling.speed[known]), rests)
    variant, source, doubt = phases.recognise(course, trial.info, variants)
    blank, four, none = np.full(t.size, NAN), np.full((t.size, 4), NAN), np.zeros(0)
    health = Health(
        t=none, kind=(), innovation=none, innovation_std=none, nis={}, accel_bias=blank,
        accel_bias_std=blank, gyro_bias=blank, gyro_bias_std=blank, rests=rests,
        verdict="No IMU: only the wheels are known, neither body velocity nor slip.", good=False,
    )  # fmt: skip
    rolled = float(rolling.mean[known][-1] - rolling.mean[known][0])
    said = "no IMU: body velocity and slip cannot be estimated, only wheel velocities"
    return Motion(
        trial=trial.name, virtual=trial.info.virtual, t=t, x=blank, x_std=blank, v=blank, v_std=blank,
        pitch=blank, pitch_std=blank, v_wheel=rolling.velocity, v_wheel_std=rolling.velocity_std, slip=four,
        slip_std=four, slip_velocity=blank, slip_velocity_std=blank, phase=course.name,
        slip_ratio=Estimate(NAN), distance=Estimate(NAN),
        distance_wheels=Estimate(rolled, rolling.step),
        steady=course.steady, t_start=phases.command_start(trial.command, Estimate(0.0), course.onset),
        clock_offset=Estimate(0.0), variant=variant, variant_source=source, noise={}, health=health,
        warnings=(*trial.warnings, *rolling.warnings, said, *([doubt] if doubt else [])),
    )  # fmt: skip
