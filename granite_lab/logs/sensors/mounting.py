"""From the sensor's axes to the robot's: orientation, levelling, the forward axis."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate
from granite_lab.logs.counters import interpolated
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.sensors.ramps import STEP, gain_of
from granite_lab.logs.sensors.standstill import step_of
from granite_lab.logs.trial import Array, ImuStream
from granite_lab.parameters import GRAVITY, Robot

BEYOND = 3.0
"""What gravity shows beyond this many std of the IMU's grade is an error of mounting or scale."""

LEAST_POWER = 0.01
"""Wheels whose squared acceleration adds up to less than this tell no direction [m^2/s^3]."""

RIVAL = 0.5
"""A peak of a correlation that is not twice as high as the next one is not told from it (as in PIV)."""

TURN = np.radians(15.0)
"""Turns by less than this correct a straight course [rad]: its way is 1 % longer than the chord at most."""

LOCAL = 0.0026
"""Half the range of gravity on Earth about 9.81 m/s^2, as a share (9.780 to 9.832 m/s^2, WGS 84)."""


@dataclass(frozen=True, eq=False)
class BodyImu:
    """The IMU's samples (N,) in the axes of R (x forward, y left, z up), at the sensor's place."""

    t: Array  # [s]
    forward: Array  # specific force along x [m/s^2]; NaN where it was not logged, as the others
    left: Array  # along y
    up: Array  # along z
    roll_rate: Array  # [rad/s]
    pitch_rate: Array
    yaw_rate: Array
    gravity: float  # that the forward axis sees per radian of pitch [m/s^2]; 0: the logger removed it
    levelled: bool  # the axes were levelled at standstill, so pitch counts from there
    rotation: Rotation  # takes vectors in the sensor's axes to those of R

    @cached_property
    def period(self) -> float:
        """Median time between two samples [s]."""
        return float(np.median(np.diff(self.t)))

    @cached_property
    def has_pitch_rate(self) -> bool:
        """Whether a pitch gyro was logged."""
        return bool(np.isfinite(self.pitch_rate).any())

    @cached_property
    def steps(self) -> tuple[float, float]:
        """Smallest steps of `forward` [m/s^2] and `pitch_rate` [rad/s], found in the sensor's axes; 0: none.

        Of axes that turn into these the steps add as errors of rounding do.
        """
        matrix, steps = self.rotation.as_matrix(), []
        triples = (self.forward, self.left, self.up), (self.roll_rate, self.pitch_rate, self.yaw_rate)
        for axis, triple in zip((0, 1), triples, strict=True):
            body = np.stack(triple, axis=1)
            whole = bool(np.isfinite(body).all())
            step = matrix[axis] * step_of(body @ matrix) if whole else step_of(triple[axis][:, None])
            steps.append(float(np.linalg.norm(step)))
        return steps[0], steps[1]


def to_body(imu: ImuStream, rotation: Rotation, *, levelled: bool = False) -> BodyImu:
    """Turn the samples into robot axes; a column that was not logged stays NaN where it matters.

    Samples that are in robot axes already (`ImuStream.robot_axes`) stay as they are.
    """
    if imu.robot_axes and not levelled:
        rotation = Rotation.identity()
    force, rate = _turn(rotation, imu.specific_force), _turn(rotation, imu.angular_rate)
    return BodyImu(
        t=imu.t, forward=force[:, 0], left=force[:, 1], up=force[:, 2], roll_rate=rate[:, 0],
        pitch_rate=rate[:, 1], yaw_rate=rate[:, 2], gravity=0.0 if imu.gravity_removed else GRAVITY,
        levelled=levelled, rotation=rotation,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Levelled:
    """An IMU after its specific force at standstill was compared with gravity.

    Attributes:
        stream, imu: the samples in the sensor's and in the robot's axes, scaled and levelled.
        robot: with the std of the accelerometer's scale that is left.
        doubts: what was put right, and how much that leaves open.
    """

    stream: ImuStream
    imu: BodyImu
    robot: Robot
    doubts: tuple[Doubt, ...] = ()


def by_gravity(stream: ImuStream, imu: BodyImu, still: np.ndarray, robot: Robot) -> Levelled:
    """Put right what gravity at standstill shows of the IMU's mounting and scale beyond its grade.

    An error within the grade stays: it is a bias, which the filter estimates. A larger magnitude of the
    specific force is a scale error, known within the bias of the vertical axis. That bias is as large as the
    grade says or the horizontal axes show; where a tilt hides theirs, it may be the whole difference. The
    scale error is common to all axes, as by a wrong g or range, or that of the vertical axis alone, whose
    sensitivity was trimmed by itself; each is as likely. A larger tilt is one of the mounting, as on level
    ground; the std of the scale covers a slope of the ground, along which distances are longer by
    1 / cos(tilt). A tilt that changes distances by less than `LOCAL` stays.

    `stream` is in the sensor's axes, `imu` in the robot's; `still` (N,) is True at standstill.
    """
    grade, mean = robot.imu_grade, stream.specific_force[still].mean(axis=0) if still.any() else np.zeros(3)
    size = float(np.linalg.norm(mean))
    if stream.gravity_removed or not 0.8 * GRAVITY < size < 1.2 * GRAVITY:  # an axis is missing, too
        return Levelled(stream, imu, robot)
    doubts, bias = list[Doubt](), grade.accel_bias / GRAVITY
    up = imu.rotation.apply(mean / size)
    tilt = float(np.arccos(np.clip(up[2], -1.0, 1.0)))
    usual = float(np.hypot(bias, np.radians(robot.imu.tilt)))
    tilted = not imu.levelled and tilt > BEYOND * usual and 1.0 - float(np.cos(tilt)) > LOCAL
    excess, scale = size / GRAVITY - 1.0, Estimate(0.0, grade.accel_scale)
    if abs(excess) > BEYOND * float(np.linalg.norm([bias, grade.accel_scale, LOCAL])):
        vertical = abs(excess) if tilted else max(bias, float(np.linalg.norm(up[:2])) / 2.0**0.5)
        # prior std of the scale: the excess itself; measured by gravity within the bias (Gaussian posterior)
        share = excess**2 / (excess**2 + vertical**2 + LOCAL**2)
        left = abs(excess) * float(np.sqrt(1.0 - share))
        alone = np.sqrt(0.5) * share * excess
        scale = Estimate(share * excess, float(np.linalg.norm([left, alone, grade.accel_scale])))
        factor = 1.0 + scale.value
        stream = replace(stream, specific_force=stream.specific_force / factor, scaled=factor)
        seen = f"the specific force at standstill is {size:.2f} m/s^2, not {GRAVITY:g}"
        taken = f"taken for a scale error of {100.0 * scale.value:.1f} ± {100.0 * scale.std:.1f} %"
        doubts.append(Doubt(seen, remedy=taken, grade="fair"))
    rotation, levelled = imu.rotation, imu.levelled
    if tilted:
        rotation, levelled = level(stream, still, rotation), True
        scale = replace(scale, std=float(np.hypot(scale.std, 1.0 - np.cos(tilt))))
        seen = f"the IMU is {np.degrees(tilt):.1f} deg off level at standstill"
        doubts.append(Doubt(seen, remedy="levelled, as on level ground", grade="fair"))
    if not doubts:
        return Levelled(stream, imu, robot)
    imu = to_body(stream, rotation, levelled=levelled)
    robot = replace(robot, imu_grade=replace(grade, accel_scale=scale.std))
    return Levelled(stream, imu, robot, tuple(doubts))


def by_ramps(found: Levelled, wheel_t: Array, wheel_speed: Array) -> Levelled:
    """Turn the axes about z by the angle that the wheels' ramps show, where it changes distances.

    Where the wheels gain speed (M,) [m/s], a robot that drives straight is pushed along its x axis. The
    forward axis of an IMU that is turned by an angle reads the cosine of it, and the left axis its sine. What
    a yaw gyro shows of centripetal acceleration is taken out of the latter. A robot that turns may drift, and
    without a yaw gyro a bend would look like a turned sensor: nothing is judged then. As of a tilt
    (`by_gravity`), an angle that changes distances by less than `LOCAL` stays, and the std of the scale
    covers that the angle is one of the left axis alone.
    """
    stream, imu, robot = found.stream, found.imu, found.robot
    seen = np.isfinite(np.stack([imu.forward, imu.left, imu.yaw_rate])).all(axis=0)
    speed, grade = np.nan_to_num(wheel_speed), robot.imu_grade
    if stream.robot_axes or not seen.all() or wheel_t.size < 2 or imu.t.size < 2:
        return found
    grid = np.arange(imu.t[0], imu.t[-1], STEP)
    pace = interpolated(grid, wheel_t, speed)
    forward, left, yaw = (interpolated(grid, imu.t, x) for x in (imu.forward, imu.left, imu.yaw_rate))
    turning = yaw - np.median(yaw)
    if np.ptp(np.cumsum(turning)) * STEP > TURN:
        return found
    gain = gain_of([forward, left - pace * turning], pace)
    heading = float(np.arctan2(gain.vector[1], gain.vector[0]))
    lost = 1.0 - float(np.cos(heading))
    clear = gain.power * STEP >= LEAST_POWER and gain.opposite <= RIVAL
    if not clear or lost <= LOCAL or abs(heading) <= BEYOND * gain.std:
        return found
    turned = to_body(stream, Rotation.from_euler("z", -heading) * imu.rotation, levelled=imu.levelled)
    std = float(np.hypot(grade.accel_scale, lost))
    by = f"{np.degrees(heading):.0f} ± {np.degrees(gain.std):.1f} deg"
    what = f"the IMU is turned by {by} about the vertical, by the wheels' ramps"
    doubt = Doubt(what, remedy="its axes were turned back", grade="fair")
    robot = replace(robot, imu_grade=replace(grade, accel_scale=std))
    return Levelled(stream, turned, robot, (*found.doubts, doubt))


def _turn(rotation: Rotation, vectors: Array) -> Array:
    """Apply a rotation; an axis of R that needs an absent column becomes NaN, the others stay."""
    absent = ~np.isfinite(vectors).any(axis=0)
    matrix = rotation.as_matrix()
    turned = np.where(absent, 0.0, vectors) @ matrix.T
    turned[:, (np.abs(matrix[:, absent]) > 0.05).any(axis=1)] = np.nan
    return np.asarray(turned)


def level(imu: ImuStream, still: np.ndarray, rotation: Rotation) -> Rotation:
    """Add the smallest turn that puts gravity on R's z axis at standstill; refuse without gravity."""
    up = imu.specific_force[still].mean(axis=0)
    size = float(np.linalg.norm(up))
    if not 0.8 * GRAVITY < size < 1.2 * GRAVITY:
        raise EstimateError(
            f"the IMU's specific force at standstill is {size:.2f} m/s^2, so it cannot be levelled",
            "levelling needs all three accelerometer axes with gravity in them; give [imu] rotation instead",
        )
    return Rotation.align_vectors([[0.0, 0.0, 1.0]], [rotation.apply(up / size)])[0] * rotation


def find_forward(imu: ImuStream, levelled: Rotation, wheel_t: Array, wheel_speed: Array) -> Rotation:
    """Turn levelled axes about z until x points where the wheels accelerate the robot to.

    The horizontal specific force is regressed on the acceleration of the wheels, whose speed is (M,) [m/s];
    the direction of the regression vector is forward.

    Raises:
        EstimateError: nothing accelerates, or the direction is not clear.
    """
    grid = np.arange(imu.t[0], imu.t[-1], STEP)
    flat = levelled.apply(imu.specific_force)[:, :2].T
    gain = gain_of([np.interp(grid, imu.t, axis) for axis in flat], interpolated(grid, wheel_t, wheel_speed))
    if np.hypot(*gain.vector) < 0.2 or gain.std > np.radians(15):
        raise EstimateError(
            "the IMU's forward axis cannot be found: no clear acceleration phase in common with the wheels",
            "give it in the robot's file: [imu] rotation = [roll, pitch, yaw], forward = 'given'",
        )
    return Rotation.from_euler("z", -np.arctan2(gain.vector[1], gain.vector[0])) * levelled
