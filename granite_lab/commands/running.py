"""Options of commands that work on many trials: where the work is done, what is remembered, what is fatal."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from granite_lab.commands.common import warn

if TYPE_CHECKING:
    from granite_lab.errors import LabError
    from granite_lab.running import Execution

T = TypeVar("T")

SchedulerOption = Annotated[
    str | None,
    typer.Option("--scheduler", metavar="ADDRESS", help="Work on the Dask cluster with this scheduler."),
]
CacheOption = Annotated[
    bool, typer.Option("--cache/--no-cache", help="Remember results, and take those that still hold.")
]
StrictOption = Annotated[
    bool, typer.Option("--strict", help="A trial that fails ends it all; else it is left out.")
]


def execution_of(jobs: int, scheduler: str | None, cache: bool) -> Execution:
    """Return where the work is done and what is remembered."""
    from granite_lab.api.options import execution_of as of

    return of(jobs, scheduler, cache)


def good(files: Sequence[Path], outcomes: Sequence[T | LabError], strict: bool) -> list[T]:
    """Return the results; a trial that failed is told and left out.

    Raises:
        LabError: of the first trial that failed, if `strict` or if none went through.
    """
    from granite_lab.api.records import sifted

    results, failures = sifted(files, outcomes, strict=strict)
    warn([f"{trial}: left out: {reason}" for trial, reason in failures])
    return results


def tidy(execution: Execution) -> None:
    """Keep the cache within its size; say where it could not be written."""
    if execution.cache is not None:
        execution.cache.trim()
        if execution.cache.trouble is not None:
            warn([f"nothing is remembered: {execution.cache.trouble.message}"])
