"""What is missing: the gap before and after, the candidates, when the model disagrees, what could be seen."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from granite_lab.discovery.finding import Candidate, Finding, Residual
from granite_lab.logs.trial import Array
from granite_lab.reporting import canvas
from granite_lab.reporting.answers import gap_pair
from granite_lab.reporting.canvas import AFTER, BEFORE
from granite_lab.reporting.figures import Figure
from granite_lab.reporting.names import (
    STATUS,
    brief,
    capital,
    channel_name,
    channels_of,
    listed,
    plain,
    short,
    shown_candidates,
    times,
    with_found,
)
from granite_lab.reporting.rounding import places, significant, tidy_unit

Pair = tuple[float, float]
"""Before and after; NaN where not known."""

GAP = "gap over noise and tolerance [–]"
SHOWN = 3
"""Channels of a time history: those in which the gap is largest."""
FITTED = 12
"""Candidates that a figure shows at most."""


def gap_figure(finding: Finding) -> Figure:
    """Draw the gap over all sensors, in the fit and on trials left out, and of each sensor in the fit."""
    whole, known = finding.gap, {g.channel: g for g in finding.gaps}
    lines = {"all sensors": whole.train}
    if math.isfinite(whole.held_out[0]):
        lines["all, trials left out"] = whole.held_out
    first = len(lines)
    lines |= {channel_name(c): known[c].train for c in channels_of(finding) if c in known}
    before, after, where = gap_pair(finding)
    title = f"Sensors and model differ by {times(before)} times what noise and tolerance explain"
    if finding.effects:
        title = (
            f"{capital(with_found(finding))}, the gap falls from {times(before)} to {times(after)} {where}"
        )
    return Figure(
        "found_gap", title,
        "Root mean square of the residuals over what noise and tolerance explain, for the readings of each "
        "sensor.",
        "Root mean square of the residuals over what noise and tolerance explain, without and with the "
        "effects found, over all sensors and for each.",
        partial(_dumbbells, lines, finding, rule=first), finding.virtual,
    )  # fmt: skip


def held_out_figure(finding: Finding) -> Figure | None:
    """Draw how well each trial and each speed is predicted by a fit that did not see it; None without any."""
    trials, speeds = finding.trials_left_out, finding.speeds_left_out
    lines = {short(x.name): (x.before, x.after) for x in trials}
    lines |= {f"all at {x.name} m/s": (x.before, x.after) for x in speeds}
    if not lines:
        return None
    title = "Gap of each trial and speed that was left out of the fit"
    if finding.effects:
        own = ((trials, "trials"), (speeds, "speeds"))
        better = [f"{sum(x.after < x.before for x in f)} of {len(f)} {what}" for f, what in own if f]
        title = f"{capital(with_found(finding))}, {' and '.join(better)} are predicted better"
    return Figure(
        "found_held_out", title, "Each row is predicted by a fit to the other trials.",
        "Gap of each trial and of each speed that was left out of the fit, without and with the effects "
        "found.",
        partial(_dumbbells, lines, finding, rule=len(trials) if trials and speeds else 0), finding.virtual,
    )  # fmt: skip


def _dumbbells(lines: Mapping[str, Pair], finding: Finding, *, rule: int = 0) -> Canvas:
    """Draw before and after of each row; a thin line stands above row number `rule`."""
    known = [v for pair in lines.values() for v in pair if math.isfinite(v) and v > 0]
    low, high = 0.8 * min([*known, 0.9]), 1.25 * max([*known, 2.0])
    figure, (axis,) = canvas.named_rows(list(lines), row=0.2, head=0.3)
    with canvas.styled():
        before, after = np.maximum(np.array(list(lines.values())).T, 1.05 * low)
        y = np.arange(len(lines))
        axis.axvline(1.0, color=canvas.INK, linewidth=1.0, linestyle=(0, (4, 1.5)))
        if finding.effects:
            axis.hlines(y, np.fmin(before, after), np.fmax(before, after), color=canvas.FAINT, linewidth=1.6)
        axis.plot(before, y, "o", color=BEFORE, markersize=4.5, label="paper's model")
        if finding.effects:
            axis.plot(after, y, "D", color=AFTER, markersize=4, label=with_found(finding))
        canvas.log_axis(axis, low, high)
        axis.set_xlabel(GAP)
        if rule:
            axis.axhline(rule - 0.5, color=canvas.FAINT, linewidth=0.6)
        canvas.legend_on_top(figure, axis, 3)
        canvas.mark_virtual(figure, finding.virtual)
    return figure


MARKERS = {"named": "o", "twin": "s", "small": "v", "less likely": "D", "screened": ".", "at a bound": "x"}


def candidates_figure(finding: Finding) -> Figure | None:
    """Draw probability and closed share of the candidates that were fitted in full; None without any."""
    every = shown_candidates(finding)
    if not every:
        return None
    fitted = [c for c in every if math.isfinite(c.closes) or c.status == "named"]
    shown = (fitted or every)[:FITTED]
    named = [plain(c.id) for c in every if c.status == "named"]
    title = (
        "No candidate explains the disagreement" if finding.verdict == "unknown" else "No candidate is needed"
    )
    if named and finding.verdict == "named":
        title = (
            f"Of {len(every)} candidates, {listed(named)} {'is' if len(named) == 1 else 'are'} in the model"
        )
    more = len(every) - len(shown)
    rest = f" {more} others were screened out or are less likely; the table lists them." if more else ""
    return Figure(
        "found_candidates", title,
        "Posterior probability that the effect is in the model, and share of the gap that it closes "
        f"alone.{rest}",
        "Posterior probability of the candidate effects, and the share of the gap that each closes alone.",
        partial(_candidates, shown, finding), finding.virtual,
    )  # fmt: skip


def _candidates(shown: list[Candidate], finding: Finding) -> Canvas:
    figure, (left, right) = canvas.named_rows([brief(c.id) for c in shown], columns=2, row=0.2, head=0.45)
    with canvas.styled():
        for status, marker in MARKERS.items():
            own = [(i, c) for i, c in enumerate(shown) if c.status == status]
            if not own:
                continue
            y, colour = [i for i, _ in own], canvas.FITTED if status == "named" else canvas.GREY
            closes = [100 * float(np.clip(c.closes, -0.5, 1.0)) for _, c in own]
            for axis, x in ((left, [100 * c.probability for _, c in own]), (right, closes)):
                axis.plot(
                    x, y, linestyle="none", marker=marker, markersize=5, color=colour, label=STATUS[status],
                    clip_on=False,
                )  # fmt: skip
        for label, c in zip(left.get_yticklabels(), shown, strict=True):
            label.set_fontweight("bold" if c.status == "named" else "normal")
        left.set_xlim(-8, 105)
        left.set_xlabel("probability [%]")
        finite = [100 * c.closes for c in shown if math.isfinite(c.closes)]
        right.set_xlim(max(min([-8.0, *finite]), -50) - 5, 105)
        right.set_xlabel("closes alone [%]")
        canvas.legend_on_top(figure, left, 3)
        canvas.mark_virtual(figure, finding.virtual)
    return figure


def intervals_figure(finding: Finding) -> Figure | None:
    """Draw the intervals of disagreement over time, one panel per speed; None without any."""
    if not finding.where:
        return None
    worst, n = max(finding.where, key=lambda d: d.share), len(finding.where)
    where = f"from {places(worst.start, 2)} s to {places(worst.end, 2)} s"
    return Figure(
        "found_intervals",
        f"The paper's model disagrees most in the {channel_name(worst.channel)} at {worst.variant:g} m/s "
        f"{where}",
        f"{'One interval' if n == 1 else f'{n} intervals'} in which sensor and model differ by more than "
        "the tolerance. Colour: difference over the rms of the sensor in motion.",
        "Bars over time, per speed and sensor, where the model without effects disagrees with the trials "
        "by more than the tolerance.",
        partial(_intervals, finding), finding.virtual,
    )  # fmt: skip


TICKS = [1, 2, 5, 10, 20, 50]


def _intervals(finding: Finding) -> Canvas:
    speeds, channels = sorted({d.variant for d in finding.where}), channels_of(finding)
    norm, colours = mpl.colors.LogNorm(TICKS[0], TICKS[-1]), mpl.colormaps["cividis"]
    tall, between, head, foot = 0.13 * len(channels), 0.24, 0.24, 0.98
    height = head + len(speeds) * tall + between * (len(speeds) - 1) + foot
    wide = canvas.WIDTH - canvas.NAMES - canvas.RIGHT
    end = max(float(r.t[-1]) for r in finding.residuals if r.variant in speeds)
    with canvas.styled():
        figure = Canvas(figsize=(canvas.WIDTH, height))
        for k, speed in enumerate(speeds):
            low = height - head - (k + 1) * tall - k * between
            box = (canvas.NAMES / canvas.WIDTH, low / height, wide / canvas.WIDTH, tall / height)
            axis = figure.add_axes(box)
            for d in (d for d in finding.where if d.variant == speed):
                colour = colours(norm(np.clip(100 * d.share, TICKS[0], TICKS[-1])))
                axis.barh(
                    channels.index(d.channel),
                    d.end - d.start,
                    left=d.start,
                    height=0.8,
                    linewidth=0,
                    color=colour,
                )
            axis.set_facecolor(colours(0.0))
            axis.set_ylim(len(channels) - 0.5, -0.5)
            axis.set_yticks(range(len(channels)), [channel_name(c) for c in channels], fontsize=6.5)
            axis.tick_params(axis="y", length=0)
            axis.grid(visible=False, axis="y")
            axis.set_xlim(-0.5, end)
            axis.text(0, 1.02, f"{speed:g} m/s", transform=axis.transAxes, fontsize=8, va="bottom")
            axis.tick_params(labelbottom=k == len(speeds) - 1)
        axis.set_xlabel("time since the start of the command [s]")
        names = ["≤1", *(str(t) for t in TICKS[1:-1]), "≥50"]
        scale = mpl.cm.ScalarMappable(norm, colours)
        canvas.colour_bar(figure, scale, "difference over the sensor's rms [%]", TICKS, names)
        canvas.mark_virtual(figure, finding.virtual)
    return figure


SCALE = {"rad/s": (1e3, "mrad/s"), "rad": (1e3, "mrad")}
"""Unit to the factor and unit in which a sensor is drawn, where not in its own."""


def history_figures(finding: Finding) -> list[Figure]:
    """Draw the sensors with the largest gap, one figure per speed: mean of the trials, and the model."""
    known = {g.channel: g.train[0] for g in finding.gaps}
    ranked = sorted(channels_of(finding), key=lambda c: -known.get(c, 0.0))[:SHOWN]
    groups: dict[float, dict[str, list[Residual]]] = {}
    for r in finding.residuals:
        if r.channel in ranked:
            groups.setdefault(r.variant, {}).setdefault(r.channel, []).append(r)
    found = []
    for velocity, own in sorted(groups.items()):
        # Of two commands at one speed the last is drawn.
        same = {c: [r for r in group if r.phase == group[-1].phase] for c, group in own.items()}
        drawn = {c: mean_of(same[c]) for c in ranked if c in same}
        n = max(len(group) for group in same.values())
        which = f"Mean of {n} trials" if n > 1 else "One trial"
        found.append(
            Figure(
                f"found_history_{velocity:.2f}".replace(".", "p"),
                f"{velocity:g} m/s: {_closer(finding, drawn)}",
                f"{which}. Grey: the paper's model disagrees by more than the tolerance. Wheel angles are "
                "drawn less the paper's model.",
                f"Readings over time at {velocity:g} m/s, measured and simulated without and with the "
                "effects found.",
                partial(_history, finding, drawn), finding.virtual,
            )
        )  # fmt: skip
    return found


def _closer(finding: Finding, drawn: Mapping[str, Residual]) -> str:
    if not finding.effects:
        return "readings of the sensors with the largest gap"
    rms = {c: (_rms(m.before - m.measured), _rms(m.after - m.measured)) for c, m in drawn.items()}
    factor = {c: before / after for c, (before, after) in rms.items() if after > 0}
    best = max(factor, key=lambda c: factor[c], default="")
    if not best or factor[best] < 1.1:
        return "no sensor comes closer"
    return f"{channel_name(best)} is {significant(factor[best], 2)} times closer {with_found(finding)}"


def mean_of(group: list[Residual]) -> Residual:
    """Return the mean over trials of one command; NaN where no trial was measured."""
    known = np.array([np.isfinite(r.measured) for r in group])
    count = known.sum(axis=0)

    def average(name: str) -> Array:
        rows = np.array([getattr(r, name) for r in group])
        total = np.where(known & np.isfinite(rows), rows, 0.0).sum(axis=0)
        return np.where(count > 0, total / np.fmax(count, 1), np.nan)

    return replace(group[0], measured=average("measured"), before=average("before"), after=average("after"))


def _history(finding: Finding, drawn: Mapping[str, Residual]) -> Canvas:
    figure, axes = canvas.stacked([1.1] * len(drawn), [2] + [1] * (len(drawn) - 1))
    with canvas.styled():
        for axis, (name, mean) in zip(axes, drawn.items(), strict=True):
            scale, unit = SCALE.get(mean.unit, (1.0, tidy_unit(mean.unit)))
            zero = mean.before if mean.unit == "rad" else np.zeros_like(mean.before)
            for d in finding.where:
                if d.channel == name and d.variant == mean.variant:
                    axis.axvspan(d.start, d.end, color=canvas.SHADE, linewidth=0, zorder=0)
            lines = [
                (mean.measured, canvas.MEASURED_LIGHT, 2.2, "measured"),
                (mean.before, BEFORE, 1.0, "paper's model")
            ]  # fmt: skip
            if finding.effects:
                lines.append((mean.after, AFTER, 1.0, with_found(finding)))
            for values, colour, width, label in lines:
                axis.plot(mean.t, scale * (values - zero), color=colour, linewidth=width, label=label)
            less = " less model" if mean.unit == "rad" else ""
            axis.text(1, 1.02, f"{channel_name(name)}{less}", transform=axis.transAxes, fontsize=8,
            ha="right",
                      va="bottom")  # fmt: skip
            axis.set_ylabel(f"[{unit}]")
            axis.yaxis.set_major_locator(MaxNLocator(4))
        canvas.legend_on_top(figure, axes[0], 3, left=canvas.LEFT - 0.1)
        axes[-1].set_xlabel("time since the start of the command [s]")
        t = next(iter(drawn.values())).t
        axes[0].set_xlim(float(t[0]), float(t[-1]))
        canvas.align_labels(axes)
        canvas.mark_virtual(figure, finding.virtual)
    return figure


def _rms(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else math.nan
