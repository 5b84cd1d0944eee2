"""The figures behind `plot()` of motions, fits, comparisons and findings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from granite_lab.api.logs import Ingested
from granite_lab.api.records import Records
from granite_lab.comparison.record import Comparison
from granite_lab.discovery.finding import Finding
from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Motion
from granite_lab.fitting.fit import AThetaFit, K92Fit
from granite_lab.parameters import load_paper
from granite_lab.reporting import canvas
from granite_lab.reporting.plot_motion import SLIP_STD_SHOWN, comparison_figure
from granite_lab.reporting.plot_search import gap_figure


def plot(record: Any) -> Figure:
    """Return the figure of a record.

    Raises:
        TypeError: there is none.
    """
    if isinstance(record, Records) and len(record):
        if all(isinstance(item, K92Fit) for item in record):
            return fits_plot([(f.variant.velocity, f.k92) for f in record], any(f.virtual for f in record))
        if len(record) == 1:
            return plot(record[0])
        raise TypeError("plot(): of fits all are drawn, of other records one, as in records[0].plot()")
    match record:
        case Ingested():
            return motion_plot(record.motion)
        case Motion():
            return motion_plot(record)
        case K92Fit():
            return fits_plot([(record.variant.velocity, record.k92)], record.virtual)
        case AThetaFit():
            return fits_plot([(v, k92) for _, v, k92, _ in record.points], record.virtual, record)
        case Comparison():
            return comparison_figure(record, 0).draw()
        case Finding():
            return gap_figure(record).draw()
    raise TypeError(f"plot(): there is no figure of {type(record).__name__}")


def motion_plot(motion: Motion) -> Figure:
    """Draw velocity, slip ratio and pitch over time with bands of ±2σ."""
    wheels = np.isfinite(motion.v_wheel).any(axis=1)
    t, wheel = motion.t[wheels], np.nanmean(motion.v_wheel[wheels], axis=1)
    with canvas.styled():
        figure, axes = canvas.panels([1.25, 1.05, 0.85])
        _band(axes[0], motion.t, motion.v, motion.v_std, "body")
        axes[0].plot(t, wheel, color=canvas.MEASURED_LIGHT, label="wheels, mean")
        for k, (name, color) in enumerate((("front", canvas.MEASURED), ("rear", canvas.MEASURED_LIGHT))):
            columns = [2 * k, 2 * k + 1]  # fl and fr, then rl and rr
            known = np.isfinite(motion.slip[:, columns]).any(axis=1)
            known &= (motion.slip_std[:, columns] < SLIP_STD_SHOWN).all(axis=1)
            slip = np.full(motion.t.shape, math.nan)
            slip[known] = np.nanmean(motion.slip[known][:, columns], axis=1)
            axes[1].plot(motion.t, 100 * slip, color=color, label=f"{name} wheels")
        degree = 180 / math.pi
        _band(axes[2], motion.t, degree * motion.pitch, degree * motion.pitch_std, "nose down")
        for axis, label in zip(axes, ("velocity [m/s]", "slip ratio [%]", "pitch [°]"), strict=True):
            axis.set_ylabel(label)
            canvas.legend(axis)
        axes[-1].set_xlabel("time of the log [s]")
        canvas.mark_virtual(figure, motion.virtual)
    return figure


def _band(axis: Any, t: Any, value: Any, std: Any, label: str) -> None:
    axis.fill_between(t, value - 2 * std, value + 2 * std, color=canvas.MEASURED, alpha=0.25, linewidth=0)
    axis.plot(t, value, color=canvas.MEASURED, label=f"{label}, ±2σ")


def fits_plot(fits: Sequence[tuple[float, Estimate]], virtual: bool, law: AThetaFit | None = None) -> Figure:
    """Draw k_92 over velocity with 95 % intervals, the law and values of the paper, and a fitted law.

    Args:
        fits: desired velocity [m/s] and k_92 of each trial.
        virtual: some of the logs were written by a simulator.
        law: a_θ that was fitted to them.
    """
    paper = load_paper()
    known = [(v, k92) for v, k92 in fits if math.isfinite(k92.value)]
    top = 1.1 * max([*(v for v, _ in known), *(point.velocity for point in paper.table3)])
    v = np.linspace(0, top, 200)
    with canvas.styled():
        figure, (axis,) = canvas.panels([2.6], head=0.46)
        axis.plot(
            v, np.exp(-paper.a_theta * v), color=canvas.PAPER, linestyle=(0, (4, 1.5)),
            label=f"paper, exp(−{paper.a_theta:g} v)",
        )  # fmt: skip
        table = [(point.velocity, point.k92) for point in paper.table3]
        axis.plot(
            *zip(*table, strict=True), color=canvas.PAPER, marker="s", linestyle="none", label="Table 3"
        )
        if law is not None:
            low, high = (np.exp(-a_theta * v) for a_theta in law.ci95)
            axis.fill_between(v, low, high, color=canvas.FITTED, alpha=0.25, linewidth=0)
            axis.plot(
                v, np.exp(-law.a_theta.value * v), color=canvas.FITTED,
                label=f"fit, exp(−{law.a_theta.value:.3g} v), 95 %",
            )  # fmt: skip
        axis.errorbar(
            [v for v, _ in known], [k92.value for _, k92 in known],
            yerr=[1.96 * np.nan_to_num(k92.std) for _, k92 in known],
            color=canvas.MEASURED, marker="o", markersize=4, linestyle="none",
            label="one trial, 95 %",
        )  # fmt: skip
        axis.set(xlim=(0, top), ylim=(-0.03, 1.03), xlabel="desired velocity [m/s]", ylabel="k_92 [-]")
        canvas.legend(axis, 2)
        canvas.mark_virtual(figure, virtual)
    return figure
