"""Densities and smoothed derivatives, as `scipy.signal` has them, whose import takes half a second."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from scipy.ndimage import correlate1d

from granite_lab.logs.trial import Array

BLACKMAN_HARRIS = (0.35875, -0.48829, 0.14128, -0.01168)
"""Coefficients of the cosines of the window with four terms and the least side lobes (Harris, 1978)."""


def periodograms(values: Array, rate: float, window: Array) -> tuple[Array, Array]:
    """(F,) frequencies [Hz] and (S, F) one-sided densities [unit^2/Hz] of segments that overlap by half.

    The mean of each segment, as long as the window, is removed.
    """
    size = window.size
    parts = np.lib.stride_tricks.sliding_window_view(values, size)[:: max(1, size - size // 2)]
    parts = parts - parts.mean(axis=1, keepdims=True)
    power = np.abs(np.fft.rfft(parts * window, axis=1)) ** 2 / (rate * np.sum(window**2))
    power[:, 1 : None if size % 2 else -1] *= 2.0
    return np.asarray(np.fft.rfftfreq(size, 1.0 / rate)), np.asarray(power)


def spectral_density(values: Array, rate: float, window: Array) -> tuple[Array, Array]:
    """Return the mean of the `periodograms` (Welch)."""
    frequency, density = periodograms(values, rate, window)
    return frequency, np.asarray(density.mean(axis=0))


def hann(size: int) -> Array:
    """Return a periodic Hann window."""
    return np.asarray(0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(size) / size))


def blackman_harris(size: int) -> Array:
    """Return a symmetric Blackman-Harris window."""
    phase = 2.0 * np.pi * np.arange(size) / max(1, size - 1)
    return np.asarray(sum(a * np.cos(k * phase) for k, a in enumerate(BLACKMAN_HARRIS)))


def slope(values: Array, window: int, order: int, step: float, derivative: int = 1) -> Array:
    """Return a derivative of polynomials through the neighbours of each sample (Savitzky and Golay).

    The first and the last value continue beyond the ends; `step` is from sample to sample.
    """
    return np.asarray(
        correlate1d(values, _weights(window, order, derivative) / step**derivative, mode="nearest")
    )


@cache
def _weights(window: int, order: int, derivative: int) -> Array:
    """(window,) weights of the neighbours, a step of 1 apart."""
    t = np.arange(window) - window // 2
    fit = np.linalg.pinv(np.vander(t, order + 1, increasing=True))[derivative]
    return np.asarray(fit * math.factorial(derivative))
