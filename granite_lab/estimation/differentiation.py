"""Velocity from sampled positions: local lines with a window that fits the motion, and stamp noise."""

from __future__ import annotations

import numpy as np

from granite_lab.logs.trial import Array

MOVING = 0.02
"""Wheel velocity [m/s] above which a wheel certainly rolls."""


MEET = 2.5
"""Confidence intervals of slopes reach this many std to either side."""


def slope(t: Array, y: Array, sigma: Array) -> tuple[Array, Array]:
    """Differentiate by local straight lines, the window as wide as the motion allows.

    At each sample the windows of 5, 9 and 17 samples are tried in turn; one is kept as long as
    its confidence interval meets those of all narrower ones (Goldenshluger & Nemirovski 1997), so
    corners stay sharp and steady motion is smooth.

    Args:
        t: (M,) stamps [s], increasing.
        y: (M,) signal.
        sigma: (M,) std of one sample of y.

    Returns:
        (M,) derivative and its std, by the noise of the samples alone.
    """
    m = t.size
    low, high = np.full(m, -np.inf), np.full(m, np.inf)
    best, best_std = np.full(m, np.nan), np.full(m, np.nan)
    going = np.ones(m, dtype=bool)
    for half in (2, 4, 8):
        if m < 3 and half > 2:
            break
        value, std = _line(t, y, sigma, min(half, max(m - 1, 1)))
        low, high = np.maximum(low, value - MEET * std), np.minimum(high, value + MEET * std)
        going &= low <= high
        best = np.where(going, value, best)
        best_std = np.where(going, std, best_std)
    return best, best_std


def _line(t: Array, y: Array, sigma: Array, half: int) -> tuple[Array, Array]:
    """Slope of the least squares line through 2 half + 1 samples (fewer at the ends), and its std."""
    m = t.size
    offsets = np.arange(-half, half + 1)
    index = np.arange(m)[:, None] + offsets
    inside = (index >= 0) & (index < m)
    index = np.clip(index, 0, m - 1)
    tt = (t[index] - t[:, None]) * inside
    yy = (y[index] - y[:, None]) * inside
    n = inside.sum(axis=1)
    tc = (tt - (tt.sum(axis=1) / n)[:, None]) * inside
    spread = (tc**2).sum(axis=1)
    spread = np.where(spread > 0, spread, np.inf)
    return (tc * yy).sum(axis=1) / spread, sigma / np.sqrt(spread)


def stamp_scatter(t: Array, mean: Array, speed: Array, quantum: float) -> float:
    """Std of the stamps [s]: scatter of the distance about cubics, over the velocity.

    Fourth differences cancel any motion that is cubic over five samples; their variance is 70 times
    that of one sample, on evenly spaced stamps.
    """
    fast = np.abs(speed) > 0.3 * max(float(np.nanmax(np.abs(speed), initial=0.0)), MOVING)
    if mean.size < 12 or fast.sum() < 12:
        return 0.0
    width = 5
    index = np.arange(mean.size - width + 1)[:, None] + np.arange(width)
    ok = fast[index].all(axis=1) & np.isfinite(mean[index]).all(axis=1)
    if ok.sum() < 8:
        return 0.0
    tt = t[index[ok]] - t[index[ok][:, 2]][:, None]
    # divided differences handle stamps that are not even
    weights = np.ones_like(tt)
    for i in range(width):
        for j in range(width):
            if i != j:
                weights[:, i] /= tt[:, i] - tt[:, j]
    contrast = (weights * mean[index[ok]]).sum(axis=1) / np.sqrt((weights**2).sum(axis=1))
    scatter = 1.4826 * float(np.median(np.abs(contrast)))
    typical = float(np.median(np.abs(speed[fast])))
    return float(np.sqrt(max(scatter**2 - quantum**2 / 12.0 / 4.0, 0.0)) / typical)
