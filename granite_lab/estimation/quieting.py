"""The frame's vibration taken out of the nominal velocity where the wheels turn steadily.

Sand lets a body change its velocity no faster than its wheels do: what an IMU shows near the frame's
own frequency while they turn steadily is the frame. Around the ramps nothing is touched, and the
filter's oscillator carries the doubt.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.ndimage import gaussian_filter1d, minimum_filter1d

from granite_lab.estimation.integration import Nominal
from granite_lab.estimation.roll import cumulate
from granite_lab.logs.trial import Array

HALF = 0.25
"""The smoothing halves an oscillation of this many widths' reciprocal: width [s] times frequency [Hz]."""

CUT = 0.31
"""The smoothing halves an oscillation of this share of the vibration's frequency; of half of it, 8 % pass."""

FADE = 0.1
"""The smoothing comes in within this time [s]."""

LOWEST = 5.0
"""The smoothing passes whatever is slower than this [Hz]: it may be motion."""

APART = 1.5
"""A vibration this many times faster than what the smoothing must pass can be told from motion."""


def smoothed(signal: Array, width: float) -> Array:
    """(N,) signal smoothed by 2 G - G G, G a Gaussian of `width` samples: true to cubics, without delay."""
    once = gaussian_filter1d(signal, width, mode="nearest")
    return np.asarray(2.0 * once - gaussian_filter1d(once, width, mode="nearest"))


def quieten(nominal: Nominal, steady: np.ndarray, frequency: float) -> Nominal:
    """Take the vibration out of velocity and distance where the wheels turn steadily.

    Args:
        nominal: the integrated motion.
        steady: (N,) True where the wheels' velocity has been, and will be, the same for a while.
        frequency: of the vibration [Hz].

    Returns:
        the motion with `vibration_left`: (N,) share of the vibration's rms that is still in it, counting
        as such what is up to an octave slower than the smoothing removes. Unchanged where the vibration
        is too slow to be told from motion, or the wheels never turn steadily.
    """
    period = float(np.median(np.diff(nominal.t)))
    cut = max(CUT * frequency, LOWEST)
    width = HALF / (cut * period)
    on = steady & ~nominal.rest
    if frequency < APART * LOWEST or width < 1.0 or on.sum() * period < 1.0:
        return nominal
    fade = max(round(FADE / period), 1)
    inner = minimum_filter1d(on.astype(float), 2 * fade + 1, mode="constant")
    weight = gaussian_filter1d(inner, fade / 3.0, mode="constant")
    weight = np.where(on, weight, 0.0)
    slow = smoothed(nominal.v, width)
    motion = smoothed(nominal.v, 2.0 * width)
    core = inner > 0
    if not core.any():
        return nominal
    whole = float(np.mean((nominal.v - motion)[core] ** 2))
    left = min(float(np.sqrt(np.mean((slow - motion)[core] ** 2) / max(whole, 1e-20))), 1.0)
    fast = weight * (nominal.v - slow)
    return dataclasses.replace(
        nominal,
        v=nominal.v - fast,
        x=nominal.x - cumulate(nominal.t, fast, nominal.rest),
        vibration_left=1.0 - weight * (1.0 - left),
    )
