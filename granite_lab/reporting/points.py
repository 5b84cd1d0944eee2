"""Points with bars on an axis: trials, means and published values."""

from __future__ import annotations

import math
from typing import Any

from matplotlib.axes import Axes

from granite_lab.reporting import canvas
from granite_lab.reporting.summary import Speed

APART, WIDE = 0.008, 0.05
"""Abscissae of the trials of a speed [m/s]: from one to the next, and from first to last at most."""
CROWD = 12
"""So many trials of a speed are drawn in full; more are drawn smaller and fainter."""


def point(
    axis: Axes, x: float, y: float, half: float, colour: str, marker: str, trials: int, label: str | None
) -> None:
    """Draw one point with a symmetric bar, if there is a point; `trials` is how many share its place."""
    if math.isfinite(y):
        axis.errorbar(
            x, y, yerr=bar(half), color=colour, marker=marker, linestyle="none", label=label, **dress(trials)
        )  # fmt: skip


def dress(trials: int) -> dict[str, Any]:
    """Return sizes of a point and its bar, so that those of many trials do not become one blot."""
    if trials <= CROWD:
        return {"markersize": 3.5, "linewidth": 0.9}
    return {"markersize": 2.5, "linewidth": 0.5, "alpha": max(0.4, CROWD / trials), "markeredgewidth": 0}


def bar(half: float) -> float:
    """Return the half length of a bar, zero where it is not known."""
    return half if math.isfinite(half) and half > 0 else 0.0


def markers(
    axis: Axes,
    points: list[tuple[float, float]],
    colour: str,
    marker: str,
    label: str,
    size: float,
    weight: float,
) -> None:
    """Draw the points that have a finite ordinate, in front of all else."""
    finite = [(x, y) for x, y in points if math.isfinite(y)]
    if finite:
        x, y = zip(*finite, strict=True)
        axis.plot(
            x,
            y,
            color=colour,
            marker=marker,
            markersize=size,
            markeredgewidth=weight,
            linestyle="none",
            label=label,
            zorder=5,
        )


def spread(speed: Speed) -> list[float]:
    """Return the abscissae of a speed's trials, side by side, all of them close to the speed."""
    n = len(speed.results)
    step = min(APART, WIDE / max(1, n - 1))
    return [speed.velocity + step * (i - (n - 1) / 2) for i in range(n)]


def frame(axis: Axes, x: str, y: str) -> None:
    """Name the axes."""
    axis.set_xlabel(x)
    axis.set_ylabel(y)
    canvas.align_labels([axis])
