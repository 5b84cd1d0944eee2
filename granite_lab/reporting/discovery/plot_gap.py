"""How much of the gap between model and trials closes, and whether it closes on trials left out."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure as Canvas

from granite_lab.discovery.finding import Finding
from granite_lab.reporting import canvas
from granite_lab.reporting.discovery import rows
from granite_lab.reporting.discovery.answers import percent, times
from granite_lab.reporting.discovery.names import (
    capital,
    channel_name,
    channels_of,
    short,
    spoken,
    with_found,
)
from granite_lab.reporting.discovery.residue import discrepancies
from granite_lab.reporting.figures import Figure
from granite_lab.reporting.rounding import significant

Pair = tuple[float, float]
"""Before and after; NaN where not known."""

GAP = "gap [–]"


def gap_drawing(finding: Finding) -> Figure:
    """Draw the gap over all channels, in the fit and on trials left out, and of each channel in the fit."""
    whole, known = finding.gap, {g.channel: g for g in finding.gaps}
    lines = {"all channels": whole.train}
    left_out = math.isfinite(whole.held_out[0])
    if left_out:
        lines["all, trials left out"] = whole.held_out
    first = len(lines)
    lines |= {channel_name(c): known[c].train for c in channels_of(finding) if c in known}
    figure = _dumbbells(lines, finding, unit=GAP, line=1.0, label="noise and tolerance", rule=first)
    before, after = whole.held_out if left_out else whole.train
    where = "On trials left out" if left_out else "In the fit"
    text = (
        f"{where}, the model without effects is off by {times(before)} times what noise and tolerance explain"
    )
    text += f", {with_found(finding)} by {times(after)}." if finding.effects else "."
    return Figure(
        "found_gap",
        f"The gap of each channel, before and after{canvas.data_tag(finding.virtual)}",
        text,
        "Root mean square of the residuals over what noise and tolerance explain, without and with what was "
        "found, over all channels and per channel.",
        lambda: figure,
    )


def discrepancy_drawing(finding: Finding) -> Figure | None:
    """Draw the discrepancy of each channel in percent of its rms, before and after; None without any."""
    shares = {c: (100 * b, 100 * a) for c, (b, a) in discrepancies(finding).items() if math.isfinite(b)}
    if not shares:
        return None
    lines = {channel_name(c): pair for c, pair in shares.items()}
    unit = "discrepancy over the channel's rms [%]"
    figure = _dumbbells(lines, finding, unit=unit, line=100 * finding.tolerance, label="tolerance")
    worst = max(shares, key=lambda c: shares[c][0])
    before, after = (significant(v, 2) for v in shares[worst])
    text = f"Largest without effects: {spoken(worst)}, {before} % of its rms"
    text += f", {with_found(finding)} {after} %" if finding.effects else ""
    return Figure(
        "found_discrepancy",
        f"What the repetitions share and the model does not explain{canvas.data_tag(finding.virtual)}",
        f"{text}; up to {percent(finding.tolerance)} does not matter.",
        "Discrepancy of the model per channel in percent of the channel's rms in motion, without and with "
        "what was found.",
        lambda: figure,
    )


def held_out_drawing(finding: Finding) -> Figure | None:
    """Draw how well each trial and each speed is predicted by a fit that did not see it; None without any."""
    trials, speeds = finding.trials_left_out, finding.speeds_left_out
    lines = {short(x.name): (x.before, x.after) for x in trials}
    lines |= {f"all at {x.name} m/s": (x.before, x.after) for x in speeds}
    if not lines:
        return None
    rule = len(trials) if trials and speeds else 0
    figure = _dumbbells(lines, finding, unit=GAP, line=1.0, label="noise and tolerance", rule=rule)
    text = "Each line was predicted by a fit to the others."
    if finding.effects:
        better = [
            f"{sum(x.after < x.before for x in own)} of {len(own)} {what}"
            for own, what in ((trials, "trials"), (speeds, "speeds")) if own
        ]  # fmt: skip
        worst = max(lines, key=lambda name: lines[name][1])
        text = (
            f"{capital(with_found(finding))}, {' and '.join(better)} are predicted better by a fit to the "
            f"others; the furthest off: {worst} ({times(lines[worst][1])})."
        )
    return Figure(
        "found_held_out",
        f"Trials and speeds predicted by a fit that did not see them{canvas.data_tag(finding.virtual)}",
        text,
        "Gap of each trial and of each speed that was left out of the fit, before and after.",
        lambda: figure,
    )


def _dumbbells(
    lines: Mapping[str, Pair], finding: Finding, *, unit: str, line: float, label: str, rule: int = 0
) -> Canvas:
    """Draw before and after of each row, and a line that says how good is good enough.

    Args:
        lines: name of each row to its values.
        finding: says whether there is an "after".
        unit: of the x axis.
        line: place of that line.
        label: of that line.
        rule: number of rows above a thin line; 0 draws none.
    """
    known = [v for pair in lines.values() for v in pair if math.isfinite(v) and v > 0]
    low, high = 0.8 * min([*known, 0.9 * line]), 1.25 * max([*known, 2.0 * line])
    figure, (axis,) = rows.panels(list(lines), row=0.2, head=0.3)
    with canvas.styled():
        before, after = np.maximum(np.array(list(lines.values())).T, 1.05 * low)
        y = np.arange(len(lines))
        axis.axvline(line, color=canvas.INK, linewidth=1.0, linestyle=(0, (4, 1.5)), label=label)
        if finding.effects:
            axis.hlines(y, np.fmin(before, after), np.fmax(before, after), color=canvas.FAINT, linewidth=1.6)
        axis.plot(before, y, "o", color=rows.BEFORE, markersize=4.5, label="without effects")
        if finding.effects:
            axis.plot(after, y, "D", color=rows.AFTER, markersize=4, label=with_found(finding))
        rows.log_axis(axis, low, high)
        axis.set_xlabel(unit)
        if rule:
            axis.axhline(rule - 0.5, color=canvas.FAINT, linewidth=0.6)
        rows.legend_on_top(figure, axis, 3)
        canvas.mark_virtual(figure, finding.virtual)
    return figure
