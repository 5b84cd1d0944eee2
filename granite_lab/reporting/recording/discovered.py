"""What a search for the missing effect found, on the clock of one trial."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from granite_lab.comparison.record import Comparison
from granite_lab.discovery.finding import Finding, Residual
from granite_lab.reporting.discovery.names import channel_name, effects_in_words
from granite_lab.reporting.recording.events import Event, Interval
from granite_lab.reporting.recording.signals import GREEN, MEASURED, VERMILION, Line, command_start

BEFORE, AFTER = VERMILION, GREEN
UNITS = {"m/s^2": "m/s²"}


def intervals_of(finding: Finding, comparison: Comparison) -> list[Interval]:
    """Return where the model without effects disagrees with a trial, on the comparison's clock.

    A disagreement is found in the mean over the repetitions of a command, so that it holds for each
    of its trials.
    """
    own = _residuals(finding, comparison)
    if not own:
        return []
    late = own[0].t_start - command_start(comparison)
    return [
        Interval(d.start + late, d.end + late, channel_name(d.channel), f"{d.strength:.1f} × noise")
        for d in finding.where
        if d.variant == own[0].variant
    ]


def found_lines(finding: Finding, comparison: Comparison) -> Iterator[Line]:
    """Yield what the sensors read beside the simulation without and with what was found.

    Wheel angles grow all the time, so that of them the difference to the measurement is drawn.
    """
    named = bool(finding.effects)
    for r in _residuals(finding, comparison):
        unit = UNITS.get(r.unit, r.unit)
        t = r.t + r.t_start - command_start(comparison)
        angle = r.unit == "rad"
        less = " − measured" if angle else ""
        drawn = [] if angle else [("measured", r.measured, MEASURED)]
        drawn.append((f"before{less}", r.before - r.measured if angle else r.before, BEFORE))
        if named:
            drawn.append((f"after{less}", r.after - r.measured if angle else r.after, AFTER))
        names, values, colours = zip(*drawn, strict=True)
        yield Line(
            f"found_{r.channel}/lines",
            tuple(f"{name} [{unit}]" for name in names),
            t,
            np.column_stack(values),
            colours,
        )


def found_events(finding: Finding, comparison: Comparison) -> Iterator[Event]:
    """Yield what was found, as log lines at the start of the trial."""
    if not _residuals(finding, comparison):
        return
    t = float(comparison.motion.t[0] - command_start(comparison))
    yield Event(t, effects_in_words(finding), "INFO" if finding.verdict == "none" else "WARN")


def _residuals(finding: Finding, comparison: Comparison) -> list[Residual]:
    return [r for r in finding.residuals if r.trial == comparison.motion.trial]
