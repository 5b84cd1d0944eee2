"""Recordings of one trial and of a whole study, with a layout that needs no set-up in the viewer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, cycle
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import TextLogColumn, TextLogColumnKind, TimelineColumn

from granite_lab.comparison.compare import Comparison
from granite_lab.discovery.finding import Finding
from granite_lab.folders import distinct
from granite_lab.logs.trial import Trial
from granite_lab.parameters import by_speed
from granite_lab.reporting.names import SENSORS, capital
from granite_lab.reporting.recording.lines import (
    CHANNELS,
    DIFFERS,
    OF_TRIALS,
    STANDSTILL,
    Interval,
    Line,
    fitted_plot,
    intervals_of,
    lines_of,
    overlaid,
    write_events,
    write_lines,
)
from granite_lab.reporting.recording.scene import VIEWPOINT, write_scene
from granite_lab.reporting.recording.stream import TIMELINE, Writer, drawable, recording, root_of
from granite_lab.reporting.render import to_markdown
from granite_lab.results import StudyResult

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
OVERLAY = "all_trials"
"""Entity below which the plots of all trials stand."""
TIME_AXIS = rrb.TimeAxis(link="LinkToGlobal")
MOST_NAMED, MOST_ROWS = 5, 5
"""Most trials of a speed that an overlay names in its legend (of more, the pointer shows the name), and most
plots of a tab that stand below each other."""


def _series(origin: str, title: str, lines: Sequence[Line], *, legend: bool = True) -> Any:
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
        origin=origin, name=f"{title} [{lines[0].unit}]", axis_x=TIME_AXIS, axis_y=axis,
        plot_legend=rrb.PlotLegend("RightTop", visible=legend),
    )  # fmt: skip


def _scene(root: str) -> Any:
    """Return the 3D view: from the right, a little above the sand, travelling with the measured robot."""
    return rrb.Spatial3DView(
        origin=f"{root}/{VIEWPOINT}",
        contents=f"{root}/scene/**",
        name="Robot: measured (solid), simulated (orange outline)",
        background=rrb.Background(color=(24, 27, 32)),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            position=(0.02, -0.93, 0.26), look_target=(0.02, 0.0, 0.055), eye_up=(0, 0, 1)
        ),
    )


def _log(root: str) -> Any:
    """Return the log: level and text, which begins with the time (a column of its own is cut off)."""
    kinds = (TextLogColumnKind.LogLevel, TextLogColumnKind.Body)
    columns = rrb.TextLogColumns(
        timeline_columns=[TimelineColumn(TIMELINE, visible=False)],
        text_log_columns=[TextLogColumn(kind) for kind in kinds],
    )
    return rrb.TextLogView(origin=f"{root}/events", name="Events", columns=columns)


def trial_layout(root: str, lines: Sequence[Line], *, lanes: int, name: str) -> Any:
    """Return the layout of one trial: robot, key, bars and log on the left, plots on the right."""
    plots: dict[str, list[Line]] = {}
    for line in lines:
        plots.setdefault(line.entity.partition("/")[0], []).append(line)
    bars = rrb.StateTimelineView(
        origin=root or "/",
        contents=[f"{root}/phase", f"{root}/{STANDSTILL}", f"{root}/{DIFFERS}/**"],
        name="Phases"
        + (", and where the simulation differs, by up to [% of the sensor's rms]" if lanes else ""),
        time_view=TIME_AXIS,
    )
    key = rrb.TextDocumentView(origin=f"{root}/key", name="Key")
    shares = [4.4, 1.4 + 0.52 * min(lanes, 7), 2.0]
    left = [rrb.Horizontal(_scene(root), key, column_shares=[5, 3]), bars, _log(root)]
    tabs = []
    for title, keys in TABS.items():
        if views := [_series(f"{root}/{k}", TITLES[k], plots[k]) for k in keys if k in plots]:
            columns = 1 if len(views) <= MOST_ROWS else 2
            tabs.append(rrb.Grid(*views, grid_columns=columns, name=title))
    return rrb.Horizontal(rrb.Vertical(*left, row_shares=shares), rrb.Tabs(*tabs), name=name)


def overlay(rows: Mapping[str, Sequence[Line]], many: int) -> Any:
    """Return velocity and slip of all trials: a row per speed, from its lines of `overlaid`, with a key.

    The legends name the trials unless a speed has too `many`.
    """
    views = []
    for i, (speed, lines) in enumerate(rows.items()):
        pair = []
        for plot, label in (("velocity", "velocity"), ("slip", "slip, mean of the wheels")):
            root = f"{OVERLAY}/{i}/{plot}"
            if of_plot := [line for line in lines if line.entity.startswith(f"{root}/")]:
                pair.append(_series(f"/{root}", f"{speed}: {label}", of_plot, legend=many <= MOST_NAMED))
        if pair:
            views.append(rrb.Horizontal(*pair, name=speed))
    key = rrb.TextDocumentView(origin="/key", name="Key")
    return rrb.Horizontal(rrb.Vertical(*views), key, column_shares=[6, 1], name="All trials")


def blueprint(content: Any) -> Any:
    """Return the whole blueprint: side panels away, paused at the start of the one timeline."""
    return rrb.Blueprint(
        content,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="paused"),
        auto_layout=False,
        auto_views=False,
    )


def record_trial(trial: Trial, comparison: Comparison, path: Path, *, finding: Finding | None = None) -> Path:
    """Write the Rerun recording of one trial, layout included; whole or not at all; return its path.

    With a finding, bars show where the simulation differs, and its simulations are drawn, too.

    Raises:
        LabError: the file cannot be written.
    """
    content = _Content(trial, comparison, finding)
    with recording(path, trial.name, blueprint(content.layout("", trial.name))) as stream:
        content.write(Writer(stream))
    return path


def record_study(result: StudyResult, path: Path, *, finding: Finding | None = None) -> Path:
    """Write one recording of all trials of a study, on one clock that starts with each trial's command.

    Each trial stands below an entity of its own name and has a tab of its own; the first tab lays the
    velocities and slips of all trials over each other. Arguments and errors as in `record_trial`.
    """
    names = distinct([drawable(r.trial.name) for r in result.trials])
    pairs = zip(names, result.trials, strict=True)
    contents = {name: _Content(r.trial, r.comparison, finding) for name, r in pairs}
    speeds = by_speed(content.comparison.motion.variant.velocity for content in contents.values())
    tabs, rows = [], {}
    for i, (speed, positions) in enumerate(speeds.items()):
        of_speed = [names[position] for position in positions]
        layouts = [contents[name].layout(root_of(name), name) for name in of_speed]
        tabs.append(rrb.Tabs(*layouts, name=f"{speed:.3g} m/s"))
        rows[f"{speed:.3g} m/s"] = [
            line
            for name, colour in zip(of_speed, cycle(OF_TRIALS))
            for line in overlaid(f"{OVERLAY}/{i}", name, contents[name].comparison, colour)
        ]
    first = overlay(rows, max(map(len, speeds.values())))
    with recording(path, result.name, blueprint(rrb.Tabs(first, *tabs, active_tab=0))) as stream:
        Writer(stream).static("key", _page("recording_key.md", virtual=result.virtual, study=True))
        write_lines(Writer(stream), chain(*rows.values()))
        for name, content in contents.items():
            content.write(Writer(stream, root_of(name)))
    return path


@dataclass(frozen=True)
class _Content:
    """What a recording holds of one trial."""

    trial: Trial
    comparison: Comparison
    finding: Finding | None

    @cached_property
    def lines(self) -> list[Line]:
        return lines_of(self.trial, self.comparison, self.finding)

    @cached_property
    def bars(self) -> list[Interval]:
        return intervals_of(self.comparison, self.finding)

    def layout(self, root: str, name: str) -> rrb.Horizontal:
        lanes = len({bar.channel for bar in self.bars})
        return trial_layout(root, self.lines, lanes=lanes, name=drawable(name))

    def write(self, writer: Writer) -> None:
        write_lines(writer, self.lines)
        write_scene(writer, self.comparison)
        write_events(writer, self.comparison, self.bars, self.finding)
        motion = self.comparison.motion
        writer.static("key", _page("recording_key.md", virtual=motion.virtual, study=False))


def _page(template: str, **content: object) -> Any:
    """Return a Markdown document."""
    return rr.TextDocument(drawable(to_markdown(template, **content).strip()), media_type="text/markdown")
