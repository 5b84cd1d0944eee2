"""The robot slip ratio over speed, beside the paper's experiment."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from granite_lab.parameters import Paper
from granite_lab.reporting import canvas
from granite_lab.reporting.figures import Figure
from granite_lab.reporting.points import bar, frame, markers, point, spread
from granite_lab.reporting.summary import Speed


def slip_drawing(speeds: Sequence[Speed], paper: Paper, virtual: bool) -> Figure:
    """Draw λ_R over the desired velocity: each trial, the means, the model and the paper."""
    figure, (axis,) = canvas.stacked([2.6], [2])
    with canvas.styled():
        for i, speed in enumerate(speeds):
            x = spread(speed)
            for j, result in enumerate(speed.results):
                slip = result.comparison.motion.slip_ratio
                point(
                    axis,
                    x[j],
                    slip.value * 100,
                    196 * slip.std,
                    canvas.MEASURED_LIGHT,
                    "o",
                    len(x),
                    "a trial" if i + j == 0 else None,
                )
            if math.isfinite(speed.slip.value):
                axis.errorbar(
                    speed.velocity, speed.slip.value * 100,
                    yerr=[[100 * bar(speed.slip.value - speed.slip.low)],
                    [100 * bar(speed.slip.high - speed.slip.value)]],
                    color=canvas.MEASURED, marker="D", markersize=4.5, capsize=4, linewidth=1.4,
                    label="mean, 95 %" if i == 0 else None,
                )  # fmt: skip
        markers(
            axis,
            [(s.velocity, s.simulated * 100) for s in speeds],
            canvas.SIMULATED,
            "_",
            "simulated with fitted k₉₂",
            12,
            2.0,
        )
        markers(
            axis,
            [(p.velocity, p.slip_measured * 100) for p in paper.table3],
            canvas.PAPER,
            "+",
            "paper, experiment",
            10,
            1.8,
        )
        frame(axis, "desired velocity [m/s]", "robot slip ratio [%]")
        axis.set_xlim(left=0)
        axis.set_ylim(bottom=min(0.0, axis.get_ylim()[0]))
        canvas.legend_above(axis, 2)
        canvas.mark_virtual(figure, virtual)
    return Figure(
        "slip_over_speed", f"Robot slip ratio over speed{canvas.data_tag(virtual)}", _describe_slip(speeds),
        "Robot slip ratio over desired velocity: trials, means with 95 % intervals, simulation and the "
        "paper's experiment.",
        lambda: figure,
    )  # fmt: skip


def _describe_slip(speeds: Sequence[Speed]) -> str:
    known = [s for s in speeds if math.isfinite(s.slip.value)]
    if len(known) < 2:
        return "Measured slip with its 95 % interval beside the paper's experiment."
    rising = all(a.slip.value < b.slip.value for a, b in pairwise(known))
    compared = [s.slip.holds(s.published.slip_measured) for s in known if s.published]
    trend = "Slip grows with speed" if rising else "Slip does not grow steadily with speed"
    if not compared:
        return f"{trend}."
    inside = sum(c is True for c in compared)
    return (
        f"{trend}; the paper's experiment is inside the 95 % interval at {inside} of {len(compared)} speeds."
    )
