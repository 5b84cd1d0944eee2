"""`plan_next`: the trial that would best tell apart what a discovery could not."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from granite_lab.api.found import finding_in, newest_in
from granite_lab.discovery.plan import Plan
from granite_lab.discovery.plan import plan_next as rank
from granite_lab.discovery.plan_design import Design
from granite_lab.discovery.plan_file import NAME, load_design, load_document
from granite_lab.discovery.plan_question import question
from granite_lab.effects import library, load_effects
from granite_lab.errors import InputError

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class Planned:
    """Trials that could come next.

    Attributes:
        plan: what is open, and the proposals, best first.
        design: the trials at hand.
    """

    plan: Plan
    design: Design

    def to_frame(self) -> pd.DataFrame:
        """Return the proposals, one row each, best first; `probability` is that of the right answer then."""
        import pandas as pd  # noqa: PLC0415

        names = ["v_mps", "a_mps2", "distance_m", "repeats", "probability", "evidence", "channel", "phase"]
        rows = []
        for p in self.plan.proposals:
            v = p.option.variant
            motion = (v.velocity, v.acceleration, v.distance, p.option.repeats)
            rows.append((*motion, p.after.chance, p.after.evidence, p.channel, p.phase))
        return pd.DataFrame(rows, columns=names)


def plan_next(
    folder: str | Path,
    *,
    room: float | None = None,
    max_speed: float | None = None,
    effects: str | Path | None = None,
    jobs: int = 1,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> Planned:
    """Propose the next trial: the one that best separates what the trials so far left open.

    Args:
        folder: written by ``granite-lab discover … --out DIR`` or ``granite-lab study … --out DIR``.
        room: longest way the sand allows [m]; the longest so far by default.
        max_speed: fastest command [m/s].
        effects: your own effect file (.py). It is run: use only code you trust.
        jobs: number of processes; 0 means one per core.
        progress: told how many trials are looked at, and of how many.

    Returns:
        the proposals; the table has a row for each.

    Raises:
        InputError: the folder holds no finding.
        EstimateError: the trials at hand cannot be simulated.
    """
    path = newest_in(Path(folder))
    found = finding_in(path, load_document)
    if not (Path(folder) / NAME).exists():
        raise InputError(
            f"{folder}: holds no finding ('{NAME}' is missing)",
            f"run 'granite-lab discover TRIALS… --out {folder}' first",
        )
    known = library() | (load_effects(Path(effects)) if effects else {})
    asked = question(found, known, str(path))
    design = load_design(Path(folder) / NAME)
    plan = rank(
        design, asked, room=room, max_speed=max_speed, jobs=jobs or os.cpu_count() or 1, progress=progress
    )
    return Planned(plan, design)
