"""The numbers of the answers: slip and k_92 by speed, and how far the model is from each channel."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from granite_lab.estimate import mean_over
from granite_lab.parameters import Paper
from granite_lab.reporting.rounding import Number, decided, shown_as, significant, tidy_unit, with_unit
from granite_lab.reporting.words import PHASES, quantity
from granite_lab.results import Gap, StudyResult, TrialResult

NOISE, CLEAR = 1.5, 3.0
"""Difference over noise up to which a channel agrees, and above which it differs clearly."""

SMALL, UNSEEN = 0.01, 0.2
"""Shares of a channel's largest value: a difference below the first is small; noise above the second is
too large for a judgement."""


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
