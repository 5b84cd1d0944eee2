"""Stated probabilities against how often the effects acted: table and diagram."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.against_truth import table
from benchmarks.intervals import ratio, wilson
from granite_lab.files import write_bytes
from granite_lab.reporting import canvas

Stated = Sequence[tuple[str, float, bool]]
"""Effect that was named or described, stated probability, and whether it is right."""

EDGES = (0.0, 0.3, 0.6, 0.8, 0.9, 0.95, 0.98, 0.99, 1.0)
"""Edges of the bins, closer where most effects are."""


@dataclass(frozen=True)
class Bin:
    """The effects whose stated probability lies in one range.

    Attributes:
        low, high: the range; its upper end belongs to it in the last bin only.
        mean: of the stated probabilities.
        right, total: effects.
    """

    low: float
    high: float
    mean: float
    right: int
    total: int

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the share that is right, after Wilson."""
        return wilson(self.right / self.total, self.total)

    @property
    def holds(self) -> bool:
        """Whether the interval holds the stated mean."""
        return self.interval[0] <= self.mean <= self.interval[1]


def bins(stated: Stated) -> list[Bin]:
    """Return the bins that have names."""
    found = []
    for low, high in pairwise(EDGES):
        own = [(p, right) for _, p, right in stated if low <= p < high or p == high == EDGES[-1]]
        if own:
            mean = float(np.mean([p for p, _ in own]))
            found.append(Bin(low, high, mean, sum(right for _, right in own), len(own)))
    return found


def section(stated: Stated, picture: str) -> str:
    """Return the section of a page: a table, and the diagram where any effect was stated.

    Args:
        stated: of all sets.
        picture: path of the diagram, as the page states it.
    """
    head = "## Stated probability\n\n"
    if not stated:
        return f"{head}No effect was named or described.\n"
    rows = []
    for b in bins(stated):
        right = ratio(b.right, b.total, "/")
        rows.append(
            [f"{b.low:g}–{b.high:g}", f"{b.mean:.3f}", right if b.holds else f"**{right}**",
             "yes" if b.holds else "no"]
        )  # fmt: skip
    columns = ["stated", "mean", "right (95 % interval after Wilson)", "interval holds the mean"]
    return f"{head}{table(columns, rows)}\n![Reliability diagram]({picture})\n"


def diagram(stated: Stated) -> Figure:
    """Draw the share that is right over the stated probability, by bins."""
    with canvas.styled():
        figure = Figure(figsize=(canvas.WIDTH, 3.2), layout="constrained")
        axis = figure.add_subplot()
        axis.plot([0, 1], [0, 1], color=canvas.GREY, linewidth=0.8, label="as stated")
        found = bins(stated)
        shares = np.array([b.right / b.total for b in found])
        away = np.abs(np.array([b.interval for b in found]).T - shares)
        axis.errorbar(
            [b.mean for b in found], shares, away, fmt="o", color=canvas.MEASURED, capsize=2,
            label="effects, 95 % interval", markersize=4,
        )  # fmt: skip
        axis.set(xlim=(-0.02, 1.04), ylim=(-0.02, 1.04), xlabel="stated probability", ylabel="share right")
        axis.legend(loc="lower right")
    return figure


def write_diagram(stated: Stated, page: Path, picture: str) -> None:
    """Write the diagram beside a page."""
    if stated:
        write_bytes(page.parent / picture, canvas.saved(diagram(stated), "png", 110))
