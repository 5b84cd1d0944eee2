"""The trial as estimation corrected it, which every later stage reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from granite_lab.estimate import Estimate
from granite_lab.estimation.error_model import BA
from granite_lab.estimation.motion import NAN, Motion
from granite_lab.estimation.problem import Problem
from granite_lab.estimation.smoother import Solution
from granite_lab.estimation.wheels import Rolling
from granite_lab.logs.counters import joined
from granite_lab.logs.sensors.faults import Restart
from granite_lab.logs.sensors.standstill import MOVING, Interval, inside
from granite_lab.logs.sensors.wheels import opposed
from granite_lab.logs.trial import Correction, CurrentStream, ImuStream, Trial, WheelStream
from granite_lab.parameters import GRAVITY, WHEELS, Robot

AMISS = 0.05
"""A wheel that was silent and comes back off the others' rotation by this share is put level with them."""


def clean_trial(
    trial: Trial,
    robot: Robot,
    motion: Motion,
    wheels: WheelStream | None,
    rolling: Rolling | None,
    problem: Problem | None = None,
    solution: Solution | None = None,
) -> Trial:
    """Return the trial with everything that estimation found out about its sensors put right.

    The IMU is in robot axes (`ImuStream.robot_axes`), at the sensor's place; gravity is in it; readings that
    cannot be trusted are NaN, and so is a stamp at either end of a gap; the change of biases by a restart is
    taken out. Encoders and currents count forwards and stand in the order of `WHEELS`; a wheel is NaN while
    it is dead. Constant biases, tilt and gains stay in: they are for later stages to estimate. So does a
    clock offset of a few milliseconds; of a large one `Motion.clock_left` is what remains.

    `wheels` and `rolling` are the encoders with the right order and signs; `problem` and `solution` are None
    for a log without IMU.
    """
    moved, made = motion.clock_applied, _signs(trial.wheels, wheels)
    if moved != 0.0:
        how = "given" if trial.info.clock_offset is not None else "found"
        where, std = "stamps of encoders and currents", motion.clock_offset.std
        made.append(Correction(f"offset of their clock, {how}", where, moved, std, "s"))
    stream = None
    if problem is not None and solution is not None:
        stream = _imu(made, problem, solution, motion)
    currents = trial.currents
    if wheels is not None and rolling is not None:
        wheels = _level(made, wheels, rolling, robot)
        if currents is not None:
            currents = _turn_currents(made, currents, rolling, motion.health.rests, motion.clock_offset)
    clocked = replace(trial, wheels=wheels, currents=currents).on_its_clock(moved)
    return replace(
        trial, imu=stream, **clocked,
        info=replace(trial.info, clock_offset=None), corrections=(*trial.corrections, *made),
    )  # fmt: skip


def _signs(logged: WheelStream | None, wheels: WheelStream | None) -> list[Correction]:
    """Say which encoders were turned or exchanged."""
    made: list[Correction] = []
    if logged is None or wheels is None or wheels is logged:
        return made
    for i, (name, angle) in enumerate(zip(WHEELS, wheels.angle.T, strict=True)):
        sources = ((j, sign) for j in sorted(range(4), key=lambda j: j != i) for sign in (1.0, -1.0))
        same = (s for s in sources if np.array_equal(angle, s[1] * logged.angle[:, s[0]], equal_nan=True))
        j, sign = next(same, (i, 1.0))
        if j != i:
            made.append(Correction(f"taken from the column of {WHEELS[j]}", f"encoder {name}", 1, NAN, ""))
        if sign < 0:
            made.append(Correction("sign turned", f"encoder {name}", -1.0, NAN, ""))
    return made


def _imu(made: list[Correction], problem: Problem, solution: Solution, motion: Motion) -> ImuStream:
    """Return the IMU's samples put right, and add to `made` what was done."""
    imu, faults = problem.imu, problem.faults
    force = np.stack([imu.forward, imu.left, imu.up], axis=1)
    rate = np.stack([imu.roll_rate, imu.pitch_rate, imu.yaw_rate], axis=1)
    angle = float(np.degrees(imu.rotation.magnitude()))
    if angle > 0.0:
        how = "levelled at standstill" if imu.levelled else "by the robot's file"
        made.append(Correction(f"turned into robot axes, {how}", "imu", angle, NAN, "deg"))
    if imu.scale != 0.0:
        made.append(Correction("scale error taken out", "imu", imu.scale, imu.scale_std, ""))
    if problem.stream.gravity_removed:
        force[:, 0] -= GRAVITY * np.sin(motion.pitch)
        force[:, 2] += GRAVITY * np.cos(motion.pitch)
        std = GRAVITY * float(np.sqrt(np.mean(motion.pitch_std**2)))
        made.append(Correction("gravity put back", "imu", GRAVITY, std, "m/s^2"))
    for restart in faults.restarts:
        step = _bias_step(restart, solution)
        force[:, 0] -= restart.passed(imu.t) * step.value
        where = f"imu, {restart.begin:.3f} to {restart.end:.3f} s"
        correction = "step of the accelerometer's bias along x taken out"
        made.append(Correction(correction, where, step.value, step.std, "m/s^2"))
        correction = "step of the pitch gyro's bias taken out"
        made.append(Correction(correction, where, restart.step[1], restart.gyro, "rad/s"))
    force[faults.doubt], rate[faults.rate_doubt] = NAN, NAN
    for correction, count in (
        ("readings thrown off left out", np.count_nonzero(faults.spikes)),
        ("readings at the sensor's limit left out", np.count_nonzero(faults.doubt & ~faults.spikes)),
    ):
        if count:
            made.append(Correction(correction, "imu", float(count), NAN, "samples"))
    ends = np.array([(a + imu.period, b - imu.period) for a, b in faults.gaps]).ravel()
    ends = np.setdiff1d(ends, imu.t)
    for begin, end in faults.gaps:
        made.append(Correction("samples missing", f"imu, {begin:.3f} to {end:.3f} s", end - begin, NAN, "s"))
    places = np.searchsorted(imu.t, ends)
    return ImuStream(
        t=np.insert(imu.t, places, ends),
        specific_force=np.insert(force, places, NAN, axis=0),
        angular_rate=np.insert(rate, places, NAN, axis=0),
        robot_axes=True,
    )


def _bias_step(restart: Restart, solution: Solution) -> Estimate:
    """Return by how much the accelerometer's bias along x changed [m/s^2], by the smoother."""
    nodes, smoothed = solution.nodes, solution.smoothed
    i = max(int(np.searchsorted(nodes.t, restart.begin, side="right")) - 1, 0)
    j = min(int(np.searchsorted(nodes.t, restart.end)), nodes.t.size - 1)
    variance = smoothed.P[i][BA, BA] + smoothed.P[j][BA, BA] - 2.0 * smoothed.cross(i, j)[BA, BA]
    return Estimate(float(smoothed.x[j, BA] - smoothed.x[i, BA]), float(np.sqrt(max(variance, 0.0))))


def _level(made: list[Correction], wheels: WheelStream, rolling: Rolling, robot: Robot) -> WheelStream:
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
        if dead.any():
            angle[dead, i] = NAN
            how = "left out while it was dead"
            made.append(Correction(how, f"encoder {name}", float(dead.sum()), NAN, "samples"))
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
                where = f"encoder {name}, {wheels.t[a]:.3f} to {wheels.t[b]:.3f} s"
                std = float(max(np.std(way), 0.01 * abs(expected)))
                made.append(
                    Correction("angle set level with the others'", where, expected - shown, std, "rad")
                )
    return replace(wheels, angle=angle)


def _turn_currents(
    made: list[Correction], currents: CurrentStream, rolling: Rolling, rests: Sequence[Interval],
    offset: Estimate,
) -> CurrentStream:  # fmt: skip
    """Turn the currents that flow against the wheels' rotation: motors deliver power in sand.

    One motor's current is turned where it runs against the others' as well; all of them, where they run
    against the wheels' acceleration. What was done is added to `made`.
    """
    t = currents.t
    live = np.flatnonzero(np.isfinite(currents.current).sum(axis=0) > 20)
    if np.isfinite(rolling.speed).sum() < 20 or live.size == 0:
        return currents
    speed = rolling.speed_at(t)
    shift = offset.value if np.isfinite(offset.value) else 0.0
    still = inside(t + shift, rests) & (np.abs(speed) < MOVING)
    going = np.abs(speed) > max(0.3 * float(np.abs(speed).max()), MOVING)
    if going.sum() < 20:
        return currents
    values = np.full((t.size, 4), NAN)
    for i in live:
        values[:, i] = joined(t, t, currents.current[:, i])
        values[:, i] -= float(np.mean(values[still, i])) if still.sum() > 10 else 0.0
    with np.errstate(invalid="ignore"):
        power = np.mean(values[going] * np.sign(speed[going])[:, None], axis=0)
    sign = np.ones(4)
    sign[opposed(values, power, live.tolist())] = -1.0
    if np.all(power[live] < 0):
        gained = np.gradient(speed, t)
        gained -= np.mean(gained)
        total = values[:, live].sum(axis=1)
        busy = np.abs(gained) > 0.3 * float(np.abs(gained).max())
        if float((total * np.sign(speed) * gained)[busy].sum()) < 0:
            sign[live] = -1.0
    turned = [Correction("sign turned", f"current {WHEELS[i]}", -1.0, NAN, "") for i in live if sign[i] < 0]
    made += turned
    return CurrentStream(t, currents.current * sign) if turned else currents
