"""The number of lugs is read from what repeats with the wheels' angle, at all speeds."""

import numpy as np
import pytest

from granite_lab.discovery.lines import line_gains
from granite_lab.discovery.orders import ORDERS, standing_out

SPEEDS = (2.0, 3.0, 5.0, 7.0)
"""Of the wheels [rad/s]."""


def gains(wave, seed=0, noise=1.0):
    """Return the (w, c, n) gains of one channel; `wave` gives it by time, angle and acceleration."""
    rng, t = np.random.default_rng(seed), np.arange(0, 5, 0.02)
    table = np.zeros((2, len(SPEEDS), ORDERS.size))
    for c, speed in enumerate(SPEEDS):
        acceleration = np.exp(-t) - np.exp(t - 5)
        angle = speed * t
        residual = wave(t, angle, acceleration) + noise * rng.standard_normal(t.size)
        for way, size in enumerate((np.ones(t.size), acceleration)):
            table[way, c] = line_gains(ORDERS.astype(float), angle / (2 * np.pi), residual[None], size)[0]
    return table


@pytest.mark.parametrize("n", [14, 18, 20, 30])
def test_the_number_of_lugs_is_found_where_the_file_is_wrong(n):
    assert standing_out(gains(lambda _t, a, _p: 0.5 * np.cos(n * a + 1)), 24.0) == n
    assert standing_out(gains(lambda _t, a, pull: 2.0 * pull * np.cos(n * a + 1)), 24.0) == n


@pytest.mark.parametrize("seed", range(5))
def test_noise_a_resonance_and_what_is_not_round_leave_the_number_of_the_file(seed):
    assert standing_out(gains(lambda _t, a, _p: 0 * a, seed), 24.0) == 24
    assert standing_out(gains(lambda t, _a, _p: 0.5 * np.cos(2 * np.pi * 12 * t), seed), 24.0) == 24
    assert standing_out(gains(lambda _t, a, _p: 0.5 * np.cos(a), seed), 24.0) == 24
    assert standing_out(gains(lambda _t, a, _p: 0.5 * np.cos(24 * a), seed), 24.0) == 24


@pytest.mark.parametrize("constant", [True, False])
def test_a_gain_is_that_of_least_squares_of_a_cosine_and_a_sine(constant):
    rng = np.random.default_rng(4)
    x, numbers = np.cumsum(rng.uniform(0.01, 0.03, 300)), np.arange(0.3, 12.0, 0.07)
    size = np.ones(300) if constant else rng.standard_normal(300)
    left = rng.standard_normal((3, 300)) + 0.4 * size * np.cos(2 * np.pi * 5.1 * x)
    left[1, 40:55] = np.nan
    found = line_gains(numbers, x, left, None if constant else size)
    for residual, gain in zip(left, found, strict=True):
        at = np.isfinite(residual)
        y, n = np.diff(residual[at]), np.count_nonzero(at) - 1
        for k, number in enumerate(numbers):
            phase = 2 * np.pi * number * x[at]
            waves = np.diff(size[at] * np.stack([np.cos(phase), np.sin(phase)])).T
            rest = y - waves @ np.linalg.lstsq(waves, y)[0]
            assert gain[k] == pytest.approx(n / 2 * np.log((y @ y) / (rest @ rest)) - np.log(n), abs=1e-6)
