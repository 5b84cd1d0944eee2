"""Time histories like Figs. 5-8 of the paper: measured and simulated on one axis, and their difference."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from granite_lab.comparison.record import Comparison
from granite_lab.logs.trial import Array
from granite_lab.model.command import duration
from granite_lab.parameters import WHEELS
from granite_lab.reporting import canvas
from granite_lab.reporting.answers import channels_of
from granite_lab.reporting.figures import Figure
from granite_lab.reporting.names import together
from granite_lab.reporting.rounding import significant
from granite_lab.reporting.summary import Speed, gaps

Mask = npt.NDArray[np.bool_]

HEIGHTS = [1.25, 1.05, 1.05, 0.85]

SLIP_STD_SHOWN = 0.04
"""Measured slip is drawn where its standard deviation is below this; at crawling speed it says nothing."""

WIDEST = 0.3
"""Share of a panel's height up to which the band of ±2σ is drawn; a wider one becomes a bar at the side."""

PAPER = {0.3: "Figs. 5 and 6", 0.7: "Figs. 7 and 8"}
"""Figures of the paper by speed [m/s]."""


@dataclass(frozen=True)
class Panel:
    """One quantity of a time history.

    Attributes:
        id: "velocity", "slip", "torque" or "pitch".
        label: axis label with unit.
        scale: from the unit of the comparison to that of the axis.
        channels: of its lines, the dark one first; "wheels" is the mean of the four.
        key: what dark and light lines are.
    """

    id: str
    label: str
    scale: float
    channels: tuple[str, ...]
    key: str


PANELS = (
    Panel("velocity", "velocity [m/s]", 1.0, ("velocity", "wheels"), "dark: body, light: wheels"),
    Panel("slip", "slip ratio [%]", 100.0, ("slip_f", "slip_r"), "dark: front, light: rear"),
    Panel("torque", "wheel torque [N m]", 1.0, ("torque_f", "torque_r"), "dark: front, light: rear"),
    Panel("pitch", "pitch [°]", 180 / math.pi, ("pitch",), ""),
)


def motion_figure(speed: Speed) -> Figure:
    """Draw one speed, measured and simulated: its typical trial; the title judges all of them."""
    c, n = speed.typical.comparison, len(speed.results)
    which = f"Trial {c.motion.trial}" + (f", the middle one of {n} by slip" if n > 1 else "")
    like = f"; as {PAPER[speed.velocity]} of the paper" if speed.velocity in PAPER else ""
    return Figure(
        f"motion_{speed.velocity:.2f}".replace(".", "p"),
        f"{speed.velocity:g} m/s: {_verdict([r.comparison for r in speed.results])}",
        f"{which}{like}.",
        f"Velocity, slip ratio, wheel torques and pitch over time at {speed.velocity:g} m/s, measured and "
        "simulated.",
        partial(_history, c), any(r.comparison.motion.virtual for r in speed.results),
    )  # fmt: skip


def comparison_figure(c: Comparison, index: int) -> Figure:
    """Draw one trial, measured and simulated on one axis."""
    trial = c.motion.trial
    stem = re.sub(r"[^A-Za-z0-9._-]+", "_", trial)[:80]
    return Figure(
        f"compare_{index:02d}_{stem}", f"{trial}: {_verdict([c])}",
        "Dark: body or front axle, light: wheels or rear axle; grey: steady part; bands: ±2σ.",
        f"Velocity, slip ratio, wheel torques and pitch of trial {trial}, measured and simulated.",
        partial(_history, c), c.motion.virtual,
    )  # fmt: skip


def _verdict(comparisons: list[Comparison]) -> str:
    """Say which of the drawn quantities differ."""
    drawn = {name for panel in PANELS for name in panel.channels}
    judged = [c for c in channels_of(gaps(comparisons)) if c.channel in drawn]
    differ = [c.name for c in judged if c.tone in ("fair", "bad")]
    if not judged:
        return "measured and simulated"
    if not differ:
        return "measurement and simulation agree"
    return f"{together(differ)} {'differs' if len(differ) == 1 else 'differ'}"


def channel(c: Comparison, source: str, name: str) -> tuple[Array, Array]:
    """Return a channel and its std in the comparison's unit, NaN where there is nothing to show.

    Slip is left out where it is not defined well: simulated below 0.02 m/s at the wheel, measured
    where its own standard deviation exceeds `SLIP_STD_SHOWN` and outside the command.
    """
    nothing = np.full(len(c.t), np.nan)
    values = c.measured if source == "measured" else c.simulated
    if name == "wheels":
        return _mean_of_wheels(values, nothing), nothing
    value = values.get(name, nothing)
    std = c.measured_std.get(name, nothing) if source == "measured" else nothing
    if name.startswith("slip"):
        crawls = ~(np.abs(_mean_of_wheels(values, nothing)) > 0.02)
        outside = (c.t < 0) | (c.t > duration(c.run.variant))
        hidden = (std > SLIP_STD_SHOWN) | outside if source == "measured" else crawls
        value = np.where(hidden, np.nan, value)
    return value, std


def _mean_of_wheels(values: dict[str, Array], nothing: Array) -> Array:
    stack = np.array([values.get(f"wheel_{w}", nothing) for w in WHEELS])
    there = np.isfinite(stack)
    count = there.sum(axis=0)
    return np.where(count > 0, np.where(there, stack, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


def span(c: Comparison) -> tuple[float, float]:
    """Return the part of the time axis that is drawn: the command and a little rest around it [s]."""
    v = min(c.run.variant.velocity, math.sqrt(c.run.variant.acceleration * c.run.variant.distance))
    end = c.run.variant.distance / v + v / c.run.variant.acceleration
    return max(float(c.t[0]), -0.5), min(float(c.t[-1]), end + 1.2)


def _history(c: Comparison) -> Canvas:
    figure, axes = canvas.stacked(HEIGHTS, [1] * len(HEIGHTS))
    start, end = span(c)
    inside = (c.t >= start) & (c.t <= end)
    with canvas.styled():
        for axis, panel in zip(axes, PANELS, strict=True):
            _steady_part(axis, c)
            lines = [
                Line(source, light, value[inside] * panel.scale, std[inside] * panel.scale)
                for source in ("measured", "simulated")
                for light, name in enumerate(panel.channels)
                for value, std in (channel(c, source, name),)
                if np.isfinite(value[inside]).any()
            ]
            wide = _panel(axis, c.t[inside], lines, anchored=panel.id != "pitch", slip=panel.id == "slip")
            if panel.id == "velocity":
                _desired(axis, c, inside)
            measured = any(line.source == "measured" for line in lines)
            key = panel.key if measured else "not measured"
            if wide:
                unit = panel.label.partition("[")[2].rstrip("]")
                key = f"{key}; " if key else ""
                key += f"±2σ of the measurement, not drawn: {significant(wide, 2)} {unit}"
            axis.text(1, 1.02, key, transform=axis.transAxes, ha="right", va="bottom", fontsize=7.5)
            axis.set_ylabel(panel.label)
            axis.yaxis.set_major_locator(MaxNLocator(5))
        _legend(axes[0])
        _finish(axes, start, end)
        canvas.mark_virtual(figure, c.motion.virtual)
    return figure


COLOURS = {
    "measured": (canvas.MEASURED, canvas.MEASURED_LIGHT),
    "simulated": (canvas.SIMULATED, canvas.SIMULATED_LIGHT),
}


@dataclass(frozen=True, eq=False)
class Line:
    """A line of a panel: where it comes from, dark or light, (n,) values and std in the panel's unit."""

    source: str
    light: int
    value: Array
    std: Array

    @property
    def colour(self) -> str:
        """Blue tones are measured, orange tones simulated."""
        return COLOURS[self.source][self.light]


def _panel(axis: Axes, t: Array, lines: list[Line], *, anchored: bool, slip: bool) -> float:
    """Draw lines, bands and marks where a line leaves the panel; return ±2σ that is too wide to draw."""
    bounds = limits([line.value for line in lines], anchored)
    if bounds is None:
        return 0.0
    low, high = (max(bounds[0], -60.0), min(bounds[1], 105.0)) if slip else bounds
    axis.set_ylim(low, high)
    wide = 0.0
    for line in lines:
        half = float(np.nanmedian(2 * line.std)) if np.isfinite(line.std).any() else math.nan
        if half <= WIDEST / 2 * (high - low):
            s, below, above = canvas.envelope(
                t, line.value - 2 * line.std, line.value + 2 * line.std, points=300
            )
            axis.fill_between(s, below, above, color=line.colour, alpha=0.25, linewidth=0)
        elif math.isfinite(half) and not line.light:
            wide = half
        s, y = canvas.envelope(t, line.value)
        dashed = line.light and line.source == "simulated"
        axis.plot(s, y, color=line.colour, linestyle=(0, (4, 1.5)) if dashed else "-")
    for up, edge in ((True, high), (False, low)):
        _beyond(axis, t, lines, edge, up=up)
    return wide


def _beyond(axis: Axes, t: Array, lines: list[Line], edge: float, *, up: bool) -> None:
    """Mark each line that leaves a panel at its edge, and say how far the farthest goes."""
    out = []
    for line in lines:
        k = int(np.nanargmax(line.value if up else -line.value))
        if (line.value[k] > edge) if up else (line.value[k] < edge):
            out.append((float(line.value[k]), float(t[k])))
            axis.plot(
                t[k], edge, marker="^" if up else "v", color=line.colour, markersize=4.5, clip_on=False,
                linestyle="none", zorder=6,
            )  # fmt: skip
    if out:
        peak, at = max(out) if up else min(out)
        right = at < float(np.mean((t[0], t[-1])))
        axis.annotate(
            f"to {significant(peak, 2)}", (at, edge), xytext=(5 if right else -5, -1.5 if up else 1.5),
            textcoords="offset points", ha="left" if right else "right", va="top" if up else "bottom",
            fontsize=7, annotation_clip=False,
        )  # fmt: skip


def limits(lines: list[Array], anchored: bool) -> tuple[float, float] | None:
    """Return axis limits that hold all lines but rare spikes; None without a finite value.

    Args:
        lines: (n,) each.
        anchored: the axis shall contain zero.
    """
    finite = [y[np.isfinite(y)] for y in lines]
    if not any(len(y) for y in finite):
        return None
    low = min(float(np.percentile(y, 0.5)) for y in finite if len(y))
    high = max(float(np.percentile(y, 99.5)) for y in finite if len(y))
    if anchored:
        low, high = min(low, 0.0), max(high, 0.0)
    room = 0.08 * (high - low) or 0.1 * abs(high) or 1.0
    return low - room, high + room


def _legend(axis: Axes) -> None:
    for source, (colour, _) in COLOURS.items():
        axis.plot([], [], color=colour, label=source)
    canvas.legend_above(axis)


def _desired(axis: Axes, c: Comparison, inside: Mask) -> None:
    desired = c.run.signals.get("v_desired_mps")
    if desired is not None:
        t, y = canvas.envelope(c.t[inside], np.interp(c.t[inside], c.run.t, desired), points=200)
        axis.plot(t, y, color=canvas.DESIRED, linestyle=(0, (1, 1)), label="desired")


def _steady_part(axis: Axes, c: Comparison) -> None:
    start, end = c.run.steady
    if math.isfinite(start) and math.isfinite(end):
        axis.axvspan(start, end, color=canvas.SHADE, linewidth=0, zorder=0)


def _finish(axes: list[Axes], start: float, end: float) -> None:
    axes[0].set_xlim(start, end)
    axes[-1].set_xlabel("time since the start of the command [s]")
    canvas.align_labels(axes)
