"""White noise in motion, told from vibration and from motion itself by the spectrum.

The integral of white noise drifts without bound, that of vibration does not, so neither may be taken for the
other. While the wheels turn steadily, the signal of an accelerometer or a gyroscope consists of

* motion of the body, below 1.5 Hz, on some ground below 3 Hz;
* vibration, the derivative of a bounded velocity or angle: below its resonances the density rises as f^2;
* white noise, of the same density at all frequencies.

From the end of the motion the spectrum is either white noise, or white noise and such a rise up to a
resonance, with anything beyond it. No frequency holds less than the white noise. The end of the motion,
the resonance, the height of the rise and the level of the white noise are unknown: Whittle's likelihood
of the periodogram [1] weighs the models, and they are averaged [2]. So vibration is bounded only where its
spectrum is seen to fall towards low frequencies. A flat spectrum is white noise, also that of vibration
which a slow sensor folds to low frequencies. Of the density the posterior's mean is taken, because the std
of the estimate goes by it.

[1] P. Whittle, Estimation and information in stationary time series, Ark. Mat. 2 (1953).
[2] J. A. Hoeting et al., Bayesian model averaging: a tutorial, Stat. Sci. 14 (1999).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp, softmax

from granite_lab.logs.trial import Array

MOTION, RESTLESS = 1.5, 3.0
"""The body itself moves at up to this frequency [Hz]: usually, and on restless ground."""

PER_OCTAVE = 6
"""Bands of the spectrum in each octave."""

INDEPENDENT = 0.5
"""Independent ordinates for each ordinate: the reciprocal of the noise bandwidth of the window of Blackman
and Harris (1978)."""

FEWEST = 8.0
"""A rise is seen in at least so many independent ordinates."""

SEEN = 0.7
"""Share of its frequency up to which the rise to a resonance is that of a resonator without damping."""

MIDDLE = 5.0
"""The height of a rise is that at this frequency [Hz], but for the resonance."""

STEPS = 10
"""Candidates of the white noise in each decade, twice as many as of a height."""

NONE = 0.8
"""Probability, before the trial is seen, that motion adds no white noise."""

ONLY_WHITE = 0.5
"""Probability, before the trial is seen, that a band below the rise holds white noise alone."""

HIGH, BELOW = 10.0, 0.45
"""Up to this frequency [Hz], and this share of a resonance's, vibration is the tail of the resonance."""

EVIDENT = 10.0
"""A resonance is evident where the loudest octave is this many times as loud as the quietest (10 dB)."""

ADDED = np.geomspace(0.3, 3e4, 61)
"""Densities that motion may add beside an evident resonance, in shares of the one at rest."""

HEIGHTS = np.geomspace(1e-2, 1e6, 81)
"""Densities of its tail at the highest frequency, in shares of the white one at rest; all equally likely."""

NEGLIGIBLE = 0.3
"""White noise in motion below this share of that at rest is none."""


class Bands(NamedTuple):
    """A periodogram in B bands, in shares of the white noise at rest."""

    centre: Array  # (B,) mean frequency [Hz]
    number: Array  # (B,) of independent ordinates
    total: Array  # (B,) their sum


class Levels(NamedTuple):
    """Candidates of the white noise, in shares of that at rest, and what speaks for them."""

    white: Array  # (W,) from 1 on
    flat: Array  # (W,) log-probability of white noise alone above the motion, but for a constant
    rising: Array  # (W,) the same of white noise and vibration


def white_in_motion(frequency: Array, density: Array, rest: float, *, turns: bool = False) -> float:
    """White noise density (std times sqrt(s)) that motion adds to that at `rest`.

    `frequency` (F,) [Hz] and `density` (F,) are ordinates of a one-sided periodogram. A body that `turns` on
    uneven ground does so at any frequency, and its gyro shows that: there a flat spectrum alone is noise.
    """
    if not frequency.size:
        return 0.0
    white, flat, rising = levels(frequency, density / (2.0 * rest**2))
    if turns:
        rising = np.where(white == 1.0, logsumexp(rising), -np.inf)
    level = float(softmax(np.logaddexp(flat, rising)) @ white)
    return rest * float(np.sqrt(level - 1.0)) if level - 1.0 > NEGLIGIBLE else 0.0


def in_bands(frequency: Array, values: Array, per_octave: int = 1) -> tuple[Array, Array]:
    """(B,) ordinates in each band of the frequencies (F,) [Hz], and (B,) means of values (F,) over them.

    Bands without ordinates are left out.
    """
    _, place = np.unique(np.floor(per_octave * np.log2(frequency)), return_inverse=True)
    number = np.bincount(place).astype(float)
    return number, np.bincount(place, values) / number


def evident_resonance(frequency: Array, density: Array) -> bool:
    """Whether a resonance stands out of the periodogram (F,) at `frequency` (F,) [Hz] beyond the motion."""
    beyond = frequency > RESTLESS
    number, mean = in_bands(frequency[beyond], density[beyond])
    mean = mean[number >= FEWEST]
    return bool(mean.size > 1 and float(mean.max()) > EVIDENT * float(mean.min()))


def white_below_resonance(frequency: Array, density: Array, rest: float, resonance: float) -> float:
    """White noise density that motion adds to that at `rest` beside an evident resonance [Hz].

    Below it the vibration is the tail of a resonator without damping, r^2 / (1 - r^2)^2 with r the frequency
    in shares of the resonance's; above, every octave holds at least the white noise. Motion of the body adds
    to the lowest frequencies on restless ground: the smaller of the levels with and without them counts.
    """
    beyond = frequency > MOTION
    frequency, density = frequency[beyond], density[beyond] / (2.0 * rest**2)
    low = frequency < min(HIGH, BELOW * resonance)
    ratio = (frequency[low] / resonance) ** 2
    number, mean = in_bands(frequency[~low], density[~low])
    tail, quick = ratio / (1.0 - ratio) ** 2, frequency[low] > RESTLESS
    added = min(_added(density[low][use], tail[use], mean, number) for use in (quick | True, quick))
    return rest * float(np.sqrt(added)) if added > NEGLIGIBLE else 0.0


def _added(density: Array, tail: Array, mean: Array, number: Array) -> float:
    """Mean of the white noise that motion adds, in shares of that at rest, by Whittle's likelihood."""
    if density.size < FEWEST:
        return 0.0
    white = np.concatenate([[0.0], ADDED])
    height = HEIGHTS[:, None] * tail / np.max(tail)
    misfit = np.empty((white.size, height.shape[0]))
    for i, added in enumerate(white):
        level = 1.0 + added + height
        low = np.sum(np.log(level) + density / level, axis=1)
        least = np.maximum(mean, 1.0 + added)  # as loud as its mean, but not quieter than the white noise
        misfit[i] = low + np.sum(number * (np.log(least) + mean / least))
    log_posterior = logsumexp(-INDEPENDENT * misfit, axis=1)
    log_posterior += np.log(np.append(NONE, np.full(ADDED.size, (1.0 - NONE) / ADDED.size)))
    return float(softmax(log_posterior) @ white)


def levels(frequency: Array, density: Array) -> Levels:
    """Weigh levels of the white noise by a periodogram (F,), in shares of that at rest."""
    ordinates, mean = in_bands(frequency, density, PER_OCTAVE)
    centre = in_bands(frequency, frequency, PER_OCTAVE)[1]
    bands = Bands(centre, INDEPENDENT * ordinates, INDEPENDENT * ordinates * mean)
    decades = float(np.log10(max(float(np.max(mean)), 1.0))) + 0.5
    white = np.logspace(0.0, decades, max(int(decades * STEPS), 2))
    height = np.logspace(-2.0, decades + 2.0, int((decades + 4.0) * STEPS / 2))
    only_white, more = outside(bands, white)
    below = _summed(np.logaddexp(np.log(ONLY_WHITE) + only_white, np.log(1.0 - ONLY_WHITE) + more))
    above, flat = _summed(more[::-1])[::-1], _summed(only_white[::-1])[::-1]
    beyond = np.flatnonzero(centre > MOTION)
    begins = beyond[(centre[beyond] < RESTLESS) | (beyond == beyond[:1])].tolist()
    rises = [
        below[begin] + rise + above[end]
        for end in range(1, centre.size + 1)
        for begin, rise in rising_to(end, begins, bands, white, height)
    ]
    prior = np.log(np.append(NONE, np.full(white.size - 1, (1.0 - NONE) / (white.size - 1))))
    return Levels(
        white,
        prior + _mean([below[begin] + flat[begin] for begin in (0, *begins)]),
        prior + (_mean(rises) if rises else -np.inf),
    )


def outside(bands: Bands, white: Array) -> tuple[Array, Array]:
    """(B, W) log-likelihoods of bands that hold white noise (W,) alone, and with anything beside it.

    What is beside it is as probable at each of the candidates; the larger of both is the level.
    """
    only_white = -bands.number[:, None] * np.log(white) - bands.total[:, None] / white
    place = np.arange(white.size)
    larger = np.logaddexp.accumulate(
        np.append(only_white[:, 1:], np.full((len(only_white), 1), -np.inf), 1)[:, ::-1], axis=1
    )
    more = np.logaddexp(larger[:, ::-1], only_white + np.log(place + 1.0)) - np.log(white.size)
    return np.asarray(only_white), np.asarray(more)


def rising_to(
    end: int, begins: list[int], bands: Bands, white: Array, height: Array
) -> list[tuple[int, Array]]:
    """Weigh white noise (W,) with a rise of any height (A,) up to the band before `end`.

    Returns:
        those of the first bands `begins` from which it is seen in enough ordinates, each with the log-
        likelihoods (W,).
    """
    begins = [begin for begin in begins if np.sum(bands.number[begin:end]) >= FEWEST]
    if not begins:
        return []
    centre, number, total = (values[begins[0] : end, None, None] for values in bands)
    share = centre / (centre[-1] / SEEN)
    level = white + height[:, None] * (centre / MIDDLE) ** 2 / (1.0 - share**2) ** 2  # (B, A, W)
    seen = _summed((-number * np.log(level) - total / level)[::-1])[::-1]
    return [(begin, _mean(seen[begin - begins[0]])) for begin in begins]


def _mean(models: Array | list[Array]) -> Array:
    """(W,) logarithm of the mean probability of models (M, W), from logarithms."""
    return np.asarray(logsumexp(models, axis=0) - np.log(len(models)))


def _summed(values: Array) -> Array:
    """(B + 1, ...) sums of the first 0 to B values (B, ...)."""
    return np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
