"""Figures of motions, fits, comparisons, findings and runs of the model."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from granite_lab.api.logs import Ingested
from granite_lab.api.model import WheelRun
from granite_lab.api.records import Records
from granite_lab.comparison.compare import Comparison
from granite_lab.discovery.finding import Finding
from granite_lab.estimation.motion import Motion
from granite_lab.fitting.fit import AThetaFit, K92Fit
from granite_lab.logs.counters import mean_known
from granite_lab.model.run import Run
from granite_lab.reporting import canvas
from granite_lab.reporting.pictures import wheel_figure
from granite_lab.reporting.plot_motion import SLIP_STD_SHOWN, comparison_figure
from granite_lab.reporting.plot_results import fits_figure
from granite_lab.reporting.plot_search import gap_figure


def plot(record: Any) -> Figure:
    """Return a Matplotlib figure.

    Args:
        record: a motion, fit, comparison, finding, run or wheel, or what `ingest` or `fit_k92` returned.

    Raises:
        TypeError: there is no figure of such a record.
    """
    fits = record if isinstance(record, Records) else [record]
    if fits and all(isinstance(item, K92Fit) for item in fits):
        return fits_figure([(f.variant.velocity, f.k92) for f in fits], any(f.virtual for f in fits)).draw()
    if isinstance(record, Records) and record:
        if len(record) == 1:
            return plot(record[0])
        raise TypeError("plot(): of fits all are drawn, of other records one, as in plot(records[0])")
    match record:
        case Ingested(motion=motion) | (Motion() as motion):
            return motion_plot(motion)
        case Run():
            return run_plot(record)
        case WheelRun():
            return wheel_figure(record.points, f"One wheel on {record.soil.title}")
        case AThetaFit():
            return fits_figure([(v, k92) for _, v, k92, _ in record.points], record.virtual, record).draw()
        case Comparison():
            return comparison_figure(record, 0).draw()
        case Finding():
            return gap_figure(record).draw()
    raise TypeError(f"plot(): there is no figure of {type(record).__name__}")


def run_plot(run: Run) -> Figure:
    """Draw velocity, slip ratios, torques and pitch of a simulated run over time."""
    signals = (
        ("velocity [m/s]", 1.0, {"body": "v_mps", "desired": "v_desired_mps"}),
        ("slip ratio [%]", 100.0, {"front": "slip_f", "rear": "slip_r"}),
        ("torque [N m]", 1.0, {"front": "torque_f_Nm", "rear": "torque_r_Nm"}),
        ("pitch [°]", 180 / math.pi, {"nose down": "pitch_rad"}),
    )
    with canvas.styled():
        figure, axes = canvas.panels([1.1] * 4, y=[label for label, _, _ in signals], x=canvas.TIME)
        for axis, (_, scale, lines) in zip(axes, signals, strict=True):
            axis.axvspan(*run.steady, color=canvas.SHADE, linewidth=0, zorder=0)
            for colour, (name, signal) in zip(
                (canvas.SIMULATED, canvas.SIMULATED_LIGHT), lines.items(), strict=False
            ):
                axis.plot(run.t, scale * run[signal], color=colour, label=name)
            canvas.legend(axis)
    return figure


def motion_plot(motion: Motion) -> Figure:
    """Draw velocity, slip ratio and pitch over time with bands of ±2σ."""
    t, wheel, degree = motion.t, mean_known(motion.v_wheel, 1), 180 / math.pi
    known = np.isfinite(wheel)
    with canvas.styled():
        labels = ["velocity [m/s]", "slip ratio [%]", "pitch [°]"]
        figure, axes = canvas.panels([1.25, 1.05, 0.85], y=labels, x="time of the log [s]")
        canvas.band(axes[0], t, motion.v, motion.v_std, "body")
        axes[0].plot(t[known], wheel[known], color=canvas.MEASURED_LIGHT, label="wheels, mean")
        for name, color, k in (("front", canvas.MEASURED, [0, 1]), ("rear", canvas.MEASURED_LIGHT, [2, 3])):
            sure = (motion.slip_std[:, k] < SLIP_STD_SHOWN).all(axis=1)
            slip = np.where(sure, mean_known(motion.slip[:, k], 1), math.nan)
            axes[1].plot(t, 100 * slip, color=color, label=f"{name} wheels")
        canvas.band(axes[2], t, degree * motion.pitch, degree * motion.pitch_std, "nose down")
        for axis in axes:
            canvas.legend(axis)
        canvas.mark_virtual(figure, motion.virtual)
    return figure
