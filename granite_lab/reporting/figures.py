"""A figure of a report with what is told about it; files of several, drawn by several processes."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure as Canvas

from granite_lab.processes import forked, spread
from granite_lab.reporting.canvas import to_pdf, to_png, to_svg

_LABEL = re.compile(r"\s*(.*?)\s*\[([^\]]+)\]\s*$", re.S)


@dataclass(frozen=True, eq=False)
class Figure:
    """A figure of a report.

    Attributes:
        name: stem of its files.
        title: the answer that it gives, or the quantity that it shows, on one line.
        caption: what is drawn and how to read it.
        alt: a description for those who cannot see it.
        draw: draws it; called once per use, so that only one figure need be in memory at a time.
        virtual: its data were written by a simulator; `heading` and the drawing itself then say so.
    """

    name: str
    title: str
    caption: str
    alt: str
    draw: Callable[[], Canvas]
    virtual: bool = False

    @property
    def heading(self) -> str:
        """The title, with "(virtual data)" behind it where that is so."""
        return f"{self.title} (virtual data)" if self.virtual else self.title

    def units(self) -> dict[str, str]:
        """Return the quantities on the axes with their units, as the labels of the axes state them."""
        axes = self.draw().axes
        labels = [text for axis in axes for text in (axis.get_xlabel(), axis.get_ylabel()) if text]
        found = [_LABEL.match(label) for label in labels]
        return {" ".join(m[1].split()): m[2] for m in found if m}


FEW = 4
"""Fewer figures a process are not worth another one."""

DPI = 300
"""Resolution of a PNG, as journals ask for it."""


@dataclass(frozen=True)
class Files:
    """A figure in each of its formats."""

    svg: str
    png: bytes
    pdf: bytes


_figures: Sequence[Figure] = ()


def rendered(figures: Sequence[Figure], jobs: int) -> Iterator[Files]:
    """Yield the files of each figure, in their order; the bytes do not depend on the processes.

    Processes are forked, for what draws a figure cannot always be sent to another process; where the
    system cannot fork safely, this process draws.

    Args:
        figures: what to draw.
        jobs: number of processes; 0 means one per core, 1 means this process.

    Raises:
        LabError: a process died.
    """
    pool = forked(min(jobs or os.cpu_count() or 1, len(figures) // FEW), _enter, figures)
    if pool is None:
        yield from map(_render, figures)
        return
    try:
        yield from spread(pool, _work, range(len(figures)), "drew figures")
    finally:
        pool.shutdown(cancel_futures=True)


def _render(figure: Figure) -> Files:
    drawn = figure.draw()
    return Files(to_svg(drawn), to_png(drawn, DPI), to_pdf(drawn))


def _enter(figures: Sequence[Figure]) -> None:
    global _figures  # noqa: PLW0603, a worker process draws for one report
    _figures = figures


def _work(index: int) -> Files:
    return _render(_figures[index])
