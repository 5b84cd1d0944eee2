"""Faults of the logger, written into the text of a log, leave the estimate as it was."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from granite_lab.estimation import Motion, estimate
from granite_lab.estimation.mounting import BodyImu, given, to_body
from granite_lab.estimation.wheels import check_signs
from granite_lab.logs import read_trial
from granite_lab.logs.trial import ImuStream, Trial, WheelStream
from granite_lab.parameters import load_robot
from tests.truth import csv_text
from tests.truth.trials import TruthTrial, generate

COUNTS = 106000
"""Encoder counts per wheel revolution of the sample robot."""


@pytest.fixture(scope="module")
def truth() -> TruthTrial:
    return generate(31, velocity=0.5, duration=5.0, grade="industrial", still=(1.0, 1.0))


@pytest.fixture(scope="module")
def text(truth: TruthTrial) -> str:
    return csv_text.to_csv(truth.trial)


def read(tmp_path: Path, text: str) -> Trial:
    path = tmp_path / "trial.csv"
    path.write_text(text)
    return read_trial(path)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory, text: str) -> Motion:
    return estimate(read(tmp_path_factory.mktemp("plain"), text), load_robot("granite", "industrial"))


@pytest.mark.parametrize(("bits", "start"), [(16, 65000), (16, 0), (32, 2**32 - 1000)])
def test_counter_that_wraps_is_recovered_exactly(
    tmp_path: Path, text: str, plain: Motion, bits: int, start: int
) -> None:
    long = read(tmp_path, csv_text.wrapped_counts(text, COUNTS, 62, start=start))
    wrapped = read(tmp_path, csv_text.wrapped_counts(text, COUNTS, bits, start=start))
    assert np.array_equal(wrapped.wheels.angle, long.wheels.angle)
    counts = np.round(wrapped.wheels.angle * COUNTS / (2 * np.pi))
    assert counts[-1].min() > (2**16 if bits == 16 else 1000)  # it did wrap
    motion = estimate(wrapped, load_robot("granite", "industrial"))
    assert motion.v == pytest.approx(plain.v, abs=1e-4)
    assert motion.distance_wheels.value == pytest.approx(plain.distance_wheels.value, abs=1e-4)


@pytest.mark.parametrize(("damage", "words"), [
    (lambda text: csv_text.duplicated(text, 10), "stamps"),
    (lambda text: csv_text.duplicated(text, 7, disturb=0.3), "stamps"),
    (lambda text: csv_text.unsorted(text, 3), "sorted"),
])  # fmt: skip
def test_repeated_and_unsorted_rows_change_nothing(
    tmp_path: Path, text: str, plain: Motion, damage: Callable[[str], str], words: str
) -> None:
    trial = read(tmp_path, damage(text))
    assert any(words in line for line in trial.warnings), trial.warnings
    motion = estimate(trial, load_robot("granite", "industrial"))
    assert motion.v == pytest.approx(plain.v, abs=1e-9)
    assert motion.slip_ratio.value == pytest.approx(plain.slip_ratio.value, abs=1e-9)


@pytest.mark.parametrize(("prefix", "factor", "suffix"), [
    ("imu_a", 1 / 9.80665, "g"), ("imu_a", 1 / 9.80665, None), ("imu_a", 1000 / 9.80665, None),
    ("imu_g", 180 / np.pi, "dps"), ("imu_g", 180 / np.pi, None), ("t_", 1000.0, "ms"), ("t_", 1000.0, None),
    ("enc_", 180 / np.pi, "deg"), ("enc_", 180 / np.pi, None),
])  # fmt: skip
def test_other_unit_whether_named_or_not_changes_nothing(
    tmp_path: Path, text: str, plain: Motion, prefix: str, factor: float, suffix: str | None
) -> None:
    trial = read(tmp_path, csv_text.converted(text, prefix, factor, suffix))
    if suffix is None:
        assert trial.warnings  # the name lied, and that is said
    motion = estimate(trial, load_robot("granite", "industrial"))
    assert motion.t == pytest.approx(plain.t, abs=1e-5)
    assert motion.v == pytest.approx(plain.v, abs=1e-4)


def test_stretch_of_text_nan_is_bridged_and_said(tmp_path: Path, truth: TruthTrial, text: str) -> None:
    damaged = csv_text.with_gap_of_nan(text, "imu_ax_mps2", 3.0, 3.2)
    motion = estimate(read(tmp_path, damaged), load_robot("granite", "industrial"))
    assert motion.health.gaps[0] == pytest.approx((3.0, 3.2), abs=0.02)
    error = np.abs(motion.v - truth.at(motion.t, "v"))
    assert np.mean(error < 2 * motion.v_std) > 0.9


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
