"""Wherever the IMU sits, the estimate is that of the robot; roll, and turns told from wrong signs."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from granite_lab.errors import EstimateError
from granite_lab.estimation import Motion
from granite_lab.estimation.nominal import AT_REST, integrate, roll_angle
from granite_lab.logs.sensors.faults import find_faults
from granite_lab.logs.sensors.imu import mounted as orientation
from granite_lab.logs.sensors.mounting import BodyImu, level, to_body
from granite_lab.logs.sensors.signs import check_signs
from granite_lab.logs.trial import ImuStream, WheelStream
from tests.soak import SOAK
from tests.truth import faults
from tests.truth.motion import estimate
from tests.truth.trials import TruthTrial, generate, robot

DEG = st.floats(-180.0, 180.0)


@cache
def truth() -> TruthTrial:
    return generate(41, velocity=0.5, duration=3.0, still=(1.0, 1.0), grade="industrial", clock_offset=0.02)


@cache
def plain() -> Motion:
    return estimate(truth().trial, robot())


@given(roll=DEG, pitch=DEG, yaw=DEG)
@settings(max_examples=20 if SOAK else 3, derandomize=True)
def test_forward_axis_is_found_whatever_the_orientation(roll: float, pitch: float, yaw: float) -> None:
    turn = Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True).as_matrix()
    turned = faults.turned(truth().trial, turn.T)
    motion = estimate(turned, robot(forward="find"))
    error = motion.v - truth().at(motion.t, "v")
    moving = motion.v > 0.02
    # levelling at standstill leaves the pitch of the ground in the axes, a heading error its cosine
    assert np.sqrt(np.mean(error[moving] ** 2)) < 0.006
    assert np.mean(np.abs(error[moving]) < 3 * motion.v_std[moving]) > 0.9
    true = truth().slip_ratio_between(*motion.steady)
    assert abs(motion.slip_ratio.value - true) < 3 * motion.slip_ratio.std < 0.05


def test_forward_axis_cannot_be_found_without_gravity_or_acceleration() -> None:
    trial = truth().trial
    imu = trial.imu
    bare = replace(trial, imu=replace(imu, specific_force=imu.specific_force - [0.0, 0.0, 9.81]))
    with pytest.raises(EstimateError, match="cannot be levelled"):
        estimate(bare, robot(forward="find"))
    rng = np.random.default_rng(1)
    quiet = np.array([0.0, 0.0, 9.81]) + rng.normal(0, 0.02, imu.specific_force.shape)
    with pytest.raises(EstimateError, match="forward axis cannot be found") as refusal:
        estimate(replace(trial, imu=replace(imu, specific_force=quiet)), robot(forward="find"))
    assert "rotation" in refusal.value.hint


@given(st.integers(0, 10**6))
def test_levelling_is_the_smallest_turn_that_stands_gravity_upright(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start = Rotation.random(random_state=seed)
    up = rng.normal(size=3)
    up *= 9.81 / np.linalg.norm(up)
    imu = ImuStream(np.arange(20.0), np.tile(up, (20, 1)), np.zeros((20, 3)))
    levelled = level(imu, np.ones(20, dtype=bool), start)
    assert levelled.apply(up) == pytest.approx([0.0, 0.0, 9.81], abs=1e-9)
    before = start.apply(up) / 9.81
    angle = np.arccos(np.clip(before[2], -1, 1))
    assert (levelled * start.inv()).magnitude() == pytest.approx(angle, abs=1e-7)


@pytest.mark.parametrize("a", [[0, 0, 1.0], [0, 0, -1.0], [1.0, 0, 0], [0, -1.0, 0]])
def test_levelling_holds_for_opposite_axes_too(a: list[float]) -> None:
    imu = ImuStream(np.arange(20.0), np.tile(9.81 * np.array(a), (20, 1)), np.zeros((20, 3)))
    levelled = level(imu, np.ones(20, dtype=bool), Rotation.identity())
    assert levelled.apply(a) == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)


@pytest.mark.parametrize(("x", "z"), [(0.3, 0.0), (0.0, 0.25), (-0.2, 0.4)])
def test_lever_arm_is_taken_out(x: float, z: float) -> None:
    """Specific force at a place (x, z) of a body that pitches and drives, by its kinematics alone.

    Position of the sensor p = r + Rot (x, 0, z), with pitch positive nose down; its acceleration by
    differences of the position, gravity added in the sensor's axes: no formula of the estimator.
    """
    h = 1e-4
    t = np.arange(0.0, 4.0, h)
    on = np.clip((t - 1.0) / 2.0, 0.0, 1.0)
    bell = np.sin(np.pi * on) ** 4
    pitch = 0.06 * bell * np.sin(12.0 * t)
    v = 0.4 * bell
    way = np.cumsum(v) * h
    # nose down turns x towards -z
    px = way + x * np.cos(pitch) + z * np.sin(pitch)
    pz = -x * np.sin(pitch) + z * np.cos(pitch)
    ax, az = (np.gradient(np.gradient(p, h), h) for p in (px, pz))
    fx = ax * np.cos(pitch) - (az + 9.81) * np.sin(pitch)
    fz = ax * np.sin(pitch) + (az + 9.81) * np.cos(pitch)
    every = slice(None, None, 20)
    zero = np.zeros(t[every].size)
    force = np.stack([fx[every], zero, fz[every]], axis=1)
    rate = np.stack([zero, np.gradient(pitch, h)[every], zero], axis=1)
    stream = ImuStream(t[every], force, rate)
    one = robot(x=x, z=z, rotation=(0.0, 0.0, 0.0))
    imu = to_body(stream, orientation(one))
    none = np.zeros(stream.t.size)
    found = find_faults(stream, one.imu_grade, none > 0.0, none)
    nominal = integrate(imu, one, [(0.0, 0.9), (3.1, 4.0)], found, AT_REST)
    assert nominal.v == pytest.approx(v[every], abs=5e-4)
    assert nominal.x == pytest.approx(way[every], abs=5e-4)
    blind = integrate(imu, robot(x=0.0, z=0.0), [(0.0, 0.9), (3.1, 4.0)], found, AT_REST)
    assert np.abs(blind.v - v[every]).max() > 5e-3


ROBOT = robot()
T = np.arange(0.0, 14.0, 0.005)
REST = (T < 2.0) | (T > 12.0)


def leaning(roll: np.ndarray, *, bias: float = 0.0, rate_bias: float = 0.0) -> BodyImu:
    """Samples of a robot that goes straight and leans by `roll` [rad]."""
    force = np.stack([0.0 * T, 9.81 * np.sin(roll) + bias, 9.81 * np.cos(roll)], axis=1)
    rate = np.stack([np.gradient(roll, T) + rate_bias, 0.0 * T, 0.0 * T], axis=1)
    return to_body(ImuStream(T, force, rate), orientation(ROBOT))


def tilting(start: float, end: float) -> np.ndarray:
    """From one roll to another, by way of a third."""
    share = np.clip((T - 2.0) / 10.0, 0.0, 1.0)
    return start + (end - start) * share + 0.004 * np.sin(2 * np.pi * share)


@pytest.mark.parametrize("end", [0.01, -0.02])
def test_ground_that_leans_otherwise_at_the_end_does_not_shift_the_whole_motion(end: float) -> None:
    truth = tilting(0.01, end)
    found, std = roll_angle(leaning(truth), REST, ROBOT)
    assert np.abs(found - truth).max() < 0.3 * std
    assert np.ptp(found - truth) < 1e-4


def test_drift_of_the_gyro_between_standstills_is_taken_out() -> None:
    truth = tilting(0.01, 0.0)
    imu = leaning(truth)
    # a bias that is there only in motion shows at the end
    drifting = replace(imu, roll_rate=imu.roll_rate + np.where(REST, 0.0, 5e-4))
    found, _ = roll_angle(drifting, REST, ROBOT)
    assert np.ptp(found - truth) < 2e-4


def test_bias_of_the_accelerometer_stays_within_the_stated_std() -> None:
    truth = tilting(0.005, -0.01)
    found, std = roll_angle(leaning(truth, bias=ROBOT.imu_grade.accel_bias), REST, ROBOT)
    assert 0.5 * std < np.abs(found - truth).max() < 1.3 * std


def test_without_gravity_or_standstill_the_roll_is_not_known() -> None:
    imu = leaning(tilting(0.01, 0.01))
    for found, std in (
        roll_angle(replace(imu, gravity=0.0), REST, ROBOT),
        roll_angle(imu, np.zeros(T.size, dtype=bool), ROBOT),
    ):
        assert not found.any()
        assert std > np.radians(0.9)


def turning(left: float, right: float, yaw: float) -> tuple[WheelStream, BodyImu]:
    """Sides that turn at two velocities [m/s] for some seconds, and a gyro that sees a yaw rate [rad/s]."""
    t = np.arange(0.0, 8.0, 0.01)
    on = ((t > 2) & (t < 6)).astype(float)
    way = np.cumsum(on) * 0.01 / ROBOT.wheels.radius
    angle = np.stack([left * way, right * way, left * way, right * way], axis=1)
    rng = np.random.default_rng(0)
    force = rng.normal(0, 0.02, (t.size, 3)) + np.array([0.0, 0.0, 9.81])
    rate = rng.normal(0, 0.002, (t.size, 3)) + on[:, None] * [0, 0, yaw]
    return WheelStream(t, angle), to_body(ImuStream(t, force, rate), orientation(ROBOT))


def test_turn_in_place_is_not_taken_for_a_side_that_counts_backwards() -> None:
    turn = 0.6 * 0.4 / ROBOT.chassis.track  # skidding takes a part of it
    wheels, imu = turning(-0.2, 0.2, turn)
    same, said = check_signs(wheels, imu, ROBOT, forward_given=True)
    assert same is wheels
    assert said == ()
    wheels, imu = turning(-0.2, 0.2, 0.0)
    turned, said = check_signs(wheels, imu, ROBOT, forward_given=True)
    assert (turned.angle[-1] > 0).all()
    assert "fl, rl" in str(said[0])


def test_without_a_yaw_gyro_opposite_sides_stay_in_doubt() -> None:
    wheels, _ = turning(-0.2, 0.2, 0.0)
    same, said = check_signs(wheels, None, ROBOT, forward_given=False)
    assert same is wheels
    assert "no yaw gyro" in str(said[0])


def test_a_log_that_begins_amid_an_acceleration_does_not_turn_the_imu_round() -> None:
    t = np.arange(-1.0, 6.0, 0.01)
    speed = np.interp(t, [0.35, 0.95], [0.0, 2.0])  # of wheels whose stamps are 0.35 s late
    gained = np.interp(t, [0.6, 0.65, 0.7, 0.9], [3.3, 0.0, -2.0, 0.0])  # the body settles afterwards
    wheels = WheelStream(t, np.stack([np.cumsum(speed) * 0.01 / ROBOT.wheels.radius] * 4, axis=1))
    force = np.random.default_rng(0).normal(0, 0.2, (t.size, 3)) + np.array([0.0, 0.0, 9.81])
    force[:, 0] += np.where(t > 0, gained, 0.0)
    whole = to_body(ImuStream(t, force, np.zeros_like(force)), orientation(ROBOT))
    assert check_signs(wheels, whole, ROBOT, forward_given=True)[1] == ()
    cut = t > 0.6
    imu = to_body(ImuStream(t[cut], force[cut], np.zeros_like(force[cut])), orientation(ROBOT))
    part = WheelStream(t[cut], wheels.angle[cut])
    assert check_signs(part, imu, ROBOT, forward_given=True)[1] == ()


def test_exchanged_sides_are_put_right_when_the_robot_turns() -> None:
    wheels, imu = turning(0.2, 0.35, 0.7 * 0.15 / ROBOT.chassis.track)
    same, said = check_signs(wheels, imu, ROBOT, forward_given=True)
    assert same is wheels
    assert said == ()
    wheels, imu = turning(0.35, 0.2, 0.7 * 0.15 / ROBOT.chassis.track)
    right, said = check_signs(wheels, imu, ROBOT, forward_given=True)
    assert right.angle[:, 0] == pytest.approx(wheels.angle[:, 1])
    assert "exchanged" in str(said[0])
