"""Worker processes: Ctrl-C ends them quietly, none outlives its parent, results do not depend on cores."""

from __future__ import annotations

import ctypes
import gc
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any, TypeVar, cast

from granite_lab.errors import LabError

X = TypeVar("X")
Y = TypeVar("Y")

Progress = Callable[[str, int, int], None]
"""Told what is being done, how many steps of it are done, and of how many at most, 0 where not known."""

SHORT_OF_MEMORY = "is memory short? --jobs 1 works in one process"
"""What to do where a process has died."""


def init_worker(parent: int) -> None:
    """Begin a worker process: leave Ctrl-C to the parent, and end when the parent ends.

    A parent that was killed cannot tell its workers; without the watch they would wait for work
    for ever.

    Args:
        parent: its number, told by itself: when the worker begins, it may be gone already.
    """
    gc.freeze()  # no collection looks at what was inherited, so that its memory stays shared
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int, interval: float = 0.2) -> None:
    while os.getppid() == parent:
        time.sleep(interval)
    os._exit(1)


@contextmanager
def starting() -> Iterator[None]:
    """Hold Ctrl-C back while workers start: a half-started one would print a traceback.

    Workers inherit the mask and lift it in `init_worker`.
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


def forked_pool(workers: int, enter: Callable[[X], None], given: X) -> ProcessPoolExecutor | None:
    """Return a pool of forked processes, which need not be sent what they share.

    Args:
        workers: number of processes.
        enter: called in each of them first.
        given: its argument.

    Returns:
        None where this process may as well work alone, or the system cannot fork safely.
    """
    return None if workers < 2 else _forks(workers, _begin, enter, given)


def _forks(workers: int, begin: Callable[..., None], *given: Any) -> ProcessPoolExecutor | None:
    """Return a pool of forked processes, each begun by a call with the number of this one and what is given.

    None where the system cannot fork safely.
    """
    if sys.platform != "linux":
        return None
    context = multiprocessing.get_context("fork")
    given = (os.getpid(), *given)
    return ProcessPoolExecutor(workers, mp_context=context, initializer=begin, initargs=given)


def worker_pool(workers: int) -> Executor:
    """Return a pool for work that may take long, ended by `shut_down`.

    Its processes are forked where that is safe, on Linux and from a process of one thread: they need not
    import again what this one has imported.
    """
    pool = _forks(workers, init_worker) if threading.active_count() == 1 else None
    if pool is not None:
        return pool
    import loky  # noqa: PLC0415, elsewhere a pool of the standard library needs a guarded main module

    return cast(Executor, loky.ProcessPoolExecutor(workers, initializer=init_worker, initargs=(os.getpid(),)))


def shut_down(pool: Executor, *, kill: bool) -> None:
    """End a pool; `kill` does not wait for what its processes are doing."""
    for process in list(getattr(pool, "_processes", None) or {}) if kill else ():
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL if hasattr(signal, "SIGKILL") else signal.SIGTERM)
    if isinstance(pool, ProcessPoolExecutor):
        pool.shutdown(cancel_futures=True)
    else:  # loky's names it otherwise
        cast(Any, pool).shutdown(kill_workers=kill)


def _begin(parent: int, enter: Callable[[X], None], given: X) -> None:
    init_worker(parent)
    enter(given)


def mapped(pool: ProcessPoolExecutor, call: Callable[[X], Y], items: Sequence[X], did: str) -> Iterator[Y]:
    """Yield what a pool makes of each item, in their order.

    Args:
        pool: of `forked_pool`.
        call: a module-level function.
        items: its arguments.
        did: what the processes did, in the past tense.

    Raises:
        LabError: a process died.
    """
    try:
        with starting():
            answers = pool.map(call, items)
        yield from answers
    except BrokenProcessPool:
        raise LabError(f"a process that {did} has died", SHORT_OF_MEMORY) from None


_shared: list[Any] = []


def forked_map(
    call: Callable[[X, int], Y], given: X, count: int, did: str, *, jobs: int, few: int = 1
) -> Iterator[Y]:
    """Yield ``call(given, k)`` for k from 0 to `count` - 1, in this order, from processes that share `given`.

    They are forked, for what is shared cannot always be sent to another process; where the system cannot
    fork safely, this process does it all.

    Args:
        call: a module-level function.
        given: its first argument.
        count: number of items.
        did: what the processes did, in the past tense.
        jobs: number of processes; 0 means one per core, 1 means this process.
        few: fewer items than this are not worth another process.

    Raises:
        LabError: a process died.
    """
    pool = forked_pool(min(jobs or os.cpu_count() or 1, count // few), _shared.append, given)
    if pool is None:
        yield from (call(given, k) for k in range(count))
        return
    try:
        yield from mapped(pool, partial(_call_on_shared, call), range(count), did)
    finally:
        pool.shutdown(cancel_futures=True)


def _call_on_shared(call: Callable[[X, int], Y], k: int) -> Y:
    return call(_shared[-1], k)


_MAPPED_FROM, _TRIMMED_FROM = (-3, 512 * 1024), (-1, 4 * 1024 * 1024)
"""Options of the GNU C library, each with its value [bytes]: larger blocks are mapped, and unmapped when
freed; a larger free end of the heap returns to the system. Pages that are mapped anew are cleared, which was
a fifth of the processor time of a search at the library's own first values of 128 kB."""


def return_freed_memory() -> None:
    """Let the GNU C library return large arrays to the system when they are freed.

    Left to itself it raises the size from which blocks are mapped to that of the largest one freed so far, up
    to 32 MB; smaller ones then lie between others and stay (mallopt(3), M_MMAP_THRESHOLD). Once it is set the
    size stays as it is. Other C libraries are left alone.
    """
    if sys.platform == "linux":
        with suppress(AttributeError):  # musl has no such options
            for option, value in (_MAPPED_FROM, _TRIMMED_FROM):
                ctypes.CDLL(None).mallopt(option, value)


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
