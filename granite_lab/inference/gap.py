"""What a fit leaves: discrepancy of each channel, misfit beyond the tolerance, scatter of repetitions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import periodogram

from granite_lab.inference.discrepancy import FORMULA, MOTION
from granite_lab.inference.fit import Fit, with_priors
from granite_lab.inference.noise import ABOVE, CUT, FEWEST_BINS, errors
from granite_lab.inference.normal import ChannelPart, Scales
from granite_lab.inference.problem import Problem
from granite_lab.inference.scales import DISCREPANCIES, FORMULAS, posterior_at
from granite_lab.logs.trial import Array


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """What all repetitions of a command share and the model does not explain.

    Attributes:
        command: its number.
        channel: its name.
        size: rms of the channel in motion [unit].
        value: (n,) estimate at the bins, in motion; zero elsewhere [unit].
        std: (n,) its standard deviation [unit].
    """

    command: int
    channel: str
    size: float
    value: Array
    std: Array

    @property
    def share(self) -> float:
        """Its rms in motion over that of the channel, less what its standard deviation alone may make."""
        moving = self.std > 0
        if not moving.any():
            return 0.0
        sure = float(np.mean(self.value[moving] ** 2 - self.std[moving] ** 2))
        return float(np.sqrt(max(sure, 0.0))) / self.size


def discrepancies(problem: Problem, fit: Fit, *, formulas: bool = True) -> list[Discrepancy]:
    """Return the discrepancy of each command and channel.

    Args:
        problem: the trials.
        fit: of them.
        formulas: the errors of the effects' formulas are included.
    """
    step = np.append(-fit.posterior.step, 1.0)
    rows = []
    for command, part in enumerate(fit.normal.parts):
        at, names = step[part.place_in(step.size)], dict.fromkeys(c.name for c in part.channels)
        for name in names:
            channels = [c for c in part.channels if c.name == name]
            bases = problem.bases(fit.point, fit.derivatives, command, name)
            pairs = zip(channels, bases, strict=True)
            pieces = [_posterior_of(c, b.columns, at, fit.scales, formulas) for c, b in pairs]
            value, std = map(np.concatenate, zip(*pieces, strict=True))
            size, moving = problem.rms_of(command, name)
            rows.append(Discrepancy(command, name, size, value * moving, std * moving))
    return rows


def _posterior_of(
    c: ChannelPart, basis: Array, step: Array, scales: Scales, formulas: bool
) -> tuple[Array, Array]:
    """Return value and std (n,) of the discrepancy of a channel over a stretch [unit of the channel]."""
    amplitude, _ = c.amplitudes(step, scales)
    kept = np.flatnonzero((c.kind == MOTION) | ((c.kind == FORMULA) & formulas))
    columns = basis[:, kept]
    root, inverse = c.inverse(scales)
    variance = (((columns * root[kept]) @ inverse[kept]) ** 2).sum(axis=1)
    return columns @ amplitude[kept], scales.noise_factor.get(c.name, 1.0) * np.sqrt(variance)


def largest_discrepancies(problem: Problem, fit: Fit) -> dict[str, float]:
    """Return channel to its largest discrepancy over the commands, as a share of its rms in motion.

    What an error of the formulas of the effects explains is left out.
    """
    largest: dict[str, float] = {}
    for d in discrepancies(problem, fit, formulas=False):
        largest[d.channel] = max(largest.get(d.channel, 0.0), d.share)
    return largest


def prediction_change(problem: Problem, before: Fit, after: Fit) -> dict[str, float]:
    """Return channel to how far two fits' predictions are apart, at most over the commands.

    It is the rms in motion of their difference, over the repetitions, too, over the channel's rms in motion.
    In the fit before the trials may differ from each other by no more than the fit after says: numbers of the
    trials cannot stand in for what is missing.
    """
    reference = remaining(problem, with_priors(problem, before, after.scales))
    largest: dict[str, float] = {}
    for command, repetitions in enumerate(problem.commands):
        for c, places in problem.places_of(repetitions).items():
            size, moving = problem.rms_of(command, c)
            apart = np.stack([reference[i][k] - after.residuals[i][k] for i, k in places])[:, moving]
            apart = apart[np.isfinite(apart)]
            if apart.size and size > 0:
                largest[c] = max(largest.get(c, 0.0), float(np.sqrt(np.mean(apart**2))) / size)
    return largest


def remaining(problem: Problem, fit: Fit) -> list[Array]:
    """Return per trial the (C, n) residuals at the posterior mean, linear about the fit's point."""
    step, rows = fit.posterior.step, []
    shared = sum(x.size for x in fit.point.trials)
    begin = 0
    for i, (x, residual) in enumerate(zip(fit.point.trials, fit.residuals, strict=True)):
        numbers = np.concatenate([step[begin : begin + x.size], step[shared:]])
        change = problem.columns(i, fit.point, fit.derivatives) @ numbers
        rows.append(residual - change.reshape(residual.shape))
        begin += x.size
    return rows


def scatter(problem: Problem, fit: Fit) -> dict[str, float]:
    """Return channel to how far repetitions differ slowly, over its rms in motion; median of the commands.

    The numbers of single trials, as sand, gains and offsets, are fitted. Noise and vibration are subtracted,
    by their density at standstill or in the band above `CUT`, whichever is larger. What is left changes from
    trial to trial and is not in the model, as uneven ground, wind or a motor that warms up. A resonance of
    the frame that is sampled as a slow wave shows at one speed only, hence the median.

    Args:
        problem: the trials.
        fit: of them.
    """
    left = remaining(problem, fit)
    by_channel: dict[str, list[float]] = {}
    for command, repetitions in enumerate(problem.commands):
        t = problem.trials[repetitions[0]].observation
        for c, places in problem.places_of(repetitions).items():
            size, moving = problem.rms_of(command, c)
            if len(places) < 2 or size <= 0 or c.startswith("wheel"):  # wheels follow the command
                continue
            noise = errors([left[i][k] for i, k in places])
            slow = _powers(noise[:, moving], t.width, 0.0, CUT)
            above = _powers(noise[:, moving], t.width, CUT, ABOVE * CUT)
            still = _powers(noise[:, t.t < 0], t.width, 0.0, CUT)
            if slow.size and above.size:
                sure = slow.mean() * (1 - 2 / np.sqrt(slow.size))  # a power scatters by itself
                more = sure - max(above.mean(), still.mean() if still.size else 0.0)
                by_channel.setdefault(c, []).append(float(np.sqrt(max(more, 0.0) * CUT)) / size)
    return {c: float(np.median(values)) for c, values in by_channel.items()}


def _powers(rows: Array, width: float, low: float, high: float) -> Array:
    """Return the power densities of (k, n) rows between two frequencies; none where they are too short."""
    densities = [np.zeros(0)]
    for row in (r[np.isfinite(r)] for r in rows):
        if row.size >= FEWEST_BINS:
            f, power = periodogram(row, 1 / width, "hann")
            densities.append(power[(f > 0) & (f >= low) & (f < high)])
    return np.concatenate(densities)


def tolerated(scales: Scales, discrepancy: float) -> Scales:
    """Return scales under which a discrepancy of some share is taken for granted, and formulas for exact."""
    return replace(
        scales, discrepancy=discrepancy, discrepancies={}, formula=FORMULAS[0], formulas={}, noise_factor={}
    )


def beyond(problem: Problem, fit: Fit, tolerance: float) -> tuple[float, float]:
    """Return the misfit under a discrepancy of the tolerated size, and what is expected if that is true.

    The expectation is what an unlimited discrepancy leaves, and unit variance along each direction that the
    tolerated one cannot take up.
    """
    values, free = [], []
    for share in (tolerance, DISCREPANCIES[-1]):
        scales = tolerated(fit.scales, share)
        values.append(posterior_at(problem, fit.point, fit.normal, scales).misfit)
        free.append(sum(determined_by_prior(c, scales) for p in fit.normal.parts for c in p.channels))
    return values[0], values[1] + free[0] - free[1]


def determined_by_prior(channel: ChannelPart, scales: Scales) -> float:
    """Return the number of directions along which the discrepancy of a channel is held by its prior."""
    return float((channel.inverse(scales)[1] ** 2).sum())
