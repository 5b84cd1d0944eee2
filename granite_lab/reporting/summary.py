"""The numbers of the answers: slip and k_92 by speed, and how far the model is from each channel."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from granite_lab.comparison.record import Comparison, Misfit
from granite_lab.estimate import Estimate
from granite_lab.logs.trial import Array
from granite_lab.parameters import Paper
from granite_lab.reporting.content import StudyResult, TrialResult
from granite_lab.reporting.rounding import Number, decided, shown_as, significant, tidy_unit, with_unit
from granite_lab.reporting.words import PHASES, QUANTITIES, quantity

NOISE, CLEAR = 1.5, 3.0
"""Difference over noise up to which a channel agrees, and above which it differs clearly."""

SMALL, UNSEEN = 0.01, 0.2
"""Shares of a channel's largest value: a difference below the first is small; noise above the second is
too large for a judgement."""


def mean_of_known(values: Array, axis: int) -> Array:
    """Return the mean along an axis over what is finite; NaN where nothing is."""
    known = np.isfinite(values)
    count = known.sum(axis=axis)
    total = np.where(known, values, 0.0).sum(axis=axis)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


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
    stated = float(np.sqrt(np.sum(np.square([e.std for e in finite])))) / n
    scatter = float(np.std(values, ddof=1) / np.sqrt(n)) if n > 1 else math.nan
    half = float(np.fmax(1.959964 * stated, float(stdtrit(max(n - 1, 1), 0.975)) * scatter))
    mean = float(values.mean())
    return Mean(mean, float(np.fmax(stated, scatter)), mean - half, mean + half, n)


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
        slips = np.array([r.comparison.motion.slip_ratio.value for r in self.results])
        ranked = np.argsort(slips)  # NaN last
        return self.results[int(ranked[max(int(np.isfinite(slips).sum()) - 1, 0) // 2])]


def by_speed(result: StudyResult, paper: Paper) -> tuple[Speed, ...]:
    """Group the trials by desired velocity, to 0.01 m/s."""
    from granite_lab.fitting.likelihood import k92_interval  # noqa: PLC0415, heavy

    groups: dict[float, list[TrialResult]] = {}
    for trial in result.trials:
        groups.setdefault(round(trial.comparison.motion.variant.velocity, 2), []).append(trial)
    rows = []
    for velocity, trials in sorted(groups.items()):
        fits = [t.comparison.fit for t in trials]
        inner = [f for f in fits if f.status == "ok"]
        *slip, count = mean_over(t.comparison.motion.slip_ratio for t in trials)
        k92 = mean_over(f.k92 for f in inner)
        # The interval is by the likelihood where the covariance is not enough.
        ends = k92_interval(inner, (k92.low, k92.high))
        own = next((p for p in paper.table3 if abs(p.velocity - velocity) < 0.005), None)
        rows.append(
            Speed(
                velocity, tuple(trials), count, decided(*slip, unit="%", scale=100),
                decided(k92.value, k92.std, *ends),
                "at its limit" if all(f.status.endswith("bound") for f in fits) else "",
                # The paper prints three digits; the tail of 100 times a fraction is none of them.
                round(100 * own.slip_measured, 6) if own else math.nan, own.k92 if own else math.nan,
            )
        )  # fmt: skip
    return tuple(rows)


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


def gaps(comparisons: Sequence[Comparison]) -> dict[tuple[str, str], Gap]:
    """Pool the misfits of several trials, weighted by samples; (channel, phase) to gap.

    The speeds of the four wheels are one channel, "wheels".
    """
    pooled: dict[tuple[str, str], list[Misfit]] = {}
    sizes: dict[str, float] = {}
    for c in comparisons:
        largest = {}
        for name in {m.channel for m in c.misfits} & c.simulated.keys():
            values = np.abs(c.simulated[name])
            values = values[np.isfinite(values)]
            largest[name] = float(np.percentile(values, 99.5)) if values.size else 0.0
        for m in c.misfits:
            channel = "wheels" if m.channel.startswith("wheel_") else m.channel
            sizes[channel] = max(sizes.get(channel, 0.0), largest.get(m.channel, 0.0))
            if m.samples and math.isfinite(m.rms):
                pooled.setdefault((channel, m.phase), []).append(m)
    order, phases = [*QUANTITIES, *sorted(sizes.keys() - QUANTITIES)], ["all", *PHASES]
    keys = [(c, p) for c in order for p in phases if (c, p) in pooled]
    return {key: _pool(*key, sizes[key[0]], pooled[key]) for key in keys}


def _pool(channel: str, phase: str, size: float, misfits: list[Misfit]) -> Gap:
    def mean(values: list[float], of: list[Misfit]) -> float:
        return float(np.average(values, weights=[m.samples for m in of]))

    known = [m for m in misfits if math.isfinite(m.normalised)]
    rms = math.sqrt(mean([m.rms**2 for m in misfits], misfits))
    normalised = math.sqrt(mean([m.normalised**2 for m in known], known)) if known else math.nan
    bias, peak = mean([m.bias for m in misfits], misfits), max(m.peak for m in misfits)
    return Gap(channel, misfits[0].unit, phase, rms, bias, peak, normalised, size, len(misfits))


@dataclass(frozen=True)
class ChannelAnswer:
    """How well the model explains one quantity over whole trials.

    Attributes:
        channel, name: as in `Gap`, and as a reader calls it.
        unit: of `rms`, `noise` (std of the measurement) and `largest` (simulated magnitude), as printed.
        verdict, tone: in words.
        worst: phase in which the difference is largest against the noise.
    """

    channel: str
    name: str
    unit: str
    rms: float
    noise: float
    largest: float
    verdict: str
    tone: str
    worst: str

    @property
    def differs(self) -> bool:
        """Whether simulation and measurement differ by more than the noise."""
        return self.tone in ("fair", "bad")


def channels_of(found: dict[tuple[str, str], Gap]) -> tuple[ChannelAnswer, ...]:
    """Judge each channel over whole trials."""
    judged = []
    for gap in (g for g in found.values() if g.phase == "all"):
        unit, scale = shown_as(gap.unit)
        noise = gap.rms / gap.normalised if gap.normalised > 0 else math.nan
        phases = [found[gap.channel, p] for p in PHASES if (gap.channel, p) in found]
        known = [g for g in phases if math.isfinite(g.normalised)]
        worst = PHASES[max(known, key=lambda g: g.normalised).phase] if known else ""
        sizes = (gap.rms * scale, noise * scale, gap.size * scale)
        judged.append(
            ChannelAnswer(
                gap.channel, quantity(gap.channel), tidy_unit(unit), *sizes, *_judge(gap, noise), worst
            )
        )
    return tuple(judged)


def _judge(gap: Gap, noise: float) -> tuple[str, str]:
    if not math.isfinite(gap.normalised):
        return "not judged, noise not known", ""
    if gap.normalised <= NOISE:
        if gap.size > 0 and noise > UNSEEN * gap.size:
            return "not judged, noise too large", ""
        return "agrees", "good"
    if gap.size > 0 and gap.rms < SMALL * gap.size:
        return f"differs by less than {with_unit(significant(100 * SMALL, 1), '%')}", "good"
    return ("differs", "fair") if gap.normalised <= CLEAR else ("differs clearly", "bad")
