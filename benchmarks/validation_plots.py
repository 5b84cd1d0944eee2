"""Figures of docs/validation.md: every measured point, and what the model makes of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.validation_data import Series
from benchmarks.validation_fit import Array, Fit, Needed, Setup, constant, model, numbers, paper_law
from granite_lab.parameters import load_paper
from granite_lab.reporting import canvas

LABELS = ("drawbar pull [N]", "torque [N m]", "sinkage [mm]")

COLOURS = (canvas.MEASURED, canvas.MEASURED_LIGHT, canvas.SIMULATED, canvas.SIMULATED_LIGHT, canvas.FITTED,
           canvas.PAPER, canvas.INK)  # fmt: skip


def curves(series: Series, setup: Setup, low: float = -1.0) -> tuple[Array, Array]:
    """Return slips and (N, 3) pull, torque and sinkage, the load interpolated between the tests."""
    rows = [row for row in series.groups if row.slip >= low]
    slips = np.linspace(rows[0].slip, rows[-1].slip, 41)
    load = np.interp(slips, [r.slip for r in rows], [r.load for r in rows])
    found = [
        numbers(model(series, replace(rows[0], slip=float(s), load=float(w)), setup))
        for s, w in zip(slips, load, strict=True)
    ]
    return slips, np.array(found)


def against(wheels: Sequence[Series], laws: Mapping[str, Fit], full: Mapping[str, Fit]) -> Figure:
    """Draw series of one author side by side: measured points, the model's range, three models.

    Args:
        wheels: the series.
        laws: the fitted law of k_92 in slip, by series.
        full: the same with effects.
    """
    shown = [c for c in range(3) if any(not np.isnan(row_of(s)[:, c]).all() for s in wheels)]
    head = 0.72 if len(wheels) > 1 else 1.2
    wide, tall = 0.75 + 3.9 * len(wheels), 0.23 + head + 1.75 * len(shown)
    with canvas.styled():
        figure = Figure(figsize=(wide, tall))
        grid = figure.add_gridspec(
            len(shown), len(wheels), left=0.68 / wide, right=1 - 0.1 / wide, bottom=0.45 / tall,
            top=1 - head / tall, hspace=0.16, wspace=0.16,
        )  # fmt: skip
        first: dict[int, Axes] = {}
        for j, series in enumerate(wheels):
            lines = [curves(series, Setup(constant(k))) for k in (0.0, 1.0)]
            law = curves(series, Setup(paper_law))
            fitted = [curves(series, x[series.id].setup, -0.1) for x in (laws, full)]
            for i, c in enumerate(shown):
                axis = figure.add_subplot(grid[i, j], sharey=first.get(i))
                first.setdefault(i, axis)
                slips = lines[0][0]
                axis.fill_between(slips, lines[0][1][:, c], lines[1][1][:, c], color=canvas.SHADE,
                                  label="model, k_92 from 0 to 1")  # fmt: skip
                axis.plot(*column(law, c), color=canvas.SIMULATED, label="model, k_92 by the paper's law")
                axis.plot(*column(fitted[0], c), color=canvas.FITTED, label="k_92 fitted, linear in slip")
                axis.plot(*column(fitted[1], c), color=canvas.PAPER, linestyle="--",
                          label="… with slip_sinkage and bulldozing")  # fmt: skip
                points, stds = row_of(series), [r.pull_std for r in series.rows]
                scattered = bool(np.isfinite(stds).all())
                axis.errorbar(
                    [r.slip for r in series.rows], points[:, c],
                    yerr=stds if c == 0 and scattered else None,
                    fmt="o", markersize=3.2, color=canvas.MEASURED, elinewidth=0.8, capsize=1.5,
                    label="measured" + (", ± std in the run" if scattered else ""),
                )  # fmt: skip
                axis.axhline(0, color=canvas.INK, linewidth=0.5)
                if i == 0:
                    axis.set_title(series.title, loc="left", fontweight="bold")
                if j == 0:
                    axis.set_ylabel(LABELS[c])
                else:
                    axis.tick_params(labelleft=False)
                if i == len(shown) - 1:
                    axis.set_xlabel("slip ratio λ")
                else:
                    axis.tick_params(labelbottom=False)
        handles, labels = first[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="upper left", ncols=3 if len(wheels) > 1 else 1, frameon=False,
                      bbox_to_anchor=(0.0, 1.0), columnspacing=1.0, handlelength=1.6)  # fmt: skip
    return figure


def row_of(series: Series) -> Array:
    """Return (rows, 3) what was measured."""
    return np.array([[r.pull, r.torque, r.sinkage] for r in series.rows])


def column(curve: tuple[Array, Array], c: int) -> tuple[Array, Array]:
    """Return slips and one quantity."""
    return curve[0], curve[1][:, c]


def ratios(found: Mapping[str, tuple[Series, Sequence[Needed]]]) -> Figure:
    """Draw the k_92 that the drawbar pull of each slip asks for, beside the paper's."""
    paper = load_paper()
    wide, tall = 6.4, 5.0
    with canvas.styled():
        figure = Figure(figsize=(wide, tall))
        axis = figure.add_axes((0.62 / wide, 0.48 / tall, 1 - 0.76 / wide, 1 - 1.7 / tall))
        slips = np.linspace(0, 0.25, 50)
        axis.plot(slips, np.clip(paper.fig4_intercept + paper.fig4_slope * slips, 0, 1), color=canvas.GREY,
                  linewidth=1.0, label="the paper's line over slip (Fig. 4)")  # fmt: skip
        axis.plot([p.slip_measured for p in paper.table3], [p.k92 for p in paper.table3], "*", markersize=10,
                  color=canvas.GREY, label="the paper's Table 3, 0.2 to 0.7 m/s")  # fmt: skip
        for (series, needs), colour in zip(found.values(), COLOURS, strict=True):
            there = [n for n in needs if n.row.slip > -0.1]
            axis.plot([n.row.slip for n in there], [n.best[0] for n in there], color=colour, linewidth=0.9,
                      alpha=0.6)  # fmt: skip
            for good, fill in ((True, colour), (False, canvas.GROUND)):
                part = [n for n in there if n.reached[0] == good]
                axis.plot([n.row.slip for n in part], [n.best[0] for n in part], "o", color=colour,
                          markerfacecolor=fill, markersize=5, clip_on=False,
                          label=series.title if good else None)  # fmt: skip
        axis.plot([], [], "o", color=canvas.INK, markerfacecolor=canvas.GROUND, markersize=5,
                  label="hollow: no k_92 gives this pull within 5 % of the load")  # fmt: skip
        axis.set_xlabel("slip ratio λ")
        axis.set_ylabel("k_92 nearest to the drawbar pull")
        axis.set_ylim(0, 1)
        axis.set_xlim(-0.02, 0.93)
        handles, labels = axis.get_legend_handles_labels()
        figure.legend(handles, labels, loc="upper left", ncols=2, frameon=False, bbox_to_anchor=(0.02, 1.0))
    return figure
