"""What the panels of a time history draw: channels of a comparison, in printed units, thinned."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from granite_lab.comparison.record import Comparison
from granite_lab.logs.trial import Array
from granite_lab.parameters import WHEELS
from granite_lab.reporting import canvas

SLIP_STD_SHOWN = 0.10
"""Measured slip is drawn where its standard deviation is below this; at crawling speed it says nothing."""

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Trace:
    """One line of a panel.

    Attributes:
        source: "measured" or "simulated".
        label: in the legend.
        value, std: (N,) in the panel's unit; NaN where there is nothing to draw.
        light: drawn in the light tone (wheels, rear axle), and dashed if `dashed`.
    """

    source: str
    label: str
    value: Array
    std: Array
    light: bool = False
    dashed: bool = False

    @property
    def colour(self) -> str:
        """Blue tones are measured, orange tones simulated."""
        if self.source == "measured":
            return canvas.MEASURED_LIGHT if self.light else canvas.MEASURED
        return canvas.SIMULATED_LIGHT if self.light else canvas.SIMULATED


@dataclass(frozen=True)
class Panel:
    """One quantity of a time history.

    Attributes:
        id: "velocity", "slip", "torque" or "pitch".
        label: axis label with unit.
        scale: from the unit of the comparison to that of the axis.
        channels: (label, channel, light, dashed) of its lines; "wheels" is the mean of the four.
        difference_label, difference_scale: the same for the panel of differences.
    """

    id: str
    label: str
    scale: float
    channels: tuple[tuple[str, str, bool, bool], ...]
    difference_label: str
    difference_scale: float


PANELS = (
    Panel(
        "velocity", "velocity [m/s]", 1.0,
        (("wheels", "wheels", True, False), ("body", "velocity", False, False)),
        "velocity [mm/s]", 1e3,
    ),
    Panel(
        "slip", "slip ratio [%]", 100.0,
        (("front", "slip_f", False, False), ("rear", "slip_r", True, True)),
        "slip ratio [%]", 100.0,
    ),
    Panel(
        "torque", "wheel torque [N m]", 1.0,
        (("front", "torque_f", False, False), ("rear", "torque_r", True, True)),
        "wheel torque [N m]", 1.0,
    ),
    Panel(
        "pitch", "pitch [°]", 180 / math.pi,
        (("pitch", "pitch", False, False),),
        "pitch [°]", 180 / math.pi,
    ),
)  # fmt: skip


def channel(c: Comparison, source: str, name: str) -> tuple[Array, Array]:
    """Return a channel and its std in the comparison's unit, NaN where there is nothing to show.

    Slip is left out where it is not defined well: simulated below 0.02 m/s at the wheel, measured
    where its own standard deviation exceeds `SLIP_STD_SHOWN`.
    """
    nothing = np.full(len(c.t), np.nan)
    values = c.measured if source == "measured" else c.simulated
    if name == "wheels":
        return _mean_of_wheels(values, nothing), nothing
    value = values.get(name, nothing)
    std = c.measured_std.get(name, nothing) if source == "measured" else nothing
    if name.startswith("slip"):
        if source == "measured":
            hidden = std > SLIP_STD_SHOWN
        else:
            hidden = ~(np.abs(_mean_of_wheels(values, nothing)) > 0.02)
        value = np.where(hidden, np.nan, value)
    return value, std


def _mean_of_wheels(values: dict[str, Array], nothing: Array) -> Array:
    stack = np.array([values.get(f"wheel_{w}", nothing) for w in WHEELS])
    there = np.isfinite(stack)
    count = there.sum(axis=0)
    total = np.where(there, stack, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def traces(c: Comparison, panel: Panel, sources: tuple[str, ...]) -> list[Trace]:
    """Return the lines of a panel, those that hold at least one number."""
    lines = []
    for source in sources:
        for label, name, light, dashed in panel.channels:
            value, std = channel(c, source, name)
            if np.isfinite(value).any():
                shown = f"{label}, {source}" if len(sources) > 1 else label
                lines.append(
                    Trace(source, shown, value * panel.scale, std * panel.scale, light=light, dashed=dashed)
                )
    return lines


def span(c: Comparison) -> tuple[float, float]:
    """Return the part of the time axis that is drawn: the command and a little rest around it [s]."""
    v = min(c.run.variant.velocity, math.sqrt(c.run.variant.acceleration * c.run.variant.distance))
    end = c.run.variant.distance / v + v / c.run.variant.acceleration
    return max(float(c.t[0]), -0.5), min(float(c.t[-1]), end + 1.2)


def limits(lines: list[Trace], inside: Mask, anchor_zero: bool) -> tuple[float, float] | None:
    """Return axis limits that hold all lines but rare spikes; None without lines.

    Args:
        lines: what is drawn.
        inside: (N,) which samples are drawn.
        anchor_zero: the axis shall contain zero.
    """
    low, high = math.inf, -math.inf
    for line in lines:
        y = line.value[inside]
        y = y[np.isfinite(y)]
        if len(y):
            a, b = np.percentile(y, [0.5, 99.5])
            low, high = min(low, float(a)), max(high, float(b))
    if not math.isfinite(low):
        return None
    if anchor_zero:
        low, high = min(low, 0.0), max(high, 0.0)
    room = 0.08 * (high - low) or 0.1 * abs(high) or 1.0
    return low - room, high + room


def block_means(t: Array, value: Array, length: float) -> tuple[Array, Array]:
    """Average a trace over blocks of a length in time; NaN samples are left out.

    Args:
        t: (N,) uniform instants [s].
        value: (N,).
        length: of a block [s].

    Returns:
        instants and means, one per block.
    """
    step = float(np.median(np.diff(t))) if len(t) > 1 else length
    size = max(1, round(length / step))
    n = len(t) // size * size
    if n == 0:
        return t, value
    blocks = value[:n].reshape(-1, size)
    there = np.isfinite(blocks)
    count = there.sum(axis=1)
    means = np.where(count > 0, np.where(there, blocks, 0.0).sum(axis=1) / np.maximum(count, 1), np.nan)
    return t[:n].reshape(-1, size).mean(axis=1), means
