"""Misfit over channels and phases, and the health of the filter in each trial."""

from __future__ import annotations

import math
from functools import partial

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from granite_lab.estimation.motion import Motion
from granite_lab.logs.trial import Array
from granite_lab.reporting import canvas
from granite_lab.reporting.figures import Figure
from granite_lab.reporting.rounding import shown_as, significant, tidy_unit
from granite_lab.reporting.summary import CHANNELS, IN_PHASE, NOISE, PHASES, Gap, worst_of

KINDS = (canvas.MEASURED, canvas.SIMULATED, canvas.FITTED, canvas.PAPER, canvas.SIMULATED_LIGHT)
MARKERS = ("o", "s", "^", "D", "v")


def misfit_drawing(found: dict[tuple[str, str], Gap], virtual: bool) -> Figure | None:
    """Draw the misfit of each channel and phase over its noise; None without any."""
    channels = [c for c in CHANNELS if any((c, p) in found for p in PHASES)]
    if not channels:
        return None
    row, left, head, right = 0.235, 1.62, 0.3, 0.14
    height = head + row * len(channels) + 0.62
    with canvas.styled():
        figure = mpl.figure.Figure(figsize=(canvas.WIDTH, height))
        wide = canvas.WIDTH - left - right
        axis = figure.add_axes(
            (left / canvas.WIDTH, 0.62 / height, wide / canvas.WIDTH, row * len(channels) / height)
        )
        values = np.array(
            [[found[c, p].normalised if (c, p) in found else math.nan for p in PHASES] for c in channels]
        )
        shown = np.ma.masked_invalid(np.clip(values, 0.5, 20))
        norm = mpl.colors.LogNorm(0.5, 20)
        image = axis.pcolormesh(shown, cmap="cividis", norm=norm, edgecolors="white", linewidth=1.0)
        axis.set_facecolor("#f3f3f3")
        for i, c in enumerate(channels):
            for j, p in enumerate(PHASES):
                gap = found.get((c, p))
                dark = (
                    gap is not None
                    and math.isfinite(gap.normalised)
                    and norm(np.clip(gap.normalised, 0.5, 20)) < 0.5
                )
                axis.text(
                    j + 0.5,
                    i + 0.5,
                    _cell(gap),
                    ha="center",
                    va="center",
                    fontsize=7.5,
                    color="#fefefe" if dark else "#111111",
                )
        axis.set_yticks(np.arange(len(channels)) + 0.5, [CHANNELS[c] for c in channels])
        axis.set_xticks(np.arange(len(PHASES)) + 0.5, PHASES)
        axis.xaxis.tick_top()
        axis.tick_params(length=0)
        axis.grid(visible=False)
        axis.invert_yaxis()
        for spine in axis.spines.values():
            spine.set_visible(False)
        bar = figure.add_axes((left / canvas.WIDTH, 0.4 / height, wide / canvas.WIDTH, 0.1 / height))
        scale = figure.colorbar(image, cax=bar, orientation="horizontal", ticks=[0.5, 1, 2, 5, 10, 20])
        scale.ax.set_xticklabels(["≤0.5", "1", "2", "5", "10", "≥20"])
        scale.ax.minorticks_off()
        assert scale.solids is not None
        scale.solids.set(rasterized=False, edgecolor="face", linewidth=0.3)  # no image inside the SVG
        scale.set_label("rms misfit over noise [–] (1: noise floor); cells: rms", fontsize=8)
        scale.outline.set_linewidth(0.4)
        canvas.mark_virtual(figure, virtual)
    data = canvas.data_tag(virtual)
    return Figure(
        "misfit", f"Misfit per channel and phase{data}", describe_misfit(found),
        "Heat map of the root mean square misfit of each channel in each phase, over the noise.",
        lambda: figure,
    )  # fmt: skip


def _cell(gap: Gap | None) -> str:
    if gap is None or not math.isfinite(gap.rms):
        return "–"
    unit, scale = shown_as(gap.unit)
    return f"{significant(gap.rms * scale, 2)} {tidy_unit(unit)}"


def describe_misfit(found: dict[tuple[str, str], Gap]) -> str:
    """Say which cell stands out."""
    worst = worst_of(found.values())
    if worst is None:
        return "The noise of the channels is not known, so only the misfit itself is given."
    if worst.normalised <= NOISE:
        return "No channel is further from the simulation than its noise explains."
    size, share = significant(worst.normalised, 2), significant(100 * worst.relative, 2)
    return (
        f"Lighter is further beyond the noise; the largest gap is the {worst.name} "
        f"{IN_PHASE.get(worst.phase, worst.phase)} "
        f"({size} times its noise, {share} % of its largest value)."
    )


def health_drawing(motion: Motion, index: int) -> Figure:
    """Draw how the filter fared in one trial: innovations with bounds, biases with 2σ, rests shaded."""
    data = canvas.data_tag(motion.virtual)
    return Figure(
        f"health_{index:02d}", f"Health of the estimate: {motion.trial}{data}", describe_health(motion),
        f"Body velocity with rests, innovations with bounds, accelerometer and gyroscope bias of trial "
        f"{motion.trial}{data}.", partial(_health, motion),
    )  # fmt: skip


def _health(motion: Motion) -> Canvas:
    h = motion.health
    with_gyro = len(h.gyro_bias) == len(motion.t) and bool(np.isfinite(h.gyro_bias).any())
    figure, axes = canvas.stacked([1.0, 1.2, 0.95, 0.95], [1, 2, 1, 1])
    with canvas.styled():
        for axis in axes:
            for start, end in h.rests:
                axis.axvspan(
                    start,
                    end,
                    color=canvas.SHADE,
                    linewidth=0,
                    zorder=0,
                    label="at rest" if axis is axes[0] and (start, end) == h.rests[0] else None,
                )
            axis.yaxis.set_major_locator(MaxNLocator(4))
        t, v, std = canvas.envelope(motion.t, motion.v, motion.v_std, points=500)
        if np.isfinite(v).any():
            axes[0].fill_between(t, v - 2 * std, v + 2 * std, color=canvas.MEASURED, alpha=0.25, linewidth=0)
            axes[0].plot(t, v, color=canvas.MEASURED, label="body velocity ±2σ")
        axes[0].set_ylabel("velocity [m/s]")
        _innovations(axes[1], motion)
        _bias(
            axes[2], motion.t, h.accel_bias * 1e3, h.accel_bias_std * 1e3, "accelerometer bias with tilt, ±2σ"
        )
        axes[2].set_ylabel("bias [mm/s²]")
        _bias(
            axes[3],
            motion.t,
            h.gyro_bias * 1e3 if with_gyro else motion.t * math.nan,
            h.gyro_bias_std * 1e3,
            "gyroscope bias, ±2σ",
        )
        axes[3].set_ylabel("bias [mrad/s]")
        for axis in axes:
            canvas.legend_above(axis, 3)
        axes[0].set_xlim(float(motion.t[0]), float(motion.t[-1]))
        axes[-1].set_xlabel("time of the log [s]")
        axes[-1].ticklabel_format(axis="x", useOffset=False)
        canvas.align_labels(axes)
        canvas.mark_virtual(figure, motion.virtual)
    return figure


def _innovations(axis: Axes, motion: Motion) -> None:
    h = motion.health
    t, kinds = np.asarray(h.t, dtype=float), np.array(h.kind, dtype=object)
    ratio = h.innovation / np.where(h.innovation_std > 0, h.innovation_std, np.nan)
    axis.axhspan(-2, 2, color=canvas.FAINT, alpha=0.4, linewidth=0, zorder=0.5, label="±2 bound")
    for i, kind in enumerate(dict.fromkeys(h.kind)):
        where = np.flatnonzero(kinds == kind)
        thin = where[np.unique(np.linspace(0, len(where) - 1, min(len(where), 250)).astype(int))]
        axis.plot(t[thin], ratio[thin], marker=MARKERS[i % 5], markersize=1.8, linestyle="none",
        color=KINDS[i % 5],
                  label=kind.replace("_", " "), markeredgewidth=0)  # fmt: skip
    top = np.nanmax(np.abs(ratio)) if np.isfinite(ratio).any() else 3.0
    axis.set_ylim(-min(max(3.2, 1.1 * top), 8), min(max(3.2, 1.1 * top), 8))
    axis.set_ylabel("innovation [σ]")


def _bias(axis: Axes, t: Array, value: Array, std: Array, label: str) -> None:
    if len(value) != len(t) or not np.isfinite(value).any():
        axis.text(
            0.5,
            0.5,
            "not estimated",
            transform=axis.transAxes,
            ha="center",
            va="center",
            color=canvas.DESIRED,
        )
        return
    s, y, e = canvas.envelope(t, value, std, points=300)
    axis.fill_between(s, y - 2 * e, y + 2 * e, color=canvas.MEASURED, alpha=0.25, linewidth=0)
    axis.plot(s, y, color=canvas.MEASURED, label=label)


def describe_health(motion: Motion) -> str:
    """Say what to see: the filter's verdict and how many innovations leave their bounds."""
    h = motion.health
    ratio = np.abs(h.innovation) / np.where(h.innovation_std > 0, h.innovation_std, np.nan)
    ratio = ratio[np.isfinite(ratio)]
    if len(ratio) == 0:
        return f"{h.verdict} No update was made."
    outside = 100 * float(np.mean(ratio > 2))
    return f"{h.verdict} {significant(outside, 2)} % of the innovations lie outside ±2σ (about 5 % is right)."
