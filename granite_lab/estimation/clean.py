"""The trial as estimation corrected it, which every later stage reads."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from granite_lab.estimate import Estimate
from granite_lab.estimation.differentiation import MOVING
from granite_lab.estimation.faults import Faults
from granite_lab.estimation.motion import Motion
from granite_lab.estimation.mounting import BodyImu
from granite_lab.estimation.passes import Solution
from granite_lab.estimation.process import BA
from granite_lab.estimation.rest import Interval, inside
from granite_lab.estimation.restarts import Restart
from granite_lab.estimation.rolling import Rolling
from granite_lab.logs.trial import Array, Correction, CurrentStream, ImuStream, Series, Trial, WheelStream
from granite_lab.parameters import GRAVITY, WHEELS, Robot

NAN = float("nan")

OPPOSED = -0.5
"""A current that correlates with the other motors' by less than this has the opposite sign."""

AMISS = 0.05
"""A wheel that was silent and comes back off the others' rotation by this share is put level with them."""


def clean_trial(
    trial: Trial,
    robot: Robot,
    motion: Motion,
    *,
    wheels: WheelStream | None,
    rolling: Rolling | None,
    imu: BodyImu | None = None,
    faults: Faults | None = None,
    solution: Solution | None = None,
) -> Trial:
    """Return the trial with everything that estimation found out about its sensors put right.

    The IMU is in robot axes (`ImuStream.robot_axes`), at the sensor's place; gravity is in it; readings that
    cannot be trusted are NaN, and so is a stamp at either end of a gap; the change of biases by a restart is
    taken out. Encoders and currents count forwards and stand in the order of `WHEELS`; a wheel is NaN while
    it is dead. Constant biases, tilt and gains stay in: they are for later stages to estimate. So does a
    clock offset of a few milliseconds; of a large one `Motion.clock_left` is what remains.

    Args:
        trial: as it was logged.
        robot: its parameters.
        motion: what was estimated from it.
        wheels, rolling: the encoders in the right order, with the right signs.
        imu, faults, solution: IMU in robot axes without steps, what is wrong with it, the last pass;
            None for a log without IMU.
    """
    moved, made = motion.clock_applied, _signs(trial.wheels, wheels)
    if moved != 0.0:
        given = trial.info.clock_offset is not None
        std = motion.clock_offset.std
        what = "offset of their clock, given" if given else "offset of their clock, found"
        made.append(Correction(what, "stamps of encoders and currents", moved, std, "s"))
    stream = None
    if imu is not None and faults is not None and solution is not None:
        stream, more = _imu(
            imu, faults, solution, motion, put_back=bool(trial.imu and trial.imu.gravity_removed)
        )
        made += more
    currents, command = trial.currents, trial.command
    if wheels is not None and rolling is not None:
        wheels, more = _level(wheels, rolling, robot)
        made += more
        if currents is not None:
            currents, more = _turn_currents(currents, rolling, motion.health.rests, motion.clock_offset)
            made += more
        wheels = dataclasses.replace(wheels, t=wheels.t + moved)
    if currents is not None:
        currents = dataclasses.replace(currents, t=currents.t + moved)
    if command is not None:
        command = Series(command.t + moved, command.value)
    return dataclasses.replace(
        trial, imu=stream, wheels=wheels, currents=currents, command=command,
        info=dataclasses.replace(trial.info, clock_offset=None), corrections=(*trial.corrections, *made),
    )  # fmt: skip


def _signs(logged: WheelStream | None, wheels: WheelStream | None) -> list[Correction]:
    """Say which encoders were turned or exchanged."""
    made: list[Correction] = []
    if logged is None or wheels is None or wheels is logged:
        return made
    for i, name in enumerate(WHEELS):
        for j, other in enumerate(WHEELS):
            for sign in (1.0, -1.0):
                same = np.array_equal(wheels.angle[:, i], sign * logged.angle[:, j], equal_nan=True)
                if not same or not np.any(np.nan_to_num(wheels.angle[:, i])):
                    continue
                if i != j and np.array_equal(wheels.angle[:, i], logged.angle[:, i], equal_nan=True):
                    continue
                if i != j:
                    made.append(
                        Correction(f"taken from the column of {other}", f"encoder {name}", 1, NAN, "")
                    )
                if sign < 0:
                    made.append(Correction("sign turned", f"encoder {name}", -1.0, NAN, ""))
    return made


def _imu(
    imu: BodyImu, faults: Faults, solution: Solution, motion: Motion, *, put_back: bool
) -> tuple[ImuStream, list[Correction]]:
    force = np.stack([imu.forward, imu.left, imu.up], axis=1)
    rate = np.stack([imu.roll_rate, imu.pitch_rate, imu.yaw_rate], axis=1)
    made: list[Correction] = []
    angle = float(np.degrees(imu.rotation.magnitude()))
    if angle > 0.0:
        how = "levelled, x found by the wheels" if imu.levelled else "by the robot's file"
        made.append(Correction(f"turned into robot axes, {how}", "imu", angle, NAN, "deg"))
    if put_back:
        force[:, 0] -= GRAVITY * np.sin(motion.pitch)
        force[:, 2] += GRAVITY * np.cos(motion.pitch)
        std = GRAVITY * float(np.sqrt(np.mean(motion.pitch_std**2)))
        made.append(Correction("gravity put back", "imu", GRAVITY, std, "m/s^2"))
    for restart in faults.restarts:
        step = _bias_step(restart, solution)
        passed = _passed(imu.t, restart)[:, None]
        force -= passed * np.array([step.value, 0.0, 0.0])
        where = f"imu, {restart.begin:.3f} to {restart.end:.3f} s"
        made.append(
            Correction("step of the accelerometer's bias along x taken out", where, *_pair(step), "m/s^2")
        )
        turn = Estimate(restart.step[1], restart.gyro)
        made.append(Correction("step of the pitch gyro's bias taken out", where, *_pair(turn), "rad/s"))
    force[faults.doubt], rate[faults.rate_doubt] = NAN, NAN
    for what, count in (
        ("readings thrown off left out", np.count_nonzero(faults.spikes)),
        ("readings at the sensor's limit left out", np.count_nonzero(faults.doubt & ~faults.spikes)),
    ):
        if count:
            made.append(Correction(what, "imu", float(count), NAN, "samples"))
    t, period = imu.t, float(np.median(np.diff(imu.t)))
    ends = np.array([(a + period, b - period) for a, b in faults.gaps]).ravel()
    ends = np.setdiff1d(ends, t)
    for begin, end in faults.gaps:
        made.append(Correction("samples missing", f"imu, {begin:.3f} to {end:.3f} s", end - begin, NAN, "s"))
    places = np.searchsorted(t, ends)
    stream = ImuStream(
        t=np.insert(t, places, ends),
        specific_force=np.insert(force, places, NAN, axis=0),
        angular_rate=np.insert(rate, places, NAN, axis=0),
        robot_axes=True,
    )
    return stream, made


def _pair(estimate: Estimate) -> tuple[float, float]:
    return estimate.value, estimate.std


def _passed(t: Array, restart: Restart) -> Array:
    """(N,) share of a restart's step that has passed."""
    return np.asarray(np.clip((t - restart.begin) / max(restart.end - restart.begin, 1e-9), 0.0, 1.0))


def _bias_step(restart: Restart, solution: Solution) -> Estimate:
    """Return by how much the accelerometer's bias along x changed [m/s^2], by the smoother."""
    nodes, found = solution.nodes, solution.smoothed
    i = max(int(np.searchsorted(nodes.t, restart.begin, side="right")) - 1, 0)
    j = min(int(np.searchsorted(nodes.t, restart.end)), nodes.t.size - 1)
    cross = found.cross(i, j)[BA, BA]
    variance = found.P[i][BA, BA] + found.P[j][BA, BA] - 2.0 * cross
    return Estimate(float(found.x[j, BA] - found.x[i, BA]), float(np.sqrt(max(variance, 0.0))))


def _level(wheels: WheelStream, rolling: Rolling, robot: Robot) -> tuple[WheelStream, list[Correction]]:
    """Blank encoders while they are dead, and let them go on from where the others have turned to.

    Args:
        wheels: with the right signs.
        rolling: the same as distances, NaN where a wheel is not to be used.
    """
    made: list[Correction] = []
    angle = wheels.angle.copy()
    rate = None if wheels.rate is None else wheels.rate.copy()
    period = float(np.median(np.diff(wheels.t)))
    turned = rolling.distance / robot.wheels.radius
    for i, name in enumerate(WHEELS):
        known = np.isfinite(angle[:, i])
        if not known.any():
            continue
        fine = known & np.isfinite(turned[:, i])
        first = int(np.flatnonzero(known)[0])
        fine[first] = True
        dead = known & ~fine
        if dead.any() and rate is None:
            angle[dead, i] = NAN
            what = "left out while it was dead"
            made.append(Correction(what, f"encoder {name}", float(dead.sum()), NAN, "samples"))
        kept = np.flatnonzero(fine)
        if kept.size < 3:
            angle[:, i] = NAN
            continue
        for a, b in pairwise(kept):
            silent = wheels.t[b] - wheels.t[a] > 3.5 * period
            if rate is not None or not (silent or dead[a:b].any()):
                continue
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
    return dataclasses.replace(wheels, angle=angle, rate=rate), made


def _turn_currents(
    currents: CurrentStream, rolling: Rolling, rests: Sequence[Interval], offset: Estimate
) -> tuple[CurrentStream, list[Correction]]:
    """Turn the currents that flow against the wheels' rotation: motors deliver power in sand.

    One motor's current is turned where it runs against the others' as well; all of them, where they run
    against the wheels' acceleration.
    """
    t = currents.t
    known = np.isfinite(rolling.speed)
    live = np.flatnonzero(np.isfinite(currents.current).sum(axis=0) > 20)
    if known.sum() < 20 or live.size == 0:
        return currents, []
    speed = np.interp(t, rolling.t[known], rolling.speed[known])
    shift = offset.value if np.isfinite(offset.value) else 0.0
    still = inside(t + shift, rests) & (np.abs(speed) < MOVING)
    going = np.abs(speed) > max(0.3 * float(np.abs(speed).max()), MOVING)
    if going.sum() < 20:
        return currents, []
    values = np.full((t.size, 4), NAN)
    for i in live:
        fine = np.isfinite(currents.current[:, i])
        values[:, i] = np.interp(t, t[fine], currents.current[fine, i])
        values[:, i] -= float(np.mean(values[still, i])) if still.sum() > 10 else 0.0
    with np.errstate(invalid="ignore"):
        power = np.mean(values[going] * np.sign(speed[going])[:, None], axis=0)
    sign = np.ones(4)
    for i in live:
        others = [j for j in live if j != i]
        if power[i] < 0 and len(others) > 1 and np.median(power[others]) > 0:
            like = np.corrcoef(values[:, i], values[:, others].mean(axis=1))[0, 1]
            sign[i] = -1.0 if like < OPPOSED else 1.0
    if np.all(power[live] < 0):
        gained = np.gradient(speed, t)
        gained -= np.mean(gained)
        total = np.where(np.isfinite(values[:, live]), values[:, live], 0.0).sum(axis=1)
        busy = np.abs(gained) > 0.3 * float(np.abs(gained).max())
        if float((total * np.sign(speed) * gained)[busy].sum()) < 0:
            sign[live] = -1.0
    made = [Correction("sign turned", f"current {WHEELS[i]}", -1.0, NAN, "") for i in live if sign[i] < 0]
    return CurrentStream(t, currents.current * sign if made else currents.current), made
