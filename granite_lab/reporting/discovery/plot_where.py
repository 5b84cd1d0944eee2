"""When the model disagrees with the trials: intervals in time, per speed and channel."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure as Canvas

from granite_lab.discovery.finding import Finding
from granite_lab.reporting import canvas
from granite_lab.reporting.discovery import rows
from granite_lab.reporting.discovery.answers import percent
from granite_lab.reporting.discovery.names import channel_name, channels_of, spoken
from granite_lab.reporting.figures import Figure
from granite_lab.reporting.rounding import places

LOW, HIGH = 1.0, 50.0
TICKS = [1, 2, 5, 10, 20, 50]
SCALE = mpl.colors.LogNorm(LOW, HIGH)
COLOURS = mpl.colormaps["cividis"]
ROW, BETWEEN, HEAD, FOOT = 0.13, 0.24, 0.24, 0.98


def intervals_drawing(finding: Finding) -> Figure | None:
    """Draw the intervals of disagreement over time, one panel per speed; None without any."""
    speeds = sorted({d.variant for d in finding.where})
    if not speeds:
        return None
    channels = channels_of(finding)
    tall = ROW * len(channels)
    height = HEAD + len(speeds) * tall + BETWEEN * (len(speeds) - 1) + FOOT
    wide = canvas.WIDTH - rows.LEFT - rows.RIGHT
    end = max(float(r.t[-1]) for r in finding.residuals if r.variant in speeds)
    with canvas.styled():
        figure = Canvas(figsize=(canvas.WIDTH, height))
        for k, speed in enumerate(speeds):
            low = height - HEAD - (k + 1) * tall - k * BETWEEN
            box = (rows.LEFT / canvas.WIDTH, low / height, wide / canvas.WIDTH, tall / height)
            axis = figure.add_axes(box)
            for d in finding.where:
                if d.variant == speed:
                    axis.barh(
                        channels.index(d.channel), d.end - d.start, left=d.start, height=0.8, linewidth=0,
                        color=COLOURS(SCALE(np.clip(100 * d.share, LOW, HIGH))),
                    )  # fmt: skip
            axis.set_facecolor(COLOURS(0.0))
            axis.set_ylim(len(channels) - 0.5, -0.5)
            axis.set_yticks(range(len(channels)), [channel_name(c) for c in channels], fontsize=6.5)
            axis.tick_params(axis="y", length=0)
            axis.grid(visible=False, axis="y")
            axis.set_xlim(-0.5, end)
            axis.text(0, 1.02, f"{speed:g} m/s", transform=axis.transAxes, fontsize=8, va="bottom")
            axis.tick_params(labelbottom=k == len(speeds) - 1)
        axis.set_xlabel("time since the start of the command [s]")
        names = ["≤1", *(str(t) for t in TICKS[1:-1]), "≥50"]
        rows.colour_bar(
            figure, mpl.cm.ScalarMappable(SCALE, COLOURS), "share of the channel's rms [%]", TICKS, names
        )
        canvas.mark_virtual(figure, finding.virtual)
    worst = max(finding.where, key=lambda d: d.share)
    n = len(finding.where)
    count = "one interval" if n == 1 else f"{n} intervals"
    return Figure(
        "found_intervals",
        f"When the model without any effect disagrees{canvas.data_tag(finding.virtual)}",
        f"Lighter is further off: {count} beyond the tolerance; the largest is the {spoken(worst.channel)} "
        f"at {worst.variant:g} m/s from {places(worst.start, 2)} s to {places(worst.end, 2)} s "
        f"({percent(worst.share)} of its rms).",
        "Bars over time, per speed and channel, where the model without effects disagrees with the trials by "
        "more than the tolerance.",
        lambda: figure,
    )
