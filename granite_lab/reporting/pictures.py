"""Figures without a report: the channels of a log, and one wheel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from granite_lab.errors import InputError, UsageError, printable
from granite_lab.logs.trial import Array, Trial
from granite_lab.parameters import WHEELS
from granite_lab.reporting import canvas
from granite_lab.reporting.canvas import Canvas

if TYPE_CHECKING:
    from granite_lab.logs import Inspection
    from granite_lab.model.single_wheel import WheelPoint

WIDTH, HEIGHT = 6.4, 1.3
"""Of the figure and of a panel [in]."""

DATE = 1e6
"""Stamps above this [s] count from 1970; the axis then begins at the log's first whole second."""


class Trace(NamedTuple):
    """One line: stamps (N,) [s] and values (N,), its name, colour and dashes."""

    t: Array
    values: Array
    name: str
    colour: str
    dashes: str = "-"


def inspection_figure(inspection: Inspection) -> Canvas:
    """Draw the one log of an inspection.

    Raises:
        UsageError: there is more than one log.
        InputError: nothing in the log can be drawn.
    """
    if len(inspection.files) != 1:
        raise UsageError(f"--plot draws one log, but {len(inspection.files)} are given", "name one log")
    report = inspection.files[0]
    if report.trial is None:
        raise InputError(
            report.problem or f"{report.path}: no channel is recognised, nothing to plot",
            "write a column map with --write-map, correct it and pass it with --map",
        )
    return log_figure(report.trial, report.rests)


def log_figure(trial: Trial, rests: Sequence[tuple[float, float]] = ()) -> Canvas:
    """Draw every sensor of a trial over time, one panel a quantity, standstills shaded.

    Args:
        trial: as it was logged.
        rests: standstills [s, the log's time].

    Raises:
        InputError: the trial has no samples.
    """
    panels = _panels(trial)
    if not panels:
        raise InputError(
            f"{trial.name}: no samples, nothing to plot", "granite-lab inspect lists its columns"
        )
    start = min(float(trace.t[0]) for traces in panels.values() for trace in traces)
    origin = float(np.floor(start)) if start > DATE else 0.0
    with canvas.styled():
        time = f"time − {origin:.0f} s [s]" if origin else "time [s]"
        time += "; grey: standstill" if rests else ""
        frame = canvas.Frame(head=0.46, width=WIDTH)
        figure, axes = canvas.panels([HEIGHT] * len(panels), frame=frame, y=list(panels), x=time)
        for axis, traces in zip(axes, panels.values(), strict=True):
            for begin, end in rests:
                axis.axvspan(begin - origin, end - origin, color=canvas.SHADE, lw=0, zorder=0)
            for trace in traces:
                _draw(axis, trace, origin)
            canvas.legend(axis, columns=4)
        name = printable(trial.name) + (" (virtual)" if trial.info.virtual else "")
        figure.text(canvas.LEFT / WIDTH, 0.99, name, va="top", fontsize=9.5, parse_math=False)
        canvas.mark_virtual(figure, trial.info.virtual)
    return figure


def _panels(trial: Trial) -> dict[str, list[Trace]]:
    """Return the label of each panel with its unit, and the lines in it; empty channels are left out."""
    panels: dict[str, list[Trace]] = {}
    if (imu := trial.imu) is not None:
        force = "acceleration" if imu.gravity_removed else "specific force"
        for label, values in (
            (f"{force} [m/s²]", imu.specific_force),
            ("angular rate [rad/s]", imu.angular_rate),
        ):
            colours = (canvas.MEASURED, canvas.MEASURED_LIGHT, canvas.GREY)
            panels[label] = [Trace(imu.t, values[:, k], "xyz"[k], colours[k]) for k in range(3)]
    if (wheels := trial.wheels) is not None:
        label = "wheel angle [rad]" if wheels.rate is None else "wheel rate [rad/s]"
        panels[label] = _of_wheels(wheels.t, wheels.angle if wheels.rate is None else wheels.rate)
    if trial.currents is not None:
        panels["motor current [A]"] = _of_wheels(trial.currents.t, trial.currents.current)
    for label, series, name, colour in (
        ("velocity [m/s]", trial.command, "command", canvas.DESIRED),
        ("velocity [m/s]", trial.reference_v, "reference", canvas.MEASURED),
        ("distance [m]", trial.reference_x, "reference", canvas.MEASURED),
    ):
        if series is not None:
            panels.setdefault(label, []).append(Trace(series.t, series.value, name, colour))
    filled = {label: [x for x in lines if np.isfinite(x.values).any()] for label, lines in panels.items()}
    return {label: lines for label, lines in filled.items() if lines}


def _of_wheels(t: Array, values: Array) -> list[Trace]:
    """Return one line a wheel: front dark, rear light, right dashed."""
    colour, dashes = {"f": canvas.MEASURED, "r": canvas.MEASURED_LIGHT}, {"l": "-", "r": "--"}
    return [Trace(t, values[:, k], w, colour[w[0]], dashes[w[1]]) for k, w in enumerate(WHEELS)]


def _draw(axis: Axes, trace: Trace, origin: float) -> None:
    """Draw one line, thinned, interrupted where samples are missing."""
    seen = np.isfinite(trace.values)
    t, values = canvas.envelope(trace.t[seen] - origin, trace.values[seen])
    steps = np.diff(t)
    gaps = np.flatnonzero(steps > 10 * np.median(steps)) + 1 if len(steps) else np.zeros(0, dtype=np.intp)
    t, values = np.insert(t, gaps, np.nan), np.insert(values, gaps, np.nan)
    axis.plot(t, values, color=trace.colour, ls=trace.dashes, lw=0.9, label=trace.name)


def wheel_figure(points: Sequence[WheelPoint], title: str) -> Canvas:
    """Draw a sweep over slip; of one slip the stresses over the contact arc. The title is plain text."""
    title = title.replace("$", r"\$")  # a dollar would begin a formula
    return _sweep(points, title) if len(points) > 1 else _arc(points[0], title)


def _sweep(points: Sequence[WheelPoint], title: str) -> Canvas:
    """Draw drawbar pull, torque and sinkage over slip, three panels above each other."""
    with canvas.styled():
        labels = ("pull [N]", "torque [N m]", "sinkage [mm]")
        frame = canvas.Frame(head=0.6, gap=0.14)
        figure, axes = canvas.panels([1.5] * 3, frame=frame, y=labels, x="slip ratio λ [–]")
        pull, torque, sinkage = axes
        slip = [p.slip for p in points]
        for name, colour, dashes, label in (
            ("drawbar_pull", canvas.SIMULATED, "-", f"drawbar pull F + R, {title}"),
            ("thrust", canvas.SIMULATED_LIGHT, "--", "thrust F (14)"),
            ("resistance", canvas.GREY, ":", "resistance R (13)"),
        ):
            pull.plot(slip, [getattr(p, name) for p in points], color=colour, linestyle=dashes, label=label)
        torque.plot(slip, [p.torque for p in points], color=canvas.SIMULATED)
        sinkage.plot(slip, [1000 * p.sinkage for p in points], color=canvas.SIMULATED)
        for axis in (pull, torque):
            axis.axhline(0, color=canvas.INK, linewidth=0.6)
        sinkage.set_ylim(0, 1.1 * max(1000 * p.sinkage for p in points))
        canvas.legend(pull, columns=1)
    return figure


def _arc(point: WheelPoint, title: str) -> Canvas:
    """Draw normal and shear stress over the contact arc, the rear at the left."""
    with canvas.styled():
        angles = "angle ϑ from the lowest point, front at the right [°]"
        figure, (axis,) = canvas.panels([2.3], frame=canvas.Frame(head=0.46), y=["stress [kPa]"], x=angles)
        angle = np.degrees(point.angle)
        axis.axhline(0, color=canvas.INK, linewidth=0.6)
        axis.axvline(0, color=canvas.INK, linewidth=0.6)
        label, light = f"normal stress σ, {title}", canvas.SIMULATED_LIGHT
        axis.plot(angle, point.normal_stress / 1000, color=canvas.SIMULATED, label=label)
        axis.plot(angle, point.shear_stress / 1000, color=light, linestyle="--", label="shear stress τ")
        canvas.legend(axis, columns=1)
    return figure
