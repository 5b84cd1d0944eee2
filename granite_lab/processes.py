"""Manners of processes: quiet on Ctrl-C, none stays behind, and sums do not depend on the number of cores."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


def behave() -> None:
    """Begin a worker process: leave Ctrl-C to the parent, and end when the parent ends.

    A parent that was killed cannot tell its workers; without the watch they would wait for work
    for ever.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_watch, daemon=True).start()


def _watch() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def starting() -> Iterator[None]:
    """Hold Ctrl-C back while workers start: a half-started one would print a traceback.

    Workers inherit the mask and lift it in `behave`.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing.resource_tracker import ensure_running  # noqa: PLC0415, absent on Windows

    ensure_running()  # lifts the mask itself when it starts, so it starts before
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep linear algebra to one thread during the block.

    Sums that are split among threads differ in their last digits with the number of threads, and an
    iteration can turn that into a difference one sees.
    """
    import scipy.linalg  # noqa: F401, PLC0415, brings a library of its own, which must be there to be limited
    from threadpoolctl import threadpool_limits  # noqa: PLC0415

    with threadpool_limits(1, user_api="blas"):
        yield
