"""The offset between the encoders' and the IMU's clock: a first value to start the filter from."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.ndimage import uniform_filter1d

from granite_lab.estimate import Estimate
from granite_lab.estimation.mounting import BodyImu
from granite_lab.estimation.rolling import Rolling

LARGEST = 0.4
"""Offsets up to this are searched for [s]."""

STEP = 0.005
LONGEST_LAG = 0.25
"""The body follows the wheels on sand by up to a quarter of a second, and never leads them [s]."""


def coarse_offset(imu: BodyImu, rolling: Rolling) -> Estimate:
    """Correlate the wheels' acceleration with the specific force along x over the ramps.

    Returns:
        how far the encoders' clock lies behind the IMU's [s] (to be added to their stamps), with a
        std that covers the body's lag behind the wheels; std NaN where nothing accelerates.
    """
    begin = max(imu.t[0], rolling.t[0]) - LARGEST
    end = min(imu.t[-1], rolling.t[-1]) + LARGEST
    if end - begin < 4 * LARGEST or rolling.t.size < 8:
        return Estimate(0.0)
    grid = np.arange(begin, end, STEP)
    smooth = max(round(0.08 / STEP), 1)
    known = np.isfinite(rolling.speed)
    speed = np.interp(grid, rolling.t[known], rolling.speed[known])
    wheel = uniform_filter1d(np.gradient(speed, STEP), smooth)
    good = np.isfinite(imu.forward)
    force = uniform_filter1d(np.interp(grid, imu.t[good], imu.forward[good]), smooth)
    # a slow drift of pitch must not outweigh the ramps
    force -= uniform_filter1d(force, round(3.0 / STEP), mode="nearest")
    wheel -= uniform_filter1d(wheel, round(3.0 / STEP), mode="nearest")
    if float(np.max(np.abs(wheel))) < 0.1:
        return Estimate(0.0)
    size = 2 ** int(np.ceil(np.log2(2 * grid.size)))
    spectrum = np.fft.rfft(force, size) * np.conj(np.fft.rfft(wheel, size))
    correlation = np.fft.irfft(spectrum, size)
    reach = round(LARGEST / STEP)
    lags = np.arange(-reach, reach + 1)
    values = correlation[lags]
    norm = float(np.sqrt(np.sum(force**2) * np.sum(wheel**2)))
    best = int(np.argmax(values))
    if values[best] < 0.2 * norm or best in (0, values.size - 1):
        return Estimate(0.0)
    a, b, c = values[best - 1 : best + 2]
    lag = (lags[best] + 0.5 * (a - c) / (a - 2 * b + c)) * STEP
    return Estimate(float(lag - 0.5 * LONGEST_LAG), float(np.hypot(0.02, 0.3 * LONGEST_LAG)))


def refine_offset(coarse: Estimate, log_likelihood: Callable[[float], float]) -> Estimate:
    """Refine an offset by the likelihood of the first moments of motion.

    The body lags the wheels once both move, so correlation is biased; but wheel and body set off
    together, and the filter's model of slip (any share of the wheel's speed) keeps them so.

    Args:
        coarse: where to search, with its std [s].
        log_likelihood: of the measurements around the onset of motion, given an offset [s].

    Returns:
        the best offset on a grid refined twice, with half of the last spacing as std.
    """
    reach = 2.0 * LONGEST_LAG / 2.0
    spacing, centre = 0.02, coarse.value
    candidates = centre + np.arange(-reach, reach + 1e-9, spacing)
    for _ in range(2):
        values = np.array([log_likelihood(float(c)) for c in candidates])
        centre = float(candidates[int(np.argmax(values))])
        spacing /= 3.0
        candidates = np.asarray(centre + spacing * np.arange(-2.0, 3.0))
    return Estimate(centre, 0.01)
