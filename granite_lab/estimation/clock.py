"""The offset between the encoders' and the IMU's clock: a first value to start the filter from."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from granite_lab.estimate import Estimate
from granite_lab.estimation.mounting import BodyImu
from granite_lab.estimation.rolling import Rolling
from granite_lab.logs.trial import Array

LARGEST = 0.4
"""Offsets up to this are searched for [s]."""

STEP = 0.005
"""Spacing of the correlation [s]."""

TEMPER = 0.5
"""Weight of the likelihood of an offset: the slip model is an idealisation, exact to millimetres only."""

LEFT_OVER = 2.5e-3
"""Std of the offset by how the body really sets off and stops in the sand [s], and by play and tyres: a
robot that rings at 10 Hz follows its wheels so much later."""

LONGEST_LAG = 0.25
"""The body follows the wheels on sand by up to a quarter of a second, and never leads them [s]."""


FARTHEST = 1.0
"""Offsets up to this are searched for where odometry was smoothed [s]."""

CLEAR = 0.5
"""Correlation at which such an offset counts as found."""


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


def slow_offset(imu: BodyImu, rolling: Rolling) -> Estimate:
    """Correlate wheels and IMU over seconds, where odometry was smoothed and terrain shakes the robot.

    Pitch is taken out by its gyro. The smoothing is as long as it must be for a clear correlation.

    Returns:
        how far the encoders' clock lies behind the IMU's [s]; std NaN where it does not show, or where
        the body's usual lag behind the wheels explains the correlation as well.
    """
    begin, end = max(imu.t[0], rolling.t[0]), min(imu.t[-1], rolling.t[-1])
    known, good = np.isfinite(rolling.speed), np.isfinite(imu.forward)
    if end - begin < 8.0 * FARTHEST or known.sum() < 32 or good.sum() < 32:
        return Estimate(0.0)
    step = 2.0 * STEP
    grid = np.arange(begin, end, step)
    speed = np.interp(grid, rolling.t[known], rolling.speed[known])
    force = np.interp(grid, imu.t[good], imu.forward[good])
    if imu.has_pitch_rate:
        turned = np.cumsum(np.nan_to_num(imu.pitch_rate) * np.diff(imu.t, prepend=imu.t[0]))
        force = force + imu.gravity * np.interp(grid, imu.t, turned)
    reach = round(FARTHEST / step)
    lags = np.arange(-reach, reach + 1)
    for width in (0.1, 0.25, 0.6):
        signals = []
        for signal in (force, speed):
            slow = gaussian_filter1d(signal, width / step) - gaussian_filter1d(signal, 3.0 / step)
            signals.append(slow)
        wheel = np.gradient(signals[1], step)
        size = 2 ** int(np.ceil(np.log2(2 * grid.size)))
        spectrum = np.fft.rfft(signals[0], size) * np.conj(np.fft.rfft(wheel, size))
        values = np.fft.irfft(spectrum, size)[lags]
        norm = float(np.sqrt(np.sum(signals[0] ** 2) * np.sum(wheel**2)))
        best = int(np.argmax(values))
        if values[best] < CLEAR * norm or best in (0, values.size - 1):
            continue
        lag = float(lags[best] * step)
        usual = (lags * step >= 0.0) & (lags * step <= LONGEST_LAG)
        if values[usual].max() > 0.9 * values[best]:
            return Estimate(0.0)
        return Estimate(min(lag, max(lag - LONGEST_LAG, 0.0)), 0.25 * width)
    return Estimate(0.0)


def refine_offset(coarse: Estimate, log_likelihood: Callable[[float], float]) -> Estimate:
    """Refine an offset by the likelihood of the moments when the robot sets off and stops.

    The body lags the wheels while both move, so correlation is biased. But the body neither sets off
    before the wheels do, nor goes on when they have stopped: the first bounds the offset from above,
    the second from below. The filter's model of slip (any share of the wheel's speed, so none when
    the wheels stand) holds both.

    Args:
        coarse: where to search, with its std [s].
        log_likelihood: of the measurements around onsets and stops, given an offset [s].

    Returns:
        mean and std of the posterior, its likelihood tempered for what the slip model leaves out [s].
    """

    def posterior(candidates: Array) -> tuple[float, float]:
        score = np.array([log_likelihood(float(c)) for c in candidates]) * TEMPER
        score -= 0.5 * ((candidates - coarse.value) / coarse.std) ** 2
        weight = np.exp(score - score.max())
        mean = float(weight @ candidates / weight.sum())
        return mean, float(np.sqrt(weight @ (candidates - mean) ** 2 / weight.sum()))

    centre, spacing = coarse.value, 0.02
    candidates = np.asarray(centre + np.arange(-2.0 * coarse.std, 2.0 * coarse.std + spacing, spacing))
    centre, std = posterior(candidates)
    reach = max(0.016, 2.5 * std)
    spacing = max(0.003, reach / 7.0)
    centre, std = posterior(np.asarray(centre + np.arange(-reach, reach + spacing, spacing)))
    return Estimate(centre, float(np.sqrt(std**2 + spacing**2 / 12.0 + LEFT_OVER**2)))
