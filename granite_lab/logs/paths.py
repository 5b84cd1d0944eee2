"""Distance and speed along a path, from positions in the plane or on the globe."""

from __future__ import annotations

import numpy as np

from granite_lab.logs.trial import Array

_A = 6378137.0
_E2 = 6.69437999014e-3
"""Semi-major axis [m] and squared eccentricity of WGS 84."""

WINDOW = 5
"""Samples through which a line is laid to get a speed."""


def slope(t: Array, x: Array, window: int = WINDOW) -> Array:
    """Return the slope of a line through `window` neighbouring samples, fewer at the ends.

    Args:
        t: (N,) stamps [s].
        x: (N,) values.
        window: an odd number of samples.

    Returns:
        (N,) slope [1/s]; it has the noise and the smoothing of the window.
    """
    n = len(t)
    half = window // 2
    low = np.maximum(np.arange(n) - half, 0)
    high = np.minimum(np.arange(n) + half + 1, n)
    count = high - low

    def total(values: Array) -> Array:
        sums = np.concatenate(([0.0], np.cumsum(values)))
        return np.asarray(sums[high] - sums[low])

    # Centred first: stamps may count from 1970.
    t0, x0 = t - t.mean(), x - x.mean()
    st, sx, stt, stx = total(t0), total(x0), total(t0 * t0), total(t0 * x0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray((count * stx - st * sx) / (count * stt - st * st))


def path(t: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """Return distance along a path [m] and speed [m/s].

    The speed is the slope over a few samples in either direction, so that the noise of positions at
    rest does not add up to a distance.

    Args:
        t: (N,) stamps [s].
        x, y: (N,) positions [m].
    """
    speed = np.hypot(slope(t, x), slope(t, y))
    steps = np.diff(t) * (speed[1:] + speed[:-1]) / 2
    return np.concatenate(([0.0], np.cumsum(steps))), speed


def geographic(latitude: Array, longitude: Array) -> tuple[Array, Array]:
    """Return metres east and north of the first place.

    Args:
        latitude, longitude: (N,) [rad], WGS 84; the area is small (some kilometres).

    Source: radii of curvature of the ellipsoid in the meridian and the prime vertical.
    """
    lat0 = latitude[0]
    w = 1 - _E2 * np.sin(lat0) ** 2
    meridian, vertical = _A * (1 - _E2) / w**1.5, _A / np.sqrt(w)
    east = (longitude - longitude[0]) * vertical * np.cos(lat0)
    return np.asarray(east), np.asarray((latitude - lat0) * meridian)
