"""Trials with their truth, for judging the estimation: a random motion under random sensors.

The motion is smooth, and exactly at rest at both ends. It is not the simulator's: slip is a random process
around the published slip ratios, with the slow oscillations of velocity and the squat that the paper saw in
its experiments but not in its model.
"""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline
from scipy.signal import bilinear, lfilter

from granite_lab.estimation.motion import Motion
from granite_lab.hidden.command import trapezoid
from granite_lab.hidden.contact import Array
from granite_lab.hidden.sensors import Logger, read_currents, read_imu, read_wheels, wander
from granite_lab.hidden.simulator import DT, Body
from granite_lab.logs.trial import Series, Trial, TrialInfo
from granite_lab.parameters import ImuGrade, Robot, load_robot
from tests.truth.simulator import Driven, Result, body_from_run, interpolated

SLIP_SPEED = np.array([0.0, 0.2, 0.3, 0.5, 0.7, 1.0])
SLIP_LEVEL = np.array([0.03, 0.0531, 0.0835, 0.165, 0.229, 0.3])
"""Measured slip ratio of the robot over desired velocity [m/s] (Table 3), extended at both ends."""

TERRAIN = 0.5
"""Std of the pitch over the ground [deg]."""


def smooth(signal: Array, width: float, *, delayed: bool = True) -> Array:
    """Return the signal averaged three times over `width` [s]: twice differentiable, of finite memory.

    As a filter in time it is delayed by 1.5 widths; otherwise each average is centred.
    """
    n = 2 * round(width / DT / 2) + 1
    box = np.ones(n) / n
    kernel = np.convolve(np.convolve(box, box), box)
    reach = kernel.size - 1
    ahead = 0 if delayed else reach // 2
    padded = np.concatenate([np.full(reach - ahead, signal[0]), signal, np.full(ahead, signal[-1])])
    return np.convolve(padded, kernel, mode="valid")


def field_over(rng: np.random.Generator, x: Array, length: float, std: float) -> Array:
    """Return a random function of the place, which is constant while the robot stands; zero at the start."""
    step = length / 8
    size = int((x.max() - x.min()) / step) + 12
    grid = x.min() + step * (np.arange(size) - 4)
    values = std * wander(rng, size, step, length)
    # a cubic keeps the second derivative, and so the angular acceleration, free of jumps
    found = CubicSpline(grid, values)(x)
    return np.asarray(found - found[0])


def oscillator(drive: Array, frequency: float, damping: float) -> Array:
    """Return the response of a unit-gain second-order system [Hz, -] to `drive`, starting at rest."""
    w = 2 * np.pi * frequency
    b, a = bilinear([w**2], [1.0, 2 * damping * w, w**2], fs=1 / DT)
    return np.asarray(lfilter(b, a, drive - drive[0]) + drive[0])


def body_velocity(rolling: Array, balance: Array, grip: float, slope: float, build_up: float) -> Array:
    """Return the velocity of a body that its wheels push through a saturating force of the slip.

    The force a unit of mass is grip (1 - exp(-slip/slope)), odd in the slip, against a resistance
    that it balances at the slip ratio `balance`. A standing body stays until the force exceeds it.

    Args:
        rolling: circumferential velocity of the wheels [m/s].
        balance: slip ratio of steady motion at each instant.
        grip: largest force a unit of mass [m/s^2].
        slope: slip ratio that gives 63 % of it.
        build_up: time constant with which the force builds up [s].
    """
    v = np.zeros_like(rolling)
    resistance = grip * -np.expm1(-balance / slope)
    now, force = 0.0, 0.0
    for k in range(1, rolling.size):
        slip = (rolling[k] - now) / max(rolling[k], now, 0.02)
        wanted = math.copysign(grip * -math.expm1(-abs(slip) / slope), slip)
        force += DT * (wanted - force) / (build_up + DT)
        now = max(0.0, now + DT * (force - resistance[k]))
        v[k] = now
    return v


def random_body(
    rng: np.random.Generator,
    *,
    velocity: float,
    acceleration: float,
    robot: Robot,
    duration: float = 8.0,
    still: tuple[float, float] = (2.0, 2.0),
    slip: float | None = None,
    wobble: float = 1.0,
) -> Driven:
    """Draw a motion.

    Args:
        rng: source of all randomness.
        velocity, acceleration: of the desired trapezoid [m/s], [m/s^2].
        robot: with its mass and drive.
        duration: from the command's start to its end [s].
        still: rest before the command and after it [s].
        slip: mean slip ratio; drawn around the published one when None.
        wobble: factor on the side motion: roll of 0.25-0.3 deg, yaw rate of 0.5 deg/s (std).
    """
    command = trapezoid(velocity, acceleration, velocity * (duration - velocity / acceleration))
    n = round((still[0] + duration + still[1]) / DT) + 1
    t = DT * np.arange(n)
    desired = np.array([command.velocity(ti - still[0]) for ti in t])
    rolling = smooth(desired, 0.015)  # the drive follows the command within some hundredths of a second
    moving = rolling / velocity

    level = float(np.interp(velocity, SLIP_SPEED, SLIP_LEVEL)) * (1 + 0.08 * rng.standard_normal())
    if slip is not None:
        level = slip
    ripple = rng.uniform(0.005, 0.02) * np.sin(
        2 * np.pi * rng.uniform(0.4, 1.4) * t + rng.uniform(0, 2 * np.pi)
    )
    ratio = level * (1 + 0.08 * wander(rng, n, DT, rng.uniform(0.5, 1.5))) + ripple * velocity / 0.7
    v = body_velocity(
        rolling,
        np.maximum(ratio, 0.005),
        grip=rng.uniform(3.0, 4.2),
        slope=rng.uniform(0.3, 0.45),
        build_up=rng.uniform(0.0, 0.01),
    )
    v = smooth(v, 0.009, delayed=False)
    a = np.gradient(v, DT)
    x = cumulative_trapezoid(v, dx=DT, initial=0)

    # squat by acceleration, and the change of sinkage between rest and driving
    squat = np.radians(-rng.uniform(0.1, 0.3)) * a + np.radians(rng.normal(-0.05, 0.1)) * moving
    squat = oscillator(squat, rng.uniform(3.0, 6.0), rng.uniform(0.3, 0.6))
    start_pitch, start_roll = np.radians(0.3) * rng.standard_normal(2) * (1.0, wobble)
    ground = field_over(rng, x, rng.uniform(0.15, 0.35), np.radians(TERRAIN))
    w = v * np.sin(squat)
    each = rng.normal(0, 0.002, 4)
    unlike = 1 + each + 0.004 * np.stack([wander(rng, n, DT, 0.4) for _ in range(4)], axis=1)
    mass, drive, per_newton = robot.chassis.total_mass, robot.drive, 0.0
    if drive is not None:
        torque = drive.gear_efficiency * drive.gear_ratio * drive.torque_constant
        per_newton = robot.wheels.radius / torque
    resistance = mass * 9.81 * (0.12 + 0.2 * level) * moving
    share = np.array([0.46, 0.46, 0.54, 0.54]) / 2
    steady = still[0] + command.measured[0], still[0] + command.measured[1]
    return Driven(
        t=np.asarray(t, dtype=np.float64),
        x=x,
        v=v,
        a=a,
        w=w,
        dw=np.gradient(w, DT),
        pitch=start_pitch + ground + squat,
        roll=start_roll + field_over(rng, x, 0.3, np.radians(0.5 * wobble * TERRAIN)),
        yaw_rate=np.radians(0.5) * wobble * wander(rng, n, DT, 0.7) * moving,
        v_wheel=rolling[:, None] * unlike,
        current=(mass * a + resistance)[:, None] * share * per_newton,
        start=still[0],
        stop=still[0] + duration,
        steady=steady,
    )


SCALE_ERROR = {"industrial": 0.0005, "consumer": 0.002}
"""Std of the scale error of each IMU axis; a residual after the maker's calibration."""

RIPPLE = 0.03
"""Relative std of the slow fluctuation of the currents while the wheels turn."""

ACCELERATION = {0.2: 0.6, 0.3: 1.2, 0.5: 1.2, 0.7: 2.4}
"""Acceleration [m/s^2] over velocity [m/s] (Table 2)."""


def robot(**imu: object) -> Robot:
    """Return the sample robot with the industrial IMU, which may be mounted otherwise."""
    one = load_robot("granite", "industrial")
    return dataclasses.replace(one, imu=dataclasses.replace(one.imu, **imu))


def quiet(robot: Robot) -> Robot:
    """Return a robot whose IMU makes no error, wherever it sits."""
    kinds = ("noise", "bias", "instability", "step")
    still = {f.name: 0.0 for f in dataclasses.fields(ImuGrade) if f.name.endswith(kinds)}
    grade = dataclasses.replace(robot.imu_grade, **still)
    imu = dataclasses.replace(robot.imu, tilt=0.0, vibration=0.0, vibration_rate=0.0)
    return dataclasses.replace(robot, imu_grade=grade, imu=imu)


@dataclass(frozen=True, eq=False)
class TruthTrial:
    """A trial with what really happened; instants are those of the IMU's clock.

    Attributes:
        trial: what was logged.
        body: true motion, whose attributes are the trial's too.
        clock_offset: the encoders' stamps lie this far *behind* the IMU's [s]: an instant that
            the IMU calls t carries the encoder stamp t - clock_offset.
        accel_bias, gyro_bias: (3,) turn-on biases in sensor axes.
        mounting: (3, 3) rotation from robot to sensor axes, tilt included.
    """

    trial: Trial
    body: Body
    clock_offset: float
    accel_bias: Array
    gyro_bias: Array
    mounting: Array

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "body":  # while it is being copied
            raise AttributeError(name)
        return getattr(self.body, name)

    def at(self, t: Array | float, name: str) -> Array:
        """Return `x`, `v`, `pitch` or `v_wheel` at instants of the IMU's clock."""
        return interpolated(t, self.t, getattr(self, name))

    def errors(self, motion: Motion) -> tuple[Array, Array]:
        """Return error and std of an estimate's v while the robot moves."""
        moving = (motion.t > self.start) & (motion.t < self.stop + 0.5)
        return (motion.v - self.at(motion.t, "v"))[moving], motion.v_std[moving]

    @property
    def slip_ratio(self) -> float:
        """λ_R by (2) over `steady`."""
        return self.slip_ratio_between(*self.steady)

    def slip_ratio_between(self, start: float, stop: float) -> float:
        """Return λ_R by (2) between two instants."""
        inside = (self.t >= start) & (self.t <= stop)
        rolled = np.trapezoid(self.v_wheel[inside].mean(axis=1), self.t[inside])
        return float(1.0 - np.trapezoid(self.v[inside], self.t[inside]) / rolled)

    def without_gravity(self, attitude_error: float = 0.0) -> Trial:
        """Return the trial of a logger that takes gravity out, its attitude off by a slow wave [rad]."""
        imu = self.trial.imu
        pitch = self.at(imu.t, "pitch") + attitude_error * np.sin(0.8 * imu.t + 1.0)
        gravity = 9.81 * np.stack([-np.sin(pitch), np.zeros(pitch.size), np.cos(pitch)], axis=1)
        force = imu.specific_force - gravity @ self.mounting.T
        imu = dataclasses.replace(imu, specific_force=force, gravity_removed=True)
        return dataclasses.replace(self.trial, imu=imu)


def observe(
    rng: np.random.Generator,
    body: Body,
    robot: Robot,
    *,
    name: str,
    info: TrialInfo,
    logger: Logger,
    clock_offset: float = 0.0,
    reference: bool = False,
) -> TruthTrial:
    """Log a motion with the sensors of a robot.

    Args:
        rng: source of all sensor errors.
        body: what really happened.
        robot: with an IMU grade.
        name, info: of the trial.
        logger: errors that no record of a robot states.
        clock_offset: by which the encoders' stamps lie behind the IMU's [s].
        reference: log the true position and velocity as an external reference.
    """
    imu, accel_bias, gyro_bias, mounting = read_imu(rng, body, robot, logger)
    trial = Trial(
        name=name,
        info=info,
        imu=imu,
        wheels=read_wheels(rng, body, robot, clock_offset),
        currents=read_currents(rng, body, robot, clock_offset, logger),
        reference_x=Series(body.t[::10], body.x[::10]) if reference else None,
        reference_v=Series(body.t[::10], body.v[::10]) if reference else None,
    )
    return TruthTrial(trial, body, clock_offset, accel_bias, gyro_bias, mounting)


def generate(
    seed: int,
    *,
    velocity: float = 0.3,
    grade: str = "industrial",
    robot: Robot | None = None,
    clock_offset: float = 0.0,
    logger: Logger | None = None,
    reference: bool = False,
    **motion: Any,
) -> TruthTrial:
    """Draw a trial. The motion depends on the seed and the motion's arguments alone, not on the sensors.

    Args:
        seed: of everything random.
        velocity: of the command [m/s]; its acceleration is that of Table 2.
        grade: of the IMU.
        robot: the sample robot with an IMU of the grade by default.
        clock_offset: by which the encoders' stamps lie behind the IMU's [s].
        logger: errors that no record of a robot states; by default with the scale error of the grade.
        reference: log the truth as an external reference too.
        motion: duration, still, slip and wobble as for `random_body`.
    """
    rig = robot or load_robot("granite", grade)
    acceleration = float(np.interp(velocity, list(ACCELERATION), list(ACCELERATION.values())))
    motion_seed, sensor_seed = np.random.SeedSequence(seed).spawn(2)
    body = random_body(
        np.random.default_rng(motion_seed), velocity=velocity, acceleration=acceleration,
        robot=rig, **motion,
    )  # fmt: skip
    info = TrialInfo(
        robot=rig.name, v_desired=velocity, a_max=acceleration,
        distance=velocity * (body.stop - body.start - velocity / acceleration), virtual=True,
    )  # fmt: skip
    return observe(
        np.random.default_rng(sensor_seed), body, rig, name=f"truth-{velocity:g}-{grade}-{seed}", info=info,
        clock_offset=clock_offset, reference=reference,
        logger=logger or Logger(gain=SCALE_ERROR.get(grade, 0.001), ripple=RIPPLE),
    )  # fmt: skip


def log_run(seed: int, run: Result, *, clock_offset: float = 0.0) -> TruthTrial:
    """Log a run of the reference simulator with the random sensors of the sample robot.

    Args:
        seed: of the sensors.
        run: with as much rest at both ends as the log should have (`settle`, `after`); it coasts for
            about two seconds after the command.
        clock_offset: as for `generate`.
    """
    cruising = run.t[run.v_d > run.v_d.max() - 1e-9]
    body = body_from_run(run, steady=(0.5 * float(cruising[0] + cruising[-1]), float(cruising[-1])))
    v = float(run.v_d.max())
    return observe(
        np.random.default_rng(seed), body, robot(), name=f"run-{v:g}-{seed}",
        info=TrialInfo(robot="granite", v_desired=v, distance=float(run.s_d[-1]), virtual=True),
        clock_offset=clock_offset, logger=Logger(gain=SCALE_ERROR["industrial"], ripple=RIPPLE),
    )  # fmt: skip
