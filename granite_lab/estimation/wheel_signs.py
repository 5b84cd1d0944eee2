"""Do the encoders count forwards, and is each the wheel it is said to be? Judged by the IMU."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.ndimage import uniform_filter1d

from granite_lab.errors import EstimateError
from granite_lab.estimation.differentiation import MOVING
from granite_lab.estimation.mounting import BodyImu
from granite_lab.logs.trial import Array, WheelStream
from granite_lab.parameters import WHEELS, Robot

STEP = 0.01
"""Spacing of the grid on which wheels and IMU are compared [s]."""

REACH = 40
"""Lags searched to either side, for the clocks may be that far apart [steps]."""

ALIKE = 0.9
"""Wheels whose velocities correlate this much, up to the sign, drive straight (or turn in place)."""

CLEAR = 0.4
"""Correlation with the IMU from which on a direction counts as seen."""

TURNING = 0.25
"""Gyro over yaw rate by the wheels from which on the robot really turns; skidding takes half of it."""


def check(
    wheels: WheelStream, imu: BodyImu | None, robot: Robot, *, forward_known: bool
) -> tuple[WheelStream, tuple[str, ...]]:
    """Turn wheels that count backwards, and exchange the sides where the gyro shows that they are.

    Wheels of opposite signs either turn the robot in place, which the yaw gyro sees, or some of them
    count backwards. Front and rear of a side cannot be told apart by the motion of the frame.

    Args:
        wheels: as logged.
        imu: in robot axes, or None.
        robot: wheel radius and track.
        forward_known: the IMU's forward axis is given, so the IMU also tells forwards from backwards.

    Returns:
        the stream with corrected signs and sides; what was corrected or is doubtful.

    Raises:
        EstimateError: the IMU's axes are not those of the robot.
    """
    grid, speed = _speeds(wheels, robot)
    live = np.flatnonzero(np.nan_to_num(np.abs(speed)).max(axis=0, initial=0.0) > MOVING)
    if live.size == 0 or grid.size < 4 * REACH:
        return wheels, ()
    said: list[str] = []
    yaw = _yaw_rate(imu, grid)
    sign = _relative_signs(speed, live)
    if (sign[live] < 0).any():
        if _sides_differ(sign, live):
            turning = _gain(yaw, _turn(speed, robot))
            if yaw is None:
                said.append("left and right wheels turn against each other, and no yaw gyro tells why")
                return wheels, tuple(said)
            if abs(turning) > TURNING:
                return wheels, ()
        sign = _choose_side(sign, live, speed, imu, grid, forward_known)
        names = [WHEELS[i] for i in live if sign[i] < 0]
        said.append(f"encoder {', '.join(names)} counts against the others: its sign was turned")
        speed = speed * sign
    if forward_known and imu is not None and _against(imu, grid, speed):
        sign = -sign
        speed = -speed
        said.append("the encoders count backwards, by the IMU: their signs were turned")
    order = list(range(4))
    if yaw is not None and float(np.std(yaw)) > 0.05:
        turn = _turn(speed, robot)
        if float(np.std(turn)) > 0.05 and _correlation(yaw, turn) < -0.7:
            order = [1, 0, 3, 2]
            said.append("the sides of the encoders are exchanged, by the gyro: put right")
    if not said:
        return wheels, ()

    def corrected(values: Array) -> Array:
        return (values * sign)[:, order]

    rate = None if wheels.rate is None else corrected(wheels.rate)
    return dataclasses.replace(wheels, angle=corrected(wheels.angle), rate=rate), tuple(said)


def _speeds(wheels: WheelStream, robot: Robot) -> tuple[Array, Array]:
    """Even stamps (K,) [s] and the wheels' velocities there (K, 4) [m/s], smoothed, NaN without encoder."""
    grid = np.arange(wheels.t[0], wheels.t[-1], STEP)
    speed = np.full((grid.size, 4), np.nan)
    if grid.size < 2:
        return grid, speed
    for i in range(4):
        known = np.isfinite(wheels.angle[:, i])
        if known.sum() > 2:
            angle = np.interp(grid, wheels.t[known], wheels.angle[known, i])
            speed[:, i] = uniform_filter1d(np.gradient(angle, STEP), 9) * robot.wheels.radius
    return grid, speed


def _yaw_rate(imu: BodyImu | None, grid: Array) -> Array | None:
    if imu is None or not np.isfinite(imu.yaw_rate).any():
        return None
    known = np.isfinite(imu.yaw_rate)
    return np.interp(grid, imu.t[known], imu.yaw_rate[known] - float(np.median(imu.yaw_rate[known])))


def _relative_signs(speed: Array, live: np.ndarray) -> Array:
    """(4,) signs against the first live wheel; all +1 where the wheels do not move alike."""
    sign = np.ones(4)
    first = np.nan_to_num(speed[:, live[0]])
    for i in live[1:]:
        likeness = _correlation(first, np.nan_to_num(speed[:, i]), centred=False)
        if abs(likeness) < ALIKE:
            return np.ones(4)
        sign[i] = np.sign(likeness)
    return sign


def _sides_differ(sign: Array, live: np.ndarray) -> bool:
    left, right = ({float(sign[i]) for i in live if i % 2 == side} for side in (0, 1))
    return len(left) == len(right) == 1 and left != right


def _turn(speed: Array, robot: Robot) -> Array:
    """(K,) yaw rate by the difference of the sides [rad/s], positive to the left."""
    left, right = (_mean(speed[:, side::2]) for side in (0, 1))
    return (right - left) / (robot.chassis.track if robot.chassis else 0.5)


def _mean(values: Array) -> Array:
    known = np.isfinite(values)
    return np.asarray(np.where(known, values, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1))


def _choose_side(
    sign: Array, live: np.ndarray, speed: Array, imu: BodyImu | None, grid: Array, forward_known: bool
) -> Array:
    """Say which of two groups of wheels is wrong: the smaller, else by the IMU, else the one going back."""
    ahead = int((sign[live] > 0).sum())
    if 2 * ahead != live.size:
        return sign if 2 * ahead > live.size else -sign
    common = _mean(speed * sign)
    if forward_known and imu is not None:
        gain, clearness = _forward_gain(imu, grid, common)
        if clearness > CLEAR:
            return sign if gain[0] > 0 else -sign
    return sign if float(common.sum()) >= 0 else -sign


def _against(imu: BodyImu, grid: Array, speed: Array) -> bool:
    """Say whether all encoders count backwards.

    Raises:
        EstimateError: the IMU's x axis does not point where the wheels accelerate the robot to.
    """
    gain, clearness = _forward_gain(imu, grid, _mean(speed))
    heading = np.degrees(np.arctan2(gain[1], gain[0]))
    if clearness < CLEAR or abs(heading) < 45 or not 0.3 < np.hypot(*gain) < 3.0:
        return False
    if abs(heading) > 135:
        if float(_mean(speed).sum()) < 0:
            return True
        raise EstimateError(
            "the IMU is accelerated backwards while the wheels gain speed: its x axis points backwards",
            "give its [imu] rotation in the robot's file, or let forward = 'find' look for it",
        )
    raise EstimateError(
        f"the IMU is accelerated {heading:.0f} deg beside its x axis when the wheels gain speed: "
        "its axes are not the robot's",
        "give its [imu] rotation in the robot's file, or let forward = 'find' look for it",
    )


def _forward_gain(imu: BodyImu, grid: Array, speed: Array) -> tuple[Array, float]:
    """Regress the horizontal specific force (2,) on the wheels' acceleration at the best lag.

    Returns:
        the gains of x and y; how clear the matter is (correlation, less that of the best lag elsewhere
        in the opposite direction).
    """
    wheel = _without_trend(np.gradient(speed, STEP))
    force = []
    for values in (imu.forward, imu.left):
        known = np.isfinite(values)
        level = np.interp(grid, imu.t[known], values[known]) if known.any() else np.zeros(grid.size)
        force.append(_without_trend(level))
    power = float(wheel @ wheel)
    if power * STEP < 0.01:
        return np.zeros(2), 0.0
    gains = np.array(
        [[float(np.roll(wheel, lag) @ f) / power for f in force] for lag in range(-REACH, REACH + 1)]
    )
    best = gains[int(np.argmax(np.hypot(*gains.T)))]
    along = best / max(float(np.hypot(*best)), 1e-12)
    common = along[0] * force[0] + along[1] * force[1]
    clear = float(np.hypot(*best)) * np.sqrt(power / max(float(common @ common), 1e-12))
    return best, float(clear)


def _without_trend(signal: Array) -> Array:
    """Smooth over 0.1 s, and leave out what is slower than a ramp (pitch on slopes)."""
    smooth = uniform_filter1d(signal, round(0.1 / STEP), mode="nearest")
    return np.asarray(smooth - uniform_filter1d(smooth, round(3.0 / STEP), mode="nearest"))


def _gain(signal: Array | None, on: Array) -> float:
    return 0.0 if signal is None else float(signal @ on) / max(float(on @ on), 1e-12)


def _correlation(a: Array, b: Array, *, centred: bool = True) -> float:
    if centred:
        a, b = a - a.mean(), b - b.mean()
    return float(a @ b) / max(float(np.sqrt((a @ a) * (b @ b))), 1e-12)
