"""Where the model and the data disagree: a map over channel, command, time and frequency.

Under the null the whitened residuals are independent with unit variance, and so is their mean over
the repetitions of a command times the square root of their number. Windows of several lengths are
scored on that mean, once by its level and slow swing, once by its energy in a band of frequency;
the largest score of the whole map, over random signs of the pure error, is the threshold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.fft import dct

from granite_lab.discovery.baseline import by_command, channels_of, having_channel
from granite_lab.discovery.observation import Mask
from granite_lab.discovery.problem import Problem
from granite_lab.estimation.motion import PhaseName
from granite_lab.logs.trial import Array

LENGTHS = (6, 12, 24, 48, 96)
"""Lengths of the windows in bins; they overlap by half."""

BANDS = ((0.0, 2.0), (2.0, 5.0), (5.0, 12.0), (12.0, 25.0))
"""Bands of frequency [Hz]."""

FLIP = 25
"""Bins whose sign changes together in the bootstrap."""


@dataclass(frozen=True)
class Disagreement:
    """An interval in which a channel disagrees with the model.

    Attributes:
        channel: as in `observation.UNITS`.
        phase: commanded phase in the interval's middle.
        variant: desired velocity of the command [m/s].
        start, end: since the start of the command [s].
        frequency: where the disagreement is strongest [Hz].
        strength: rms of the whitened mean residual over the interval; 1 is noise.
    """

    channel: str
    phase: PhaseName
    variant: float
    start: float
    end: float
    frequency: float
    strength: float


@dataclass(frozen=True, eq=False)
class Track:
    """The mean whitened residual of one channel over the repetitions of one command.

    Attributes:
        channel: its name.
        command: number of the command.
        t: (n,) middle of each bin since the start of the command [s].
        phase: (n,) commanded phase.
        z: (n,) mean over the repetitions times the square root of their number.
        trials: which trials went in.
        velocity: of the command [m/s].
        width: of a bin [s].
    """

    channel: str
    command: int
    t: Array
    phase: tuple[str, ...]
    z: Array
    trials: tuple[int, ...]
    velocity: float
    width: float


def tracks(problem: Problem, white: Sequence[Array]) -> list[Track]:
    """Average whitened residuals over the repetitions of each command."""
    found = []
    for own in by_command(problem):
        for c in channels_of(problem, own):
            having = having_channel(problem, own, c)
            o = problem.trials[having[0]].observation
            z = np.sum([rows_of(problem, i, c, white[i]) for i in having], axis=0) / np.sqrt(len(having))
            found.append(
                Track(
                    c,
                    problem.trials[own[0]].variant,
                    o.t,
                    o.phase,
                    z,
                    tuple(having),
                    o.variant.velocity,
                    o.width,
                )
            )
    return found


def rows_of(problem: Problem, trial: int, channel: str, white: Array) -> Array:
    """Return the (n,) part of a trial's whitened residual that belongs to a channel."""
    k, n = problem.trials[trial].channels.index(channel), problem.trials[trial].observation.bins
    return white[k * n : (k + 1) * n]


def windows(n: int) -> list[tuple[int, int]]:
    """List the windows over n bins."""
    return [
        (a, a + length) for length in LENGTHS if length <= n for a in range(0, n - length + 1, length // 2)
    ]


def window_scores(z: Array, width: float) -> Array:
    """Return (windows, bands) scores, each a standard normal number under the null.

    Args:
        z: (n,) or (n, k) unit white noise under the null; the result then has a last axis of k.
        width: of a bin [s].
    """
    z = z if z.ndim == 2 else z[:, None]
    rows = [np.zeros((0, len(BANDS), z.shape[1]))]
    for length in (length for length in LENGTHS if length <= z.shape[0]):
        cut = sliding_window_view(z, length, axis=0)[:: length // 2]
        power = np.asarray(dct(cut, norm="ortho", axis=-1)) ** 2
        scores = np.full((len(cut), len(BANDS), z.shape[1]), -np.inf)
        for k, inside in enumerate(in_bands(length, width)):
            if inside.any():
                scores[:, k] = _normal(power[..., inside].sum(axis=-1), int(inside.sum()))
        rows.append(scores)
    return np.concatenate(rows)


def frequencies(n: int, width: float) -> Array:
    """Return the (n,) frequencies of a cosine transform over n bins [Hz]."""
    return np.arange(n) / (2 * n * width)


def in_bands(n: int, width: float) -> list[Mask]:
    """Return per band of `BANDS` which of the n frequencies lie in it."""
    f = frequencies(n, width)
    return [(f >= low) & (f < high) for low, high in BANDS]


def _normal(energy: Array, freedom: int) -> Array:
    """Return a sum of squares as a standard normal number (Wilson and Hilferty 1931)."""
    v = 2 / (9 * freedom)
    return np.asarray((np.cbrt(energy / freedom) - (1 - v)) / np.sqrt(v))


def null_threshold(
    problem: Problem,
    error: Sequence[Array],
    rng: np.random.Generator,
    *,
    level: float = 0.01,
    draws: int = 100,
) -> float:
    """Return the score that the largest of the map exceeds with probability `level` under the null.

    The tail is extrapolated by a Gumbel law from the draws.

    Args:
        problem: for the layout.
        error: (m,) whitened pure error per trial.
        rng: of the signs.
        level: probability of a false alarm anywhere on the map.
        draws: how many maps.
    """
    largest = np.full(draws, -np.inf)
    for track in tracks(problem, error):
        n = track.z.size
        cuts = np.repeat(np.arange(-(-n // FLIP)), FLIP)[:n]
        z = np.zeros((n, draws))
        for i in track.trials:
            signs = rng.choice([-1.0, 1.0], size=(cuts[-1] + 1, draws))
            z += rows_of(problem, i, track.channel, error[i])[:, None] * signs[cuts]
        z /= np.sqrt(len(track.trials))
        largest = np.fmax(largest, window_scores(z, track.width).max(axis=(0, 1)))
    spread = float(np.std(largest)) * np.sqrt(6) / np.pi
    return float(np.mean(largest) + spread * (-np.log(-np.log(1 - level)) - 0.5772))


def disagreements(problem: Problem, white: Sequence[Array], threshold: float) -> list[Disagreement]:
    """Return the intervals whose score exceeds the threshold, the strongest first."""
    found = []
    for track in tracks(problem, white):
        scores = window_scores(track.z, track.width)[:, :, 0].max(axis=1)
        hit = np.zeros(track.z.size, dtype=bool)
        # short windows first: a long one counts only where no short one has said it more precisely
        for (a, b), score in sorted(
            zip(windows(track.z.size), scores, strict=True), key=lambda w: w[0][1] - w[0][0]
        ):
            if score > threshold and not hit[a:b].any():
                hit[a:b] = True
        for a, b in _runs(hit, track.phase):
            found.append(_describe(track, a, b))
    return sorted(found, key=lambda d: -d.strength * np.sqrt(d.end - d.start))


def largest_score(problem: Problem, white: Sequence[Array]) -> float:
    """Return the largest score of the map."""
    return max(float(window_scores(t.z, t.width).max()) for t in tracks(problem, white))


def _runs(hit: Array, phase: tuple[str, ...]) -> list[tuple[int, int]]:
    """Return the runs of bins that are hit, cut where the phase changes."""
    runs: list[tuple[int, int]] = []
    begin: int | None = None
    for k in range(hit.size + 1):
        goes_on = k < hit.size and hit[k] and (begin is None or phase[k] == phase[begin])
        if begin is not None and not goes_on:
            runs.append((begin, k))
            begin = None
        if k < hit.size and hit[k] and begin is None:
            begin = k
    return runs


def _describe(track: Track, a: int, b: int) -> Disagreement:
    z = track.z[a:b]
    power = np.asarray(dct(z, norm="ortho")) ** 2
    f = frequencies(b - a, track.width)
    return Disagreement(
        channel=track.channel,
        phase=cast("PhaseName", track.phase[(a + b) // 2]),
        variant=track.velocity,
        start=float(track.t[a] - track.width / 2),
        end=float(track.t[b - 1] + track.width / 2),
        frequency=float(f[np.argmax(power)]),
        strength=float(np.sqrt(np.mean(z**2))),
    )
