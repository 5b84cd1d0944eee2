"""A closer look at the moments in which what was found makes the most difference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from granite_lab.discovery.finding import Finding
from granite_lab.logs.trial import Array
from granite_lab.reporting import canvas
from granite_lab.reporting.canvas import Drawing
from granite_lab.reporting.discovery import rows
from granite_lab.reporting.discovery.names import CHANNELS, spoken, what_found
from granite_lab.reporting.discovery.residue import Mean, means
from granite_lab.reporting.rounding import significant, tidy_unit, with_unit

LONG = 1.2
"""Length of the moment that is shown [s]."""

LEAD = 0.2
"""Time before it that is shown as well [s]."""

LOOKS, PANELS = 2, 2
"""Moments, and channels of each."""

LEAST = 0.05
"""A second moment, and a second channel, is shown where it explains this share of what the first does."""

WHEN = {"start": "at the start", "end": "at the end", "steady": "in steady motion", "rest": "at rest"}

SCALE = {"rad/s": (1e3, "mrad/s"), "rad": (1e3, "mrad")}


@dataclass(frozen=True, eq=False)
class Look:
    """A moment of a command.

    Attributes:
        velocity: desired velocity of the command [m/s].
        window: bins of the moment.
        event: what happens in it: "start", "end", or the commanded phase between and after them.
        gain: whitened squares that what was found explains.
        means: channels with the largest gain first.
    """

    velocity: float
    window: slice
    event: str
    gain: float
    means: tuple[Mean, ...]


def looks(finding: Finding) -> list[Look]:
    """Return the moments in which what was found explains most, each at another event of the motion."""
    groups: dict[tuple[float, tuple[str, ...]], list[Mean]] = {}
    for mean in means(finding):
        groups.setdefault((mean.velocity, mean.phase), []).append(mean)
    found = [look for own in groups.values() for look in _moments(own)]
    best: list[Look] = []
    for look in sorted(found, key=lambda look: -look.gain):
        enough = look.gain > (LEAST * best[0].gain if best else 0)
        if enough and all(look.event != b.event for b in best):
            best.append(look)
    return best[:LOOKS]


def _moments(own: Sequence[Mean]) -> list[Look]:
    """Return the best moment of one command at each event."""
    first = own[0]
    n = min(round(LONG / first.width), first.t.size)
    gains = np.array([m.z_before**2 - m.z_after**2 for m in own])
    over = np.convolve(gains.sum(axis=0), np.ones(n), mode="valid")
    phases = np.array(first.phase)
    found = {}
    for start in np.argsort(-over):
        early = max(0, int(start) - round(LEAD / first.width))
        window = slice(early, early + n)
        event = _event(phases[window])
        if event not in found:
            by_channel = gains[:, int(start) : int(start) + n].sum(axis=1)
            order = np.argsort(-by_channel, kind="stable")[:PANELS]
            shown = tuple(own[k] for k in order if by_channel[k] >= LEAST * by_channel[order[0]])
            found[event] = Look(first.velocity, window, event, float(over[start]), shown)
    return list(found.values())


def _event(phases: Array) -> str:
    """Name what happens in a moment by the (n,) commanded phases in it."""
    if "accelerate" in phases:
        return "start"
    if "brake" in phases:
        return "end"
    values, counts = np.unique(phases, return_counts=True)
    return str(values[np.argmax(counts)])


def closer_drawings(finding: Finding) -> list[Drawing]:
    """Draw the moments in which what was found makes the most difference; none without effects."""
    if not finding.effects:
        return []
    return [_drawing(finding, look, k) for k, look in enumerate(looks(finding), 1)]


def _drawing(finding: Finding, look: Look, number: int) -> Drawing:
    heights, panels = [], []
    for mean in look.means:
        if not mean.channel.startswith("wheel"):  # an angle grows all the time: only differences show
            heights.append(1.15)
            panels.append((mean, False))
        heights.append(0.75)
        panels.append((mean, True))
    figure, axes = canvas.stacked(heights, [2] + [1] * (len(panels) - 1))
    with canvas.styled():
        for axis, (mean, differs) in zip(axes, panels, strict=True):
            (_difference if differs else _overlaid)(axis, mean, look, finding)
        axes[-1].set_xlabel("time since the start of the command [s]")
        t = look.means[0].t[look.window]
        axes[0].set_xlim(float(t[0]), float(t[-1]))
        rows.legend_on_top(figure, _with_most(axes), 4, left=canvas.LEFT - 0.1)
        canvas.align_labels(axes)
        canvas.mark_virtual(figure, finding.virtual)
    data = canvas.data_tag(finding.virtual)
    when = WHEN.get(look.event, look.event)
    return Drawing(
        f"found_closer_{number}",
        f"A closer look: {look.velocity:g} m/s, {when}{data}",
        _describe(look, f"{what_found(finding)} explains {'most' if number == 1 else 'much, too'}"),
        f"Sensor readings at {look.velocity:g} m/s, {when}, measured and simulated without and with what was "
        f"found, and what the simulations are off by{data}.",
        figure,
    )


def _with_most(axes: Sequence[Axes]) -> Axes:
    return max(axes, key=lambda axis: len(axis.get_legend_handles_labels()[1]))


def _overlaid(axis: Axes, mean: Mean, look: Look, finding: Finding) -> None:  # noqa: ARG001
    scale, unit = _unit(mean)
    inside = look.window
    for values, colour, width, label in (
        (mean.measured, canvas.MEASURED_LIGHT, 3.2, "measured"),
        (mean.before, rows.BEFORE, 1.3, "before"),
        (mean.after, rows.AFTER, 1.3, "after"),
    ):
        axis.plot(mean.t[inside], scale * values[inside], color=colour, linewidth=width, label=label)
    _frame(axis, CHANNELS.get(mean.channel, mean.channel), unit)


def _difference(axis: Axes, mean: Mean, look: Look, finding: Finding) -> None:
    scale, unit = _unit(mean)
    inside = look.window
    noise = 2 * scale * _noise(finding, mean, look)
    if noise > 0:
        axis.axhspan(-noise, noise, color=canvas.SHADE, linewidth=0, zorder=0, label="±2σ of noise")
    axis.axhline(0, color=canvas.MEASURED_LIGHT, linewidth=1.6, label="measured")
    for values, colour, label in ((mean.before, rows.BEFORE, "before"), (mean.after, rows.AFTER, "after")):
        off = scale * (values - mean.measured)[inside]
        axis.plot(mean.t[inside], off, color=colour, linewidth=1.3, label=label)
    _frame(axis, f"{CHANNELS.get(mean.channel, mean.channel)}: simulated − measured", unit)


def _frame(axis: Axes, name: str, unit: str) -> None:
    axis.text(0, 1.03, name, transform=axis.transAxes, fontsize=8, va="bottom")
    axis.set_ylabel(f"[{unit}]")
    axis.yaxis.set_major_locator(MaxNLocator(4))


def _unit(mean: Mean) -> tuple[float, str]:
    return SCALE.get(mean.unit, (1.0, tidy_unit(mean.unit)))


def _noise(finding: Finding, mean: Mean, look: Look) -> float:
    """Return the std of the mean [unit], by how far the repetitions are apart; 0 with a single one."""
    own = [
        r for r in finding.residuals
        if (r.channel, r.variant, r.phase) == (mean.channel, mean.velocity, mean.phase)
    ]  # fmt: skip
    if len(own) < 2:
        return 0.0
    off = np.array([(r.measured - r.after)[look.window] for r in own])
    known = np.isfinite(off).all(axis=0)
    return float(np.sqrt(off[:, known].var(axis=0, ddof=1).mean() / len(own))) if known.any() else 0.0


def _describe(look: Look, found: str) -> str:
    n = max(m.trials for m in look.means)
    parts = []
    for mean in look.means:
        scale, unit = _unit(mean)
        before, after = (
            with_unit(significant(scale * _rms((v - mean.measured)[look.window]), 2), unit)
            for v in (mean.before, mean.after)
        )
        parts.append(f"{spoken(mean.channel)} by {before} before and {after} after")
    what = "the trial" if n == 1 else f"the mean of {n} trials"
    return f"Here {found}. The model is off {what}, rms, in {', in '.join(parts)}."


def _rms(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")
