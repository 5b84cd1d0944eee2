"""The trial as estimation corrected it, which every later stage reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from granite_lab.estimation.error_model import BA
from granite_lab.estimation.motion import NAN, Motion
from granite_lab.estimation.smoother import Solution
from granite_lab.estimation.wheels import Rolling
from granite_lab.logs.counters import interpolated
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.sensors.faults import Restart
from granite_lab.logs.sensors.standstill import MOVING, inside
from granite_lab.logs.trial import Array, CurrentStream, ImuStream, Trial, WheelStream
from granite_lab.parameters import GRAVITY, WHEELS, Robot

AMISS = 0.05
"""Share by which the angle of a wheel that was silent may differ from the others' rotation; beyond it, the
angle is set to theirs."""

OPPOSED = -0.5
"""Correlation of a motor's current with the others' below which its sign is wrong."""


def clean_trial(
    trial: Trial,
    robot: Robot,
    motion: Motion,
    wheels: WheelStream | None,
    rolling: Rolling | None,
    solution: Solution | None = None,
) -> Trial:
    """Return the trial with everything that estimation found out about its sensors put right.

    The IMU is in robot axes (`ImuStream.robot_axes`), at the sensor's place; gravity is in it; readings that
    cannot be trusted are NaN, and so is a stamp at either end of a gap; the change of biases by a restart is
    taken out. Encoders and currents count forwards and stand in the order of `WHEELS`; a wheel is NaN while
    it is dead. Constant biases, tilt and gains stay in: they are for later stages to estimate. So does a
    clock offset of a few milliseconds; of a large one `Motion.clock_left` is what remains.

    `wheels` and `rolling` are the encoders with the right order and signs; `solution` is None for a log
    without IMU.
    """
    stream = None if solution is None else _imu(solution, motion)
    currents, doubts = trial.currents, list[Doubt]()
    if wheels is not None and rolling is not None:
        wheels = _level(wheels, rolling, robot, doubts)
        if currents is not None:
            currents = _turn_currents(currents, rolling, motion, doubts)
    clocked = replace(trial, wheels=wheels, currents=currents).on_its_clock(motion.clock_applied)
    info = replace(trial.info, clock_offset=None)
    return replace(trial, imu=stream, **clocked, info=info, doubts=(*trial.doubts, *doubts))


def _imu(solution: Solution, motion: Motion) -> ImuStream:
    """Return the IMU's samples put right."""
    problem = solution.problem
    imu, faults = problem.imu, problem.faults
    force = np.stack([imu.forward, imu.left, imu.up], axis=1)
    rate = np.stack([imu.roll_rate, imu.pitch_rate, imu.yaw_rate], axis=1)
    if problem.stream.gravity_removed:
        force[:, 0] -= GRAVITY * np.sin(motion.pitch)
        force[:, 2] += GRAVITY * np.cos(motion.pitch)
    for restart in faults.restarts:
        force[:, 0] -= restart.passed(imu.t) * _bias_step(restart, solution)
    force[faults.doubt], rate[faults.rate_doubt] = NAN, NAN
    ends = np.array([(a + imu.period, b - imu.period) for a, b in faults.gaps]).ravel()
    ends = np.setdiff1d(ends, imu.t)
    places = np.searchsorted(imu.t, ends)
    return ImuStream(
        t=np.insert(imu.t, places, ends),
        specific_force=np.insert(force, places, NAN, axis=0),
        angular_rate=np.insert(rate, places, NAN, axis=0),
        robot_axes=True,
        scaled=problem.stream.scaled,
    )


def _bias_step(restart: Restart, solution: Solution) -> float:
    """Return by how much the accelerometer's bias along x changed [m/s^2], by the smoother."""
    nodes, bias = solution.nodes, solution.smoothed.x[:, BA]
    i = max(int(np.searchsorted(nodes.t, restart.begin, side="right")) - 1, 0)
    j = min(int(np.searchsorted(nodes.t, restart.end)), nodes.t.size - 1)
    return float(bias[j] - bias[i])


def _level(wheels: WheelStream, rolling: Rolling, robot: Robot, doubts: list[Doubt]) -> WheelStream:
    """Blank encoders while they are dead, and let them go on from where the others have turned to."""
    if wheels.rate is not None:
        return wheels
    angle = wheels.angle.copy()
    period = float(np.median(np.diff(wheels.t)))
    turned = rolling.distance / robot.wheels.radius
    for i, name in enumerate(WHEELS):
        finite = np.isfinite(angle[:, i])
        if not finite.any():
            continue
        fine = finite & np.isfinite(turned[:, i])
        fine[np.flatnonzero(finite)[0]] = True
        dead = finite & ~fine
        angle[dead, i] = NAN
        kept = np.flatnonzero(fine)
        if kept.size < 3:
            angle[:, i] = NAN
            continue
        # a gap, or dead meanwhile
        broken = (np.diff(wheels.t[kept]) > 3.5 * period) | (np.diff(np.cumsum(dead)[kept]) > 0)
        for a, b in zip(kept[:-1][broken], kept[1:][broken], strict=True):
            # the others' rotation meanwhile
            way = np.delete(turned[b] - turned[a], i)
            way = way[np.isfinite(way)]
            if way.size == 0:
                continue
            expected, shown = float(np.mean(way)), float(angle[b, i] - angle[a, i])
            if abs(shown - expected) > AMISS * abs(expected) + 2.0 * max(wheels.step, 1e-3):
                angle[b:, i] += expected - shown
                seen = f"turned unlike the others from {wheels.t[a]:.3f} to {wheels.t[b]:.3f} s"
                doubts.append(Doubt(seen, f"encoder {name}", "its angle is set level with theirs"))
    return replace(wheels, angle=angle)


def _turn_currents(
    currents: CurrentStream, rolling: Rolling, motion: Motion, doubts: list[Doubt]
) -> CurrentStream:
    """Turn the currents that flow against the wheels' rotation: motors deliver power in sand.

    One motor's current is turned where it runs against the others' as well; all of them, where they run
    against the wheels' acceleration.
    """
    t = currents.t
    live = np.flatnonzero(np.isfinite(currents.current).sum(axis=0) > 20)
    if np.isfinite(rolling.speed).sum() < 20 or live.size == 0:
        return currents
    speed = rolling.speed_at(t)
    shift = np.nan_to_num(motion.clock_offset.value)
    still = inside(t + shift, motion.health.rests) & (np.abs(speed) < MOVING)
    going = np.abs(speed) > max(0.3 * float(np.abs(speed).max()), MOVING)
    if going.sum() < 20:
        return currents
    values = np.full((t.size, 4), NAN)
    for i in live:
        values[:, i] = interpolated(t, t, currents.current[:, i])
        values[:, i] -= float(np.mean(values[still, i])) if still.sum() > 10 else 0.0
    with np.errstate(invalid="ignore"):
        power = np.mean(values[going] * np.sign(speed[going])[:, None], axis=0)
    sign = np.ones(4)
    sign[_opposed(values, power, live.tolist())] = -1.0
    if np.all(power[live] < 0):
        gained = np.gradient(speed, t)
        gained -= np.mean(gained)
        total = values[:, live].sum(axis=1)
        busy = np.abs(gained) > 0.3 * float(np.abs(gained).max())
        if float((total * np.sign(speed) * gained)[busy].sum()) < 0:
            sign[live] = -1.0
    if turned := ", ".join(WHEELS[i] for i in live if sign[i] < 0):
        doubts.append(Doubt("flows against the wheels", f"current {turned}", "its sign was turned"))
    return CurrentStream(t, currents.current * sign) if turned else currents


def _opposed(values: Array, power: Array, live: Sequence[int]) -> list[int]:
    """Return which of the `live` motors' currents (N, 4) [A] run against the others', which deliver power.

    `power` (4,) [A] is their mean, counted positive where it drives the wheels.
    """
    against = []
    for i in live:
        others = [j for j in live if j != i]
        if power[i] < 0 and len(others) > 1 and np.median(power[others]) > 0:
            like = np.corrcoef(values[:, i], values[:, others].mean(axis=1))[0, 1]
            against += [i] if like < OPPOSED else []
    return against
