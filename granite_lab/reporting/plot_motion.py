"""Measured and simulated motion over time (Figs. 5-8 of the paper)."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from granite_lab.comparison.compare import Comparison
from granite_lab.estimation.motion import Motion
from granite_lab.logs.counters import mean_known
from granite_lab.logs.trial import Array
from granite_lab.model.command import duration
from granite_lab.parameters import WHEELS
from granite_lab.reporting import canvas
from granite_lab.reporting.canvas import Canvas, Figure
from granite_lab.reporting.channels import judged_channels
from granite_lab.reporting.names import lines_link, speed_stem, together
from granite_lab.reporting.speeds import Speed
from granite_lab.results import pooled_misfits
from granite_lab.rounding import axis_unit, shown_as, significant

SLIP_STD_SHOWN = 0.04
"""Measured slip is drawn where its standard deviation is below this; at crawling speed it is larger."""

WIDEST = 0.3
"""Share of a panel's height up to which the band of ±2σ is drawn; the width of a wider band is printed."""

PAPER = {0.3: "Figs. 5 and 6", 0.7: "Figs. 7 and 8"}
"""Figures of the paper by speed [m/s]."""

SOURCES = {
    "simulated": ((canvas.SIMULATED, canvas.SIMULATED_LIGHT), 1.9),
    "measured": ((canvas.MEASURED, canvas.MEASURED_LIGHT), 0.9),
}
"""Colours, dark and light, and width of the lines: thin measured ones lie on wide simulated ones."""


class Panel(NamedTuple):
    """One quantity of a time history.

    Attributes:
        name: of the axis.
        unit: of the comparison; drawn as by `axis_unit`, differences as by `shown_as`.
        height: of the panel [in].
        channels: of its lines, the dark one first; "wheels" is the mean of the four.
        key: what dark and light lines are.
    """

    name: str
    unit: str
    height: float
    channels: tuple[str, ...]
    key: str = ""


DIFFERENCE = 0.42
"""Height of a panel with the difference [in]."""

PANELS = (
    Panel("velocity", "m/s", 1.1, ("velocity", "wheels"), "dark: body, light: wheels"),
    Panel("slip ratio", "-", 0.95, ("slip_f", "slip_r"), "dark: front, light: rear"),
    Panel("torque", "N m", 0.95, ("torque_f", "torque_r"), "dark: front, light: rear"),
    Panel("pitch", "rad", 0.7, ("pitch",)),
)


def motion_figure(speed: Speed) -> Figure:
    """Draw one speed, measured and simulated: its typical trial; the title judges all of them."""
    c, n = speed.typical, len(speed.results)
    like = f", the middle one of {n} by slip" if n > 1 else ""
    like += f"; as {PAPER[speed.velocity]} of the paper" if speed.velocity in PAPER else ""
    title = f"{speed.velocity:g} m/s: {_verdict(speed.results)}"
    virtual = any(r.motion.virtual for r in speed.results)
    name = f"motion_{speed_stem(speed.velocity)}"
    caption = f"Trial {c.motion.trial}{like}."
    return Figure(name, title, caption, partial(_history, c), virtual, lines_link(c.motion.trial))


def comparison_figure(c: Comparison, index: int, like: Sequence[Comparison] = ()) -> Figure:
    """Draw one trial, measured and simulated on one axis.

    The title judges it together with those `like` it, the repetitions of its command.
    """
    stem = re.sub(r"[^A-Za-z0-9._-]+", "_", c.motion.trial)[:80]
    title, name = f"{c.motion.trial}: {_verdict(like or [c])}", f"compare_{index:02d}_{stem}"
    caption = "Blue: measured, orange: simulated; grey: steady part; bands: ±2σ."
    return Figure(name, title, caption, partial(_history, c), c.motion.virtual)


def _verdict(comparisons: Sequence[Comparison]) -> str:
    """Say which of the drawn quantities differ."""
    drawn = {name for panel in PANELS for name in panel.channels}
    judged = [c for c in judged_channels(pooled_misfits(comparisons)) if c.channel in drawn]
    differ = [c.name for c in judged if c.differs]
    if differ:
        return f"{together(differ)} {'differs' if len(differ) == 1 else 'differ'}"
    return "measurement and simulation agree" if judged else "measured and simulated"


def shown_channel(c: Comparison, source: str, name: str) -> tuple[Array, Array]:
    """Return a channel and its std in the comparison's unit, NaN where there is nothing to show.

    Slip is left out where it is not defined well: simulated below 0.02 m/s at the wheel, measured
    where its own standard deviation exceeds `SLIP_STD_SHOWN` and outside the command.
    """
    nothing = np.full(len(c.t), np.nan)
    values = c.measured if source == "measured" else c.simulated
    wheels = mean_known(np.array([values.get(f"wheel_{w}", nothing) for w in WHEELS]), 0)
    if name == "wheels":
        return wheels, nothing
    value = values.get(name, nothing)
    std = c.measured_std.get(name, nothing) if source == "measured" else nothing
    if name.startswith("slip"):
        outside = (c.t < 0) | (c.t > duration(c.run.variant))
        hidden = (std > SLIP_STD_SHOWN) | outside if source == "measured" else ~(np.abs(wheels) > 0.02)
        value = np.where(hidden, np.nan, value)
    return value, std


class Line(NamedTuple):
    """A line of a panel: source, 0 if dark and 1 if light, (n,) values and std in the panel's unit."""

    source: str
    light: int
    value: Array
    std: Array

    @property
    def colour(self) -> str:
        """Blue tones are measured, orange tones simulated."""
        return SOURCES[self.source][0][self.light]


def _history(c: Comparison) -> Canvas:
    heights = [h for p in PANELS for h in (p.height, DIFFERENCE)]
    labels = [
        label for p in PANELS for label in (f"{p.name} [{axis_unit(p.unit)[0]}]", f"[{shown_as(p.unit)[0]}]")
    ]
    figure, axes = canvas.panels(heights, frame=canvas.Frame(gap=0.2), y=labels, x=canvas.TIME)
    end = min(float(c.t[-1]), duration(c.run.variant) + 1.2)
    inside = (c.t >= -0.5) & (c.t <= end)
    t = c.t[inside]
    for axis, below, panel in zip(axes[::2], axes[1::2], PANELS, strict=True):
        for panel_axis in (axis, below) if all(map(math.isfinite, c.run.steady)) else ():
            panel_axis.axvspan(*c.run.steady, color=canvas.SHADE, linewidth=0, zorder=0)
        unit, scale = axis_unit(panel.unit)
        lines = [
            Line(source, light, value[inside] * scale, std[inside] * scale)
            for source in SOURCES
            for light, name in enumerate(panel.channels)
            for value, std in (shown_channel(c, source, name),)
            if np.isfinite(value[inside]).any()
        ]
        wide = _panel(axis, panel, t, lines)
        _difference(below, panel, t, lines)
        parts = [panel.key if any(line.source == "measured" for line in lines) else "not measured"]
        if wide:
            parts.append(f"±2σ of the measurement, not drawn: {significant(wide, 2)} {unit}")
        canvas.key(axis, "; ".join(filter(None, parts)))
    desired = c.run.signals.get("v_desired_mps")
    if desired is not None and t.size:
        s, y = canvas.envelope(t, np.interp(t, c.run.t, desired), points=200)
        axes[0].plot(s, y, color=canvas.DESIRED, linestyle=(0, (1, 1)), label="desired")
    for source, ((colour, _), width) in SOURCES.items():
        axes[0].plot([], [], color=colour, linewidth=width, label=source)
    canvas.legend(axes[0])
    # Where the log holds nothing of the command, the empty panels still show its time.
    axes[0].set_xlim(*((t[0], t[-1]) if t.size > 1 else (-0.5, duration(c.run.variant) + 1.2)))
    return figure


def _panel(axis: Axes, panel: Panel, t: Array, lines: Sequence[Line]) -> float:
    """Draw lines, bands and marks where a line leaves the panel; return ±2σ that is too wide to draw."""
    if not lines:
        return 0.0
    # All samples but rare spikes are inside; these are marked.
    low = min(float(np.nanpercentile(line.value, 0.5)) for line in lines)
    high = max(float(np.nanpercentile(line.value, 99.5)) for line in lines)
    if len(panel.channels) > 1:  # pitch has no natural zero
        low, high = min(low, 0.0), max(high, 0.0)
    room = 0.08 * (high - low) or 0.1 * abs(high) or 1.0
    low, high = low - room, high + room
    if "slip_f" in panel.channels:
        low, high = max(low, -60.0), min(high, 105.0)
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
        axis.plot(*canvas.envelope(t, line.value), color=line.colour, linewidth=SOURCES[line.source][1])
    for sign, edge in ((1, high), (-1, low)):
        _mark_beyond(axis, t, lines, edge, sign)
    return wide


def _difference(axis: Axes, panel: Panel, t: Array, lines: Sequence[Line]) -> None:
    """Draw simulated minus measured of each channel, less rare spikes."""
    axis.yaxis.set_major_locator(MaxNLocator(3))
    if not lines:
        return
    axis.axhline(0, color=canvas.INK, linewidth=0.6, zorder=1)
    canvas.key(axis, "simulated − measured")
    every, finer = [], shown_as(panel.unit)[1] / axis_unit(panel.unit)[1]
    for light in range(len(panel.channels)):
        pair = {line.source: line for line in lines if line.light == light}
        if len(pair) == len(SOURCES):
            gap = finer * (pair["simulated"].value - pair["measured"].value)
            axis.plot(*canvas.envelope(t, gap), color=pair["simulated"].colour, linewidth=0.8)
            every.append(gap[np.isfinite(gap)])
    finite = np.concatenate([*every, np.zeros(1)])
    low, high = np.percentile(finite, [1, 99]) if finite.size > 1 else (-1.0, 1.0)
    most = 1.2 * max(abs(low), abs(high)) or 1.0
    axis.set_ylim(-most, most)


def _mark_beyond(axis: Axes, t: Array, lines: Sequence[Line], edge: float, sign: int) -> None:
    """Mark each line that leaves a panel above (sign 1) or below (-1), and say how far the farthest goes."""
    out = []
    for line in lines:
        k = int(np.nanargmax(sign * line.value))
        if sign * line.value[k] > sign * edge:
            out.append((sign * float(line.value[k]), float(t[k])))
            axis.plot(
                t[k], edge, marker="^" if sign > 0 else "v", color=line.colour, markersize=4.5,
                clip_on=False, linestyle="none", zorder=6,
            )  # fmt: skip
    if out:
        peak, at = max(out)
        right = at < float(np.mean((t[0], t[-1])))
        axis.annotate(
            f"to {significant(sign * peak, 2)}", (at, edge), xytext=(5 if right else -5, -1.5 * sign),
            textcoords="offset points", ha="left" if right else "right", va="top" if sign > 0 else "bottom",
            fontsize=7, annotation_clip=False,
        )  # fmt: skip


KINDS = (
    (canvas.MEASURED, "o"), (canvas.SIMULATED, "s"), (canvas.FITTED, "^"), (canvas.PAPER, "D"),
    (canvas.SIMULATED_LIGHT, "v"),
)  # fmt: skip
"""Colour and marker of the kinds of innovations."""

SHOWN_INNOVATIONS = 200
"""Innovations of each kind that are drawn at most."""


def health_figure(motion: Motion, index: int) -> Figure:
    """Draw the checks of one estimate: velocity and innovations with their bounds, standstills shaded."""
    h = motion.health
    ratio = h.innovation / np.where(h.innovation_std > 0, h.innovation_std, np.nan)
    outside = 100 * float(np.mean(np.abs(ratio[np.isfinite(ratio)]) > 2)) if np.isfinite(ratio).any() else 0.0
    squares = ", ".join(f"{kind.replace('_', ' ')} {significant(x, 2)}" for kind, x in h.nis.items())
    title = f"{motion.trial}: the estimate is {'good' if h.good else 'doubtful'}"
    caption = (
        f"{significant(outside, 2)} % of the innovations lie outside ±2σ (band); 5 % are expected. Mean "
        f"normalised innovation squared (1 is ideal, up to 3 is good; more if innovations are few): "
        f"{squares or 'none'}. Grey: standstills."
    )
    make, lines = partial(_health, motion, ratio), lines_link(motion.trial)
    return Figure(f"health_{index:02d}", title, caption, make, motion.virtual, lines)


def _health(motion: Motion, ratio: Array) -> Canvas:
    h, kinds = motion.health, np.array(motion.health.kind, dtype=object)
    figure, axes = canvas.panels(
        [1.0, 1.2], frame=canvas.Frame(gap=0.3 if len(set(h.kind)) < 4 else 0.46),
        y=["velocity [m/s]", "innovation [σ]"], x="time of the log [s]",
    )  # fmt: skip
    for axis in axes:
        for start, end in h.rests:
            axis.axvspan(start, end, color=canvas.SHADE, linewidth=0, zorder=0)
    t, v, std = canvas.envelope(motion.t, motion.v, motion.v_std, points=300)
    canvas.band(axes[0], t, v, std, "body velocity")
    axes[1].axhspan(-2, 2, color=canvas.FAINT, alpha=0.4, linewidth=0, zorder=0.5)
    for kind, (colour, marker) in zip(dict.fromkeys(h.kind), itertools.cycle(KINDS), strict=False):
        positions = np.flatnonzero(kinds == kind)
        positions = positions[:: -(-positions.size // SHOWN_INNOVATIONS)]
        axes[1].plot(
            np.asarray(h.t)[positions], ratio[positions], marker=marker, markersize=1.8, linestyle="none",
            color=colour, label=kind.replace("_", " "), markeredgewidth=0,
        )  # fmt: skip
    highest = float(np.nanmax(np.abs(ratio))) if np.isfinite(ratio).any() else 3.0
    limit = min(max(3.2, 1.1 * highest), 8.0)
    axes[1].set_ylim(-limit, limit)
    for axis in axes:
        canvas.legend(axis, points=2.5)
    axes[0].set_xlim(float(motion.t[0]), float(motion.t[-1]))
    axes[-1].ticklabel_format(axis="x", useOffset=False)
    return figure
