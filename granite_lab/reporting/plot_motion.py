"""Time histories like Figs. 5-8 of the paper: simulated, measured, both on one axis, their difference."""

from __future__ import annotations

import math
import re

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from granite_lab.comparison.record import Comparison
from granite_lab.logs.trial import Array
from granite_lab.reporting import canvas
from granite_lab.reporting.figures import Figure
from granite_lab.reporting.rounding import rounded_like, shown_as, significant, with_unit
from granite_lab.reporting.summary import IN_PHASE, NOISE, Speed, gaps, worst_of
from granite_lab.reporting.traces import (
    PANELS,
    Mask,
    Panel,
    Trace,
    block_means,
    channel,
    limits,
    span,
    traces,
)

HEIGHTS = [1.5, 1.2, 1.3, 1.1]
BLOCK = 0.1
"""Differences are averaged over this time before they are drawn [s]."""


def motion_drawings(speed: Speed) -> list[Figure]:
    """Draw one speed: simulated, measured, overlaid (its typical trial) and the differences (all trials)."""
    result = speed.typical
    c = result.comparison
    virtual = c.motion.virtual
    data = canvas.data_tag(virtual)
    of = f"{speed.velocity:g} m/s"
    stem = f"motion_{speed.velocity:.2f}".replace(".", "p")
    paper = {0.3: ("Fig. 5", "Fig. 6"), 0.7: ("Fig. 7", "Fig. 8")}.get(speed.velocity)
    like = [f", as {p} of the paper" if paper else "" for p in (paper or ("", ""))]
    simulated, measured = _history(c, ("simulated",), virtual), _history(c, ("measured",), virtual)
    trial = f"trial {result.trial.name}"
    k92 = rounded_like(c.fit.k92.value, c.fit.k92.std)
    return [
        Figure(
            f"{stem}_simulated", f"{of}: simulated{like[0]}",
            f"Model of the paper with k_92 = {k92}, fitted to the steady slip of {trial}: "
            f"{_describe_slip(c.run.slip_ratio)}",
            f"Simulated velocity, slip ratio, wheel torques and pitch over time at {of}.", lambda: simulated,
        ),
        Figure(
            f"{stem}_measured", f"{of}: measured{like[1]}{data}",
            f"{trial[0].upper()}{trial[1:]}, the middle one of {len(speed.results)} by slip: "
            f"{_describe_slip(c.motion.slip_ratio.value, c.motion.slip_ratio.std)}",
            f"Measured velocity, slip ratio, wheel torques and pitch over time at {of}, with bands of two "
            f"standard deviations{data}.", lambda: measured,
        ),
        Figure(
            f"{stem}_overlaid", f"{of}: measured and simulated on one axis{data}",
            _describe_overlay(c), f"The two histories at {of} drawn on the same axes{data}.",
            lambda: _history(c, ("measured", "simulated"), virtual),
        ),
        Figure(
            f"{stem}_difference", f"{of}: simulated minus measured, every trial{data}",
            _describe_difference(speed),
            f"Differences of velocity, slip ratio, torques and pitch over time for {len(speed.results)} "
            f"trials at {of}{data}.",
            lambda: _differences(speed, virtual),
        ),
    ]  # fmt: skip


def comparison_drawing(c: Comparison, index: int) -> Figure:
    """Draw one trial, measured and simulated on one axis."""
    data = canvas.data_tag(c.motion.virtual)
    return Figure(
        f"compare_{index:02d}_{_stem(c.motion.trial)}", f"{c.motion.trial}: measured and simulated{data}",
        _describe_overlay(c),
        f"Velocity, slip ratio, wheel torques and pitch of trial {c.motion.trial}, measured and "
        f"simulated{data}.",
        lambda: _history(c, ("measured", "simulated"), c.motion.virtual),
    )  # fmt: skip


def _stem(name: str) -> str:
    """Return a trial's name as it may stand in a file name."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", name)[:80]


def _describe_slip(value: float, std: float = math.nan) -> str:
    if not math.isfinite(value):
        return "the slip of the steady part (grey) could not be had."
    text = with_unit(rounded_like(value, std, scale=100), "%")
    return f"over the steady part (grey) the body is {text} slower than the wheels."


def _describe_overlay(c: Comparison) -> str:
    found = gaps([c])
    parts = []
    for key, name in (
        ("velocity", "Body velocities"),
        ("torque_r", "rear torques"),
        ("pitch", "pitch angles"),
    ):
        gap = found.get((key, "all"))
        if gap:
            unit, scale = shown_as(gap.unit)
            parts.append(f"{name} differ by {with_unit(significant(gap.rms * scale, 2), unit)} rms")
    if not parts:
        return "Nothing was measured that could be laid over the simulation."
    text = ", ".join(parts)
    return f"{text[0].upper()}{text[1:]}; bands are ±2σ of the measurement."


def _describe_difference(speed: Speed) -> str:
    drawn = ("velocity", "slip_f", "slip_r", "torque_f", "torque_r", "pitch")
    found = gaps([r.comparison for r in speed.results]).values()
    worst = worst_of(g for g in found if g.channel in drawn)
    if worst is None:
        return f"Averages over {BLOCK:g} s; what trials share is the model's, the rest noise or sand."
    if worst.normalised <= NOISE:
        return f"Averages over {BLOCK:g} s: no channel leaves its noise by much."
    unit, scale = shown_as(worst.unit)
    side = "above" if worst.bias > 0 else "below"
    return (
        f"Averages over {BLOCK:g} s: the largest gap is the {worst.name} {IN_PHASE[worst.phase]}, "
        f"simulated on average {with_unit(significant(abs(worst.bias) * scale, 2), unit)} {side} measured."
    )


def _history(c: Comparison, sources: tuple[str, ...], virtual: bool) -> Canvas:
    rows = [2, 2, 2, 1] if len(sources) > 1 else [1, 1, 1, 1]
    figure, axes = canvas.stacked(HEIGHTS, rows)
    start, end = span(c)
    inside = (c.t >= start) & (c.t <= end)
    with canvas.styled():
        for axis, panel in zip(axes, PANELS, strict=True):
            _steady_part(axis, c)
            lines = traces(c, panel, sources)
            if panel.id == "velocity":
                _desired(axis, c, inside)
            for line in lines:
                draw_trace(axis, c.t[inside], line, inside)
            if not lines:
                _say_nothing(axis, "not measured")
            both = traces(c, panel, ("simulated", "measured"))
            bounds = limits(both, inside, anchor_zero=panel.id != "pitch")
            if bounds:
                axis.set_ylim(
                    max(bounds[0], -60), min(bounds[1], 105)
                ) if panel.id == "slip" else axis.set_ylim(*bounds)
            axis.set_ylabel(panel.label)
            canvas.legend_above(axis, 3 if panel.id in ("velocity", "pitch") or len(sources) == 1 else 2)
            axis.yaxis.set_major_locator(MaxNLocator(5))
        _finish(axes, start, end)
        canvas.mark_virtual(figure, virtual and "measured" in sources)
    return figure


def draw_trace(axis: Axes, t: Array, line: Trace, inside: Mask) -> None:
    """Draw one line with its ±2σ band."""
    value, std = line.value[inside], line.std[inside]
    if np.isfinite(std).any():
        s, low, high = canvas.envelope(t, value - 2 * std, value + 2 * std, points=300)
        axis.fill_between(s, low, high, color=line.colour, alpha=0.25, linewidth=0)
    s, y = canvas.envelope(t, value)
    axis.plot(s, y, color=line.colour, linestyle=(0, (4, 1.5)) if line.dashed else "-", label=line.label)


def _desired(axis: Axes, c: Comparison, inside: Mask) -> None:
    desired = c.run.signals.get("v_desired_mps")
    if desired is not None:
        t, y = canvas.envelope(c.t[inside], np.interp(c.t[inside], c.run.t, desired), points=200)
        axis.plot(t, y, color=canvas.DESIRED, linestyle=(0, (1, 1)), label="desired")


def _steady_part(axis: Axes, c: Comparison) -> None:
    start, end = c.run.steady
    if math.isfinite(start) and math.isfinite(end):
        axis.axvspan(start, end, color=canvas.SHADE, linewidth=0, zorder=0)


def _differences(speed: Speed, virtual: bool) -> Canvas:
    figure, axes = canvas.stacked(HEIGHTS, [2, 2, 2, 1])
    typical = speed.typical.comparison
    start, end = span(typical)
    with canvas.styled():
        for axis, panel in zip(axes, PANELS, strict=True):
            _steady_part(axis, typical)
            height = _difference_lines(axis, panel, speed, start, end)
            if height is None:
                _say_nothing(axis, "not measured")
            else:
                axis.set_ylim(-height, height)
            axis.axhline(0, color=canvas.INK, linewidth=0.6)
            axis.set_ylabel(panel.difference_label)
            axis.yaxis.set_major_locator(MaxNLocator(5))
            canvas.legend_above(axis, 3)
        _finish(axes, start, end)
        canvas.mark_virtual(figure, virtual)
    return figure


def _difference_lines(axis: Axes, panel: Panel, speed: Speed, start: float, end: float) -> float | None:
    """Draw the differences of all trials and the noise of the typical one.

    Returns:
        the height the axis needs on either side; None without any difference. A band of noise far
        wider than the lines fills the panel rather than flatten them.
    """
    scale, largest = panel.difference_scale, []
    names = [row for row in panel.channels if row[1] != "wheels"]
    for label, name, _, dashed in names:
        for i, result in enumerate(speed.results):
            c = result.comparison
            inside = (c.t >= start) & (c.t <= end)
            gap = (channel(c, "simulated", name)[0] - channel(c, "measured", name)[0])[inside] * scale
            if np.isfinite(gap).any():
                t, y = block_means(c.t[inside], gap, BLOCK)
                axis.plot(
                    t, y, color=canvas.GREY if dashed else canvas.INK, linewidth=0.9,
                    linestyle=(0, (4, 1.5)) if dashed else "-", label=label if i == 0 else None,
                )  # fmt: skip
                largest.append(float(np.nanmax(np.abs(y))))
    if not largest:
        return None
    height = 1.15 * max(largest) or 1.0
    c = speed.typical.comparison
    value, std = channel(c, "measured", names[0][1])
    band = np.where((c.t >= start) & (c.t <= end) & np.isfinite(value), 2 * std * scale, np.nan)
    if np.isfinite(band).any():
        t, high = canvas.envelope(c.t, band, points=300)
        axis.fill_between(t, -high, high, color=canvas.FAINT, alpha=0.5, linewidth=0, label="±2σ of a sample")
        height = max(height, min(1.1 * float(np.nanmax(band)), 3 * height))
    return height


def _say_nothing(axis: Axes, text: str) -> None:
    axis.text(0.5, 0.5, text, transform=axis.transAxes, ha="center", va="center", color=canvas.DESIRED)


def _finish(axes: list[Axes], start: float, end: float) -> None:
    axes[0].set_xlim(start, end)
    axes[-1].set_xlabel("time since the start of the command [s]")
    canvas.align_labels(axes)
