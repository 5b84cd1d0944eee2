"""The figures behind `plot()` of motions, fits, comparisons and findings."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from granite_lab.api.logs import Ingested
from granite_lab.api.records import Records
from granite_lab.comparison.record import Comparison
from granite_lab.discovery.finding import Finding
from granite_lab.estimation.motion import Motion
from granite_lab.fitting.fit import AThetaFit, K92Fit
from granite_lab.reporting import canvas
from granite_lab.reporting.plot_motion import SLIP_STD_SHOWN, comparison_figure
from granite_lab.reporting.plot_results import fits_figure
from granite_lab.reporting.plot_search import gap_figure


def plot(record: Any) -> Figure:
    """Return the figure of a record.

    Raises:
        TypeError: there is none.
    """
    if isinstance(record, Records) and len(record):
        if all(isinstance(item, K92Fit) for item in record):
            return fits_figure(
                [(f.variant.velocity, f.k92) for f in record], any(f.virtual for f in record)
            ).draw()
        if len(record) == 1:
            return plot(record[0])
        raise TypeError("plot(): of fits all are drawn, of other records one, as in records[0].plot()")
    match record:
        case Ingested():
            return motion_plot(record.motion)
        case Motion():
            return motion_plot(record)
        case K92Fit():
            return fits_figure([(record.variant.velocity, record.k92)], record.virtual).draw()
        case AThetaFit():
            return fits_figure([(v, k92) for _, v, k92, _ in record.points], record.virtual, record).draw()
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
        canvas.band(axes[0], motion.t, motion.v, motion.v_std, "body")
        axes[0].plot(t, wheel, color=canvas.MEASURED_LIGHT, label="wheels, mean")
        for k, (name, color) in enumerate((("front", canvas.MEASURED), ("rear", canvas.MEASURED_LIGHT))):
            columns = [2 * k, 2 * k + 1]  # fl and fr, then rl and rr
            known = np.isfinite(motion.slip[:, columns]).any(axis=1)
            known &= (motion.slip_std[:, columns] < SLIP_STD_SHOWN).all(axis=1)
            slip = np.full(motion.t.shape, math.nan)
            slip[known] = np.nanmean(motion.slip[known][:, columns], axis=1)
            axes[1].plot(motion.t, 100 * slip, color=color, label=f"{name} wheels")
        degree = 180 / math.pi
        canvas.band(axes[2], motion.t, degree * motion.pitch, degree * motion.pitch_std, "nose down")
        for axis, label in zip(axes, ("velocity [m/s]", "slip ratio [%]", "pitch [°]"), strict=True):
            axis.set_ylabel(label)
            canvas.legend(axis)
        axes[-1].set_xlabel("time of the log [s]")
        canvas.mark_virtual(figure, motion.virtual)
    return figure
