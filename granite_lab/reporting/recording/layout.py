"""Blueprints: how the viewer is laid out when a recording opens, with nothing to set up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import TextLogColumn, TextLogColumnKind, TimelineColumn

from granite_lab.logs.trial import Array
from granite_lab.reporting.recording.scene import VIEWPOINT
from granite_lab.reporting.recording.signals import MEASURED, SIMULATED, Line
from granite_lab.reporting.recording.stream import TIMELINE, root_of

TITLES = {
    "velocity": "Velocity [m/s]",
    "slip": "Slip ratio of the axles [-]",
    "torque": "Drive torque per wheel [N m]",
    "pitch": "Pitch, positive nose down [rad]",
    "wheel_velocity": "Circumferential wheel velocity, measured [m/s]",
    "wheel_slip": "Slip ratio of each wheel, measured [-]",
    "current": "Motor current, measured [A]",
    "residual_velocity": "Body velocity, simulated − measured [m/s]",
    "residual_wheel": "Wheel velocity, simulated − measured [m/s]",
    "residual_slip": "Slip ratio, simulated − measured [-]",
    "residual_torque": "Drive torque, simulated − measured [N m]",
    "residual_pitch": "Pitch, simulated − measured [rad]",
    "residual_accel": "Specific force, simulated − measured [m/s²]",
    "residual_pitch_rate": "Pitch rate, simulated − measured [rad/s]",
    "specific_force": "IMU specific force, forward [m/s²]",
    "pitch_rate": "IMU pitch rate [rad/s]",
    "imu": "IMU specific force, the sensor's own axes [m/s²]",
    "accel_bias": "Estimated bias of the accelerometer, tilt included [m/s²]",
    "gyro_bias": "Estimated bias of the gyroscope [rad/s]",
    "innovation": "Innovations of the filter over their predicted std [σ]",
}
FOUND = {
    "accel_x": "Forward acceleration read by the IMU{} [m/s²]",
    "accel_z": "Vertical acceleration read by the IMU{} [m/s²]",
    "pitch_rate": "Pitch rate read by the IMU{} [rad/s]",
    "wheel": "Wheel angle, mean of all{} [rad]",
    "wheel_split": "Wheel angle, front − rear{} [rad]",
    "current_f": "Motor current, front{} [A]",
    "current_r": "Motor current, rear{} [A]",
}
"""Channels of a search for the missing effect."""

TITLES |= {
    f"found_{c}": title.format(": measured − simulated" if c.startswith("wheel") else "")
    for c, title in FOUND.items()
} | {f"discrepancy_{c}": title.format(": discrepancy of the model") for c, title in FOUND.items()}
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
Extent = Mapping[str, tuple[float, float]]
"""Plot to the range of values it shows at first, where the data alone would choose a bad one."""
TIME_AXIS = rrb.TimeAxis(link="LinkToGlobal")


def extent_of(lines: Sequence[Line]) -> Extent:
    """Return ranges of values for the plots that these lines fill.

    Slip (1) is a quotient of small numbers as the robot starts and stops and may take any value there,
    so its plots show the range that most samples need; all others show all samples.
    """
    parts: dict[str, list[Array]] = {}
    for line in lines:
        parts.setdefault(line.entity.partition("/")[0], []).append(line.value.ravel())
    extent = {}
    for plot, values in parts.items():
        ratio = "slip" in plot
        known = np.concatenate([*values, [0.0]] if ratio else values)
        low, high = np.nanpercentile(known, [4, 96] if ratio else [0, 100])
        margin = (0.15 if ratio else 0.08) * (high - low) + (0.02 if ratio else 1e-9)
        extent[plot] = (float(low - margin), float(high + margin))
    return extent


def plot(root: str, key: str, extent: Extent, *, legend: bool) -> Any:
    """Return the view of one plot below a trial's root; its legend stands where little happens."""
    return rrb.TimeSeriesView(
        origin=f"{root}/{key}",
        name=TITLES[key],
        axis_x=TIME_AXIS,
        axis_y=rrb.ScalarAxis(range=extent[key]),
        plot_legend=rrb.PlotLegend(
            "RightTop" if key.startswith(("found", "discrepancy")) else "LeftTop", visible=legend
        ),
    )


def scene(root: str) -> Any:
    """Return the 3D view: from the right, a little above the sand, travelling with the measured robot."""
    return rrb.Spatial3DView(
        origin=f"{root}/{VIEWPOINT}",
        contents=f"{root}/scene/**",
        name="Robot as measured (blue) and simulated (orange ghost)",
        background=rrb.Background(color=(24, 27, 32)),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            position=(0.05, -0.98, 0.27), look_target=(0.05, 0.0, 0.055), eye_up=(0, 0, 1)
        ),
    )


def log(root: str) -> Any:
    """Return the log: level and text, which begins with the time (a column of its own is cut off)."""
    kinds = (TextLogColumnKind.LogLevel, TextLogColumnKind.Body)
    columns = rrb.TextLogColumns(
        timeline_columns=[TimelineColumn(TIMELINE, visible=False)],
        text_log_columns=[TextLogColumn(kind) for kind in kinds],
    )
    return rrb.TextLogView(origin=f"{root}/events", name="Events", columns=columns)


def trial_layout(root: str, lines: Sequence[Line], *, lanes: int, name: str) -> Any:
    """Return the layout of one trial: robot, bars and log on the left, plots on the right."""
    extent = extent_of(lines)
    names: dict[str, int] = {}
    for line in lines:
        key = line.entity.partition("/")[0]
        names[key] = names.get(key, 0) + len(line.names)
    bars = rrb.StateTimelineView(origin=f"{root}/bars", name="Phases and intervals", time_view=TIME_AXIS)
    about = rrb.TextDocumentView(origin=f"{root}/about", name="About")
    left = [scene(root), bars, rrb.Tabs(log(root), about)]
    shares = [5, 0.3 + 0.42 * min(lanes, 9), 2.2]
    tabs = []
    for title, keys in TABS.items():
        views = [plot(root, key, extent, legend=names[key] > 1) for key in keys if key in names]
        if views:
            tabs.append(rrb.Vertical(*views, name=title))
    return rrb.Horizontal(
        rrb.Vertical(*left, row_shares=shares), rrb.Tabs(*tabs), column_shares=[1, 1], name=name
    )


def overlay(groups: Mapping[str, Sequence[str]], extents: Mapping[str, Extent]) -> Any:
    """Return velocity and slip of all trials, a row per variant.

    Args:
        groups: name of the variant to the names of its trials.
        extents: ranges of the plots per variant.
    """
    rows = []
    for variant, trials in groups.items():
        views = [
            _overlay(
                trials, key, f"{variant}: {what}, measured (blue), simulated (orange)", extents[variant][key]
            )
            for key, what in (("velocity", "velocity [m/s]"), ("robot_slip", "mean slip ratio [-]"))
        ]
        rows.append(rrb.Horizontal(*views, name=variant))
    return rrb.Vertical(*rows, name="All trials")


def _overlay(trials: Sequence[str], key: str, title: str, extent: tuple[float, float]) -> Any:
    """Return a view of one plot over trials; a line's name, its trial's, shows where the pointer is."""
    styles = {}
    for k, trial in enumerate(trials):
        fade = 1 - 0.45 * k / max(len(trials) - 1, 1)
        for kind, colour in (
            ("measured", tuple(round(c * fade) for c in MEASURED)),
            ("simulated", SIMULATED),
        ):
            style = rr.SeriesLines(names=f"{trial}, {kind}", colors=colour, widths=1.3)
            styles[f"{root_of(trial)}/{key}/{kind}"] = style.visualizer()
    return rrb.TimeSeriesView(
        origin="/",
        contents=list(styles),
        name=title,
        axis_x=TIME_AXIS,
        axis_y=rrb.ScalarAxis(range=extent),
        plot_legend=rrb.PlotLegend(visible=False),
        overrides=styles,
    )


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
