"""Estimates on real logs of other robots, against GPS, motion capture and yaw rates."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.real_logs_data import Comparison, boreal, car, figures, husky, over, sliding, yaw_lag

DATA = Path(os.environ.get("GRANITE_LAB_REAL_LOGS") or Path(__file__).parents[3] / "shared" / "data")
pytestmark = [
    pytest.mark.real_logs,
    pytest.mark.skipif(not DATA.is_dir(), reason="the real logs are not here"),
]

GPS_STD = 0.18
"""Scatter of a GPS speed over five fixes [m/s]."""


@cache
def the_husky() -> Comparison:
    return husky(DATA)


@cache
def the_car(run: int) -> Comparison:
    return car(DATA, run)


@pytest.mark.parametrize("run", [4, 21, 22])
def test_the_small_car_is_known_twice_as_well_as_its_wheels_tell(run: int) -> None:
    found = the_car(run)
    reference = found.item.trial.reference_v
    assert reference is not None
    assert found.t.size == reference.t.size > 1000
    assert found.by_wheels.rmse > 0.25
    assert found.improvement >= 2.0
    assert found.coverage(found.std) >= 0.92
    assert 0.5 < found.item.motion.distance.value / np.trapezoid(reference.value, reference.t) < 1.1


@pytest.mark.parametrize("run", [4, 21, 22])
def test_where_the_small_car_skids_the_gain_is_largest(run: int) -> None:
    found = the_car(run)
    estimate, wheels = found.where(np.abs(found.true_slip) > 0.2)
    assert estimate.samples > 100
    assert wheels.rmse > 3 * estimate.rmse


def test_the_husky_goes_as_fast_as_gps_says_within_its_noise() -> None:
    found = the_husky()
    assert found.t.size > 900
    # GPS scatters by about as much as estimate and wheels differ from it
    assert found.estimate.rmse < 0.30
    assert abs(found.estimate.bias) < 0.10
    estimate, _ = over(found)
    assert estimate.rmse < 0.13
    assert 0.88 <= found.coverage(np.hypot(found.std, GPS_STD)) <= 0.98
    assert 0.5 < found.nees < 1.6


def test_the_husky_stands_still_when_gps_does() -> None:
    found = the_husky()
    rest = (found.t > 240.0) & (found.t < 246.0)
    assert np.max(np.abs(found.v[rest])) < 0.02
    assert figures(found.reference[rest]).rmse < 0.05


def test_the_huskys_clocks_differ_by_what_its_yaw_rates_say() -> None:
    offset = the_husky().item.motion.clock_offset
    assert abs(offset.value - yaw_lag(DATA)) < 2 * offset.std
    assert offset.std < 0.1


def test_without_a_standstill_the_estimate_says_so_and_is_wide() -> None:
    for name, item in boreal(DATA):
        motion = item.motion
        assert not motion.health.good, name
        assert any("no standstill" in line for line in motion.warnings), name
        # steady slip of up to 30 % is not excluded
        assert motion.distance.std > 0.1 * motion.distance.value, name
        assert abs(motion.distance.value - motion.distance_wheels.value) < 2 * motion.distance.std, name


@pytest.mark.parametrize(("surface", "low", "high"), [("table", 12, 15), ("gray", 22, 24), ("green", 39, 45)])
def test_slip_of_the_three_wheeled_robot_by_its_camera(surface: str, low: float, high: float) -> None:
    runs = [run for run in sliding(DATA) if run.name.startswith(surface)]
    assert runs
    for run in runs:
        assert low <= 100 * run.slip <= high, run.name
