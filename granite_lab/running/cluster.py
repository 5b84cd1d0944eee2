"""Work on an existing Dask cluster: the only module that imports dask.distributed.

Workers must have this version of granite-lab and see the same files under the same paths. Dask
talks in pickles: use a cluster that you trust.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from granite_lab.errors import LabError, UsageError
from granite_lab.running import cache

X = TypeVar("X")
Y = TypeVar("Y")

PATIENCE = 10
"""How long a scheduler may take to answer, and to have workers [s]."""

AHEAD = 2
"""Items per thread of the cluster that are on their way."""

_alone = threading.Lock()


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """Connect to a scheduler and cancel what is left there in the end.

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
    try:
        try:
            client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError:
            raise UsageError(
                f"scheduler '{address}' has no workers", f"start some: dask worker {address}"
            ) from None
        yield client
    finally:
        client.close(timeout=PATIENCE)


def run_on(client: Any, call: Callable[[X], Y], items: Sequence[X]) -> Iterator[tuple[int, Y | LabError]]:
    """Yield (index, result) of each item, in the order in which they are finished.

    Args:
        client: of `connected`.
        call: a module-level function of this package, or a partial of one.
        items: its arguments.

    Raises:
        LabError: all workers are gone.
    """
    from distributed import wait  # noqa: PLC0415

    code, folder = cache.code(search=True), str(Path.cwd())
    queue = list(enumerate(items))[::-1]
    inside: dict[Any, int] = {}
    try:
        while queue or inside:
            room = max(1, sum(client.nthreads().values())) * (1 + AHEAD) - len(inside)
            for index, item in (queue.pop() for _ in range(min(room, len(queue)))):
                inside[client.submit(_on_worker, call, item, folder, code, pure=False)] = index
            try:
                done = wait(list(inside), timeout=PATIENCE, return_when="FIRST_COMPLETED").done
            except TimeoutError:
                if not client.nthreads():
                    raise LabError(
                        "the cluster has lost all its workers",
                        "start new ones; finished trials are remembered",
                    ) from None
                continue
            for future in done:
                index = inside.pop(future)
                yield index, _result(future, items[index])
    finally:
        client.cancel(list(inside))


def _result(future: Any, item: Any) -> Any:
    error = future.exception()
    if error is None:
        return future.result()
    what = (str(error).splitlines() or [""])[0]
    return LabError(
        f"{item}: the cluster could not work on it: {type(error).__name__}: {what}",
        "see the logs of its workers; is granite-lab installed there?",
    )


def _on_worker(call: Callable[[X], Y], item: X, folder: str, code: str) -> Y | LabError:
    """Do one item on a worker, in the folder of the caller.

    A process has only one current folder: the threads of a worker take turns.
    """
    if cache.code(search=True) != code:
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
