"""The IMU may sit anywhere and in any orientation; the estimate is that of the robot all the same."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from granite_lab.errors import EstimateError
from granite_lab.estimation import Motion, estimate
from granite_lab.estimation.faults import find_faults
from granite_lab.estimation.mounting import given as orientation
from granite_lab.estimation.mounting import level, to_body, turn_between
from granite_lab.estimation.nominal import integrate
from granite_lab.logs.trial import ImuStream
from tests.truth import faults
from tests.truth.trials import TruthTrial, generate, robot

DEG = st.floats(-180.0, 180.0)


@cache
def truth() -> TruthTrial:
    return generate(41, velocity=0.5, duration=3.0, still=(1.0, 1.0), grade="industrial", clock_offset=0.02)


@cache
def plain() -> Motion:
    return estimate(truth().trial, robot())


def elementary(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Rz(yaw) Ry(pitch) Rx(roll), from its definition; angles in degrees."""
    a, b, c = np.radians([roll, pitch, yaw])
    rx = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    ry = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    rz = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    return rz @ ry @ rx


@given(roll=DEG, pitch=DEG, yaw=DEG)
def test_rotation_of_the_robots_file_takes_sensor_axes_to_the_robots(
    roll: float, pitch: float, yaw: float
) -> None:
    matrix = orientation(robot(rotation=(roll, pitch, yaw))).as_matrix()
    assert matrix == pytest.approx(elementary(roll, pitch, yaw), abs=1e-12)


@given(roll=DEG, pitch=DEG, yaw=DEG)
@settings(max_examples=6, deadline=None, derandomize=True)
def test_forward_axis_is_found_whatever_the_orientation(roll: float, pitch: float, yaw: float) -> None:
    turned = faults.turned(truth().trial, elementary(roll, pitch, yaw).T)
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
def test_turn_between_holds_for_opposite_axes_too(a: list[float]) -> None:
    b = np.array([0.0, 0.0, 1.0])
    assert turn_between(np.array(a), b).apply(a) == pytest.approx(b, abs=1e-12)


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
    found = find_faults(imu, stream, one.imu_grade, np.zeros(stream.t.size, dtype=bool))
    nominal = integrate(imu, one, [(0.0, 0.9), (3.1, 4.0)], found)
    assert nominal.v == pytest.approx(v[every], abs=5e-4)
    assert nominal.x == pytest.approx(way[every], abs=5e-4)
    blind = integrate(imu, robot(x=0.0, z=0.0), [(0.0, 0.9), (3.1, 4.0)], found)
    assert np.abs(blind.v - v[every]).max() > 5e-3
