"""Manners of worker processes: quiet on Ctrl-C, and none stays behind when its parent is gone."""

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
