"""The figures of `benchmarks.real_trials_page`: slip ratios of each trial of a set."""

from __future__ import annotations

import math

from matplotlib.figure import Figure

from benchmarks.real_trials_set import Outcome
from granite_lab.reporting import canvas

RANGE = (-40.0, 80.0)
"""Slip ratios that are drawn [%]: what is beyond tells nothing more."""


def slips(outcome: Outcome) -> Figure:
    """Draw λ_R ± 2 std of each trial, one below the other: estimated, with the reference, and by it alone."""
    rows = [row for row in outcome.rows if row.grade != "refused"]
    kinds = (
        ("slip", "by IMU and wheels", canvas.MEASURED, -0.2),
        ("referred", "with the reference", canvas.FITTED, 0.0),
        ("truth", "by the reference alone", canvas.SIMULATED, 0.2),
    )
    tall = 1.0 + 0.34 * max(len(rows), 1)
    with canvas.styled():
        figure = Figure(figsize=(6.8, tall))
        axis = figure.add_axes((0.2, 0.5 / tall, 0.78, 1 - 0.85 / tall))
        for name, label, colour, below in kinds:
            known = [(i, e) for i, row in enumerate(rows) if math.isfinite((e := getattr(row, name)).value)]
            if known:
                axis.errorbar(
                    [100 * e.value for _, e in known], [i + below for i, _ in known],
                    xerr=[200 * e.std for _, e in known], fmt="o", markersize=3, color=colour, label=label,
                )  # fmt: skip
        axis.set_yticks(range(len(rows)), [row.name for row in rows])
        axis.set_ylim(len(rows) - 0.5, -0.5)
        axis.set_xlim(*RANGE)
        axis.set_xlabel("slip ratio λ_R ± 2 std [%]")
        figure.legend(loc="upper right", ncols=3, frameon=False)
    return figure
