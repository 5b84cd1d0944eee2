"""Speeds of wheels at corners and between them, against what the wheels did."""

from __future__ import annotations

import numpy as np
import pytest

from granite_lab.estimation import wheel_speeds
from granite_lab.estimation.wheel_speeds import Array, speeds_of
from granite_lab.estimation.wheels import local_slope, speeds_where

RADIUS, FOLLOWS = 0.0965, 0.02
"""Radius of the wheels [m]; time in which motors follow a corner [s]."""


def ramps(t: Array, top: float) -> tuple[Array, Array]:
    """Return way and speed of wheels that follow a trapezoid, with corners at 1, 1.5, 4 and 4.5 s."""
    fine = np.arange(0.0, 6.5, 1e-3)
    wanted = np.interp(fine, [1.0, 1.5, 4.0, 4.5], [0.0, top, top, 0.0])
    lag = np.exp(-np.arange(0.0, 0.2, 1e-3) / FOLLOWS)
    speed = np.convolve(wanted, lag / lag.sum())[: fine.size]
    way = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2) * 1e-3])
    return np.interp(t, fine, way), np.interp(t, fine, speed)


def logged(counts: int, rate: float, top: float, rng: np.random.Generator) -> tuple[Array, ...]:
    """Return stamps, the distances of four encoders, their std, and the true speed."""
    t = np.arange(0.1, 6.0, 1 / rate)
    late = rng.normal(0, 2e-4, t.size)
    way, speed = ramps(t + late, top)
    step = 2 * np.pi * RADIUS / counts
    distance = np.floor(way[:, None] / step + rng.uniform(size=4)) * step
    between = np.clip(step * rate / np.maximum(speed, 1e-3), 1, 0.2 * rate)  # counts come slower than samples
    sigma = np.sqrt(step**2 / 12 * between + (2e-4 * speed) ** 2)
    return t, distance, sigma, ramps(t, top)[1]


def rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))


@pytest.mark.parametrize(("counts", "rate"), [(1024, 100), (4096, 50), (16384, 100), (106000, 100)])
def test_the_std_holds_at_corners_and_between_them(counts: int, rate: int) -> None:
    rng = np.random.default_rng(counts)
    off: dict[bool, list[Array]] = {True: [], False: []}
    share: dict[bool, list[Array]] = {True: [], False: []}
    lines = []
    for top in (0.2, 0.4, 0.7):
        t, distance, sigma, speed = logged(counts, rate, top, rng)
        found, std = speeds_of(t, distance, sigma)
        at_corner = np.min(np.abs(t[:, None] - np.array([1.0, 1.5, 4.0, 4.5]) - 0.03), axis=1) < 0.07
        steady = (t > 2.0) & (t < 3.8)
        for corner, here in ((True, at_corner), (False, steady)):
            off[corner].append(found[here] - speed[here, None])
            share[corner].append(off[corner][-1] / std[here, None])
        lines.append(local_slope(t, distance[:, 0], sigma)[at_corner] - speed[at_corner])
    assert 0.6 < rms(np.concatenate(share[True])) < 1.4
    assert 0.4 < rms(np.concatenate(share[False])) < 1.4
    assert rms(np.concatenate(off[True])) < 0.6 * rms(np.concatenate(lines))  # they round the corners
    assert rms(np.concatenate(off[False])) < 0.5 * rms(np.concatenate(off[True]))


def test_logged_speeds_are_smoothed_alike() -> None:
    rng = np.random.default_rng(1)
    t = np.arange(0.1, 6.0, 0.01)
    speed = ramps(t, 0.5)[1]
    y = speed[:, None] + rng.normal(0, 5e-3, (t.size, 4))
    found, std = speeds_of(t, y, np.full(t.size, 5e-3), rates=True)
    assert rms(found - speed[:, None]) < 0.5 * rms(y - speed[:, None])
    assert 0.7 < rms((found - speed[:, None]) / std[:, None]) < 1.4


def test_long_logs_are_smoothed_in_parts_that_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    t, distance, sigma, _ = logged(16384, 100, 0.5, np.random.default_rng(2))
    whole, std = speeds_of(t, distance, sigma)
    monkeypatch.setattr(wheel_speeds, "PART", 4.0)
    parts, std_of_parts = speeds_of(t, distance, sigma)
    assert rms((parts - whole) / std[:, None]) < 0.3
    assert std_of_parts == pytest.approx(std, rel=0.5)


def test_gaps_and_lost_wheels_leave_the_others_their_speed() -> None:
    t, distance, sigma, speed = logged(16384, 100, 0.5, np.random.default_rng(3))
    keep = (t < 2.0) | (t > 3.5)
    t, distance, sigma, speed = t[keep], distance[keep], sigma[keep], speed[keep]
    known = np.ones(distance.shape, dtype=bool)
    known[t > 2.0, 1] = False
    found, std = speeds_where(known, t, distance, sigma)
    assert np.isnan(found[~known]).all()
    assert np.isnan(std[~known]).all()
    steady = known & ((t > 1.7) & (t < 3.9))[:, None]
    assert np.abs(found - speed[:, None])[steady].max() < 5e-3


def test_a_difference_of_numbers_that_are_alike_to_the_last_digit_has_a_variance() -> None:
    covariance = np.stack([np.full((1, 6), 2.0), np.full((1, 6), np.nextafter(2.0, 3.0))], axis=2)
    found = wheel_speeds._variance(covariance, np.array([-1.0, 1.0]))
    assert found == pytest.approx(np.full((1, 5), 4 * np.finfo(float).eps))
