"""Regression of the specific force on the acceleration of the wheels: lag, gain and direction.

The specific force along the robot is the acceleration of its wheels, but for slip. So a regression of the one
on the other tells the offset of their clocks, the axis that points forward, and its sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from granite_lab.logs.trial import Array

STEP = 0.005
"""Spacing of the grid on which both are compared [s]."""

SMOOTH, SLOW = 0.08, 3.0
"""What changes within the first is vibration, over the second pitch on a slope [s]."""

LARGEST = 0.4
"""Lags up to this are searched: the clocks may be so far apart [s]."""

LEAST_RAMP = 0.1
"""Wheels that never accelerate by this much show no offset [m/s^2]."""


def correlate(force: Array, wheel: Array, reach: int) -> tuple[Array, int, float]:
    """Correlate specific force with the wheels' acceleration, both (M,) on one grid.

    Returns:
        (2 reach + 1,) the correlation at each lag of the force; the place of its largest value, and that
        value in shares of what it can be, 0 at the end of the reach.
    """
    size = 2 ** int(np.ceil(np.log2(2 * max(force.size, reach + 1))))
    values = np.fft.irfft(np.fft.rfft(force, size) * np.conj(np.fft.rfft(wheel, size)), size)
    values = values[np.arange(-reach, reach + 1)]
    best = int(np.argmax(values))
    inner = best not in (0, values.size - 1)
    whole = float(np.sqrt(np.sum(force**2) * np.sum(wheel**2)))
    return values, best, float(values[best]) / max(whole, 1e-300) if inner else 0.0


def changing(acceleration: Array) -> Array:
    """(K,) acceleration on the grid without vibration, and without what is slower than a ramp."""
    smooth = uniform_filter1d(acceleration, max(round(SMOOTH / STEP), 1))
    return np.asarray(smooth - uniform_filter1d(smooth, round(SLOW / STEP), mode="nearest"))


class Gain(NamedTuple):
    """Horizontal specific force over the wheels' acceleration, at the lag at which it is largest.

    Attributes:
        vector: (2,) [-].
        power: sum of the squared accelerations [m^2/s^4].
        explained: correlation of the wheels' acceleration with the force along the vector.
        opposite: the largest gain the other way, at any lag, as a share of it.
        std: of its direction, by the force across [rad].
    """

    vector: Array
    power: float
    explained: float
    opposite: float
    std: float


def gain_of(force: Sequence[Array], speed: Array) -> Gain:
    """Regress specific force along two axes, each (G,), on the acceleration of wheels by their speed (G,)."""
    wheel, both = changing(np.gradient(speed, STEP)), np.stack([changing(axis) for axis in force])
    power, reach = max(float(wheel @ wheel), 1e-12), round(LARGEST / STEP)
    gains = np.stack([correlate(axis, wheel, reach)[0] for axis in both], axis=1) / power
    vector = gains[int(np.argmax(np.hypot(*gains.T)))]
    size = max(float(np.hypot(*vector)), 1e-12)
    x, y = vector / size
    along, across = np.array([[x, y], [-y, x]]) @ both
    explained = size * float(np.sqrt(power / max(float(along @ along), 1e-12)))
    std = float(np.std(across) / size * np.sqrt(SMOOTH / STEP / power))
    return Gain(vector, power, explained, float((-gains @ (x, y)).max()) / size, std)
