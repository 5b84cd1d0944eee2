"""How much of the gap between model and trials closes, and whether it closes on trials left out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from granite_lab.discovery.finding import Finding, Gap
from granite_lab.reporting import canvas
from granite_lab.reporting.canvas import Drawing
from granite_lab.reporting.discovery import rows
from granite_lab.reporting.discovery.answers import closed, share_in_words, times
from granite_lab.reporting.discovery.names import channel_name, short, with_found
from granite_lab.reporting.discovery.residue import channels_of
from granite_lab.reporting.summary import IN_PHASE, PHASES

UNIT = "gap: rms over noise [–]"


@dataclass(frozen=True)
class Row:
    """One line of a gap figure: rms over noise before and after, and the floor; NaN where not known."""

    name: str
    values: tuple[tuple[float, float, float], ...]


def gap_drawing(finding: Finding) -> Drawing:
    """Draw the gap per channel and phase, on the trials of the fit and on trials left out."""
    table = {(g.channel, g.phase): g for g in finding.gaps} | {("all", "all"): finding.gap}
    channels = channels_of(finding)
    keys = [("all", "all"), *((c, "all") for c in channels), *(("all", p) for p in PHASES)]
    lines = [Row(_name(table[k]), (table[k].train, table[k].held_out)) for k in keys if k in table]
    figure = _dumbbells(lines, ("in the fit", "left out of the fit"), finding, (0.5, len(channels) + 0.5))
    return Drawing(
        "found_gap",
        f"The gap before and after, per channel and phase{canvas.data_tag(finding.virtual)}",
        _describe_gap(finding),
        "Root mean square difference between trials and model over the noise, without and with what was "
        "found, per channel and phase, for trials in the fit and left out of it.",
        figure,
    )


def _name(gap: Gap) -> str:
    if gap.channel != "all":
        return channel_name(gap.channel)
    return IN_PHASE.get(gap.phase, "everything")


def _dumbbells(
    lines: Sequence[Row], titles: Sequence[str], finding: Finding, rules: Sequence[float] = ()
) -> Figure:
    known = [v for line in lines for own in line.values for v in own if math.isfinite(v) and v > 0]
    low, high = 0.8 * min([*known, 0.9]), 1.25 * max([*known, 2.0])
    figure, axes = rows.panels(
        [line.name for line in lines],
        columns=len(titles),
        row=0.2,
        head=0.3,
        foot=rows.FOOT if len(titles) == 1 else 0.64,
    )
    with canvas.styled():
        for k, (axis, title) in enumerate(zip(axes, titles, strict=True)):
            before, after, floor = (np.array([line.values[k][i] for line in lines]) for i in range(3))
            y = np.arange(len(lines))
            axis.hlines(y, np.fmin(before, after), np.fmax(before, after), color=canvas.FAINT, linewidth=1.6)
            axis.plot(floor, y, "|", color=canvas.INK, markersize=8, label="noise floor")
            axis.plot(before, y, "o", color=rows.BEFORE, markersize=4.5, label="model without effects")
            if finding.effects:
                axis.plot(after, y, "D", color=rows.AFTER, markersize=4, label=with_found(finding))
            rows.log_axis(axis, low, high)
            axis.set_xlabel(UNIT if len(titles) == 1 else f"{title}\n{UNIT}")
            for at in rules:
                axis.axhline(at, color=canvas.FAINT, linewidth=0.6)
        if lines[0].name == "everything":
            axes[0].get_yticklabels()[0].set_fontweight("bold")
        rows.legend_on_top(figure, axes[0], 3)
        canvas.mark_virtual(figure, finding.virtual)
    return figure


def _describe_gap(finding: Finding) -> str:
    before, after, floor = finding.gap.held_out
    text = f"On trials left out, the model without effects is off by {times(before)} times the noise"
    if finding.effects:
        share = closed(finding.gap.held_out)
        part = (
            f" ({share_in_words(share).replace('of it', 'of the gap')} closes)"
            if math.isfinite(share)
            else ""
        )
        text += f", {with_found(finding)} by {times(after)}{part}"
    return f"{text}; noise alone, from what repetitions do not share, gives {times(floor)}."


def held_out_drawing(finding: Finding) -> Drawing | None:
    """Draw how well each trial and each speed is predicted by a fit that did not see it."""
    counts = _counts(finding)
    floor = finding.gap.held_out[2]
    lines = []
    for name, before, after in finding.trial_losses:
        n = counts.get(name, 0)
        if n:
            lines.append(Row(short(name), ((math.sqrt(before / n), math.sqrt(after / n), floor),)))
    for velocity, before, after in finding.losses:
        n = sum(counts.get(t, 0) for t in _trials_at(finding, velocity))
        if n:
            values = (math.sqrt(before / n), math.sqrt(after / n), floor)
            lines.append(Row(f"all at {velocity:g} m/s", (values,)))
    if not lines:
        return None
    rules = (len(finding.trial_losses) - 0.5,) if finding.losses else ()
    figure = _dumbbells(lines, ("",), finding, rules)
    return Drawing(
        "found_held_out",
        f"Trials and speeds predicted by a fit that did not see them{canvas.data_tag(finding.virtual)}",
        _describe_held_out(finding, lines),
        "Gap of each trial and of each speed when it was left out of the fit, without and with what was "
        "found.",
        figure,
    )


def _counts(finding: Finding) -> dict[str, int]:
    counts: dict[str, int] = {}
    for r in finding.residuals:
        counts[r.trial] = counts.get(r.trial, 0) + int(np.isfinite(r.measured).sum())
    return counts


def _trials_at(finding: Finding, velocity: float) -> set[str]:
    return {r.trial for r in finding.residuals if r.variant == velocity}


def _describe_held_out(finding: Finding, lines: Sequence[Row]) -> str:
    each = len(finding.trial_losses)
    if not finding.effects:
        return "Each line was predicted by a fit to the others; without an effect there is one dot a line."
    better = sum(after < before for _, before, after in finding.trial_losses)
    text = f"{with_found(finding).capitalize()}, {better} of {each} trials are predicted better by a fit to "
    text += "the others"
    if finding.losses:
        of = sum(after < before for _, before, after in finding.losses)
        text += f", and {of} of {len(finding.losses)} speeds by a fit to the other speeds"
    worst = max(lines, key=lambda line: line.values[0][1])
    return f"{text}; the furthest off: {worst.name} ({times(worst.values[0][1])} times the noise)."
