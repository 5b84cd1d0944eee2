"""The simulations of a search for a missing effect, on a cluster."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from granite_lab.effects import library
from granite_lab.errors import LabError
from granite_lab.inference.pool import Respond, Scenario, Task
from granite_lab.logs.trial import Array
from granite_lab.model.dictionary import dictionary
from granite_lab.model.effect import Effect
from granite_lab.model.latent import LatentForce
from granite_lab.running.cache import fingerprint
from granite_lab.running.codec import decode, encode
from granite_lab.running.each import Execution, connected, run_on


@contextmanager
def on_cluster(execution: Execution, effects: Path | None) -> Iterator[Respond | None]:
    """Give what simulates on the cluster, or None where this machine does it."""
    if execution.scheduler is None:
        yield None
        return
    sha = fingerprint(effects) if effects else ""
    with connected(execution.scheduler) as client:

        def respond(scenario: Scenario, tasks: Sequence[Task]) -> list[Array | None]:
            if type(scenario) is not Scenario:  # a worker makes a plain scenario
                return [scenario.respond(task) for task in tasks]
            size = max(1, min(16, len(tasks) // (2 * max(1, sum(client.nthreads().values())))))
            parts = [tuple(tasks[i : i + size]) for i in range(0, len(tasks), size)]
            computed: dict[int, list[Array | None]] = {}
            for index, part in run_on(client, partial(_simulate, encode(scenario), effects, sha), parts):
                if isinstance(part, LabError):
                    raise LabError(f"the cluster failed: {part.message.partition(': ')[2]}", part.hint)
                computed[index] = part
            return [signals for index in range(len(parts)) for signals in computed[index]]

        yield respond


def _simulate(
    scenario: bytes, effects: Path | None, sha: str, tasks: Sequence[Task]
) -> list[Array | None] | LabError:
    """Simulate on a worker, which takes a user's own effects from their file."""
    if effects and fingerprint(effects) != sha:
        return LabError(f"worker: {effects} is another file on a worker", "share the folder with the workers")
    made: Scenario = decode(scenario, effects_of_search(effects))
    return [made.respond(task) for task in tasks]


def effects_of_search(file: Path | None) -> dict[str, Effect]:
    """Return all effects that a search may simulate: the library, terms of the dictionary, pushes."""
    return library(file) | dictionary() | {LatentForce.id: LatentForce()}
