"""The tables that say how good model and estimates are, and what they were made from."""

from __future__ import annotations

import math

from granite_lab.reporting.content import StudyResult
from granite_lab.reporting.rounding import NONE, shown_as, significant, tidy_unit
from granite_lab.reporting.study_tables import data_cell
from granite_lab.reporting.summary import Gap, worst_of
from granite_lab.reporting.table import Cell, Table, columns, count, number, words

TONES = {"within the noise": "good", "small gap": "good", "visible gap": "fair", "large gap": "bad"}


def channel_table(found: dict[tuple[str, str], Gap], virtual: bool) -> Table:
    """Return how well the model explains each channel over whole trials: the table of the first page."""
    rows = []
    for gap in (gap for gap in found.values() if gap.phase == "all"):
        unit, scale = shown_as(gap.unit)
        worst = worst_of(g for g in found.values() if g.channel == gap.channel)
        rows.append(
            (
                words(gap.name), words(gap.word, TONES.get(gap.word, "")),
                Cell(f"{significant(gap.rms * scale, 2)} {tidy_unit(unit)}", (gap.rms, gap.unit)),
                number(gap.normalised, 2), number(gap.relative, 2, scale=100),
                words(worst.phase if worst else NONE),
                data_cell(virtual),
            )
        )  # fmt: skip
    return Table(
        "channels", "How well the model explains each channel",
        "Simulated minus measured over whole trials, beside the noise of the measurement (1: at the "
        "noise) and the largest value of the channel. Below 1 % of that a gap is small, however quiet "
        "the sensor.",
        columns(
            "channel", "verdict", ("misfit, rms", ("rms", "unit")), ("over noise", ("rms_over_noise",)),
            ("of largest value [%]", ("rms_over_largest",)), "worst phase", "data",
        ),
        tuple(rows),
    )  # fmt: skip


def misfit_table(found: dict[tuple[str, str], Gap], virtual: bool) -> Table:
    """Return the misfit per channel and phase."""
    rows = []
    for (_, phase), gap in found.items():
        unit, scale = shown_as(gap.unit)
        rows.append(
            (
                words(gap.name), words(phase), words(tidy_unit(unit)), number(gap.rms, 2, scale=scale),
                number(gap.bias, 2, scale=scale),
                number(gap.peak, 2, scale=scale), number(gap.normalised, 2), count(gap.trials),
                data_cell(virtual),
            )
        )  # fmt: skip
    return Table(
        "misfits", "Misfit per channel and phase, over all trials",
        "Simulated minus measured: root mean square, mean, largest; the CSV holds them in SI units, slip "
        "ratios as fractions.",
        columns(
            "channel", "phase", "unit", ("rms", ("rms_si",)), ("mean", ("bias_si",)),
            ("largest", ("peak_si",)),
            ("rms over noise", ("rms_over_noise",)), ("trials", ("trials",)), "data",
        ),
        tuple(rows),
    )  # fmt: skip


def health_table(result: StudyResult) -> Table:
    """Return the verdicts on the filter."""
    rows = []
    for r in result.trials:
        h = r.comparison.motion.health
        nis = ", ".join(f"{kind.replace('_', ' ')} {significant(value, 2)}" for kind, value in h.nis.items())
        white = ", ".join(
            f"{kind.replace('_', ' ')} {_chance(h.ljung_box.get(kind, math.nan))} ({significant(r, 1)})"
            for kind, r in h.whiteness.items()
            if math.isfinite(r)
        )
        rest = sum(end - start for start, end in h.rests)
        rows.append(
            (
                words(r.trial.name), data_cell(r.trial.info.virtual),
                words("good" if h.good else "doubtful", "good" if h.good else "bad"), number(rest, 2),
                words(nis or NONE), words(white or NONE), words(h.verdict),
            )
        )  # fmt: skip
    return Table(
        "health", "Health of the estimates",
        "NIS is the mean normalised innovation squared: 1 is ideal, below 1 cautious, above 1 overconfident. "
        "Successive innovations should be independent: the probability that chance alone makes them "
        "correlate as they do (Ljung and Box, ten lags; small: they are not independent), and their "
        "correlation in brackets (0 is ideal).",
        columns(
            "trial", "data", "filter", ("at rest [s]", ("rest_s",)), "NIS per update",
            "chance of such correlation", "verdict",
        ),
        tuple(rows),
    )  # fmt: skip


def _chance(probability: float) -> str:
    """Write a probability; below one in a thousand only that."""
    return "<0.001" if probability < 0.001 else significant(probability, 1)
