"""What the residuals of a finding look like: means over repetitions, strengths by phase and frequency."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

import numpy as np
from scipy.fft import dct

from granite_lab.discovery.finding import Finding, Residual
from granite_lab.discovery.lackfit import BANDS
from granite_lab.logs.trial import Array
from granite_lab.reporting.discovery.names import CHANNELS
from granite_lab.reporting.summary import PHASES


@dataclass(frozen=True, eq=False)
class Mean:
    """One channel at one speed, averaged over the repetitions of the command.

    Attributes:
        channel, unit: which.
        velocity: desired velocity [m/s].
        trials: how many went in.
        t: (n,) time since the start of the command [s].
        phase: (n,) commanded phase.
        measured, before, after: (n,) mean of the sensor and of the simulations [unit]; NaN where no
            trial was measured.
        z_before, z_after: (n,) whitened residual, scaled so that noise is 1 whatever the number of trials.
    """

    channel: str
    unit: str
    velocity: float
    trials: int
    t: Array
    phase: tuple[str, ...]
    measured: Array
    before: Array
    after: Array
    z_before: Array
    z_after: Array

    @property
    def width(self) -> float:
        """Time between samples [s]."""
        return float(self.t[1] - self.t[0])


def means(finding: Finding) -> list[Mean]:
    """Average over the trials of each command, channels in the order of the report."""
    groups: dict[tuple[str, float, tuple[str, ...]], list[Residual]] = {}
    for r in finding.residuals:
        groups.setdefault((r.channel, r.variant, r.phase), []).append(r)
    order = list(CHANNELS)
    ranked = sorted(
        groups.items(), key=lambda g: (g[0][1], order.index(g[0][0]) if g[0][0] in order else 99, g[0][0])
    )
    return [_mean(group) for _, group in ranked]


def _mean(group: list[Residual]) -> Mean:
    first, n = group[0], np.sqrt(len(group))
    known = np.array([np.isfinite(r.measured) for r in group])
    count = known.sum(axis=0)

    def average(name: str) -> Array:
        rows = np.array([getattr(r, name) for r in group])
        total = np.where(known & np.isfinite(rows), rows, 0.0).sum(axis=0)
        return np.where(count > 0, total / np.fmax(count, 1), np.nan)

    def whitened(name: str) -> Array:
        return np.asarray(np.sum([getattr(r, name) for r in group], axis=0) / n)

    return Mean(
        first.channel,
        first.unit,
        first.variant,
        len(group),
        first.t,
        first.phase,
        average("measured"),
        average("before"),
        average("after"),
        whitened("white_before"),
        whitened("white_after"),
    )


def channels_of(finding: Finding) -> list[str]:
    """Return the channels that the search used, in the order of the report."""
    found = {r.channel for r in finding.residuals}
    return [c for c in CHANNELS if c in found] + sorted(found - set(CHANNELS))


@dataclass(frozen=True)
class Strength:
    """How far trials and model are apart in one channel, phase and band of frequency, over all speeds.

    Attributes:
        before, after: rms of the mean residual over its noise, without and with what was found.
        count: how many numbers went in.
    """

    before: float
    after: float
    count: float

    def score(self, *, after: bool) -> float:
        """Return the energy as a standard normal number (Wilson and Hilferty 1931), like the map's scores."""
        v = 2 / (9 * self.count)
        rms = self.after if after else self.before
        return float((np.cbrt(rms**2) - (1 - v)) / np.sqrt(v))


def strengths(finding: Finding) -> dict[tuple[str, str, int], Strength]:
    """Return channel, phase and number of the band to the strength there."""
    total: dict[tuple[str, str, int], Array] = {}
    for mean in means(finding):
        start = 0
        for phase, run in groupby(mean.phase):
            end = start + len(list(run))
            f, *power = _spectrum([z[start:end] for z in (mean.z_before, mean.z_after)], mean.width)
            for k, (low, high) in enumerate(BANDS):
                inside = (f >= low) & (f < high)
                add = np.array([power[0][inside].sum(), power[1][inside].sum(), inside.sum()], dtype=float)
                key = mean.channel, phase, k
                total[key] = total.get(key, np.zeros(3)) + add
            start = end
    return {
        key: Strength(float(np.sqrt(t[0] / t[2])), float(np.sqrt(t[1] / t[2])), float(t[2]))
        for key, t in total.items()
        if t[2] > 0 and key[1] in PHASES
    }


def spectra(finding: Finding, edges: Array) -> tuple[Array, Array, Array]:
    """Return per band of frequency the mean power before, after, and how many numbers went in; 1 is noise.

    Args:
        finding: the record.
        edges: (k + 1,) of the bands [Hz].
    """
    total = np.zeros((3, edges.size - 1))
    for mean in means(finding):
        f, *power = _spectrum([mean.z_before, mean.z_after], mean.width)
        band = np.digitize(f, edges) - 1
        inside = (band >= 0) & (band < edges.size - 1)
        for row, values in zip(total, (*power, np.ones_like(f)), strict=True):
            np.add.at(row, band[inside], values[inside])
    count = np.fmax(total[2], 1)
    return (
        np.where(total[2] > 0, total[0] / count, np.nan),
        np.where(total[2] > 0, total[1] / count, np.nan),
        total[2],
    )


def _spectrum(rows: list[Array], width: float) -> tuple[Array, ...]:
    """Return frequencies [Hz] and the power of each row at them."""
    n = rows[0].size
    return np.arange(n) / (2 * n * width), *(np.asarray(dct(z, norm="ortho")) ** 2 for z in rows)
