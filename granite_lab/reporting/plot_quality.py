"""Where model and measurement differ, by quantity and phase, and the checks of an estimate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from granite_lab.estimation.motion import Motion
from granite_lab.reporting import canvas
from granite_lab.reporting.answers import ChannelAnswer
from granite_lab.reporting.figures import Figure
from granite_lab.reporting.names import together
from granite_lab.reporting.rounding import shown_as, significant, tidy_unit
from granite_lab.reporting.summary import CHANNELS, PHASES, Gap

KINDS = (canvas.MEASURED, canvas.SIMULATED, canvas.FITTED, canvas.PAPER, canvas.SIMULATED_LIGHT)
MARKERS = ("o", "s", "^", "D", "v")
LOW, HIGH = 0.5, 20.0


def misfit_figure(
    found: dict[tuple[str, str], Gap], judged: Sequence[ChannelAnswer], virtual: bool
) -> Figure | None:  # fmt: skip
    """Draw the difference of each quantity and phase over its noise; None without any."""
    if not any(phase in PHASES for _, phase in found):
        return None
    differ = [c.name for c in judged if c.tone in ("fair", "bad")]
    title = "No quantity differs from the simulation by more than its noise"
    if differ:
        title = f"Model and measurement differ in {together(differ)}"
    return Figure(
        "misfit", title,
        "Root mean square of simulated minus measured in each phase (numbers), and the same over the noise "
        "of the measurement (colour; 1 means as large as the noise).",
        "Heat map of the root mean square difference of each quantity in each phase, over the noise.",
        partial(_misfit, found, virtual), virtual,
    )  # fmt: skip


def _misfit(found: dict[tuple[str, str], Gap], virtual: bool) -> Canvas:
    channels = [c for c in CHANNELS if any((c, p) in found for p in PHASES)]
    figure, (axis,) = canvas.named_rows([CHANNELS[c] for c in channels], row=0.27, head=0.3, foot=0.8)
    with canvas.styled():
        cells = [[found[c, p].normalised if (c, p) in found else math.nan for p in PHASES] for c in channels]
        values = np.clip(np.array(cells), LOW, HIGH)
        norm = mpl.colors.LogNorm(LOW, HIGH)
        x, y = np.arange(len(PHASES) + 1), np.arange(len(channels) + 1) - 0.5
        image = axis.pcolormesh(
            x, y, np.ma.masked_invalid(values), cmap="cividis", norm=norm, edgecolors="white", linewidth=1.0
        )
        axis.set_facecolor("#f3f3f3")
        for i, c in enumerate(channels):
            for j, p in enumerate(PHASES):
                dark = math.isfinite(values[i, j]) and norm(values[i, j]) < 0.5
                axis.text(
                    j + 0.5, i, _cell(found.get((c, p))), ha="center", va="center", fontsize=7.5,
                    color="#fefefe" if dark else "#111111",
                )  # fmt: skip
        axis.set_xticks(np.arange(len(PHASES)) + 0.5, PHASES)
        axis.xaxis.tick_top()
        axis.tick_params(length=0)
        axis.grid(visible=False)
        for spine in axis.spines.values():
            spine.set_visible(False)
        ticks, names = [0.5, 1, 2, 5, 10, 20], ["≤0.5", "1", "2", "5", "10", "≥20"]
        canvas.colour_bar(figure, image, "rms difference over noise [–]", ticks, names)
        canvas.mark_virtual(figure, virtual)
    return figure


def _cell(gap: Gap | None) -> str:
    if gap is None or not math.isfinite(gap.rms):
        return "–"
    unit, scale = shown_as(gap.unit)
    return f"{significant(gap.rms * scale, 2)} {tidy_unit(unit)}"


def health_figure(motion: Motion, index: int) -> Figure:
    """Draw the checks of one estimate: innovations with bounds, rests shaded."""
    h = motion.health
    ratio = np.abs(h.innovation) / np.where(h.innovation_std > 0, h.innovation_std, np.nan)
    outside = 100 * float(np.mean(ratio[np.isfinite(ratio)] > 2)) if np.isfinite(ratio).any() else math.nan
    text = f"{significant(outside, 2)} % of the innovations lie outside ±2σ; 5 % are expected. "
    nis = ", ".join(f"{kind.replace('_', ' ')} {significant(x, 2)}" for kind, x in h.nis.items())
    text += f"Mean normalised innovation squared (1 is ideal): {nis}. " if nis else ""
    return Figure(
        f"health_{index:02d}", f"{motion.trial}: the estimate is {'good' if h.good else 'doubtful'}",
        f"{'' if math.isnan(outside) else text}Grey: standstills."
        + ("" if h.good else f" {h.verdict}"),
        f"Body velocity with standstills, and innovations with bounds, of trial "
        f"{motion.trial}.", partial(_health, motion), motion.virtual,
    )  # fmt: skip


def _health(motion: Motion) -> Canvas:
    figure, axes = canvas.stacked([1.0, 1.2], [1, 1 if len(set(motion.health.kind)) < 3 else 2])
    with canvas.styled():
        for axis in axes:
            for start, end in motion.health.rests:
                axis.axvspan(start, end, color=canvas.SHADE, linewidth=0, zorder=0)
        t, v, std = canvas.envelope(motion.t, motion.v, motion.v_std, points=300)
        if np.isfinite(v).any():
            axes[0].fill_between(t, v - 2 * std, v + 2 * std, color=canvas.MEASURED, alpha=0.25, linewidth=0)
            axes[0].plot(t, v, color=canvas.MEASURED, label="body velocity ±2σ")
        axes[0].set_ylabel("velocity [m/s]")
        _innovations(axes[1], motion)
        for axis in axes:
            axis.yaxis.set_major_locator(MaxNLocator(4))
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
    axis.axhspan(-2, 2, color=canvas.FAINT, alpha=0.4, linewidth=0, zorder=0.5)
    for i, kind in enumerate(dict.fromkeys(h.kind)):
        where = np.flatnonzero(kinds == kind)
        thin = where[np.unique(np.linspace(0, len(where) - 1, min(len(where), 200)).astype(int))]
        axis.plot(
            t[thin], ratio[thin], marker=MARKERS[i % 5], markersize=1.8, linestyle="none", color=KINDS[i % 5],
            label=kind.replace("_", " "), markeredgewidth=0,
        )  # fmt: skip
    top = np.nanmax(np.abs(ratio)) if np.isfinite(ratio).any() else 3.0
    axis.set_ylim(-min(max(3.2, 1.1 * top), 8), min(max(3.2, 1.1 * top), 8))
    axis.set_ylabel("innovation [σ]")
