"""Sensors that lie: columns that cannot be what they are called, judged against the other sensors."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from granite_lab.errors import InputError
from granite_lab.logs.encoders import quantum
from granite_lab.logs.stretches import rests
from granite_lab.logs.trial import Array, CurrentStream, ImuStream, Trial
from granite_lab.parameters import GRAVITY, WHEELS, Robot

OFF_AXIS = 45.0
"""Gravity at rest farther than this [deg] from the robot's z axis stands on another axis."""

MISSED, BETTER = 0.12, 4.0
"""A pitch rate leaves more velocity than this [m/s] at rest, and another one this many times less."""

FREE = (1.3, 0.05, 0.3)
"""A wheel that turns this many times as fast as the others, which agree to this share, for so long [s]."""

HANGS = 0.5
"""All axes of a sensor that repeat themselves for longer [s] hang."""

OUT = "to = [] in a column map (inspect --write-map) leaves it out"


def check_sensors(
    trial: Trial, robot: Robot, where: str, names: Mapping[str, str]
) -> tuple[Trial, list[str]]:
    """Refuse columns that cannot be what they are called; leave out what one wheel does off the ground.

    Args:
        trial: as read.
        robot: how its IMU is mounted, and what its motors can do.
        where: the file, for messages.
        names: channel to the name of its column.

    Returns:
        the trial with currents in amperes, without the stretches of a wheel that turns freely; warnings.

    Raises:
        InputError: a column that would carry a wrong result, with what it looks like and what to write.
    """
    doubts: list[str] = []
    if trial.imu is None and trial.wheels is not None and any(name.startswith("imu_") for name in names):
        empty = ", ".join(f"'{name}'" for channel, name in names.items() if channel.startswith("imu_"))
        raise InputError(f"{where}: columns {empty}: every cell is empty, expected an IMU's samples", OUT)
    if trial.wheels is not None:
        _whole_numbers(trial, where, names)
        _too_fast(trial, robot, where, names)
        angle = trial.wheels.angle[np.isfinite(trial.wheels.angle)]
        if trial.imu is not None and len(trial.imu.t) > 100 and len(angle) and np.ptp(angle) > 1.0:
            _dead(trial.imu, robot, where, names)
            still = rests(trial, robot)
            _gravity(trial.imu, robot, still, where, names)
            _pitch_rate(trial.imu, robot, still, where, names)
        trial, more = _off_ground(trial, names)
        doubts += more
    if trial.currents is not None:
        currents, more = _currents(trial, trial.currents, robot, names)
        trial = dataclasses.replace(trial, currents=currents)
        doubts += more
    return trial, doubts


def _mounting(robot: Robot) -> Array:
    """Return the matrix from the sensor's axes to the robot's."""
    roll, pitch, yaw = robot.imu.rotation
    return np.asarray(Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True).as_matrix())


def _dead(imu: ImuStream, robot: Robot, where: str, names: Mapping[str, str]) -> None:
    """Refuse an axis that never changes and that velocity or pitch need."""
    turn = np.abs(_mounting(robot)) > 0.5
    any_axis = robot.imu.forward == "find"
    for what, stem, values, rows in (
        ("accelerometer", "imu_a", imu.specific_force, (0, 2)),
        ("gyroscope", "imu_g", imu.angular_rate, (1,)),
    ):
        held = np.concatenate(([0], (np.diff(values, axis=0) == 0).all(axis=1).astype(np.int8), [0]))
        begins, ends = np.flatnonzero(np.diff(held) == 1), np.flatnonzero(np.diff(held) == -1)
        hangs = max(zip(begins, ends, strict=True), key=lambda run: run[1] - run[0], default=(0, 0))
        begin, end = float(imu.t[hangs[0]]), float(imu.t[min(hangs[1], len(imu.t) - 1)])
        if end - begin > HANGS and 0 < hangs[1] - hangs[0] < 0.9 * len(imu.t) and hangs[1] - hangs[0] > 50:
            columns = " ".join(f"'{names.get(stem + axis, stem + axis)}'" for axis in "xyz")
            raise InputError(
                f"{where}: columns {columns}: every sample from t = {begin:.3f} s to {end:.3f} s is the "
                f"same, expected readings of the {what} that change: the sensor hangs",
                "cut the log there",
            )
        constant = np.array([np.isfinite(v).all() and np.ptp(v) == 0 for v in values.T])
        other = imu.angular_rate if stem == "imu_a" else imu.specific_force
        if constant.all() and (np.isnan(other).all() or not np.ptp(other, axis=0).any()):
            return  # nothing is connected: the rails' warning says so
        for j in np.flatnonzero(constant):
            channel = f"{stem}{'xyz'[j]}"
            if len(values) > 10 and (any_axis or any(turn[row, j] for row in rows)):
                raise InputError(
                    f"{where}: column '{names.get(channel, channel)}': every sample is {values[0, j]:.6g}, "
                    f"expected readings of the {what} that change: the sensor hangs or is not connected",
                    OUT,
                )


def _gravity(
    imu: ImuStream, robot: Robot, still: list[tuple[float, float]], where: str, names: Mapping[str, str]
) -> None:
    """Refuse an accelerometer whose gravity at rest is not on the robot's z axis."""
    if imu.gravity_removed or robot.imu.forward == "find" or not still or np.isnan(imu.specific_force).any():
        return
    rest = _within(imu.t, still)
    mean = imu.specific_force[rest].mean(axis=0) if rest.any() else np.zeros(3)
    size = float(np.linalg.norm(mean))
    up = _mounting(robot) @ mean / max(size, 1e-9)
    if 0.5 * GRAVITY < size < 1.5 * GRAVITY and up[2] < np.cos(np.radians(OFF_AXIS)):
        j, expected = int(np.argmax(np.abs(mean))), int(np.argmax(np.abs(_mounting(robot)[2])))
        should = names.get(f"imu_a{'xyz'[expected]}", "xyz"[expected])
        is_on = names.get(f"imu_a{'xyz'[j]}", "xyz"[j])
        raise InputError(
            f"{where}: column '{is_on}' reads {mean[j]:+.2f} m/s^2 at rest: gravity is on it, expected on "
            f"'{should}' upwards",
            "exchange the axes in a column map (or scale = -1), or give [imu] rotation in the robot's file",
        )


def _within(t: Array, spans: list[tuple[float, float]]) -> np.ndarray:
    """(N,) True where a stamp lies well inside one of the intervals."""
    mark = np.zeros(len(t), dtype=bool)
    for begin, end in spans:
        mark |= (t > begin + 0.1) & (t < end - 0.1)
    return mark


def _pitch_rate(
    imu: ImuStream, robot: Robot, still: list[tuple[float, float]], where: str, names: Mapping[str, str]
) -> None:
    """Refuse a pitch rate with which the velocity does not return to zero, where another one does that.

    Between two rests velocity is the integral of specific force less gravity's part by pitch, and pitch
    is the integral of the pitch rate; both are levelled and unbiased at the rests.
    """
    if (
        imu.gravity_removed
        or robot.imu.forward == "find"
        or len(still) < 2
        or np.isnan(imu.specific_force).any()
    ):
        return
    matrix = _mounting(robot)
    force, rate = imu.specific_force @ matrix.T, np.nan_to_num(imu.angular_rate) @ matrix.T
    left: dict[str, list[float]] = {}
    for (a, b), (c, d) in pairwise(still):
        first, last, motion = (
            _within(imu.t, [(a, b)]),
            _within(imu.t, [(c, d)]),
            (imu.t >= b - 0.1) & (imu.t <= c + 0.1),
        )
        if c - b > 60 or min(first.sum(), last.sum(), motion.sum()) < 10:
            continue
        t = imu.t[motion]
        level = np.arcsin(
            np.clip([force[first, 0].mean() / -GRAVITY, force[last, 0].mean() / -GRAVITY], -1, 1)
        )
        for j, axis in enumerate("xyz"):
            for turned in (1.0, -1.0):
                w = turned * (rate[motion, j] - (rate[first, j].mean() + rate[last, j].mean()) / 2)
                pitch = np.concatenate(([0.0], np.cumsum(np.diff(t) * (w[1:] + w[:-1]) / 2)))
                # the end is levelled, too: what is left over is drift
                pitch += (t - t[0]) / (t[-1] - t[0]) * (level[1] - level[0] - pitch[-1])
                a_x = force[motion, 0] + GRAVITY * np.sin(level[0] + pitch)
                left.setdefault(f"{'+' if turned > 0 else '-'}{axis}", []).append(
                    abs(float(np.trapezoid(a_x, t)))
                )
    if not left:
        return
    missed = {which: float(np.median(found)) for which, found in left.items()}
    best = min(missed, key=lambda which: missed[which])
    if best != "+y" and missed["+y"] > MISSED and missed["+y"] > BETTER * missed[best]:
        j = int(np.argmax(np.abs(matrix[1])))
        name = names.get(f"imu_g{'xyz'[j]}", "pitch rate")
        forward = names.get(f"imu_a{'xyz'[int(np.argmax(np.abs(matrix[0])))]}", "forward axis")
        sign = f"its sign or that of '{forward}' is wrong"
        what = sign if best == "-y" else f"the rate about {best[1]} fits: axes exchanged"
        raise InputError(
            f"{where}: column '{name}': with it as pitch rate {missed['+y']:.2f} m/s are left at standstill, "
            f"with {best} {missed[best]:.2f} m/s: {what}",
            "scale = -1 in a column map turns a sign, 'to' exchanges axes; pitch rate is positive nose down",
        )


def _whole_numbers(trial: Trial, where: str, names: Mapping[str, str]) -> None:
    """Refuse an angle [rad] that only takes whole numbers: those are counts."""
    assert trial.wheels is not None
    if trial.wheels.rate is not None:
        return
    for i, wheel in enumerate(WHEELS):
        angle = trial.wheels.angle[:, i]
        angle = angle[np.isfinite(angle)]
        if (
            len(angle) > 20
            and len(np.unique(angle)) > 20
            and (angle == np.rint(angle)).all()
            and quantum(angle) >= 1
        ):
            raise InputError(
                f"{where}: column '{names.get(f'enc_{wheel}', wheel)}': only whole numbers up to "
                f"{np.abs(angle).max():.0f}, expected an angle in rad: they look like counts",
                'unit = "counts" and counts_per_rev = … in a column map',
            )


def _too_fast(trial: Trial, robot: Robot, where: str, names: Mapping[str, str]) -> None:
    """Refuse wheels that turn faster than the motors can turn them at their highest voltage."""
    drive, wheels = robot.drive, trial.wheels
    if drive is None or wheels is None:
        return
    top = drive.voltage_max / (drive.emf_constant * drive.gear_ratio)
    for i, wheel in enumerate(WHEELS):
        known = np.isfinite(wheels.angle[:, i])
        if np.count_nonzero(known) < 20:
            continue
        t = wheels.t[known]
        rate = np.abs(np.diff(wheels.angle[known, i]) / np.diff(t))
        fast = float(np.quantile(rate, 0.75))
        if fast > 1.5 * top:
            radius = robot.wheels.radius
            raise InputError(
                f"{where}: column '{names.get(f'enc_{wheel}', wheel)}': the wheel turns with {fast:.3g} "
                f"rad/s ({fast * radius:.2g} m/s), expected at most {top:.3g} rad/s of {robot.name}'s motors",
                'counts need unit = "counts" and counts_per_rev = … in a column map; or name the robot',
            )


def _off_ground(trial: Trial, names: Mapping[str, str]) -> tuple[Trial, list[str]]:
    """Leave a wheel out where it turns much faster than the other three, which agree."""
    wheels = trial.wheels
    if wheels is None or wheels.rate is not None or not np.isfinite(wheels.angle).all():
        return trial, []
    dt = float(np.median(np.diff(wheels.t)))
    n = max(round(0.1 / dt), 1)
    if len(wheels.t) < 4 * n:
        return trial, []
    span = wheels.t[n:] - wheels.t[:-n]
    speed = np.abs(wheels.angle[n:] - wheels.angle[:-n]) / span[:, None]
    angle, doubts = wheels.angle.copy(), []
    for i, wheel in enumerate(WHEELS):
        others = np.delete(speed, i, axis=1)
        middle = np.median(others, axis=1)
        free = (speed[:, i] > FREE[0] * middle) & (np.ptp(others, axis=1) < FREE[1] * middle)
        free &= middle > 0.1 * float(np.quantile(middle, 0.95))
        edges = np.diff(np.concatenate(([0], free.astype(np.int8), [0])))
        begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
        long = [(a, b) for a, b in zip(begins, ends, strict=True) if (b - a) * dt >= FREE[2]]
        for a, b in long:
            angle[a : b + n, i] = np.nan
        if long:
            ratio = float(np.median(speed[free, i] / middle[free]))
            doubts.append(
                f"column '{names.get(f'enc_{wheel}', wheel)}': the wheel turns {ratio:.2g} times as fast as "
                f"the others from t = {wheels.t[long[0][0]]:.2f} s on: off the ground? left out there"
            )
    if not doubts:
        return trial, []
    return dataclasses.replace(trial, wheels=dataclasses.replace(wheels, angle=angle)), doubts


def _currents(
    trial: Trial, currents: CurrentStream, robot: Robot, names: Mapping[str, str]
) -> tuple[CurrentStream, list[str]]:
    """Convert currents beyond what the motors can draw from mA; name one that flows against the others."""
    doubts: list[str] = []
    limit = robot.drive.voltage_max / robot.drive.resistance if robot.drive else 300.0
    values = currents.current
    shown = np.abs(values[np.isfinite(values)])
    if len(shown) and (high := float(np.quantile(shown, 0.95))) > 3 * limit:
        column = next((name for channel, name in names.items() if channel.startswith("cur_")), "currents")
        doubts.append(
            f"column '{column}' and its like: {high:.4g} A, more than the motors can draw ({limit:.3g} A): "
            'they are in mA; converted (say unit = "mA" in a column map)'
        )
        values = values / 1000
    live = [i for i in range(4) if np.isfinite(values[:, i]).sum() > 20]
    if trial.wheels is not None and len(live) > 2 and np.ptp(values[:, live], axis=0).all():
        known = np.isfinite(trial.wheels.angle).any(axis=1)
        if np.count_nonzero(known) < 20:
            return CurrentStream(currents.t, values), doubts
        mean = np.nanmean(trial.wheels.angle[known], axis=1)
        speed = np.interp(currents.t, trial.wheels.t[known], np.gradient(mean, trial.wheels.t[known]))
        going = np.abs(speed) > 0.3 * float(np.abs(speed).max())
        live = [i for i in live if np.isfinite(values[going, i]).any()]
        power = [float(np.nanmean(values[going, i] * np.sign(speed[going]))) for i in live]
        for k, i in enumerate(live if len(live) > 2 else []):
            others = power[:k] + power[k + 1 :]
            like = np.nan_to_num(values[:, [j for j in live if j != i]]).mean(axis=1)
            if (
                power[k] < 0
                and min(others) > 0
                and np.corrcoef(np.nan_to_num(values[:, i]), like)[0, 1] < -0.5
            ):
                doubts.append(
                    f"column '{names.get(f'cur_{WHEELS[i]}', WHEELS[i])}': the current flows against the "
                    "other motors': its sign is wrong; say scale = -1 in a column map"
                )
    return (currents if values is currents.current else CurrentStream(currents.t, values)), doubts
