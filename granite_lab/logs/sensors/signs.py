"""Signs and sides of the wheel encoders, and the direction of the IMU's x axis."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from granite_lab.errors import EstimateError
from granite_lab.logs.counters import interpolated, mean_known
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.sensors.mounting import LEAST_POWER, RIVAL, BodyImu
from granite_lab.logs.sensors.ramps import LARGEST, SMOOTH, STEP, gain_of
from granite_lab.logs.sensors.standstill import MOVING
from granite_lab.logs.trial import Array, WheelStream
from granite_lab.parameters import WHEELS, Robot

ALIKE = 0.9
"""Wheels whose velocities correlate this much, up to the sign, drive straight (or turn in place)."""

CLEAR = 0.4
"""Correlation with the IMU from which on a direction counts as seen."""

TELLING = 0.7
"""Correlation of the gyro with the yaw rate by the wheels from which on it tells sides: half in common."""

TURNING = 0.25
"""Gyro over yaw rate by the wheels from which on the robot really turns; skidding takes half of it."""

AXES = "write its [imu] rotation into the robot's file, or forward = 'find' there to have it searched"
"""What to do about an IMU whose axes are not the robot's."""

EXCHANGED = (
    "put right; if the names of the wheels are right, imu_gz has the wrong sign: scale = -1 in a column map"
)
"""What to do about encoders that turn the robot the other way than the gyro does: either may be wrong."""


def check_signs(
    wheels: WheelStream, imu: BodyImu | None, robot: Robot, *, forward_given: bool
) -> tuple[WheelStream, tuple[Doubt, ...]]:
    """Turn wheels that count backwards, and exchange the sides where the gyro shows that they are.

    Wheels of opposite signs either turn the robot in place, which the yaw gyro sees, or some of them
    count backwards. Front and rear of a side cannot be told apart by the motion of the frame. If the IMU's
    forward axis is known, it also tells forwards from backwards.

    Returns:
        the stream with corrected signs and sides; what was corrected or is doubtful.

    Raises:
        EstimateError: the IMU's axes are not those of the robot.
    """
    grid, speed = _speeds(wheels, robot)
    live = np.flatnonzero(np.nan_to_num(np.abs(speed)).max(axis=0, initial=0.0) > MOVING)
    if live.size == 0 or grid.size < 4 * LARGEST / STEP:
        return wheels, ()
    judge = imu if forward_given else None
    doubts: list[Doubt] = []
    yaw = None
    if imu is not None and np.isfinite(imu.yaw_rate).any():
        yaw = interpolated(grid, imu.t, imu.yaw_rate - float(np.nanmedian(imu.yaw_rate)))
    sign = _relative_signs(speed, live)
    if (sign[live] < 0).any():
        left, right = ({float(sign[i]) for i in live if i % 2 == side} for side in (0, 1))
        if len(left) == len(right) == 1 and left != right:
            if yaw is None:
                why = "left and right wheels turn against each other, and no yaw gyro tells why"
                return wheels, (Doubt(why),)
            turn = _turn(speed, robot)
            if abs(float(yaw @ turn) / max(float(turn @ turn), 1e-12)) > TURNING:
                return wheels, ()
        sign = _choose_side(sign, live, speed, judge, grid)
    elif yaw is not None:
        sign = _by_turning(speed, yaw, robot)
    if names := [WHEELS[i] for i in live if sign[i] < 0]:
        against = f"encoder {', '.join(names)} counts against the others"
        doubts.append(Doubt(against, remedy="its sign was turned"))
        speed = speed * sign
    if judge is not None and _against(judge, grid, speed):
        sign, speed = -sign, -speed
        doubts.append(Doubt("the encoders count backwards, by the IMU", remedy="their signs were turned"))
    order = list(range(4))
    if yaw is not None and float(np.std(yaw)) > 0.05:
        turn = _turn(speed, robot)
        if float(np.std(turn)) > 0.05 and _correlation(yaw - yaw.mean(), turn - turn.mean()) < -TELLING:
            order = [1, 0, 3, 2]
            doubts.append(Doubt("the sides of the encoders are exchanged, by the gyro", remedy=EXCHANGED))
    if not doubts:
        return wheels, ()
    resolution = tuple(wheels.resolution[i] for i in order)
    turned = wheels.changed(lambda values: (values * sign)[:, order], resolution=resolution)
    return turned, tuple(doubts)


def _speeds(wheels: WheelStream, robot: Robot) -> tuple[Array, Array]:
    """Even stamps (K,) [s] and the wheels' velocities there (K, 4) [m/s], smoothed, NaN without encoder."""
    grid = np.arange(wheels.t[0], wheels.t[-1], STEP)
    speed = np.full((grid.size, 4), np.nan)
    for i, angle in enumerate(wheels.angle.T):
        if grid.size > 1 and np.isfinite(angle).sum() > 2:
            rate = np.gradient(interpolated(grid, wheels.t, angle), STEP)
            speed[:, i] = uniform_filter1d(rate, round(SMOOTH / STEP)) * robot.wheels.radius
    return grid, speed


def _relative_signs(speed: Array, live: np.ndarray) -> Array:
    """(4,) signs against the first live wheel; all +1 where the wheels do not move alike."""
    sign, moves = np.ones(4), np.nan_to_num(speed[:, live].T)
    alike = np.array([_correlation(moves[0], wheel) for wheel in moves])
    if np.abs(alike).min() >= ALIKE:
        sign[live] = np.sign(alike)
    return sign


def _by_turning(speed: Array, yaw: Array, robot: Robot) -> Array:
    """(4,) signs by a yaw gyro, of wheels that drive straight and turn in place by turns.

    Where a side counts backwards, the wheels seem to turn while the robot drives straight, and to drive
    straight while it turns.
    """
    left_turned = np.array([-1.0, 1.0, -1.0, 1.0])
    rate = yaw - yaw.mean()
    given, other = (
        turn - turn.mean() for turn in (_turn(speed * s, robot) for s in (np.ones(4), left_turned))
    )
    seen, as_given = _correlation(rate, other), _correlation(rate, given)
    turns = abs(float(rate @ other)) > TURNING * float(other @ other)
    if not turns or abs(seen) < TELLING or 1.0 - seen**2 > RIVAL * (1.0 - as_given**2):
        return np.ones(4)
    return left_turned if seen > 0 else -left_turned


def _turn(speed: Array, robot: Robot) -> Array:
    """(K,) yaw rate by the difference of the sides [rad/s], positive to the left."""
    left, right = (np.nan_to_num(mean_known(speed[:, side::2])) for side in (0, 1))
    return np.asarray((right - left) / (robot.chassis.track if robot.chassis else 0.5))


def _choose_side(sign: Array, live: np.ndarray, speed: Array, imu: BodyImu | None, grid: Array) -> Array:
    """Say which of two groups of wheels is wrong: the smaller, else by the IMU, else the one going back."""
    ahead = int((sign[live] > 0).sum())
    if 2 * ahead != live.size:
        return sign if 2 * ahead > live.size else -sign
    common = np.nan_to_num(mean_known(speed * sign))
    if imu is not None:
        gain, clearness = _forward_gain(imu, grid, common)
        if clearness > CLEAR:
            return sign if gain[0] > 0 else -sign
    return sign if float(common.sum()) >= 0 else -sign


def _against(imu: BodyImu, grid: Array, speed: Array) -> bool:
    """Say whether all encoders count backwards; refuse an IMU whose x axis is not the robot's."""
    common = np.nan_to_num(mean_known(speed))
    gain, clearness = _forward_gain(imu, grid, common)
    heading = np.degrees(np.arctan2(gain[1], gain[0]))
    if clearness < CLEAR or abs(heading) < 45 or not 0.3 < np.hypot(*gain) < 3.0:
        return False
    if abs(heading) <= 135:
        raise EstimateError(
            f"when the wheels gain speed, the IMU's acceleration points {heading:.0f} deg away from its x "
            "axis: its axes are not the robot's",
            AXES,
        )
    if float(common.sum()) < 0:
        return True
    raise EstimateError(
        "when the wheels gain speed, the IMU's acceleration points backwards: its x axis points backwards",
        AXES,
    )


def _forward_gain(imu: BodyImu, grid: Array, speed: Array) -> tuple[Array, float]:
    """Regress the horizontal specific force (2,) on the wheels' acceleration at the best lag.

    Also how clear the matter is: the share of the force that it explains, and nothing where the opposite
    direction explains more than `RIVAL` of that at another lag, as where a log begins amid an acceleration.
    """
    axes = (v if np.isfinite(v).any() else np.zeros(v.size) for v in (imu.forward, imu.left))
    gain = gain_of([interpolated(grid, imu.t, values) for values in axes], speed)
    seen = gain.power * STEP >= LEAST_POWER and gain.opposite <= RIVAL
    return gain.vector, gain.explained if seen else 0.0


def _correlation(a: Array, b: Array) -> float:
    return float(a @ b) / max(float(np.sqrt((a @ a) * (b @ b))), 1e-12)
