"""Time histories of the sensors, measured and simulated without and with what was found."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from granite_lab.discovery.finding import Finding
from granite_lab.logs.trial import Array
from granite_lab.reporting import canvas
from granite_lab.reporting.canvas import Drawing
from granite_lab.reporting.discovery import rows
from granite_lab.reporting.discovery.names import channel_name, spoken, with_found
from granite_lab.reporting.discovery.residue import Mean, channels_of, means
from granite_lab.reporting.rounding import significant, tidy_unit

SHOWN = 3
"""Channels that are drawn: those in which the gap is largest."""

CLOSER = 1.1
"""A channel in which the model comes closer by this factor is worth a word."""

SCALE = {"pitch_rate": (1e3, "mrad/s"), "wheel": (1e3, "mrad"), "wheel_split": (1e3, "mrad")}
"""Channel to the factor and unit in which it is drawn, where not in its own."""


def history_drawings(finding: Finding) -> list[Drawing]:
    """Draw the channels with the largest gap, one figure per speed."""
    known = {g.channel: g.train[0] for g in finding.gaps if g.phase == "all" and g.channel != "all"}
    ranked = sorted(channels_of(finding), key=lambda c: -known.get(c, 0.0))[:SHOWN]
    chosen = [c for c in channels_of(finding) if c in ranked]
    groups: dict[float, list[Mean]] = {}
    for mean in means(finding):
        if mean.channel in chosen:
            groups.setdefault(mean.velocity, []).append(mean)
    return [_speed(finding, velocity, own) for velocity, own in sorted(groups.items())]


def _speed(finding: Finding, velocity: float, own: list[Mean]) -> Drawing:
    by_channel = {m.channel: m for m in own}  # of two commands at one speed the last is drawn
    figure, axes = canvas.stacked([1.05] * len(by_channel), [2] + [1] * (len(by_channel) - 1))
    with canvas.styled():
        for axis, mean in zip(axes, by_channel.values(), strict=True):
            _panel(axis, mean, finding)
        rows.legend_on_top(figure, axes[0], 4, left=canvas.LEFT - 0.1)
        axes[-1].set_xlabel("time since the start of the command [s]")
        first = next(iter(by_channel.values()))
        axes[0].set_xlim(float(first.t[0]), float(first.t[-1]))
        canvas.align_labels(axes)
        canvas.mark_virtual(figure, finding.virtual)
    data = canvas.data_tag(finding.virtual)
    return Drawing(
        f"found_history_{velocity:.2f}".replace(".", "p"),
        f"{velocity:g} m/s: {_titled(finding)}{data}",
        _describe(finding, by_channel),
        f"Sensor readings over time at {velocity:g} m/s, measured and simulated without and with what was "
        f"found{data}.",
        figure,
    )


def _titled(finding: Finding) -> str:
    return "measured, and the model before and after" if finding.effects else "measured and simulated"


def _panel(axis: Axes, mean: Mean, finding: Finding) -> None:
    scale, unit = SCALE.get(mean.channel, (1.0, tidy_unit(mean.unit)))
    name = channel_name(mean.channel)
    angle = mean.channel.startswith("wheel")
    name += ": simulated − measured" if angle else ""
    zero = mean.measured if angle else np.zeros_like(mean.measured)
    for d in finding.where:
        if d.channel == mean.channel and d.variant == mean.velocity:
            axis.axvspan(d.start, d.end, color=canvas.SHADE, linewidth=0, zorder=0)
    axis.plot(
        mean.t, scale * (mean.measured - zero), color=canvas.MEASURED_LIGHT, linewidth=2.2, label="measured"
    )
    axis.plot(
        mean.t,
        scale * (mean.before - zero),
        color=rows.BEFORE,
        linewidth=1.0,
        label="before" if finding.effects else "model",
    )
    if finding.effects:
        axis.plot(mean.t, scale * (mean.after - zero), color=rows.AFTER, linewidth=1.0, label="after")
    if finding.where:
        axis.fill_between([], [], color=canvas.SHADE, linewidth=0, label="beyond chance")
    axis.text(0, 1.03, name, transform=axis.transAxes, fontsize=8, va="bottom")
    axis.set_ylabel(f"[{unit}]")
    axis.yaxis.set_major_locator(MaxNLocator(4))


def _describe(finding: Finding, shown: dict[str, Mean]) -> str:
    n = max(m.trials for m in shown.values())
    what = "One trial" if n == 1 else f"Mean of {n} trials"
    if not finding.effects:
        return f"{what}, the channels with the largest gap."
    factor = {c: _rms(m.before - m.measured) / _rms(m.after - m.measured) for c, m in shown.items()}
    better = {c: f for c, f in factor.items() if f >= CLOSER}
    if not better:
        return f"{what}, the channels with the largest gap: none of them comes closer."
    closer = ", ".join(f"{spoken(c)} {significant(f, 2)} times" for c, f in better.items())
    return f"{what}. {with_found(finding).capitalize()}, the model is closer: {closer}."


def _rms(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")
