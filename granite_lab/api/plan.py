"""`plan_next`: the trial that would best answer what a search has left open."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from granite_lab.api.calls import checked
from granite_lab.effects import library, load_effects
from granite_lab.errors import InputError
from granite_lab.planning.design import NAME, load_design
from granite_lab.planning.plan import Plan
from granite_lab.planning.plan import plan_next as rank


@checked
def plan_next(
    folder: str | Path,
    *,
    room: float | None = None,
    max_speed: float | None = None,
    effects: str | Path | None = None,
    jobs: int = 0,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> Plan:
    """Propose the next trial: the one that best answers what the trials so far left open.

    Args:
        folder: written by ``granite-lab discover … --out DIR`` or ``granite-lab study … --out DIR``.
        room: longest way the sand allows [m]; the longest so far by default.
        max_speed: fastest command [m/s]; 1.25 times the fastest so far by default.
        effects: your own effect file (.py). It is run: use only code you trust.
        jobs: number of processes; 0 means one per core.
        progress: told how many trials are looked at, and of how many.

    Returns:
        the proposals; the table has a row for each.

    Raises:
        InputError: the folder holds no search.
        UsageError: a named effect is neither in the library nor in the effect file.
        EstimateError: the trials at hand cannot be simulated.
    """
    path = Path(folder) / NAME
    if not path.is_file():
        raise InputError(
            f"{folder}: holds no search for a missing effect ('{NAME}' is missing)",
            f"run 'granite-lab discover TRIALS… --out {folder}', or 'study' without --no-discover, first",
        )
    known = library() | (load_effects(Path(effects)) if effects else {})
    return rank(
        load_design(path), known,
        room=room, max_speed=max_speed, jobs=jobs or os.cpu_count() or 1, progress=progress,
    )  # fmt: skip
