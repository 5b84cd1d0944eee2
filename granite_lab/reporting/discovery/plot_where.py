"""Where model and trials disagree: a map over channel, phase and frequency, and intervals in time."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from granite_lab.discovery.finding import Finding
from granite_lab.discovery.lackfit import BANDS
from granite_lab.reporting import canvas
from granite_lab.reporting.canvas import Drawing
from granite_lab.reporting.discovery import rows
from granite_lab.reporting.discovery.names import channel_name, spoken, with_found
from granite_lab.reporting.discovery.residue import Strength, channels_of, strengths
from granite_lab.reporting.rounding import places, significant
from granite_lab.reporting.summary import IN_PHASE, PHASES

LOW, HIGH = 1.0, 50.0
TICKS = [1, 2, 5, 10, 20, 50]
SCALE = mpl.colors.LogNorm(LOW, HIGH)
COLOURS = mpl.colormaps["cividis"]


def map_drawing(finding: Finding, *, after: bool = False) -> Drawing:
    """Draw the strength of the disagreement by channel, phase and frequency.

    Args:
        finding: the record.
        after: of the model with what was found; otherwise of the model without.
    """
    channels, found = channels_of(finding), strengths(finding)
    marks = {key for key, s in found.items() if s.score(after=after) > finding.map_threshold}
    figure, (axis,) = rows.panels([channel_name(c) for c in channels], row=0.22, head=0.25, foot=1.3)
    with canvas.styled():
        values = np.array(
            [
                [_rms(found.get((c, p, k)), after=after) for p in PHASES for k in range(len(BANDS))]
                for c in channels
            ]
        )
        shown = np.ma.masked_invalid(np.clip(values, LOW, HIGH))
        n = len(BANDS)
        x, y = np.arange(n * len(PHASES) + 1) - 0.5, np.arange(len(channels) + 1) - 0.5
        image = axis.pcolormesh(x, y, shown, cmap=COLOURS, norm=SCALE, edgecolors="white", linewidth=0.6)
        axis.set_facecolor("#f3f3f3")
        for i, c in enumerate(channels):
            for j, p in enumerate(PHASES):
                for k in range(n):
                    if (c, p, k) in marks:
                        dark = SCALE(np.clip(values[i, j * n + k], LOW, HIGH)) < 0.5
                        axis.plot(
                            j * n + k, i, marker="o", markersize=2.6, color="#fefefe" if dark else "#111111"
                        )
        for j, p in enumerate(PHASES):
            axis.text((j + 0.5) * n - 0.5, -0.62, p, ha="center", va="bottom", fontsize=8)
            if j:
                axis.axvline(j * n - 0.5, color=canvas.INK, linewidth=0.9)
        names = [f"{low:g}–{high:g}" for low, high in BANDS] * len(PHASES)
        axis.set_xticks(range(len(names)), names, rotation=90, fontsize=7)
        axis.set_xlabel("band of frequency [Hz]", fontsize=8, labelpad=2)
        _bare(axis)
        _scale(figure, image, "rms of the mean difference over its noise [–]")
        canvas.mark_virtual(figure, finding.virtual)
    which = with_found(finding) if after else "without any effect"
    return Drawing(
        f"found_map_{'after' if after else 'before'}",
        f"Disagreement by channel, phase and frequency, model {which}{canvas.data_tag(finding.virtual)}",
        _describe_map(found, marks, after=after),
        f"Heat map of the difference between trials and the model {which}, over its noise, by channel, "
        "commanded phase and band of frequency.",
        figure,
    )


def _bare(axis: Axes) -> None:
    axis.tick_params(length=0)
    axis.grid(visible=False)
    for spine in axis.spines.values():
        spine.set_visible(False)


def _scale(figure: Figure, image: object, label: str) -> None:
    height = figure.get_size_inches()[1]
    wide = canvas.WIDTH - rows.LEFT - rows.RIGHT
    bar = figure.add_axes((rows.LEFT / canvas.WIDTH, 0.4 / height, wide / canvas.WIDTH, 0.09 / height))
    scale = figure.colorbar(image, cax=bar, orientation="horizontal", ticks=TICKS)  # type: ignore[arg-type]
    scale.ax.set_xticklabels(["≤1", *(str(t) for t in TICKS[1:-1]), "≥50"])
    scale.ax.minorticks_off()
    assert scale.solids is not None
    scale.solids.set(rasterized=False, edgecolor="face", linewidth=0.3)  # no image inside the SVG
    scale.set_label(label, fontsize=8)
    scale.outline.set_linewidth(0.4)


def _rms(strength: Strength | None, *, after: bool) -> float:
    if strength is None:
        return float("nan")
    return strength.after if after else strength.before


def _describe_map(
    found: dict[tuple[str, str, int], Strength], marks: set[tuple[str, str, int]], *, after: bool
) -> str:
    if not marks:
        return "No cell is further from the model than chance explains; noise alone is dark."
    (channel, phase, band) = max(marks, key=lambda key: _rms(found[key], after=after))
    low, high = BANDS[band]
    return (
        f"Lighter is further beyond the noise; dots mark what chance does not explain. Strongest: "
        f"{spoken(channel)} {IN_PHASE[phase]}, {low:g}–{high:g} Hz "
        f"({significant(_rms(found[channel, phase, band], after=after), 2)} times its noise)."
    )


def intervals_drawing(finding: Finding) -> Drawing | None:
    """Draw the intervals of disagreement over time, one panel per speed; None without any."""
    speeds = sorted({d.variant for d in finding.where})
    if not speeds:
        return None
    channels = channels_of(finding)
    row, between, head, foot = 0.13, 0.24, 0.24, 0.98
    tall = row * len(channels)
    height = head + len(speeds) * tall + between * (len(speeds) - 1) + foot
    wide = canvas.WIDTH - rows.LEFT - rows.RIGHT
    ends = [float(r.t[-1]) for r in finding.residuals if r.variant in speeds]
    with canvas.styled():
        figure = Figure(figsize=(canvas.WIDTH, height))
        for k, speed in enumerate(speeds):
            low = height - head - (k + 1) * tall - k * between
            axis = figure.add_axes(
                (rows.LEFT / canvas.WIDTH, low / height, wide / canvas.WIDTH, tall / height)
            )
            for d in finding.where:
                if d.variant == speed:
                    colour = COLOURS(SCALE(np.clip(d.strength, LOW, HIGH)))
                    axis.barh(
                        channels.index(d.channel), d.end - d.start, left=d.start, height=0.8,
                        color=colour, linewidth=0,
                    )  # fmt: skip
            axis.set_facecolor(COLOURS(0.0))  # as on the map: dark is noise
            axis.set_ylim(len(channels) - 0.5, -0.5)
            axis.set_yticks(range(len(channels)), [channel_name(c) for c in channels], fontsize=6.5)
            axis.tick_params(axis="y", length=0)
            axis.grid(visible=False, axis="y")
            axis.set_xlim(-0.5, max(ends))
            axis.text(0, 1.02, f"{speed:g} m/s", transform=axis.transAxes, fontsize=8, va="bottom")
            axis.tick_params(labelbottom=k == len(speeds) - 1)
        axis.set_xlabel("time since the start of the command [s]")
        image = mpl.cm.ScalarMappable(SCALE, COLOURS)
        _scale(figure, image, "strength over noise [–]")
        canvas.mark_virtual(figure, finding.virtual)
    return Drawing(
        "found_intervals",
        f"When the model without any effect disagrees{canvas.data_tag(finding.virtual)}",
        _describe_intervals(finding),
        "Bars over time, per speed and channel, where the model without effects disagrees with the trials "
        "beyond chance.",
        figure,
    )


def _describe_intervals(finding: Finding) -> str:
    strongest = max(finding.where, key=lambda d: d.strength)
    n = len(finding.where)
    count = "one interval" if n == 1 else f"{n} intervals"
    return (
        f"Dark is noise, lighter is further beyond it: {count} beyond chance; the strongest is the "
        f"{spoken(strongest.channel)} at "
        f"{strongest.variant:g} m/s from {places(strongest.start, 2)} s to {places(strongest.end, 2)} s "
        f"({significant(strongest.strength, 2)} times the noise)."
    )
