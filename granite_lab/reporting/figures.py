"""Figures as SVG and PNG, drawn by several processes where there are several figures."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence

from granite_lab.processes import forked, spread
from granite_lab.reporting.canvas import Drawing, to_png, to_svg

FEW = 4
"""Fewer figures a process are not worth another one."""

Files = tuple[str, bytes]
"""SVG and PNG of a figure."""

_drawings: Sequence[Drawing] = ()


def rendered(drawings: Sequence[Drawing], jobs: int) -> Iterator[Files]:
    """Yield SVG and PNG of each drawing, in their order; the bytes do not depend on the processes.

    Processes are forked, for what draws a figure cannot always be sent to another process; where the
    system cannot fork safely, this process draws.

    Args:
        drawings: what to draw.
        jobs: number of processes; 0 means one per core, 1 means this process.

    Raises:
        LabError: a process died.
    """
    pool = forked(min(jobs or os.cpu_count() or 1, len(drawings) // FEW), _enter, drawings)
    if pool is None:
        yield from map(_render, drawings)
        return
    try:
        yield from spread(pool, _work, range(len(drawings)), "drew figures")
    finally:
        pool.shutdown(cancel_futures=True)


def _render(drawing: Drawing) -> Files:
    figure = drawing.figure
    return to_svg(figure), to_png(figure)


def _enter(drawings: Sequence[Drawing]) -> None:
    global _drawings  # noqa: PLW0603, a worker process draws for one report
    _drawings = drawings


def _work(index: int) -> Files:
    return _render(_drawings[index])
