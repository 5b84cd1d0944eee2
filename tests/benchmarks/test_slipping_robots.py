"""Trials of slipping robots hold what they are said to hold, and the page judges them rightly."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from benchmarks.against_truth import Velocities, errors, inside, rms
from benchmarks.slipping_robots import (
    KINDS,
    RESTS,
    SLIP,
    by_least_squares,
    draw_sensors,
    make_course,
    page,
    sense,
)


@pytest.mark.parametrize("kind", KINDS)
def test_the_imu_without_noise_measures_the_motion(kind: str) -> None:
    rng = np.random.default_rng(5)
    course = make_course(kind, rng)
    sensors = dataclasses.replace(
        draw_sensors(rng), accel=0, gyro=0, accel_bias=0, gyro_bias=0, shake=0, late=0, imu_rate=200
    )
    imu = sense(course, sensors, rng).imu
    rate = imu.angular_rate[:, 1]
    pitch = course.pitch[0] + np.cumsum(rate) / 200
    force = imu.specific_force[:, 0] + 9.81 * np.sin(pitch) + 0.10 * rate**2
    v = np.cumsum(force) / 200 - 0.12 * rate
    ends = imu.t + 0.5 / 200  # a sample is the mean over its interval
    assert v == pytest.approx(np.interp(ends, course.t, course.v), abs=4e-3)


def test_each_robot_slips_as_its_name_says() -> None:
    courses = {kind: make_course(kind, np.random.default_rng(2)) for kind in KINDS}
    for course in courses.values():
        assert np.max(np.abs(course.v[[0, -1]])) < 2e-3
    stands = np.abs(courses["is stuck"].v) < 1e-3
    assert np.ptp(courses["is stuck"].t[stands & (courses["is stuck"].wheel > 0.1)]) > 1.5
    through = courses["slips through"]
    ratio = 1 - through.v / np.maximum(through.wheel, 0.1)
    assert 1.0 < np.sum((ratio > 0.85) & (through.wheel > 0.1)) / 1000 < 3.0
    slope = courses["brakes on a slope"]
    assert np.max(slope.v[slope.wheel == 0]) > 0.03
    assert np.deg2rad(4) < slope.pitch[-1] - slope.pitch[0] < np.deg2rad(14)
    rings = courses["rings"]
    after = rings.v[rings.t > rings.t[np.flatnonzero(rings.wheel > 0)[-1]]]
    crossings = np.flatnonzero(np.diff(np.sign(after)))[:4]
    assert np.diff(crossings) / 1000 == pytest.approx(0.25, abs=0.03)


def test_who_is_told_more_knows_more() -> None:
    squares = {True: 0.0, False: 0.0}
    for seed in range(4):
        rng = np.random.default_rng(seed)
        course, sensors = make_course("is stuck", rng), draw_sensors(rng)
        imu = sense(course, sensors, rng).imu
        v = np.interp(imu.t - sensors.late, course.t, course.v)
        for told in squares:
            squares[told] += rms(by_least_squares(course, sensors, imu, slip_told=told) - v) ** 2
    assert squares[True] < squares[False] < 4 * 0.01**2


def made_up(error: float, std: float, told: float) -> Velocities:
    z = np.random.default_rng(0).standard_normal(2000)
    zero = np.zeros(z.size)
    others = {RESTS: zero + told, SLIP: zero + told}
    return Velocities("", zero, zero, error * z, zero + std, zero + 0.1, "good", others)


def test_errors_and_coverage_are_those_of_the_samples() -> None:
    runs = [made_up(0.01, 0.01, 0.002), made_up(0.01, 0.002, 0.002)]
    assert rms(errors(runs)) == pytest.approx(0.01, rel=0.05)
    assert rms(errors(runs, "wheels")) == pytest.approx(0.1)
    assert rms(errors(runs, SLIP)) == pytest.approx(0.002)
    assert inside(runs[:1]) == pytest.approx(0.954, abs=0.015)
    assert inside(runs) == pytest.approx(0.5 * (0.954 + 0.311), abs=0.02)
    assert np.isnan(inside(runs, low=1.5))


def test_the_page_says_which_aims_are_missed() -> None:
    text = page({
        "a": [made_up(0.003, 0.003, 0.002), "a, seed 1: no standstill"],
        "b": [made_up(0.01, 0.003, 0.002)] * 2,
        "c": [made_up(0.003, 0.3, 0.002)] * 2,
    })  # fmt: skip
    assert "Both are reached for:\na." in text
    assert "| a | 2 |" in text
    assert "| 10.0 | 2.0 | 2.0 | **5.0** |" in text
    assert "| **100** |" in text
    assert "1 / 0 / 0 | 1 |" in text
