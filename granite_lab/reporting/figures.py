"""Figures as SVG and PNG, drawn by several processes where there are several figures."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context

from granite_lab.errors import LabError
from granite_lab.processes import behave, starting
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
    workers = min(jobs or os.cpu_count() or 1, len(drawings) // FEW)
    if workers < 2 or sys.platform != "linux":
        yield from map(_render, drawings)
        return
    pool = ProcessPoolExecutor(
        workers, mp_context=get_context("fork"), initializer=_enter, initargs=(drawings,)
    )
    try:
        with starting():
            files = pool.map(_work, range(len(drawings)))
        yield from files
    except BrokenProcessPool:
        raise LabError(
            "a process that drew figures has died", "is memory short? --jobs 1 works in one process"
        ) from None
    finally:
        pool.shutdown(cancel_futures=True)


def _render(drawing: Drawing) -> Files:
    figure = drawing.figure
    return to_svg(figure), to_png(figure)


def _enter(drawings: Sequence[Drawing]) -> None:
    global _drawings  # noqa: PLW0603, a worker process draws for one report
    _drawings = drawings
    behave()


def _work(index: int) -> Files:
    return _render(_drawings[index])
