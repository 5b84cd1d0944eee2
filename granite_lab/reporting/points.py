"""Points with bars on an axis: trials, means and published values."""

from __future__ import annotations

import math

from matplotlib.axes import Axes

from granite_lab.reporting import canvas
from granite_lab.reporting.summary import Speed


def point(
    axis: Axes, x: float, y: float, half: float, colour: str, marker: str, size: float, label: str | None
) -> None:
    """Draw one point with a symmetric bar, if there is a point."""
    if math.isfinite(y):
        axis.errorbar(
            x,
            y,
            yerr=bar(half),
            color=colour,
            marker=marker,
            markersize=size,
            linewidth=0.9,
            linestyle="none",
            label=label,
        )


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
    """Return the abscissae of a speed's trials, side by side so that their bars do not cover each other."""
    n = len(speed.results)
    return [speed.velocity + 0.008 * (i - (n - 1) / 2) for i in range(n)]


def frame(axis: Axes, x: str, y: str) -> None:
    """Name the axes."""
    axis.set_xlabel(x)
    axis.set_ylabel(y)
    canvas.align_labels([axis])
