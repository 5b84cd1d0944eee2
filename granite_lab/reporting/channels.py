"""How well the model explains each quantity: the verdict by channel, and the tables of the differences."""

from __future__ import annotations

import math
from dataclasses import dataclass

from granite_lab.columns import Cell, Column, Table, number, words
from granite_lab.discovery.finding import Finding
from granite_lab.results import PHASES, PooledMisfit
from granite_lab.rounding import NONE, shown_as, significant, with_unit

AGREES = "agrees"

NOISE, CLEAR = 1.5, 3.0
"""Difference over noise up to which a channel agrees, and above which it differs clearly."""

SENSORS_OF = {
    "wheels": ("wheel", "wheel_split"), "torque_f": ("current_f",), "torque_r": ("current_r",),
    "accel": ("accel_x",), "pitch_rate": ("pitch_rate",),
}  # fmt: skip
"""Channel of a comparison to those of a search that see the same."""

SMALL, UNSEEN = 0.01, 0.2
"""Shares of a channel's largest value: a difference below the first is small; noise above the second is
too large for a judgement."""


@dataclass(frozen=True)
class ChannelAnswer:
    """How well the model explains one quantity over whole trials.

    Attributes:
        channel, name: as in `PooledMisfit`, and as a reader calls it.
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

    def size(self, value: float) -> Cell:
        """Return one of its numbers with the unit."""
        return Cell(
            f"{significant(value, 2)} {self.unit}" if math.isfinite(value) else NONE, (value, self.unit)
        )


CHANNEL_TABLE = Table[ChannelAnswer](
    "channels",
    "Simulated minus measured, by quantity",
    Column("quantity", lambda c: c.name),
    Column("verdict", lambda c: words(c.verdict, c.tone)),
    Column("difference, rms", lambda c: c.size(c.rms), "rms rms_unit"),
    Column("noise", lambda c: c.size(c.noise), "noise noise_unit"),
    Column("largest value", lambda c: c.size(c.largest), "largest largest_unit"),
    Column("largest difference", lambda c: c.worst),
    note="Root mean square of the difference over whole trials, beside the noise of the measurement (its "
    "standard deviation) and the largest simulated value. Points: percentage points of slip. “Differs, less "
    "than the noise”: seen only in the mean over repetitions, by the search for what is missing.",
)


def judged_channels(
    by_phase: dict[tuple[str, str], PooledMisfit], finding: Finding | None = None
) -> tuple[ChannelAnswer, ...]:
    """Judge each channel over whole trials.

    A search averages repetitions and sees smaller differences than a trial shows: no channel agrees in which
    it found the model to differ by more than the tolerance.
    """
    over = {g.channel for g in finding.gaps if g.train[0] > 1.0} if finding is not None else set()
    judged = []
    for gap in (g for g in by_phase.values() if g.phase == "all"):
        unit, scale = shown_as(gap.unit)
        noise = gap.rms / gap.normalised if gap.normalised > 0 else math.nan
        phases = [by_phase[gap.channel, p] for p in PHASES if p != "all" and (gap.channel, p) in by_phase]
        judged_phases = [g for g in phases if math.isfinite(g.normalised)]
        worst = PHASES[max(judged_phases, key=lambda g: g.normalised).phase] if judged_phases else ""
        sizes = (gap.rms * scale, noise * scale, gap.size * scale)
        verdict, tone = _judge(gap, noise)
        if verdict == AGREES and over.intersection(SENSORS_OF.get(gap.channel, ())):
            verdict, tone = "differs, less than the noise", "fair"
        judged.append(ChannelAnswer(gap.channel, gap.name, unit, *sizes, verdict, tone, worst))
    return tuple(judged)


def _judge(gap: PooledMisfit, noise: float) -> tuple[str, str]:
    if not math.isfinite(gap.normalised):
        return "not judged, noise not known", ""
    if gap.normalised <= NOISE:
        if gap.size > 0 and noise > UNSEEN * gap.size:
            return "not judged, too noisy", ""
        return AGREES, "good"
    if gap.size > 0 and gap.rms < SMALL * gap.size:
        return f"differs by under {with_unit(significant(100 * SMALL, 1), '%')}", "good"
    return ("differs", "fair") if gap.normalised <= CLEAR else ("differs clearly", "bad")


def _small(value: float, gap: PooledMisfit) -> Cell:
    return number(value, 2, scale=shown_as(gap.unit)[1])


MISFITS = Table[PooledMisfit](
    "misfits",
    "Simulated minus measured, by quantity and phase",
    Column("quantity", lambda g: g.name),
    Column("phase", lambda g: PHASES[g.phase]),
    Column("unit", lambda g: Cell(shown_as(g.unit)[0], (g.unit,))),
    Column("rms", lambda g: _small(g.rms, g), "rms_si"),
    Column("mean", lambda g: _small(g.bias, g), "bias_si"),
    Column("largest", lambda g: _small(g.peak, g), "peak_si"),
    Column("rms over noise", lambda g: g.normalised, "rms_over_noise", unit="–", digits=2),
    Column("trials", lambda g: g.trials, "trials"),
    note="Over all trials. The CSV file holds SI units, slip ratios as fractions.",
)
"""The difference in each quantity and phase."""
