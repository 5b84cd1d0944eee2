"""What differs from one repetition to the next, and yet is seen by several sensors.

Noise is learnt from what repetitions of a command do not share, and a disturbance that comes at another
instant or phase in each trial (a gust, a strap, a sensor's own phase) hides in it. But the noise of one
sensor knows nothing of the noise of another, while a disturbance moves body, wheels and motors together:
under the null the products of their pure errors average out.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from scipy.fft import dct

from granite_lab.discovery.baseline import by_command, channels_of
from granite_lab.discovery.finding import Unrepeated
from granite_lab.discovery.lackfit import BANDS, in_bands, rows_of
from granite_lab.discovery.problem import Problem
from granite_lab.logs.trial import Array


def unrepeated(problem: Problem, error: Sequence[Array]) -> Unrepeated:
    """Return how clearly the sensors agree about what repetitions do not share.

    Args:
        problem: the trials, with the noise.
        error: (m,) per trial, from `granite_lab.discovery.baseline.pure_error`.
    """
    total: dict[tuple[str, str, int], float] = {}
    variance: dict[tuple[str, str, int], float] = {}
    for own in by_command(problem):
        if len(own) < 2:
            continue
        # R errors around their mean, scaled to unit variance, are R - 1 independent ones
        spread = len(own) / (len(own) - 1)
        everywhere = [
            c for c in channels_of(problem, own) if all(c in problem.trials[i].channels for i in own)
        ]
        for i in own:
            for key, product, count in _products(problem, i, everywhere, error[i]):
                total[key] = total.get(key, 0.0) + product
                variance[key] = variance.get(key, 0.0) + spread * count
    found = Unrepeated()
    for (first, second, band), product in total.items():
        score = abs(product) / np.sqrt(variance[first, second, band])
        if score > found.score:
            found = Unrepeated(float(score), first, second, *BANDS[band])
    return found


def _products(
    problem: Problem, i: int, channels: Sequence[str], error: Array
) -> list[tuple[tuple[str, str, int], float, int]]:
    """Return per pair of channels of different sensors, and band, the inner product of a trial's errors."""
    o = problem.trials[i].observation
    spectra = {c: np.asarray(dct(rows_of(problem, i, c, error), norm="ortho")) for c in channels}
    inside = in_bands(o.bins, o.width)
    return [
        ((first, second, band), float(a[inside[band]] @ b[inside[band]]), int(inside[band].sum()))
        for (first, a), (second, b) in combinations(spectra.items(), 2)
        if _sensor(first) != _sensor(second)
        for band in range(len(BANDS))
        if inside[band].any()
    ]


def _sensor(channel: str) -> str:
    """Return what a channel was measured by; the axes of an IMU feel one vibration."""
    return "imu" if channel in ("accel_x", "accel_z", "pitch_rate") else channel.partition("_")[0]
