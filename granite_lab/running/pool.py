"""Work in processes of this machine, by loky: they need no guard of the script that calls."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from granite_lab.errors import LabError
from granite_lab.processes import SHORT_OF_MEMORY, behave, starting

X = TypeVar("X")
Y = TypeVar("Y")

AHEAD = 2
"""Items per process that wait in its queue; finished results never pile up beyond that."""


def run_here(call: Callable[[X], Y], items: Sequence[X], jobs: int) -> Iterator[tuple[int, Y | LabError]]:
    """Yield (index, result) of each item, in the order in which they are finished.

    A process that dies takes its items with it; these are tried once more, each in a process of its
    own, so that only the one that kills its process fails.

    Args:
        call: a module-level function, or a partial of one.
        items: its arguments.
        jobs: number of processes; 0 means one per core, 1 means this process.
    """
    workers = min(jobs or os.cpu_count() or 1, len(items))
    if workers <= 1:
        yield from ((i, call(item)) for i, item in enumerate(items))
        return
    lost: list[tuple[int, X]] = []
    queue = deque(enumerate(items))
    while queue:
        yield from _crowd(call, queue, workers, lost)
    for index, item in lost:
        again: list[tuple[int, X]] = []
        yield from _crowd(call, deque([(index, item)]), 1, again)
        if again:
            yield index, LabError(f"{item}: the process that worked on it died", SHORT_OF_MEMORY)


def _crowd(
    call: Callable[[X], Y], queue: deque[tuple[int, X]], workers: int, lost: list[tuple[int, X]]
) -> Iterator[tuple[int, Y]]:
    """Empty a queue with one pool; where the pool breaks, what was in it goes to `lost`."""
    from loky import ProcessPoolExecutor  # noqa: PLC0415, not needed by one process

    inside: dict[Future[Y], tuple[int, X]] = {}
    pool = ProcessPoolExecutor(workers, initializer=behave)
    ended = False
    try:
        while queue or inside:
            with starting():
                while queue and len(inside) < workers * (1 + AHEAD):
                    inside[pool.submit(call, queue[0][1])] = queue[0]
                    queue.popleft()
            for future in wait(inside, return_when=FIRST_COMPLETED).done:
                result = future.result()
                yield inside.pop(future)[0], result
        ended = True
    except BrokenProcessPool:
        for future, (index, item) in inside.items():
            if future.done() and future.exception() is None:
                yield index, future.result()
            else:
                lost.append((index, item))
    finally:
        pool.shutdown(kill_workers=not ended)
