"""Time histories of the sensors: measured, simulated before and after, and the discrepancy with its band."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from granite_lab.discovery.finding import Finding, Residual
from granite_lab.logs.trial import Array
from granite_lab.reporting import canvas
from granite_lab.reporting.discovery import rows
from granite_lab.reporting.discovery.names import capital, channel_name, channels_of, spoken, with_found
from granite_lab.reporting.discovery.residue import means
from granite_lab.reporting.figures import Figure
from granite_lab.reporting.rounding import significant, tidy_unit

SHOWN = 3
"""Channels that are drawn: those in which the gap is largest."""

CLOSER = 1.1
"""A channel in which the model comes closer by this factor is worth a word."""

SCALE = {"rad/s": (1e3, "mrad/s"), "rad": (1e3, "mrad")}
"""Unit to the factor and unit in which a channel is drawn, where not in its own."""


def history_drawings(finding: Finding) -> list[Figure]:
    """Draw the channels with the largest gap, one figure per speed."""
    known = {g.channel: g.train[0] for g in finding.gaps}
    ranked = sorted(channels_of(finding), key=lambda c: -known.get(c, 0.0))[:SHOWN]
    groups: dict[float, dict[str, tuple[int, Residual]]] = {}
    for n, mean in means(finding):
        if mean.channel in ranked:  # of two commands at one speed the last is drawn
            groups.setdefault(mean.variant, {})[mean.channel] = (n, mean)
    return [_speed(finding, velocity, own) for velocity, own in groups.items()]


def _speed(finding: Finding, velocity: float, found: dict[str, tuple[int, Residual]]) -> Figure:
    own = {c: mean for c, (_, mean) in found.items()}
    figure, axes = canvas.stacked([0.95, 0.6] * len(own), [2] + [1] * (2 * len(own) - 1))
    with canvas.styled():
        for k, mean in enumerate(own.values()):
            _readings(axes[2 * k], mean, finding)
            _discrepancy(axes[2 * k + 1], mean, finding)
        rows.legend_on_top(figure, axes[0], 4, left=canvas.LEFT - 0.1)
        axes[-1].set_xlabel("time since the start of the command [s]")
        t = next(iter(own.values())).t
        axes[0].set_xlim(float(t[0]), float(t[-1]))
        canvas.align_labels(axes)
        canvas.mark_virtual(figure, finding.virtual)
    data = canvas.data_tag(finding.virtual)
    what = "measured, and the model before and after" if finding.effects else "measured and simulated"
    return Figure(
        f"found_history_{velocity:.2f}".replace(".", "p"),
        f"{velocity:g} m/s: {what}{data}",
        _describe(finding, max(n for n, _ in found.values()), own),
        f"Sensor readings over time at {velocity:g} m/s, measured and simulated without and with what was "
        f"found, and the discrepancy of the model with its 95 % band{data}.",
        lambda: figure,
    )


def _readings(axis: Axes, mean: Residual, finding: Finding) -> None:
    scale, unit = _unit(mean)
    angle = mean.unit == "rad"  # an angle grows all the time: only differences show
    zero = mean.before if angle else np.zeros_like(mean.before)
    for d in finding.where:
        if d.channel == mean.channel and d.variant == mean.variant:
            axis.axvspan(d.start, d.end, color=canvas.SHADE, linewidth=0, zorder=0)
    lines = [
        (mean.measured, canvas.MEASURED_LIGHT, 2.2, "measured"),
        (mean.before, rows.BEFORE, 1.0, "before" if finding.effects else "model"),
    ]
    if finding.effects:
        lines.append((mean.after, rows.AFTER, 1.0, "after"))
    for values, colour, width, label in lines:
        axis.plot(mean.t, scale * (values - zero), color=colour, linewidth=width, label=label)
    if finding.where:
        axis.fill_between([], [], color=canvas.SHADE, linewidth=0, label="beyond the tolerance")
    less = " less before" if finding.effects else " less the model"
    _frame(axis, f"{channel_name(mean.channel)}{less if angle else ''}", unit)


def _discrepancy(axis: Axes, mean: Residual, finding: Finding) -> None:
    scale, unit = _unit(mean)
    centre, half = scale * mean.discrepancy_after, 2 * scale * mean.std
    colour = rows.AFTER if finding.effects else rows.BEFORE
    axis.fill_between(mean.t, centre - half, centre + half, color=colour, alpha=0.25, linewidth=0)
    axis.axhline(0, color=canvas.INK, linewidth=0.5)
    if finding.effects:
        axis.plot(mean.t, scale * mean.discrepancy_before, color=rows.BEFORE, linewidth=1.0)
    axis.plot(mean.t, centre, color=colour, linewidth=1.0)
    _frame(axis, f"{channel_name(mean.channel)}: discrepancy ± 2 std", unit)


def _frame(axis: Axes, name: str, unit: str) -> None:
    axis.text(0, 1.03, name, transform=axis.transAxes, fontsize=8, va="bottom")
    axis.set_ylabel(f"[{unit}]")
    axis.yaxis.set_major_locator(MaxNLocator(4))


def _unit(mean: Residual) -> tuple[float, str]:
    return SCALE.get(mean.unit, (1.0, tidy_unit(mean.unit)))


def _describe(finding: Finding, n: int, shown: dict[str, Residual]) -> str:
    what = "One trial" if n == 1 else f"Mean of {n} trials"
    if not finding.effects:
        return f"{what}, the channels with the largest gap."
    factor = {c: _rms(m.before - m.measured) / _rms(m.after - m.measured) for c, m in shown.items()}
    better = {c: f for c, f in factor.items() if f >= CLOSER}
    if not better:
        return f"{what}, the channels with the largest gap: none of them comes closer."
    closer = ", ".join(f"{spoken(c)} {significant(f, 2)} times" for c, f in better.items())
    return f"{what}. {capital(with_found(finding))}, the model is closer: {closer}."


def _rms(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")
