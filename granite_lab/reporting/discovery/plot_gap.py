"""How much of the gap between model and trials closes, and whether it closes on trials left out."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from granite_lab.discovery.finding import Finding
from granite_lab.reporting import canvas
from granite_lab.reporting.canvas import Drawing
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
from granite_lab.reporting.rounding import significant

Pair = tuple[float, float]
"""Before and after; NaN where not known."""

GAP = "gap [–]"


def gap_drawing(finding: Finding) -> Drawing:
    """Draw the gap per channel, on the trials of the fit and on trials left out."""
    table = {g.channel: g for g in finding.gaps} | {"all": finding.gap}
    shown = [table[c] for c in ("all", *channels_of(finding)) if c in table]
    names = ["everything", *(channel_name(g.channel) for g in shown[1:])]
    panels = [("in the fit", [g.train for g in shown])]
    if any(math.isfinite(v) for g in shown for v in g.held_out):
        panels.append(("left out of the fit", [g.held_out for g in shown]))
    figure = _dumbbells(names, panels, finding, unit=GAP, line=1.0, label="noise and tolerance", rules=(0.5,))
    before, after = finding.gap.held_out if len(panels) == 2 else finding.gap.train
    where = "On trials left out" if len(panels) == 2 else "In the fit"
    text = (
        f"{where}, the model without effects is off by {times(before)} times what noise and tolerance explain"
    )
    text += f", {with_found(finding)} by {times(after)}." if finding.effects else "."
    return Drawing(
        "found_gap",
        f"The gap of each channel, before and after{canvas.data_tag(finding.virtual)}",
        text,
        "Root mean square of the residuals over what noise and tolerance explain, without and with what was "
        "found, per channel, for trials in the fit and left out of it.",
        figure,
    )


def discrepancy_drawing(finding: Finding) -> Drawing | None:
    """Draw the discrepancy of each channel in percent of its rms, before and after; None without any."""
    shares = {c: (100 * b, 100 * a) for c, (b, a) in discrepancies(finding).items() if math.isfinite(b)}
    if not shares:
        return None
    names = [channel_name(c) for c in shares]
    figure = _dumbbells(
        names, [("", list(shares.values()))], finding, unit="discrepancy over the channel's rms [%]",
        line=100 * finding.tolerance, label="tolerance",
    )  # fmt: skip
    worst = max(shares, key=lambda c: shares[c][0])
    before, after = (significant(v, 2) for v in shares[worst])
    text = f"Largest without effects: {spoken(worst)}, {before} % of its rms"
    text += f", {with_found(finding)} {after} %" if finding.effects else ""
    return Drawing(
        "found_discrepancy",
        f"What the repetitions share and the model does not explain{canvas.data_tag(finding.virtual)}",
        f"{text}; up to {percent(finding.tolerance)} does not matter.",
        "Discrepancy of the model per channel in percent of the channel's rms in motion, without and with "
        "what was found.",
        figure,
    )


def held_out_drawing(finding: Finding) -> Drawing | None:
    """Draw how well each trial and each speed is predicted by a fit that did not see it; None without any."""
    trials, speeds = finding.trials_left_out, finding.speeds_left_out
    lines = {short(x.name): (x.before, x.after) for x in trials}
    lines |= {f"all at {x.name} m/s": (x.before, x.after) for x in speeds}
    if not lines:
        return None
    rules = (len(trials) - 0.5,) if trials and speeds else ()
    figure = _dumbbells(
        list(lines), [("", list(lines.values()))], finding, unit=GAP, line=1.0, label="noise and tolerance",
        rules=rules,
    )  # fmt: skip
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
    return Drawing(
        "found_held_out",
        f"Trials and speeds predicted by a fit that did not see them{canvas.data_tag(finding.virtual)}",
        text,
        "Gap of each trial and of each speed that was left out of the fit, before and after.",
        figure,
    )


def _dumbbells(
    names: Sequence[str],
    panels: Sequence[tuple[str, Sequence[Pair]]],
    finding: Finding,
    *,
    unit: str,
    line: float,
    label: str,
    rules: Sequence[float] = (),
) -> Figure:
    """Draw before and after of each row, and a line that says how good is good enough.

    Args:
        names: of the rows.
        panels: title and values of each, beside each other.
        finding: says whether there is an "after".
        unit: of the x axis.
        line: place of that line.
        label: of that line.
        rules: rows between which a line is drawn.
    """
    known = [v for _, pairs in panels for pair in pairs for v in pair if math.isfinite(v) and v > 0]
    low, high = 0.8 * min([*known, 0.9 * line]), 1.25 * max([*known, 2.0 * line])
    foot = rows.FOOT if len(panels) == 1 else 0.64
    figure, axes = rows.panels(names, columns=len(panels), row=0.2, head=0.3, foot=foot)
    with canvas.styled():
        for axis, (title, pairs) in zip(axes, panels, strict=True):
            before, after = np.fmax(np.array(pairs).T, 1.05 * low)
            y = np.arange(len(names))
            axis.axvline(line, color=canvas.INK, linewidth=1.0, linestyle=(0, (4, 1.5)), label=label)
            if finding.effects:
                axis.hlines(
                    y, np.fmin(before, after), np.fmax(before, after), color=canvas.FAINT, linewidth=1.6
                )
            axis.plot(before, y, "o", color=rows.BEFORE, markersize=4.5, label="without effects")
            if finding.effects:
                axis.plot(after, y, "D", color=rows.AFTER, markersize=4, label=with_found(finding))
            rows.log_axis(axis, low, high)
            axis.set_xlabel(f"{title}\n{unit}" if title else unit)
            for at in rules:
                axis.axhline(at, color=canvas.FAINT, linewidth=0.6)
        if names[0] == "everything":
            axes[0].get_yticklabels()[0].set_fontweight("bold")
        rows.legend_on_top(figure, axes[0], 3)
        canvas.mark_virtual(figure, finding.virtual)
    return figure
