"""Densities and slopes are those of SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from granite_lab.estimation.spectrum import blackman_harris, hann, slope, spectral_density

VALUES = 3.0 + np.random.default_rng(1).normal(size=777)


@pytest.mark.parametrize("size", [128, 255])
def test_a_density_is_that_of_welch(size: int) -> None:
    for own, theirs in zip(
        spectral_density(VALUES, 100.0, hann(size)), signal.welch(VALUES, 100.0, nperseg=size), strict=True
    ):
        np.testing.assert_allclose(own, theirs, rtol=1e-12)


@pytest.mark.parametrize("size", [100, 101])
def test_a_density_of_one_segment_is_the_periodogram(size: int) -> None:
    window = signal.windows.blackmanharris(size)
    np.testing.assert_allclose(blackman_harris(size), window, atol=1e-12)
    for own, theirs in zip(
        spectral_density(VALUES[:size], 50.0, window),
        signal.periodogram(VALUES[:size], 50.0, window),
        strict=True,
    ):
        np.testing.assert_allclose(own, theirs, rtol=1e-9)


@pytest.mark.parametrize(("order", "derivative"), [(3, 2), (1, 1), (2, 1)])
def test_a_slope_is_that_of_savitzky_and_golay(order: int, derivative: int) -> None:
    theirs = signal.savgol_filter(VALUES, 31, order, deriv=derivative, delta=0.01, mode="nearest")
    own = slope(VALUES, 31, order, 0.01, derivative)
    np.testing.assert_allclose(own, theirs, atol=1e-9 * np.abs(theirs).max())
