"""Figures of a search: the gap without and with effects, candidates, and when model and sensors disagree."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from textwrap import wrap

import numpy as np
from matplotlib.ticker import MaxNLocator

from granite_lab.discovery.finding import Candidate, Finding, Residual
from granite_lab.logs.counters import mean_known
from granite_lab.logs.trial import Array
from granite_lab.parameters import by_speed
from granite_lab.reporting import canvas
from granite_lab.reporting.answers import gap_pair
from granite_lab.reporting.canvas import AFTER, BEFORE, Canvas, Figure
from granite_lab.reporting.names import (
    STATUS,
    capital,
    lines_link,
    listed,
    plain,
    sensor,
    sensors_of,
    speed_stem,
    with_effects,
)
from granite_lab.rounding import places, shown_as, significant, times

Pair = tuple[float, float]
"""Before and after; NaN where not known."""

SHOWN = 3
"""Channels of a time history: those in which the gap is largest."""
KEYS_LEFT = 0.06
"""Where legends of named rows begin, from the left edge of the figure [in]."""


def gap_figure(finding: Finding) -> Figure:
    """Draw the gap over all sensors, in the fit and on trials left out, and of each sensor in the fit."""
    whole, by_channel = finding.gap, {g.channel: g for g in finding.gaps}
    lines = {"all sensors": whole.train}
    if math.isfinite(whole.held_out[0]):
        lines["trials left out"] = whole.held_out
    first = len(lines)
    lines |= {sensor(c): by_channel[c].train for c in sensors_of(finding) if c in by_channel}
    before, after, where = gap_pair(finding)
    title = f"The gap between sensors and model is {times(before)}; noise and tolerance explain 1"
    if finding.terms:
        title = (
            f"{capital(with_effects(finding))}, the gap falls from {times(before)} to {times(after)} {where}"
        )
    caption = (
        "Above the line: rms of all residuals, divided by the rms that noise and tolerance explain. Below: "
        "largest discrepancy of each sensor beyond its noise, divided by the tolerance."
    )
    return Figure("found_gap", title, caption, partial(_dumbbells, lines, finding, first), finding.virtual)


def _dumbbells(lines: Mapping[str, Pair], finding: Finding, rule: int) -> Canvas:
    """Draw before and after of each row; a thin line stands above row number `rule`."""
    before, after = pairs = np.array(list(lines.values())).T
    high = max([*pairs[np.isfinite(pairs)], 2.0])
    figure, (axis,) = canvas.named_rows(list(lines), row=0.2)
    y = np.arange(len(lines))
    axis.axvline(1.0, color=canvas.INK, linewidth=1.0, linestyle=(0, (4, 1.5)))
    axis.plot(before, y, "o", color=BEFORE, markersize=4.5, label="paper's model")
    if finding.terms:
        axis.hlines(
            y, np.fmin(before, after), np.fmax(before, after), color=canvas.FAINT, linewidth=1.6, zorder=1
        )
        axis.plot(after, y, "D", color=AFTER, markersize=4, label=with_effects(finding))
    for k, pair in enumerate(lines.values()):
        text = " → ".join(times(x) for x in (pair if finding.terms else pair[:1]))
        axis.text(1.42 * high, k, text, ha="right", va="center", fontsize=7.5)
    axis.set(xlim=(-0.04 * high, 1.45 * high), xlabel="gap (1 or less: explained) [–]")
    axis.set_xticks([x for x in MaxNLocator(5).tick_values(0, high) if 0 <= x <= high])
    axis.axhline(rule - 0.5, color=canvas.FAINT, linewidth=0.6)
    canvas.legend(axis, left=KEYS_LEFT)
    return figure


MARKERS = {
    "named": "o", "twin": "s", "described": "^", "small": "v", "less likely": "D", "screened": ".",
    "at a bound": "x",
}  # fmt: skip


def candidates_figure(finding: Finding) -> Figure | None:
    """Draw probability and closed share of all candidates; None without any."""
    every = finding.candidates
    if not every:
        return None
    named = [plain(e.id) for e in finding.effects]
    unknown = finding.verdict == "unknown"
    title = "No candidate explains the disagreement" if unknown else "No candidate is needed"
    if named:
        are = "is" if len(named) == 1 else "are"
        title = f"Of {len(every)} candidates, {listed(named)} {are} in the model"
    caption = (
        "Probability that the effect is in the model, and share of the gap that it closes alone. "
        "Candidates that were screened out were not fitted in full."
    )
    return Figure("found_candidates", title, caption, partial(_candidates, every), finding.virtual)


def _candidates(shown: Sequence[Candidate]) -> Canvas:
    names = ["\n".join(wrap(plain(c.id), 38)) for c in shown]
    figure, (left, right) = canvas.named_rows(names, columns=2, row=0.17, left=2.1)
    for status in dict.fromkeys(c.status for c in shown):
        rows = [(i, c) for i, c in enumerate(shown) if c.status == status]
        closes = [100 * float(np.clip(c.closes, -0.5, 1.0)) for _, c in rows]
        for axis, x in ((left, [100 * c.probability for _, c in rows]), (right, closes)):
            axis.plot(
                x, [i for i, _ in rows], linestyle="none", marker=MARKERS[status], markersize=5,
                color=canvas.FITTED if status == "named" else canvas.GREY, label=STATUS[status],
                clip_on=False,
            )  # fmt: skip
    for label, c in zip(left.get_yticklabels(), shown, strict=True):
        label.set_fontweight("bold" if c.status == "named" else "normal")
    left.set(xlim=(-8, 105), xlabel="probability [%]")
    lowest = min([-8.0, *(100 * c.closes for c in shown if math.isfinite(c.closes))])
    right.set(xlim=(max(lowest, -50) - 5, 105), xlabel="closes alone [%]")
    canvas.legend(left, left=KEYS_LEFT)
    return figure


def intervals_figure(finding: Finding) -> Figure | None:
    """Draw the intervals of disagreement over time, one panel per speed; None without any."""
    if not finding.where:
        return None
    worst, n = max(finding.where, key=lambda d: d.share), len(finding.where)
    where = f"from {places(worst.start, 2)} s to {places(worst.end, 2)} s"
    most = f"most in the {sensor(worst.channel)} at {worst.variant:g} m/s {where}"
    title, many = f"The paper's model disagrees {most}", "One interval" if n == 1 else f"{n} intervals"
    caption = f"{many} in which a sensor and the model differ by more than the tolerance."
    return Figure("found_intervals", title, caption, partial(_intervals, finding), finding.virtual)


def _intervals(finding: Finding) -> Canvas:
    speeds, channels = by_speed(d.variant for d in finding.where), sensors_of(finding)
    heights, variants = [0.13 * len(channels)] * len(speeds), {d.variant for d in finding.where}
    figure, axes = canvas.panels(heights, frame=canvas.Frame(left=canvas.NAMES, gap=0.24), x=canvas.TIME)
    for axis, (speed, positions) in zip(axes, speeds.items(), strict=True):
        for d in (finding.where[i] for i in positions):
            axis.barh(channels.index(d.channel), d.end - d.start, 0.8, d.start, linewidth=0, color=BEFORE)
        canvas.name_rows(axis, [sensor(c) for c in channels], 6.5)
        canvas.key(axis, f"{speed:g} m/s")
    axes[0].set_xlim(-0.5, max(float(r.t[-1]) for r in finding.residuals if r.variant in variants))
    return figure


def history_figures(finding: Finding) -> list[Figure]:
    """Draw the sensors with the largest gap, one figure per speed: mean of the trials, and the model."""
    gap_of = {g.channel: g.train[0] for g in finding.gaps}
    ranked = sorted(sensors_of(finding), key=lambda c: -gap_of.get(c, 0.0))[:SHOWN]
    figures = []
    for velocity, positions in by_speed(r.variant for r in finding.residuals).items():
        at = [finding.residuals[i] for i in positions]
        at = [r for r in at if r.command == at[-1].command]  # of two commands at one speed the last is drawn
        groups = {c: [r for r in at if r.channel == c] for c in ranked}
        drawn = {c: mean_of(group) for c, group in groups.items() if group}
        if not drawn:
            continue
        n = max(map(len, groups.values()))
        title = f"{velocity:g} m/s: {_closer(finding, drawn)}"
        name = f"found_history_{speed_stem(velocity)}"
        count = f"Mean of {n} trials" if n > 1 else "One trial"
        caption = f"{count}. Grey: the paper's model disagrees by more than the tolerance."
        make, lines = partial(_history, finding, drawn), lines_link(speed=velocity, quantity="search")
        figures.append(Figure(name, title, caption, make, finding.virtual, lines))
    return figures


def _closer(finding: Finding, drawn: Mapping[str, Residual]) -> str:
    """Say which sensor comes closest with what was found."""
    both = {c: [(v - m.measured) ** 2 for v in (m.before, m.after)] for c, m in drawn.items()}
    squares = {c: [float(mean_known(x, 0)) for x in pair] for c, pair in both.items()}
    factor = {c: math.sqrt(before / after) for c, (before, after) in squares.items() if after > 0}
    best = max(factor, key=lambda c: factor[c], default="")
    if not finding.terms or not factor.get(best, 0.0) >= 1.1:
        return "readings of the sensors with the largest gap"
    return f"{sensor(best)} is {significant(factor[best], 2)} times closer {with_effects(finding)}"


def mean_of(group: Sequence[Residual]) -> Residual:
    """Return the mean over trials of one command; NaN where no trial was measured."""
    finite = np.array([np.isfinite(r.measured) for r in group])

    def average(name: str) -> Array:
        return mean_known(np.where(finite, [getattr(r, name) for r in group], np.nan), 0)

    return replace(group[0], measured=average("measured"), before=average("before"), after=average("after"))


def _history(finding: Finding, drawn: Mapping[str, Residual]) -> Canvas:
    units = [f"[{shown_as(m.unit)[0]}]" for m in drawn.values()]
    figure, axes = canvas.panels([1.1] * len(drawn), frame=canvas.Frame(head=0.46), y=units, x=canvas.TIME)
    for axis, (name, mean) in zip(axes, drawn.items(), strict=True):
        scale = shown_as(mean.unit)[1]
        zero = mean.before if mean.unit == "rad" else np.zeros_like(mean.before)
        for d in finding.where:
            if d.channel == name and d.variant == mean.variant:
                axis.axvspan(d.start, d.end, color=canvas.SHADE, linewidth=0, zorder=0)
        lines = [
            (mean.measured, canvas.MEASURED_LIGHT, 2.2, "measured"),
            (mean.before, BEFORE, 1.0, "paper's model"),
            *([(mean.after, AFTER, 1.0, with_effects(finding))] if finding.terms else ()),
        ]
        for values, colour, width, label in lines:
            axis.plot(mean.t, scale * (values - zero), color=colour, linewidth=width, label=label)
        canvas.key(axis, sensor(name) + (", minus the paper's model" if mean.unit == "rad" else ""))
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper left", ncols=3, bbox_to_anchor=(0.13, 1.0))
    t = next(iter(drawn.values())).t
    axes[0].set_xlim(float(t[0]), float(t[-1]))
    return figure
