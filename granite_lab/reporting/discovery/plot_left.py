"""What is left of the residuals, over frequency: flat at one is noise."""

from __future__ import annotations

import numpy as np
from matplotlib.ticker import NullLocator
from scipy.special import chdtri

from granite_lab.discovery.finding import Finding
from granite_lab.reporting import canvas
from granite_lab.reporting.canvas import Drawing
from granite_lab.reporting.discovery import rows
from granite_lab.reporting.discovery.names import with_found
from granite_lab.reporting.discovery.residue import spectra
from granite_lab.reporting.rounding import significant


def left_drawing(finding: Finding) -> Drawing:
    """Draw the power of the residuals before and after, over frequency."""
    width = min(float(r.t[1] - r.t[0]) for r in finding.residuals)
    edges = np.geomspace(0.1, 0.5 / width, 19)
    before, after, count = spectra(finding, edges)
    known = count > 0
    centre = np.sqrt(edges[1:] * edges[:-1])[known]
    low, high = (chdtri(count[known], q) / count[known] for q in (0.975, 0.025))
    figure, (axis,) = canvas.stacked([1.9], [2])
    with canvas.styled():
        axis.fill_between(centre, low, high, color=canvas.FAINT, alpha=0.5, linewidth=0, label="noise, 95 %")
        axis.axhline(1, color=canvas.INK, linewidth=0.7)
        axis.plot(centre, before[known], "o-", color=rows.BEFORE, markersize=3, label="model without effects")
        if finding.effects:
            axis.plot(centre, after[known], "D-", color=rows.AFTER, markersize=3, label=with_found(finding))
        rows.log_axis(axis, 0.1, 0.5 / width)
        axis.set_yscale("log")
        values = np.concatenate([before[known], after[known], [0.3, 3.0]])
        bottom, top = 0.7 * values.min(), 1.5 * values.max()
        axis.set_ylim(bottom, top)
        ticks = [10.0**k for k in range(-4, 8) if bottom <= 10.0**k <= top]
        axis.set_yticks(ticks, [rows.times(t) for t in ticks])
        axis.yaxis.set_minor_locator(NullLocator())
        axis.set_xlabel("frequency [Hz]")
        axis.set_ylabel("power over noise [–]")
        canvas.align_labels([axis])
        canvas.legend_above(axis, 2)
        canvas.mark_virtual(figure, finding.virtual)
    return Drawing(
        "found_left",
        f"What is left, over frequency{canvas.data_tag(finding.virtual)}",
        describe_left(
            finding, below=bool(np.mean((after if finding.effects else before)[known] < low) > 0.2)
        ),
        "Power of the mean difference between trials and model over its noise, by frequency, without and "
        "with what was found.",
        figure,
    )


def describe_left(finding: Finding, *, below: bool = False) -> str:
    """Say whether what is left is noise, by the largest score of the map.

    Args:
        finding: the record.
        below: some of the spectrum lies below what noise would leave.
    """
    threshold = significant(finding.map_threshold, 2)
    score = finding.map_after if finding.effects else finding.map_before
    which = with_found(finding) if finding.effects else "without any effect"
    noise = "noise" if score <= finding.map_threshold else "more than noise"
    text = (
        f"What is left is {noise}: {which}, the stretch that is furthest off scores {significant(score, 3)}; "
        f"chance alone reaches {threshold} in one set of 100."
    )
    if below and noise == "noise":
        text += " Points below the grey band are less than noise would leave, no sign of anything missing."
    return text
