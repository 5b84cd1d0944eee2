"""What a search for the missing effect found, on the clock of one trial."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from granite_lab.comparison.record import Comparison
from granite_lab.discovery.finding import Finding, Residual
from granite_lab.reporting.names import channel_name, effects_in_words, latency_in_words, percent
from granite_lab.reporting.recording.events import Event, Interval
from granite_lab.reporting.recording.signals import (
    GREEN,
    GREY,
    MEASURED,
    MEDIUM,
    ORANGE,
    VERMILION,
    Line,
    command_start,
)

BEFORE, AFTER = VERMILION, GREEN
UNITS = {"m/s^2": "m/s²"}


def intervals_of(finding: Finding, comparison: Comparison) -> list[Interval]:
    """Return where the model without effects disagrees with a trial, on the comparison's clock.

    A disagreement is shared by the repetitions of a command, so that it holds for each of its trials.
    """
    own = _residuals(finding, comparison)
    if not own:
        return []
    late = own[0].t_start - command_start(comparison)
    return [
        Interval(d.start + late, d.end + late, channel_name(d.channel), f"{percent(d.share)} of the rms")
        for d in finding.where
        if d.variant == own[0].variant
    ]


def found_lines(finding: Finding, comparison: Comparison) -> Iterator[Line]:
    """Yield what the sensors read beside the simulation without and with what was found, and the discrepancy.

    Wheel angles grow all the time, so that of them the difference to the simulation is drawn.
    """
    named = bool(finding.effects)
    for r in _residuals(finding, comparison):
        t = r.t + r.t_start - command_start(comparison)
        if r.unit == "rad":
            drawn = [("measured − before", r.measured - r.before, BEFORE)]
            drawn += [("measured − after", r.measured - r.after, AFTER)] if named else []
        else:
            drawn = [("measured", r.measured, MEASURED), ("before", r.before, BEFORE)]
            drawn += [("after", r.after, AFTER)] if named else []
        yield _line(f"found_{r.channel}/lines", r, t, drawn)
        left = [("discrepancy before", r.discrepancy_before, ORANGE)]
        left += [("discrepancy after", r.discrepancy_after, AFTER)] if named else []
        left += [
            (f"{sign}2σ", r.discrepancy_after + 2 * k * r.std, GREY) for sign, k in (("−", -1), ("+", 1))
        ]
        yield _line(f"discrepancy_{r.channel}/lines", r, t, left, step=MEDIUM)


def _line(
    entity: str, r: Residual, t: np.ndarray, drawn: list[tuple[str, np.ndarray, tuple[int, int, int]]],
    step: float = 0.0,
) -> Line:  # fmt: skip
    names, values, colours = zip(*drawn, strict=True)
    unit = UNITS.get(r.unit, r.unit)
    return Line(entity, tuple(f"{n} [{unit}]" for n in names), t, np.column_stack(values), colours, step=step)


def found_events(finding: Finding, comparison: Comparison) -> Iterator[Event]:
    """Yield what was found, as log lines at the start of the trial; for one that was dropped, why."""
    t = float(comparison.motion.t[0] - command_start(comparison))
    for trial, reason in finding.dropped:
        if trial == comparison.motion.trial:
            yield Event(t, f"left out of the search: {reason}", "WARN")
    if not _residuals(finding, comparison):
        return
    yield Event(t, effects_in_words(finding), "INFO" if finding.verdict == "none" else "WARN")
    if latency := latency_in_words(finding.latency):
        yield Event(t, latency)


def _residuals(finding: Finding, comparison: Comparison) -> list[Residual]:
    return [r for r in finding.residuals if r.trial == comparison.motion.trial]
