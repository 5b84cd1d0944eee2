"""Steps of DRIVE as logs: windows of 2 s at 20 Hz, put together, of commands that are straight.

The tables are pickles of pandas. Nothing but pandas, NumPy and Arrow is loaded from them.
"""

from __future__ import annotations

import pickle
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

STEP, SAMPLES = 0.05, 40
"""Time between two samples [s], and samples of a window."""

STRAIGHT = 0.1
"""Commands of both sides differ by less than this share of their mean."""

SLOW = 1.0
"""Wheels that are commanded more slowly than this hardly move [rad/s]."""


class _Tables(pickle.Unpickler):
    """Loads tables only."""

    def find_class(self, module: str, name: str) -> Any:
        """Return a class of pandas, NumPy or Arrow; raise an UnpicklingError for any other."""
        own = module.split(".", maxsplit=1)[0] in ("pandas", "numpy", "pyarrow")
        if own or (module, name) == ("builtins", "slice"):
            return super().find_class(module, name)
        raise pickle.UnpicklingError(f"{module}.{name} is no part of a table")


OTHER_WAY = 0.1
"""A side that turns against its command faster than this share of it is still in the step before."""

TURNED_ROUND = (
    "imu_ax_mps2", "imu_ay_mps2", "enc_fl_radps", "enc_fr_radps", "enc_rl_radps", "enc_rr_radps",
    "v_cmd_mps", "ref_x_m",
)  # fmt: skip
"""What changes its sign if a robot that drives back is seen from behind: it then drives ahead."""

LEAST = 0.02
"""Least std of a place by ICP [m]: what a lidar of this kind measures a distance to."""


def steps_of(path: Path, radius: float) -> Iterator[tuple[str, pd.DataFrame, float]]:
    """Yield name, canonical log and std of the way [m] of each straight step, with wheels of a radius [m]."""
    with path.open("rb") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of names that pandas and NumPy have moved
        table = _Tables(file).load()
    for number, windows in table.groupby("calib_step", sort=True):
        left, right = (_column(windows, f"cmd_{side}") for side in ("left", "right"))
        mean = 0.5 * (left + right).mean()
        if abs(mean) < SLOW or abs((left - right).mean()) > STRAIGHT * abs(mean):
            continue
        yield f"step_{int(number):03d}", *_log(windows, radius)


def _column(windows: pd.DataFrame, name: str) -> np.ndarray:
    """(W, 40) samples of a quantity."""
    return windows[[f"{name}_{i}" for i in range(SAMPLES)]].to_numpy(float)


def _log(windows: pd.DataFrame, radius: float) -> tuple[pd.DataFrame, float]:
    """Return the log of a step, with the way by ICP where a new place came, and the std of that way [m].

    The places of a window count from its beginning, and its `gt_icp` is that of the next one. Between scans
    the last place is repeated. A step that drives back is seen from behind, and begins when both sides turn
    as commanded. The way is that along the heading: a path through noisy places is too long,
    and has no sign where a step begins while the robot drives the other way.
    """
    left, right = (_column(windows, f"{side}_wheel_vel").ravel() for side in ("left", "right"))
    command = 0.5 * (_column(windows, "cmd_left") + _column(windows, "cmd_right")).ravel()
    x, y = (np.column_stack([_column(windows, f"icp_{a}"), windows[f"gt_icp_{a}"]]) for a in "xy")
    yaw = _column(windows, "icp_yaw")
    steps = np.diff(x) * np.cos(yaw) + np.diff(y) * np.sin(yaw)
    way = np.append(0.0, np.cumsum(steps))[:-1]
    came = np.append(0.0, np.hypot(np.diff(x), np.diff(y)))[:-1] > 0
    axes = {f"imu_a{a}_mps2": _column(windows, f"imu_acceleration_{a}").ravel() for a in "xyz"}
    log = pd.DataFrame({
        "t_s": STEP * np.arange(way.size), **axes, "imu_gz_radps": _column(windows, "imu_yaw").ravel(),
        "enc_fl_radps": left, "enc_fr_radps": right, "enc_rl_radps": left, "enc_rr_radps": right,
        "v_cmd_mps": radius * command, "ref_x_m": np.where(came, way, np.nan),
    })  # fmt: skip
    std = _wander(log)
    if command.mean() < 0:
        log[list(TURNED_ROUND)] *= -1.0
    slower = log[["enc_fl_radps", "enc_fr_radps"]].min(axis=1) * radius
    against = slower < -OTHER_WAY * float(log["v_cmd_mps"].mean())
    first = int(np.argmin(against))  # of the samples at which both sides turn as commanded
    return log[first:], std


def _wander(log: pd.DataFrame) -> float:
    """Std of the way [m] about a constant velocity in each window but the first, in which it changes."""
    off = []
    for begin in range(SAMPLES, len(log), SAMPLES):
        known = log[begin : begin + SAMPLES].dropna(subset=["ref_x_m"])
        if len(known) > 2:
            t, x = known["t_s"].to_numpy(), known["ref_x_m"].to_numpy()
            off.append(float(np.sum((x - np.polyval(np.polyfit(t, x, 1), t)) ** 2) / (len(known) - 2)))
    return max(float(np.sqrt(np.mean(off))) if off else 0.0, LEAST)
