"""The numbers of the answer: slip and k_92 per speed, and how far the model is from each channel."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from granite_lab.comparison.record import Comparison, Misfit
from granite_lab.estimate import Estimate
from granite_lab.fitting.fit import K92Fit
from granite_lab.fitting.likelihood import chosen, k92_interval
from granite_lab.logs.trial import Array
from granite_lab.parameters import Paper
from granite_lab.reporting.content import StudyResult, TrialResult
from granite_lab.reporting.rounding import Number, decided

PHASES = ("rest", "accelerate", "steady", "brake")

IN_PHASE = {
    "rest": "at rest",
    "accelerate": "while accelerating",
    "steady": "in steady motion",
    "brake": "while braking",
}

CHANNELS = {
    "velocity": "body velocity",
    "wheels": "wheel speeds",
    "slip_f": "front slip ratio",
    "slip_r": "rear slip ratio",
    "torque_f": "front driving torque",
    "torque_r": "rear driving torque",
    "pitch": "pitch",
    "accel": "forward acceleration",
    "pitch_rate": "pitch rate",
}
"""Channels of a comparison, in the order of the report, as a reader calls them."""


class Mean(NamedTuple):
    """A mean over repetitions with its standard error, its 95 % interval, and how many went in."""

    value: float
    std: float
    low: float
    high: float
    n: int


def mean_over(estimates: Iterable[Estimate]) -> Mean:
    """Average repetitions, with the wider of two 95 % intervals.

    One comes from the scatter between the repetitions (Student's t), the other from their stated
    standard deviations. The first knows the sand's scatter, the second the sensors'; with few
    repetitions either can be too small by chance.
    """
    from scipy.special import stdtrit  # noqa: PLC0415, heavy

    finite = [e for e in estimates if math.isfinite(e.value)]
    n = len(finite)
    if n == 0:
        return Mean(math.nan, math.nan, math.nan, math.nan, 0)
    values = np.array([e.value for e in finite])
    stated = np.array([e.std for e in finite])
    by_statement = float(np.sqrt(np.sum(stated**2)) / n) if np.isfinite(stated).all() else math.nan
    by_scatter = float(np.std(values, ddof=1) / np.sqrt(n)) if n > 1 else math.nan
    halves = [1.959964 * by_statement, float(stdtrit(max(n - 1, 1), 0.975)) * by_scatter]
    known = [h for h in halves if math.isfinite(h)]
    half = max(known) if known else math.nan
    errors = [s for s in (by_statement, by_scatter) if math.isfinite(s)]
    mean = float(values.mean())
    return Mean(mean, max(errors) if errors else math.nan, mean - half, mean + half, n)


@dataclass(frozen=True, eq=False)
class Speed:
    """All trials at one desired velocity.

    Attributes:
        velocity: desired velocity [m/s].
        results: the trials.
        trials: how many have a slip ratio.
        slip: mean λ_R over the trials [%], with its standard error and 95 % interval.
        k92: mean of k_92 fitted to the steady slip [–], likewise.
        k92_note: stands in place of k_92 where no trial has an inner optimum.
        paper_slip: λ_R of the paper's experiment [%] as printed there; NaN where it has none.
        paper_k92: k_92 of the paper; NaN likewise.
    """

    velocity: float
    results: tuple[TrialResult, ...]
    trials: int
    slip: Number
    k92: Number
    k92_note: str
    paper_slip: float
    paper_k92: float

    @property
    def agrees(self) -> bool | None:
        """Whether the paper's slip lies in the interval as printed; None where that cannot be said."""
        return self.slip.holds(self.paper_slip)

    @property
    def typical(self) -> TrialResult:
        """The trial whose λ_R is in the middle; the one that is drawn."""
        ranked = sorted(
            self.results,
            key=lambda r: (
                math.isnan(r.comparison.motion.slip_ratio.value),
                r.comparison.motion.slip_ratio.value,
            ),
        )
        usable = [r for r in ranked if math.isfinite(r.comparison.motion.slip_ratio.value)]
        return usable[(len(usable) - 1) // 2] if usable else ranked[0]


def by_speed(result: StudyResult, paper: Paper) -> tuple[Speed, ...]:
    """Group the trials by desired velocity, to 0.01 m/s."""
    groups: dict[float, list[TrialResult]] = {}
    for trial in result.trials:
        groups.setdefault(round(trial.comparison.motion.variant.velocity, 2), []).append(trial)
    rows = []
    for velocity, trials in sorted(groups.items()):
        fits = [t.comparison.fit for t in trials]
        *slip, count = mean_over(t.comparison.motion.slip_ratio for t in trials)
        k92 = _k92([f for f in fits if f.status == "ok"])
        own = next((p for p in paper.table3 if abs(p.velocity - velocity) < 0.005), None)
        rows.append(
            Speed(
                velocity, tuple(trials), count, decided(*slip, unit="%", scale=100), decided(*k92),
                "at its limit" if all(f.status.endswith("bound") for f in fits) else "",
                # The paper prints three digits; the tail of 100 times a fraction is none of them.
                round(100 * own.slip_measured, 6) if own else math.nan, own.k92 if own else math.nan,
            )
        )  # fmt: skip
    return tuple(rows)


def _k92(fits: Sequence[K92Fit]) -> tuple[float, float, float, float]:
    """Return the mean k_92 with std and interval, which is by the likelihood where the covariance is off."""
    value, std, low, high, _ = mean_over(f.k92 for f in fits)
    return value, std, *chosen((low, high), k92_interval(fits, (high - low) / 2))


@dataclass(frozen=True)
class Gap:
    """How far simulation and measurement are apart in one channel and phase, over trials.

    Attributes:
        channel, unit, phase: as in `Misfit`.
        rms, bias, peak: root mean square, mean and largest absolute difference over the trials.
        normalised: root mean square over the noise (1 is the noise floor); NaN if unknown.
        size: largest simulated magnitude of the channel, rare spikes left out, same unit.
        trials: how many trials have this channel.
    """

    channel: str
    unit: str
    phase: str
    rms: float
    bias: float
    peak: float
    normalised: float
    size: float
    trials: int

    @property
    def name(self) -> str:
        """The channel as a reader calls it."""
        return CHANNELS.get(self.channel, self.channel)


def gaps(comparisons: Sequence[Comparison]) -> dict[tuple[str, str], Gap]:
    """Pool the misfits of several trials, weighted by samples; (channel, phase) to gap.

    The speeds of the four wheels are one channel, "wheels".
    """
    pooled: dict[tuple[str, str], list[Misfit]] = {}
    sizes: dict[str, float] = {}
    for comparison in comparisons:
        simulated = comparison.simulated
        own = {name: _size(simulated, name) for name in dict.fromkeys(m.channel for m in comparison.misfits)}
        for m in comparison.misfits:
            channel = "wheels" if m.channel.startswith("wheel_") else m.channel
            sizes[channel] = max(sizes.get(channel, 0.0), own[m.channel])
            if m.samples and math.isfinite(m.rms):
                pooled.setdefault((channel, m.phase), []).append(m)
    return {
        key: _pool(*key, sizes[key[0]], misfits)
        for key, misfits in sorted(pooled.items(), key=lambda item: _rank(item[0]))
    }


def _size(simulated: dict[str, Array], channel: str) -> float:
    values = np.abs(simulated.get(channel, np.empty(0)))
    values = values[np.isfinite(values)]
    return float(np.percentile(values, 99.5)) if values.size else 0.0


def _rank(key: tuple[str, str]) -> tuple[int, str, int]:
    order, phases = list(CHANNELS), ("all", *PHASES)
    place = order.index(key[0]) if key[0] in order else len(order)
    return place, key[0], phases.index(key[1]) if key[1] in phases else len(phases)


def _pool(channel: str, phase: str, size: float, misfits: list[Misfit]) -> Gap:
    weights = np.array([m.samples for m in misfits], dtype=float)
    known = [m for m in misfits if math.isfinite(m.normalised)]
    normalised = math.nan
    if known:
        squares = np.average([m.normalised**2 for m in known], weights=[m.samples for m in known])
        normalised = float(np.sqrt(squares))
    return Gap(
        channel=channel,
        unit=misfits[0].unit,
        phase=phase,
        rms=float(np.sqrt(np.average([m.rms**2 for m in misfits], weights=weights))),
        bias=float(np.average([m.bias for m in misfits], weights=weights)),
        peak=max(m.peak for m in misfits),
        normalised=normalised,
        size=size,
        trials=len(misfits),
    )


def worst_phase(found: Iterable[Gap]) -> str:
    """Return the phase in which a difference is largest against its noise; empty where that is not known."""
    known = [g for g in found if g.phase in PHASES and math.isfinite(g.normalised)]
    return max(known, key=lambda g: g.normalised).phase if known else ""
