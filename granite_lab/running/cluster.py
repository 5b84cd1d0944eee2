"""Work on an existing Dask cluster: the only module that imports dask.distributed.

Workers must have this version of granite-lab and see the same files under the same paths. Dask
talks in pickles: use a cluster that you trust.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from granite_lab.errors import LabError, UsageError
from granite_lab.running import cache
from granite_lab.running.each import AHEAD, PATIENCE, finished

X = TypeVar("X")
Y = TypeVar("Y")

_alone = threading.Lock()


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
    """Yield (index, result) of each item, in the order in which they are finished.

    Args:
        client: of `connected`.
        call: a module-level function of this package, or a partial of one.
        items: its arguments.

    Raises:
        LabError: all workers are gone.
    """
    there = partial(_on_worker, call, folder=str(Path.cwd()), code=cache.code())
    pool = client.get_executor(pure=False)

    def room() -> int:
        threads: int = sum(client.nthreads().values())
        return max(1, threads) * (1 + AHEAD)

    def idle() -> None:
        if not client.nthreads():
            raise LabError(
                "the cluster has lost all its workers", "start new ones; finished trials are remembered"
            )

    try:
        for index, future in finished(pool, there, deque(enumerate(items)), {}, room, idle):
            error = future.exception()
            what = (str(error).splitlines() or [""])[0]
            yield (
                index,
                future.result()
                if error is None
                else LabError(
                    f"{items[index]}: the cluster could not work on it: {type(error).__name__}: {what}",
                    "see the logs of its workers; is granite-lab installed there?",
                ),
            )
    finally:
        pool.shutdown(wait=False)


def _on_worker(call: Callable[[X], Y], item: X, folder: str, code: str) -> Y | LabError:
    """Do one item on a worker, in the folder of the caller.

    A process has only one current folder: the threads of a worker take turns.
    """
    if cache.code() != code:
        return LabError(
            f"{item}: a worker runs another version of granite-lab, or other libraries",
            "install the same ones on all workers and start them again",
        )
    with _alone:
        try:
            os.chdir(folder)
        except OSError:
            return LabError(f"{item}: a worker cannot see the folder {folder}", "share it with the workers")
        return call(item)
