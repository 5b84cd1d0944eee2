"""Sensors that lie: columns that cannot be what they are called, judged against the other sensors."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial.transform import Rotation

from granite_lab.errors import InputError
from granite_lab.logs.clocks import Mask, runs
from granite_lab.logs.encoders import quantum
from granite_lab.logs.layouts import ACCELERATION, CURRENTS, ENCODERS, RATE
from granite_lab.logs.stretches import rests
from granite_lab.logs.trial import Array, CurrentStream, ImuStream, Trial, WheelStream
from granite_lab.parameters import GRAVITY, Robot

OFF_AXIS = 45.0
"""Gravity at rest farther than this [deg] from the robot's z axis stands on another axis."""

MISSED, BETTER = 0.12, 4.0
"""A pitch rate leaves more velocity than this [m/s] at rest, and another one this many times less."""

FREE = (1.3, 0.05, 0.3)
"""A wheel that turns this many times as fast as the others, which agree to this share, for so long [s]."""

HANGS = 0.5
"""All axes of a sensor that repeat themselves for longer [s] hang."""

SPIKE = (1.0, 0.3)
"""A single reading nearer than this to its neighbours is no spike [m/s^2], [rad/s]."""

OUT = "to = [] in a column map (inspect --write-map) leaves it out"


def despike(stream: ImuStream) -> tuple[ImuStream, np.ndarray]:
    """Replace single readings far off both neighbours; a knock lasts longer than one or two samples.

    Returns:
        the stream, and (N,) True for the samples that were replaced in any axis. Where more than one
        sample in a hundred would go, the frame really shakes like that, and none is touched.
    """
    hit = np.zeros(stream.t.size, dtype=bool)
    clean: list[Array] = []
    for values, least in ((stream.specific_force, SPIKE[0]), (stream.angular_rate, SPIKE[1])):
        clean.append(values.copy())
        for axis in range(3):
            signal = values[:, axis]
            if stream.t.size < 50 or not np.isfinite(signal).all():
                continue
            middle = median_filter(signal, 5, mode="nearest")
            off = np.abs(signal - middle)
            spike = off > max(least, 5.0 * float(np.percentile(off, 90)))
            clean[-1][spike, axis] = middle[spike]
            hit |= spike
    if not hit.any() or hit.mean() > 0.01:
        return stream, np.zeros(stream.t.size, dtype=bool)
    return dataclasses.replace(stream, specific_force=clean[0], angular_rate=clean[1]), hit


@dataclass(frozen=True)
class _Log:
    """What every check needs: the robot, the file for messages, channel to column, where warnings go."""

    robot: Robot
    where: str
    names: Mapping[str, str]
    doubts: list[str]

    def column(self, channel: str) -> str:
        """Name the column of a channel."""
        return f"column '{self.names.get(channel, channel)}'"

    def refuse(self, channel: str, what: str, hint: str) -> InputError:
        """Return the error that names the column of a channel."""
        return InputError(f"{self.where}: {self.column(channel)}{what}", hint)

    @property
    def mounting(self) -> Array:
        """Matrix from the sensor's axes to the robot's."""
        roll, pitch, yaw = self.robot.imu.rotation
        return np.asarray(Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True).as_matrix())


def check_sensors(
    trial: Trial, robot: Robot, where: str, names: Mapping[str, str], doubts: list[str]
) -> Trial:
    """Refuse columns that cannot be what they are called; leave out what one wheel does off the ground.

    Args:
        trial: as read.
        robot: how its IMU is mounted, and what its motors can do.
        where: the file, for messages.
        names: channel to the name of its column.
        doubts: warnings are added here.

    Returns:
        the trial with currents in amperes, without the stretches of a wheel that turns freely.

    Raises:
        InputError: a column that would carry a wrong result, with what it looks like and what to write.
    """
    log, wheels = _Log(robot, where, names, doubts), trial.wheels
    imu = None if trial.imu is None else despike(trial.imu)[0]
    if wheels is not None:
        called = [name for channel, name in names.items() if channel.startswith("imu_")]
        if imu is None and called:
            empty = ", ".join(f"'{name}'" for name in called)
            raise InputError(f"{where}: columns {empty}: every cell is empty, expected an IMU's samples", OUT)
        _refuse_counts_and_speed(wheels, log)
        angle = wheels.angle[np.isfinite(wheels.angle)]
        if imu is not None and len(imu.t) > 100 and len(angle) and np.ptp(angle) > 1.0:
            _refuse_dead(imu, log)
            if (
                not imu.gravity_removed
                and robot.imu.forward != "find"
                and not np.isnan(imu.specific_force).any()
            ):
                still = rests(trial, robot)
                _refuse_gravity(imu, still, log)
                _refuse_pitch_rate(imu, still, log)
        wheels = _off_ground(wheels, log)
    currents = None if trial.currents is None else _currents(trial.currents, trial.wheels, log)
    return dataclasses.replace(trial, wheels=wheels, currents=currents)


def _refuse_counts_and_speed(wheels: WheelStream, log: _Log) -> None:
    """Refuse an angle [rad] in whole numbers, and wheels faster than the motors at their highest voltage."""
    drive, radius = log.robot.drive, log.robot.wheels.radius
    top = drive.voltage_max / (drive.emf_constant * drive.gear_ratio) if drive else np.inf
    for channel, logged in zip(ENCODERS, wheels.angle.T, strict=True):
        known = np.isfinite(logged)
        angle, t = logged[known], wheels.t[known]
        if len(angle) < 20:
            continue
        whole = wheels.rate is None and (angle == np.rint(angle)).all() and len(np.unique(angle)) > 20
        if whole and quantum(angle) >= 1:
            raise log.refuse(
                channel,
                f": only whole numbers up to {np.abs(angle).max():.0f}, expected an angle in rad: they look "
                "like counts",
                'unit = "counts" and counts_per_rev = … in a column map',
            )
        fast = float(np.quantile(np.abs(np.diff(angle) / np.diff(t)), 0.75))
        if fast > 1.5 * top:
            raise log.refuse(
                channel,
                f": the wheel turns with {fast:.3g} rad/s ({fast * radius:.2g} m/s), expected at most "
                f"{top:.3g} rad/s of {log.robot.name}'s motors",
                'counts need unit = "counts" and counts_per_rev = … in a column map; or name the robot',
            )


def _refuse_dead(imu: ImuStream, log: _Log) -> None:
    """Refuse an axis that never changes and that velocity or pitch need."""
    turn = np.abs(log.mounting) > 0.5
    for what, channels, values, other, rows in (
        ("accelerometer", ACCELERATION, imu.specific_force, imu.angular_rate, (0, 2)),
        ("gyroscope", RATE, imu.angular_rate, imu.specific_force, (1,)),
    ):
        same = runs((np.diff(values, axis=0) == 0).all(axis=1))
        first, last = max(same, key=lambda run: run[1] - run[0], default=(0, -1))
        begin, end = float(imu.t[first]), float(imu.t[last + 1])
        if end - begin > HANGS and 50 < last + 1 - first < 0.9 * len(imu.t):
            columns = " ".join(f"'{log.names.get(channel, channel)}'" for channel in channels)
            raise InputError(
                f"{log.where}: columns {columns}: every sample from t = {begin:.3f} s to {end:.3f} s is the "
                f"same, expected readings of the {what} that change: the sensor hangs",
                "cut the log there",
            )
        constant = np.array([np.isfinite(v).all() and np.ptp(v) == 0 for v in values.T])
        if constant[np.isfinite(values).any(axis=0)].all() and (
            np.isnan(other).all() or not np.ptp(other, axis=0).any()
        ):
            return  # nothing is connected: the rails' warning says so
        for j in np.flatnonzero(constant):
            if log.robot.imu.forward == "find" or any(turn[row, j] for row in rows):
                raise log.refuse(
                    channels[j],
                    f": every sample is {values[0, j]:.6g}, expected readings of the {what} that change: the "
                    "sensor hangs or is not connected",
                    OUT,
                )


def _refuse_gravity(imu: ImuStream, still: list[tuple[float, float]], log: _Log) -> None:
    """Refuse an accelerometer whose gravity at rest is not on the robot's z axis."""
    rest = _within(imu.t, still)
    mean = imu.specific_force[rest].mean(axis=0) if rest.any() else np.zeros(3)
    size = float(np.linalg.norm(mean))
    up = log.mounting @ mean / max(size, 1e-9)
    if 0.5 * GRAVITY < size < 1.5 * GRAVITY and up[2] < np.cos(np.radians(OFF_AXIS)):
        j, expected = int(np.argmax(np.abs(mean))), int(np.argmax(np.abs(log.mounting[2])))
        raise log.refuse(
            ACCELERATION[j],
            f" reads {mean[j]:+.2f} m/s^2 at rest: gravity is on it, expected on "
            f"'{log.names.get(ACCELERATION[expected], 'xyz'[expected])}' upwards",
            "exchange the axes in a column map (or scale = -1), or give [imu] rotation in the robot's file",
        )


def _within(t: Array, spans: list[tuple[float, float]]) -> Mask:
    """(N,) True where a stamp lies well inside one of the intervals."""
    mark = np.zeros(len(t), dtype=bool)
    for begin, end in spans:
        mark |= (t > begin + 0.1) & (t < end - 0.1)
    return mark


def _refuse_pitch_rate(imu: ImuStream, still: list[tuple[float, float]], log: _Log) -> None:
    """Refuse a pitch rate with which the velocity does not return to zero, where another one does that.

    Between two rests velocity is the integral of specific force less gravity's part by pitch, and pitch
    is the integral of the pitch rate; both are levelled and unbiased at the rests.
    """
    matrix = log.mounting
    force, rate = imu.specific_force @ matrix.T, np.nan_to_num(imu.angular_rate) @ matrix.T
    left: dict[str, list[float]] = {}

    def between(begin: float, end: float) -> slice:
        return slice(*np.searchsorted(imu.t, [begin, end]))

    for one, other in pairwise(still):
        first, last = (between(begin + 0.1, end - 0.1) for begin, end in (one, other))
        motion = between(one[1] - 0.1, other[0] + 0.1)
        few = min(part.stop - part.start for part in (first, last, motion)) < 10
        if few or other[0] - one[1] > 60:
            continue
        t = imu.t[motion]
        level = [np.arcsin(np.clip(force[rest, 0].mean() / -GRAVITY, -1, 1)) for rest in (first, last)]
        for j, axis in enumerate("xyz"):
            bias = (rate[first, j].mean() + rate[last, j].mean()) / 2
            w = rate[motion, j] - bias
            turned = np.concatenate(([0.0], np.cumsum(np.diff(t) * (w[1:] + w[:-1]) / 2)))
            for sign in (1.0, -1.0):
                # the end is levelled, too: what is left over is drift
                drift = level[1] - level[0] - sign * turned[-1]
                pitch = level[0] + sign * turned + (t - t[0]) / (t[-1] - t[0]) * drift
                speed = np.trapezoid(force[motion, 0] + GRAVITY * np.sin(pitch), t)
                left.setdefault(f"{'+' if sign > 0 else '-'}{axis}", []).append(abs(float(speed)))
    missed = {which: float(np.median(found)) for which, found in left.items()}
    best = min(missed, key=lambda which: missed[which], default="+y")
    if best != "+y" and missed["+y"] > max(MISSED, BETTER * missed[best]):
        forward = ACCELERATION[int(np.argmax(np.abs(matrix[0])))]
        sign_of = f"its sign or that of '{log.names.get(forward, forward)}' is wrong"
        what = sign_of if best == "-y" else f"the rate about {best[1]} fits: axes exchanged"
        raise log.refuse(
            RATE[int(np.argmax(np.abs(matrix[1])))],
            f": with it as pitch rate {missed['+y']:.2f} m/s are left at standstill, with {best} "
            f"{missed[best]:.2f} m/s: {what}",
            "scale = -1 in a column map turns a sign, 'to' exchanges axes; pitch rate is positive nose down",
        )


def _off_ground(wheels: WheelStream, log: _Log) -> WheelStream:
    """Leave a wheel out where it turns much faster than the other three, which agree."""
    dt = float(np.median(np.diff(wheels.t)))
    n = max(round(0.1 / dt), 1)
    if wheels.rate is not None or not np.isfinite(wheels.angle).all() or len(wheels.t) < 4 * n:
        return wheels
    span = wheels.t[n:] - wheels.t[:-n]
    speed = np.abs(wheels.angle[n:] - wheels.angle[:-n]) / span[:, None]
    angle = wheels.angle.copy()
    for i, channel in enumerate(ENCODERS):
        others = np.delete(speed, i, axis=1)
        middle = np.median(others, axis=1)
        free = (speed[:, i] > FREE[0] * middle) & (np.ptp(others, axis=1) < FREE[1] * middle)
        free &= middle > 0.1 * float(np.quantile(middle, 0.95))
        long = [(a, b) for a, b in runs(free) if (b + 1 - a) * dt >= FREE[2]]
        for a, b in long:
            angle[a : b + 1 + n, i] = np.nan
        if long:
            ratio = float(np.median(speed[free, i] / middle[free]))
            log.doubts.append(
                f"{log.column(channel)}: the wheel turns {ratio:.2g} times as fast as "
                f"the others from t = {wheels.t[long[0][0]]:.2f} s on: off the ground? left out there"
            )
    return dataclasses.replace(wheels, angle=angle)


def _currents(currents: CurrentStream, wheels: WheelStream | None, log: _Log) -> CurrentStream:
    """Convert currents beyond what the motors can draw from mA; name one that flows against the others."""
    drive = log.robot.drive
    limit = drive.voltage_max / drive.resistance if drive else 300.0
    shown = np.abs(currents.current[np.isfinite(currents.current)])
    if len(shown) and (high := float(np.quantile(shown, 0.95))) > 3 * limit:
        first = next((channel for channel in CURRENTS if channel in log.names), "currents")
        log.doubts.append(
            f"{log.column(first)} and its like: {high:.4g} A, more than the motors can draw ({limit:.3g} A): "
            'they are in mA; converted (say unit = "mA" in a column map)'
        )
        currents = CurrentStream(currents.t, currents.current / 1000)
    known = np.isfinite(wheels.angle).any(axis=1) if wheels is not None else np.zeros(0, dtype=bool)
    if wheels is None or np.count_nonzero(known) < 20:
        return currents
    mean = np.nanmean(wheels.angle[known], axis=1)
    speed = np.interp(currents.t, wheels.t[known], np.gradient(mean, wheels.t[known]))
    going = np.abs(speed) > 0.3 * float(np.abs(speed).max())
    values = currents.current
    live = [
        i for i in range(4) if np.isfinite(values[:, i]).sum() > 20 and np.isfinite(values[going, i]).any()
    ]
    if len(live) < 3 or not np.ptp(values[:, live], axis=0).all():
        return currents
    power = {i: float(np.nanmean(values[going, i] * np.sign(speed[going]))) for i in live}
    for i in live:
        others = [j for j in live if j != i]
        like = np.nan_to_num(values[:, others]).mean(axis=1)
        against = power[i] < 0 < min(power[j] for j in others)
        if against and np.corrcoef(np.nan_to_num(values[:, i]), like)[0, 1] < -0.5:
            log.doubts.append(
                f"{log.column(CURRENTS[i])}: the current flows against the other motors': its sign is wrong; "
                "say scale = -1 in a column map"
            )
    return currents
