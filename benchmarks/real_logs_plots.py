"""Figures of the page on real logs: velocity over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

mpl.use("Agg")
import matplotlib.pyplot as plt

if TYPE_CHECKING:
    from benchmarks.real_logs_data import Comparison
    from granite_lab.api.logs import Ingested

BLUE, ORANGE, GREY = "#0072b2", "#d55e00", "#555555"
WINDOW = 12.0
"""Length of the part of a run of the car that is shown [s]."""

STOP = (225.0, 262.0)
"""Part of the Husky's log around its stop [s]."""


def draw(
    folder: Path, gps: Comparison, cars: Sequence[Comparison], snow: Sequence[tuple[str, Ingested]]
) -> None:
    """Write the figures `husky_gps.png`, `f1tenth.png` and `borealtc.png`."""
    folder.mkdir(parents=True, exist_ok=True)
    _husky(folder / "husky_gps.png", gps)
    _cars(folder / "f1tenth.png", cars)
    _boreal(folder / "borealtc.png", snow)


def _velocity(axes: Any, item: Ingested, keep: slice | NDArray[np.bool_] = slice(None)) -> None:
    motion = item.motion
    known = np.isfinite(motion.v_wheel)
    wheels = np.where(known, motion.v_wheel, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    wheels = np.where(known.any(axis=1), wheels, np.nan)
    t, v, std = motion.t[keep], motion.v[keep], motion.v_std[keep]
    axes.fill_between(t, v - 2 * std, v + 2 * std, color=BLUE, alpha=0.2, lw=0, label="estimate ± 2 std")
    axes.plot(t, wheels[keep], color=ORANGE, lw=0.9, label="wheels")
    axes.plot(t, v, color=BLUE, lw=1.2, label="estimate")
    axes.set_xlim(t[0], t[-1])
    axes.grid(alpha=0.3, lw=0.5)


def _finish(figure: Any, path: Path) -> None:
    for axes in figure.axes:
        axes.set_ylabel("velocity [m/s]")
    figure.axes[-1].set_xlabel("time of the log [s]")
    figure.savefig(path, dpi=90, pil_kwargs={"optimize": True})
    plt.close(figure)


def _husky(path: Path, gps: Comparison) -> None:
    figure, (whole, stop) = plt.subplots(2, 1, figsize=(9, 6.2), layout="constrained")
    t = gps.item.motion.t
    for axes, part in ((whole, slice(None)), (stop, (t >= STOP[0]) & (t <= STOP[1]))):
        _velocity(axes, gps.item, part)
        axes.set_ylim(-0.25, 2.1)
    whole.plot(gps.t, gps.reference, ".", color=GREY, ms=2.5, label="GPS", zorder=1)
    near = (gps.t >= STOP[0]) & (gps.t <= STOP[1])
    stop.plot(gps.t[near], gps.reference[near], ".", color=GREY, ms=5, label="GPS", zorder=4)
    whole.set_title("Husky with GPS: the whole log", loc="left", fontsize=10)
    stop.set_title("around its one stop", loc="left", fontsize=10)
    whole.legend(loc="upper right", ncols=4, fontsize=8)
    _finish(figure, path)


def _cars(path: Path, cars: Sequence[Comparison]) -> None:
    figure, rows = plt.subplots(len(cars), 1, figsize=(9, 8), layout="constrained")
    for axes, car in zip(rows, cars, strict=True):
        begin = _busiest(car)
        t = car.item.motion.t
        _velocity(axes, car.item, (t >= begin) & (t <= begin + WINDOW))
        near = (car.t >= begin) & (car.t <= begin + WINDOW)
        axes.plot(car.t[near], car.reference[near], color="k", lw=1.2, ls="--", label="motion capture")
        axes.set_title(f"small car, {car.name}: the {WINDOW:g} s with most slip", loc="left", fontsize=10)
    rows[0].legend(loc="upper right", ncols=4, fontsize=8)
    top = rows[0].get_ylim()
    rows[0].set_ylim(top[0], top[1] + 0.2 * (top[1] - top[0]))
    _finish(figure, path)


def _busiest(car: Comparison) -> float:
    """Begin of the window in which wheels and reference differ most [s]."""
    off = np.cumsum(np.square(car.wheels - car.reference))
    starts = car.t[car.t <= max(car.t[-1] - WINDOW, car.t[0])]
    gain = np.interp(starts + WINDOW, car.t, off) - np.interp(starts, car.t, off)
    return float(starts[int(np.argmax(gain))])


def _boreal(path: Path, snow: Sequence[tuple[str, Ingested]]) -> None:
    figure, rows = plt.subplots(len(snow), 1, figsize=(9, 7), layout="constrained")
    for axes, (name, item) in zip(rows, snow, strict=True):
        _velocity(axes, item)
        ground = "snow" if name.startswith("SNOW") else "sandy loam"
        axes.set_title(f"Husky on {ground} ({name}); there is no reference", loc="left", fontsize=10)
    rows[0].legend(loc="upper right", ncols=3, fontsize=8)
    _finish(figure, path)
