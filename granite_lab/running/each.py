"""The same work on each of many trials, here or on a Dask cluster: what is remembered is not done again.

Workers of a cluster must have this version of granite-lab and see the same files under the same paths. Dask
talks in pickles: use a cluster that you trust.
"""

from __future__ import annotations

import os
import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from granite_lab.errors import LabError, UsageError
from granite_lab.logs.trial import name_of
from granite_lab.options import Options
from granite_lab.origin import Failure
from granite_lab.parameters.catalogue import CATALOGUE, clear_cache
from granite_lab.parameters.quantity import noting_files
from granite_lab.processes import SHORT_OF_MEMORY, one_thread, shut_down, starting, worker_pool
from granite_lab.running import cache as remembered
from granite_lab.running.cache import Cache, trial_key
from granite_lab.running.codec import Arena, decode, encode

T = TypeVar("T")
X = TypeVar("X")
Y = TypeVar("Y")

AHEAD = 2
"""Items per worker that wait in its queue; finished results never pile up beyond that."""

PATIENCE = 10
"""Time after which a pool that finishes nothing is looked at, and that a scheduler has to answer [s]."""

_one_at_a_time = threading.Lock()


@dataclass(frozen=True)
class Execution:
    """Where work is done and whether its results are stored; results do not depend on it.

    Attributes:
        jobs: number of processes of this machine; 0 means one per core, 1 means this process.
        scheduler: address of a Dask scheduler that does the work in their place.
        cache: of finished results; None computes everything.
    """

    jobs: int = 0
    scheduler: str | None = None
    cache: Cache | None = None

    def doubts(self) -> tuple[str, ...]:
        """Return a line where nothing could be remembered."""
        trouble = self.cache.trouble if self.cache is not None else ""
        return (f"nothing is remembered: {trouble}",) if trouble else ()


LOCAL = Execution()
"""All cores of this machine, nothing remembered."""


def each_trial(
    work: Callable[[Path, Options], T],
    paths: Sequence[Path],
    options: Options,
    *,
    execution: Execution = LOCAL,
    done: Callable[[Path], None] = lambda _: None,
) -> list[T | LabError]:
    """Apply `work` to each trial; return results and errors in the order of the trials.

    Results come out of the same bytes whether they were just made, in whichever process, or
    remembered. Their larger arrays wait on the disk, so that memory does not grow with the trials.

    Args:
        work: a module-level function of path and options that returns records.
        done: called with each path once it is finished.
    """
    cache, name = execution.cache, work.__qualname__
    arena = Arena(cache.folder if cache is not None else None)
    keys = {path: trial_key(name, path, options) for path in paths} if cache is not None else {}
    results: dict[Path, T | LabError] = {}
    for path, key in keys.items():
        if cache is not None and (outcomes := cache.get(key, arena=arena)) is not None:
            results[path] = outcomes
            done(path)
    left = [path for path in dict.fromkeys(paths) if path not in results]
    for index, outcome in _run(partial(_encoded_outcome, work, options), left, execution):
        path = left[index]
        if isinstance(outcome, LabError):
            results[path] = outcome
        else:
            # An input that was changed meanwhile no longer belongs to the key.
            if cache is not None and trial_key(name, path, options) == keys[path]:
                cache.put(keys[path], outcome)
            results[path] = decode(arena.hold(outcome))[1]
        done(path)
    return [results[path] for path in paths]


def split_failures(
    files: Sequence[Path], outcomes: Sequence[T | LabError], *, strict: bool = False
) -> tuple[list[T], tuple[Failure, ...]]:
    """Return the results of `each_trial`, and the trials that failed.

    Raises:
        LabError: of the first trial that failed, if `strict` or if none went through.
    """
    results = [outcome for outcome in outcomes if not isinstance(outcome, LabError)]
    pairs = zip(files, outcomes, strict=True)
    errors = [(path, outcome) for path, outcome in pairs if isinstance(outcome, LabError)]
    if errors and (strict or not results):
        raise _naming(*errors[0])
    return results, tuple(Failure(name_of(path), error.message, error.hint) for path, error in errors)


def _naming(path: Path, error: LabError) -> LabError:
    """Return an error of one of several trials; its message says which."""
    name = name_of(path)
    named = any(message in error.message for message in (str(path), f"'{name}'", f"{name}:"))
    return error if named else type(error)(f"{name}: {error.message}", error.hint)


def _encoded_outcome(work: Callable[[Path, Options], Any], options: Options, path: Path) -> bytes | LabError:
    """Return the encoded pair of files that were read besides the log, and result."""
    clear_cache()
    with one_thread(), noting_files() as files:
        try:
            result = work(path, options)
        except LabError as error:
            return error
        except Exception as error:  # one trial must not take the others with it
            last = traceback.extract_tb(error.__traceback__)[-1]
            fault = f"{type(error).__name__} in {Path(last.filename).name}:{last.lineno}"
            return LabError(
                f"{path}: {fault}: {' '.join(str(error).split())[:200]}",
                "this is a fault of granite-lab, not of the log: please report it",
            )
    depends = tuple((str(p), sha) for p, sha in files.items() if not p.is_relative_to(CATALOGUE))
    return encode((depends, result))


def _run(
    call: Callable[[X], Y], items: Sequence[X], execution: Execution
) -> Iterator[tuple[int, Y | LabError]]:
    """Yield (index, result) of each item, in the order in which they are finished.

    A process that dies takes its items with it; these are tried once more, one at a time, so that only
    the one that kills its process fails.
    """
    if execution.scheduler is not None and items:
        with connected(execution.scheduler) as client:
            yield from run_on(client, call, items)
        return
    workers = min(execution.jobs or os.cpu_count() or 1, len(items))
    if workers <= 1:
        yield from ((i, call(item)) for i, item in enumerate(items))
        return
    queue, suspects = deque(enumerate(items)), deque[tuple[int, X]]()
    while queue or suspects:
        single, ended = not queue, False
        pending: dict[Future[Y], tuple[int, X]] = {}
        pool = worker_pool(1 if single else workers)
        capacity = partial(int, 1 if single else workers * (1 + AHEAD))
        try:
            for index, future in _finished(pool, call, queue or suspects, pending, capacity):
                yield index, future.result()
            ended = True
        except BrokenProcessPool:
            if not single:
                suspects.extend(pending.values())
            for index, item in pending.values() if single else ():
                yield index, LabError(f"{item}: the process that worked on it died", SHORT_OF_MEMORY)
        finally:
            shut_down(pool, kill=not ended)


def _finished(
    pool: Executor,
    call: Callable[[X], Y],
    queue: deque[tuple[int, X]],
    pending: dict[Future[Y], tuple[int, X]],
    capacity: Callable[[], int],
) -> Iterator[tuple[int, Future[Y]]]:
    """Yield (index, future) as a pool finishes the items of a queue.

    Args:
        pool: that works.
        call: on each item.
        queue: of items with their index.
        pending: what the pool works on; filled here.
        capacity: returns how many items the pool may hold; 0 where it has no workers.

    Raises:
        LabError: nothing is finished any more, for all workers are gone.
    """
    while queue or pending:
        with starting():
            while queue and len(pending) < max(1, capacity()):
                pending[pool.submit(call, queue[0][1])] = queue[0]
                queue.popleft()
        done = wait(pending, PATIENCE, FIRST_COMPLETED).done
        if not done and not capacity():
            hint = "start new ones; finished trials are remembered"
            raise LabError("the cluster has lost all its workers", hint)
        for future in done:
            yield pending[future][0], future
            del pending[future]


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """Connect to a scheduler, which has `PATIENCE` to answer and to have workers.

    Raises:
        UsageError: dask.distributed is not installed, or nothing answers at the address.
    """
    try:
        from distributed import Client  # noqa: PLC0415, an extra
    except ImportError:
        raise UsageError(
            "--scheduler needs dask.distributed, which is not installed",
            "install it: pip install 'granite-lab[cluster]'",
        ) from None
    try:
        client = Client(address, timeout=PATIENCE)
    except (OSError, ValueError, TypeError) as error:
        reason = (str(error).splitlines() or [""])[0]
        raise UsageError(
            f"scheduler '{address}' cannot be reached: {reason}", "an address is like tcp://10.0.0.5:8786"
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError:
            raise UsageError(
                f"scheduler '{address}' has no workers", f"start some: dask worker {address}"
            ) from None
        yield client


def run_on(client: Any, call: Callable[[X], Y], items: Sequence[X]) -> Iterator[tuple[int, Y | LabError]]:
    """Yield (index, result) of each item as the cluster of `connected` finishes them.

    Raises:
        LabError: all workers are gone.
    """
    remote = partial(on_worker, call, folder=str(Path.cwd()), code=remembered.code())
    pool = client.get_executor(pure=False)

    def capacity() -> int:
        threads: int = sum(client.nthreads().values())
        return threads * (1 + AHEAD)

    try:
        for index, future in _finished(pool, remote, deque(enumerate(items)), {}, capacity):
            if (error := future.exception()) is None:
                yield index, future.result()
                continue
            fault = (str(error).splitlines() or [""])[0]
            message = f"{items[index]}: the cluster could not work on it: {type(error).__name__}: {fault}"
            yield index, LabError(message, "see the logs of its workers; is granite-lab installed there?")
    finally:
        pool.shutdown(wait=False)


def on_worker(call: Callable[[X], Y], item: X, folder: str, code: str) -> Y | LabError:
    """Do one item on a worker, in the folder of the caller; the threads of a worker take turns with it."""
    if remembered.code() != code:
        return LabError(
            f"{item}: a worker runs another version of granite-lab, or other libraries",
            "install the same ones on all workers and start them again",
        )
    with _one_at_a_time:
        try:
            os.chdir(folder)
        except OSError:
            return LabError(f"{item}: a worker cannot see the folder {folder}", "share it with the workers")
        return call(item)
