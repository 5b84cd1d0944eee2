"""Estimated velocities against true ones: the record, its figures and its plot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

mpl.use("Agg")
import matplotlib.pyplot as plt

Array = NDArray[np.float64]

BLUE, ORANGE = "#0072b2", "#d55e00"


@dataclass(frozen=True, eq=False)
class Velocities:
    """Velocities of one run at common stamps (N) [m/s].

    Attributes:
        name: of the run.
        t: stamps [s].
        truth: NaN where nothing is known.
        v, std: of the estimate.
        wheels: of the wheels alone.
        grade: of the estimate.
        others: of further estimates, by name.
        truth_std: noise of the truth, one for all stamps.
        window: the part [s] that a plot shows.
    """

    name: str
    t: Array
    truth: Array
    v: Array
    std: Array
    wheels: Array
    grade: str
    others: Mapping[str, Array] = field(default_factory=dict)
    truth_std: float = 0.0
    window: tuple[float, float] = (-np.inf, np.inf)


def errors(runs: Sequence[Velocities], what: str = "v") -> Array:
    """Errors of "v", of "wheels" or of another estimate, of some runs together [m/s]."""
    return np.concatenate(
        [(run.others[what] if what in run.others else getattr(run, what)) - run.truth for run in runs]
    )


def rms(values: Array) -> float:
    """Root mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def inside(runs: Sequence[Velocities], low: float = -np.inf) -> float:
    """Share of the errors within two std, where the true slip ratio exceeds `low`; NaN of nothing."""
    shares = [
        (np.abs(run.v - run.truth) <= 2.0 * np.hypot(run.std, run.truth_std))[slip_ratio(run) > low]
        for run in runs
    ]
    together = np.concatenate(shares)
    return float(together.mean()) if together.size else float("nan")


def slip_ratio(run: Velocities) -> Array:
    """(N,) true slip ratio, by the wheels' velocity and at least 0.05 m/s."""
    return np.asarray(1.0 - run.truth / np.maximum(np.abs(run.wheels), 0.05))


def percent(share: float | None) -> str:
    """Return a share in percent, a dash for none."""
    return "–" if share is None or np.isnan(share) else f"{100 * share:.0f}"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown, numbers to the right."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines) + "\n"


def draw(path: Path, runs: Sequence[Velocities], columns: int = 2) -> None:
    """Write a figure with a panel for each run: estimate with two std, wheels, truth."""
    lines = -(-len(runs) // columns)
    figure, grid = plt.subplots(
        lines, columns, figsize=(4.7 * columns, 2.3 * lines), layout="constrained", squeeze=False
    )
    for axes in grid.flat[len(runs) :]:
        axes.set_axis_off()
    for axes, run in zip(grid.flat, runs, strict=False):
        keep = (run.t >= run.window[0]) & (run.t <= run.window[1])
        t, v, std = run.t[keep], run.v[keep].copy(), run.std[keep]
        v[1:][np.diff(t) > 5 * np.median(np.diff(t))] = np.nan  # no line over what is left out
        axes.fill_between(t, v - 2 * std, v + 2 * std, color=BLUE, alpha=0.2, lw=0, label="± 2 std")
        wheels, truth = (np.where(np.isnan(v), np.nan, x[keep]) for x in (run.wheels, run.truth))
        axes.plot(t, wheels, color=ORANGE, lw=0.9, label="wheels")
        if np.isfinite(truth).any():
            axes.plot(t, truth, color="k", lw=0.9, ls="--", label="truth")
        axes.plot(t, v, color=BLUE, lw=1.2, label="estimate")
        axes.set_title(run.name, loc="left", fontsize=9)
        seen = np.concatenate([v, wheels, truth])
        low, high = np.nanmin(seen), np.nanmax(seen)
        axes.set_ylim(low - 0.3 * (high - low), high + 0.3 * (high - low))
        axes.grid(alpha=0.3, lw=0.5)
    grid[0, 0].legend(fontsize=7, ncols=2)
    for axes in grid[:, 0]:
        axes.set_ylabel("velocity [m/s]")
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=72, pil_kwargs={"optimize": True})
    plt.close(figure)
