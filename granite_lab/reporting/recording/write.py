"""The recording of a trial, with a layout that needs no set-up in the viewer."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import TextLogColumn, TextLogColumnKind, TimelineColumn

from granite_lab.comparison.compare import Comparison
from granite_lab.discovery.finding import Finding
from granite_lab.reporting.names import SENSORS, capital
from granite_lab.reporting.recording.lines import (
    CHANNELS,
    DIFFERS,
    STANDSTILL,
    Line,
    fitted_plot,
    intervals_of,
    lines_of,
    write_events,
    write_lines,
)
from granite_lab.reporting.recording.scene import VIEWPOINT, write_scene
from granite_lab.reporting.recording.stream import TIMELINE, drawable, recording
from granite_lab.reporting.render import to_markdown

TITLES = {
    "velocity": "Velocity",
    "slip": "Slip of the axles",
    "torque": "Drive torque per wheel",
    "pitch": "Pitch, positive nose down, equal before the start",
    "wheel_speed": "Wheel speed",
    "slip_of_each_wheel": "Slip of each wheel, measured",
    "motor_current": "Motor current, measured",
    "forward_acceleration": "Forward acceleration, equal before the start",
    "pitch_rate": "Pitch rate, equal before the start",
    "innovation": "Innovations of the filter over their predicted std",
}
TITLES |= {f"difference_{k}": f"{TITLES[k].split(',')[0]}: simulated − measured" for k in CHANNELS}
TITLES |= {
    fitted_plot(k): capital(name) + (": measured − simulated" if "wheel" in k else "")
    for k, name in SENSORS.items()
}
"""Plot to its title, without unit."""
TABS = {
    "Motion": ["velocity", "slip", "torque", "pitch"],
    "Wheels": ["wheel_speed", "slip_of_each_wheel", "motor_current"],
    "Sensors": ["forward_acceleration", "pitch_rate", "innovation"],
    "Differences": [f"difference_{k}" for k in CHANNELS],
    "Missing effect": [fitted_plot(k) for k in SENSORS],
}
TIME_AXIS = rrb.TimeAxis(link="LinkToGlobal")
MOST_ROWS = 5
"""Most plots of a tab that stand below each other."""


def _series(plot: str, lines: Sequence[Line]) -> Any:
    """Return the view of one plot; its legend stands where the robot is at rest again.

    Slip (1) is a quotient of small numbers as the robot starts and stops and may take any value there,
    so its plots show the range that most samples need; all others show all samples.
    """
    axis = None
    if "slip" in lines[0].entity:
        values = np.concatenate([line.value.ravel() for line in lines])
        low, high = np.nanpercentile(np.append(values, 0.0), [4, 96])
        axis = rrb.ScalarAxis(range=(10 * np.floor(low / 10 - 0.2), 10 * np.ceil(high / 10 + 0.2)))
    return rrb.TimeSeriesView(
        origin=f"/{plot}", name=f"{TITLES[plot]} [{lines[0].unit}]", axis_x=TIME_AXIS, axis_y=axis,
        plot_legend=rrb.PlotLegend("RightTop"),
    )  # fmt: skip


def _scene() -> Any:
    """Return the 3D view: from the right, a little above the sand, travelling with the measured robot."""
    return rrb.Spatial3DView(
        origin=f"/{VIEWPOINT}",
        contents="/scene/**",
        name="Robot: measured (solid), simulated (orange outline)",
        background=rrb.Background(color=(24, 27, 32)),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            position=(0.02, -0.93, 0.26), look_target=(0.02, 0.0, 0.055), eye_up=(0, 0, 1)
        ),
    )


def _log() -> Any:
    """Return the log: level and text, which begins with the time (a column of its own is cut off)."""
    kinds = (TextLogColumnKind.LogLevel, TextLogColumnKind.Body)
    columns = rrb.TextLogColumns(
        timeline_columns=[TimelineColumn(TIMELINE, visible=False)],
        text_log_columns=[TextLogColumn(kind) for kind in kinds],
    )
    return rrb.TextLogView(origin="/events", name="Events", columns=columns)


def blueprint(lines: Sequence[Line], *, lanes: int, name: str) -> Any:
    """Return the layout of one trial: robot, key, bars and log on the left, plots on the right.

    Side panels are away, and the one timeline is paused at its start.
    """
    plots: dict[str, list[Line]] = {}
    for line in lines:
        plots.setdefault(line.entity.partition("/")[0], []).append(line)
    bars = rrb.StateTimelineView(
        origin="/",
        contents=["/phase", f"/{STANDSTILL}", f"/{DIFFERS}/**"],
        name="Phases"
        + (", and where the simulation differs, by up to [% of the sensor's rms]" if lanes else ""),
        time_view=TIME_AXIS,
    )
    key = rrb.TextDocumentView(origin="/key", name="Key")
    heights = [4.4, 1.4 + 0.52 * min(lanes, 7), 2.0]
    left = [rrb.Horizontal(_scene(), key, column_shares=[5, 3]), bars, _log()]
    tabs = []
    for title, keys in TABS.items():
        if views := [_series(k, plots[k]) for k in keys if k in plots]:
            columns = 1 if len(views) <= MOST_ROWS else 2
            tabs.append(rrb.Grid(*views, grid_columns=columns, name=title))
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(*left, row_shares=heights), rrb.Tabs(*tabs), name=name),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="paused"),
        auto_layout=False,
        auto_views=False,
    )


def record_trial(comparison: Comparison, path: Path, *, finding: Finding | None = None) -> Path:
    """Write the Rerun recording of one trial, layout included; whole or not at all; return its path.

    With a finding, bars show where the simulation differs, and its simulations are drawn, too.

    Raises:
        LabError: the file cannot be written.
    """
    lines, bars = lines_of(comparison, finding), intervals_of(comparison, finding)
    lanes, name = len({bar.channel for bar in bars}), comparison.trial.name
    with recording(path, name, blueprint(lines, lanes=lanes, name=drawable(name))) as writer:
        write_lines(writer, lines)
        write_scene(writer, comparison)
        write_events(writer, comparison, bars, finding)
        key = drawable(to_markdown("recording_key.md", virtual=comparison.motion.virtual).strip())
        writer.static("key", rr.TextDocument(key, media_type="text/markdown"))
    return path
