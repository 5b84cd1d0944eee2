"""Vibration is taken out of steady motion, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from granite_lab.estimation.nominal import Nominal, quieten

T = np.arange(0.0, 10.0, 0.005)
FREQUENCY = 25.0
REST = (T < 1.0) | (T > 9.0)
STEADY = (T > 2.0) & (T < 8.0)
CORE = (T > 2.3) & (T < 7.7)


def going(v: np.ndarray) -> Nominal:
    zero = np.zeros(T.size)
    x = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(T))])
    return Nominal(T, REST, x, v, zero, zero, 0.0, 0.0, zero + 9.81, 0.0)


def motion() -> np.ndarray:
    """Up, steady with the slow oscillation that slip makes, and down."""
    return np.interp(T, [1.0, 1.6, 8.4, 9.0], [0.0, 0.5, 0.5, 0.0]) + np.where(
        REST, 0.0, 0.01 * np.sin(2 * np.pi * 1.2 * T) * np.clip((T - 1.0), 0.0, 1.0)
    )


def test_vibration_goes_and_motion_stays() -> None:
    shake = np.where(REST, 0.0, 0.002 * np.sin(2 * np.pi * FREQUENCY * T))
    found = quieten(going(motion() + shake), STEADY, FREQUENCY)
    assert np.sqrt(np.mean((found.v - motion())[CORE] ** 2)) < 1e-4
    assert found.vibration_left[CORE].max() < 0.2


def test_ramps_and_standstill_are_left_as_they_are() -> None:
    shake = np.where(REST, 0.0, 0.002 * np.sin(2 * np.pi * FREQUENCY * T))
    before = going(motion() + shake)
    found = quieten(before, STEADY, FREQUENCY)
    assert np.array_equal(found.v[~STEADY], before.v[~STEADY])
    assert found.vibration_left[~STEADY] == pytest.approx(1.0)


def test_distance_is_the_integral_of_the_velocity_and_ends_where_it_did() -> None:
    rng = np.random.default_rng(0)
    before = going(motion() + np.where(REST, 0.0, rng.normal(0, 0.002, T.size)))
    found = quieten(before, STEADY, FREQUENCY)
    assert np.gradient(found.x, T)[CORE] == pytest.approx(found.v[CORE], abs=2e-4)
    assert found.x[-1] == pytest.approx(before.x[-1], abs=5e-5)


def test_what_is_left_of_slower_shaking_is_told() -> None:
    """Shaking of 8 Hz is not told from motion by a smoothing made for 25 Hz: its doubt stays."""
    slow = np.where(REST, 0.0, 0.002 * np.sin(2 * np.pi * 8.0 * T))
    found = quieten(going(motion() + slow), STEADY, FREQUENCY)
    left = np.sqrt(np.mean((found.v - motion())[CORE] ** 2) / np.mean(slow[CORE] ** 2))
    assert found.vibration_left[CORE].mean() == pytest.approx(left, rel=0.3)


def test_without_steady_motion_nothing_changes() -> None:
    before = going(motion())
    assert quieten(before, np.zeros(T.size, dtype=bool), FREQUENCY) is before


def test_shaking_too_slow_to_be_told_from_motion_is_left_alone() -> None:
    before = going(motion())
    assert quieten(before, STEADY, 6.5) is before
