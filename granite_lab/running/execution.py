"""Where work is done and what is remembered of it."""

from __future__ import annotations

from dataclasses import dataclass

from granite_lab.running.cache import Cache


@dataclass(frozen=True)
class Execution:
    """Where work is done and what is remembered of it; results do not depend on it.

    Attributes:
        jobs: number of processes of this machine; 0 means one per core, 1 means this process.
        scheduler: address of a Dask scheduler that does the work in their place.
        cache: of finished results; None computes everything.
    """

    jobs: int = 0
    scheduler: str | None = None
    cache: Cache | None = None


HERE = Execution()
"""All cores of this machine, nothing remembered."""
