"""Options of commands that work on many trials: where the work is done, what is remembered, what is fatal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from granite_lab.commands.common import warn

if TYPE_CHECKING:
    from granite_lab.running import Execution

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
    from granite_lab.running import Cache, Execution

    return Execution(jobs, scheduler, Cache() if cache else None)


def tidy(execution: Execution) -> None:
    """Keep the cache within its size; say where it could not be written."""
    if execution.cache is not None:
        execution.cache.trim()
        if execution.cache.trouble is not None:
            warn([f"nothing is remembered: {execution.cache.trouble.message}"])
