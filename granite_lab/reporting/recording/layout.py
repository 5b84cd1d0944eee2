"""Blueprints: how the viewer is laid out when a recording opens, with nothing to set up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import rerun.blueprint as rrb
from rerun.blueprint.encodings import TextLogColumn, TextLogColumnKind, TimelineColumn

from granite_lab.logs.trial import Array
from granite_lab.reporting.recording.events import DIFFERS
from granite_lab.reporting.recording.lines import Line
from granite_lab.reporting.recording.scene import VIEWPOINT
from granite_lab.reporting.recording.stream import TIMELINE

TITLES = {
    "velocity": "Velocity [m/s]",
    "slip": "Slip of the axles [%]",
    "torque": "Drive torque per wheel [N m]",
    "pitch": "Pitch, positive nose down [°]",
    "wheel_velocity": "Circumferential wheel velocity, measured [m/s]",
    "wheel_slip": "Slip of each wheel, measured [%]",
    "current": "Motor current, measured [A]",
    "residual_velocity": "Robot velocity, simulated − measured [m/s]",
    "residual_wheel": "Wheel velocity, simulated − measured [m/s]",
    "residual_slip": "Slip, simulated − measured [% points]",
    "residual_torque": "Drive torque, simulated − measured [N m]",
    "residual_pitch": "Pitch, simulated − measured [°]",
    "residual_accel": "Specific force, simulated − measured [m/s²]",
    "residual_pitch_rate": "Pitch rate, simulated − measured [°/s]",
    "specific_force": "IMU specific force, forward [m/s²]",
    "pitch_rate": "IMU pitch rate [°/s]",
    "imu": "IMU specific force, the sensor's own axes [m/s²]",
    "accel_bias": "Estimated bias of the accelerometer, tilt included [m/s²]",
    "gyro_bias": "Estimated bias of the gyroscope [°/s]",
    "innovation": "Innovations of the filter over their predicted std [σ]",
}
FOUND = {
    "accel_x": "IMU acceleration, forward{} [m/s²]",
    "accel_z": "IMU acceleration, vertical{} [m/s²]",
    "pitch_rate": "IMU pitch rate{} [°/s]",
    "wheel": "Wheel angle, mean of all{} [°]",
    "wheel_split": "Wheel angle, front − rear{} [°]",
    "current_f": "Motor current, front{} [A]",
    "current_r": "Motor current, rear{} [A]",
}
"""Channels of a search for the missing effect."""

TITLES |= {
    f"found_{c}": title.format(": measured − simulated" if c.startswith("wheel") else "")
    for c, title in FOUND.items()
} | {f"discrepancy_{c}": title.format(": not explained by the model") for c, title in FOUND.items()}
TABS = {
    "Motion": ("velocity", "slip", "torque", "pitch"),
    "Residuals": (
        "residual_velocity",
        "residual_wheel",
        "residual_slip",
        "residual_torque",
        "residual_pitch",
    ),
    "Wheels": ("wheel_velocity", "wheel_slip", "current"),
    "Sensors": ("specific_force", "residual_accel", "pitch_rate", "residual_pitch_rate"),
    "Filter": ("innovation", "accel_bias", "gyro_bias", "imu"),
    "Missing effect": tuple(f"found_{c}" for c in FOUND),
    "Discrepancy": tuple(f"discrepancy_{c}" for c in FOUND),
}
OVERLAY = "all_trials"
"""Entity below which the plots of all trials stand."""
Extent = Mapping[str, tuple[float, float]]
"""Plot to the range of values it shows at first, where the data alone would choose a bad one."""
TIME_AXIS = rrb.TimeAxis(link="LinkToGlobal")
MOST_NAMED = 5
"""Most trials of a speed that an overlay names in its legend; of more, the pointer tells the name."""


def extent_of(lines: Sequence[Line]) -> Extent:
    """Return ranges of values for the plots that these lines fill.

    Slip (1) is a quotient of small numbers as the robot starts and stops and may take any value there,
    so its plots show the range that most samples need; all others show all samples.
    """
    parts: dict[str, list[Array]] = {}
    for line in lines:
        parts.setdefault(line.plot, []).append(line.value.ravel())
    extent = {}
    for plot, values in parts.items():
        ratio = "slip" in plot
        known = np.concatenate([*values, [0.0]] if ratio else values)
        low, high = np.nanpercentile(known, [4, 96] if ratio else [0, 100])
        if ratio:  # whole tens, so that the axis has more than one number on it
            extent[plot] = (float(10 * np.floor(low / 10 - 0.2)), float(10 * np.ceil(high / 10 + 0.2)))
        else:
            margin = 0.08 * (high - low) + 1e-9
            extent[plot] = (float(low - margin), float(high + margin))
    return extent


def _series(origin: str, title: str, extent: tuple[float, float], *, legend: bool = True) -> Any:
    """Return the view of one plot; its legend stands where the robot is at rest again."""
    return rrb.TimeSeriesView(
        origin=origin,
        name=title,
        axis_x=TIME_AXIS,
        axis_y=rrb.ScalarAxis(range=extent),
        plot_legend=rrb.PlotLegend("RightTop", visible=legend),
    )


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
    extent = extent_of(lines)
    bars = rrb.StateTimelineView(
        origin=root or "/",
        contents=[f"{root}/phase", f"{root}/robot_at_rest", f"{root}/{DIFFERS}/**"],
        name="Phases" + (", and where the simulation differs [% of the channel's rms]" if lanes > 2 else ""),
        time_view=TIME_AXIS,
    )
    key = rrb.TextDocumentView(origin=f"{root}/key", name="Key")
    about = rrb.TextDocumentView(origin=f"{root}/about", name="About this trial")
    shares = [4.4, 0.4 + 0.52 * min(lanes, 9), 2.0]
    left = [rrb.Horizontal(_scene(root), key, column_shares=[5, 3]), bars, rrb.Tabs(_log(root), about)]
    tabs = []
    for title, keys in TABS.items():
        if views := [_series(f"{root}/{k}", TITLES[k], extent[k]) for k in keys if k in extent]:
            tabs.append(rrb.Vertical(*views, name=title))
    return rrb.Horizontal(rrb.Vertical(*left, row_shares=shares), rrb.Tabs(*tabs), name=name)


def overlay(rows: Mapping[str, Sequence[Line]], many: int) -> Any:
    """Return velocity and slip of all trials, a row per speed, with a key.

    Args:
        rows: speed in words to the lines of `overlaid`, of all its trials.
        many: most trials of a speed.
    """
    views = []
    for i, (speed, lines) in enumerate(rows.items()):
        pair = []
        for plot, what in (("velocity", "velocity [m/s]"), ("slip", "slip, mean of the wheels [%]")):
            root = f"{OVERLAY}/{i}/{plot}"
            extent = extent_of([replace(x, entity=plot) for x in lines if x.entity.startswith(f"{root}/")])
            pair.append(_series(f"/{root}", f"{speed}: {what}", extent[plot], legend=many <= MOST_NAMED))
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
