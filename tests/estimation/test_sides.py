"""Sides that turn against each other: the yaw gyro tells a turn from an encoder that counts backwards."""

from __future__ import annotations

import numpy as np
import pytest

from granite_lab.estimation.mounting import BodyImu, given, to_body
from granite_lab.estimation.wheels import check_signs
from granite_lab.logs.trial import ImuStream, WheelStream
from granite_lab.parameters import load_robot


def made_up(left: float, right: float, yaw: float) -> tuple[WheelStream, BodyImu]:
    """Sides that turn at two velocities [m/s] for some seconds, and a gyro that sees a yaw rate [rad/s]."""
    robot = load_robot("granite", "industrial")
    t = np.arange(0.0, 8.0, 0.01)
    on = ((t > 2) & (t < 6)).astype(float)
    way = np.cumsum(on) * 0.01 / robot.wheels.radius
    angle = np.stack([left * way, right * way, left * way, right * way], axis=1)
    rng = np.random.default_rng(0)
    force = rng.normal(0, 0.02, (t.size, 3)) + np.array([0.0, 0.0, 9.81])
    rate = rng.normal(0, 0.002, (t.size, 3)) + on[:, None] * [0, 0, yaw]
    return WheelStream(t, angle), to_body(ImuStream(t, force, rate), given(robot))


def test_turn_in_place_is_not_taken_for_a_side_that_counts_backwards() -> None:
    robot = load_robot("granite", "industrial")
    turn = 0.6 * 0.4 / robot.chassis.track  # skidding takes a part of it
    wheels, imu = made_up(-0.2, 0.2, turn)
    same, said = check_signs(wheels, imu, robot, forward_known=True)
    assert same is wheels
    assert said == ()
    wheels, imu = made_up(-0.2, 0.2, 0.0)
    turned, said = check_signs(wheels, imu, robot, forward_known=True)
    assert (turned.angle[-1] > 0).all()
    assert "fl, rl" in said[0]


def test_without_a_yaw_gyro_opposite_sides_stay_in_doubt() -> None:
    robot = load_robot("granite", "industrial")
    wheels, _ = made_up(-0.2, 0.2, 0.0)
    same, said = check_signs(wheels, None, robot, forward_known=False)
    assert same is wheels
    assert "no yaw gyro" in said[0]


def test_exchanged_sides_are_put_right_when_the_robot_turns() -> None:
    robot = load_robot("granite", "industrial")
    wheels, imu = made_up(0.2, 0.35, 0.7 * 0.15 / robot.chassis.track)
    same, said = check_signs(wheels, imu, robot, forward_known=True)
    assert same is wheels
    assert said == ()
    wheels, imu = made_up(0.35, 0.2, 0.7 * 0.15 / robot.chassis.track)
    right, said = check_signs(wheels, imu, robot, forward_known=True)
    assert right.angle[:, 0] == pytest.approx(wheels.angle[:, 1])
    assert "exchanged" in said[0]
