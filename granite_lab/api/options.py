"""What the functions take as keywords, as the chain wants it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from granite_lab.inference.constants import LATENCY_LIMIT, TOLERANCE
from granite_lab.running import Cache, Execution, Options


def options_of(
    *,
    robot: str | Path | None = None,
    soil: str | Path | None = None,
    column_map: str | Path | None = None,
    topics: Mapping[str, str] | None = None,
    model: str | Path | None = None,
    effects: str | Path | None = None,
    tolerance: float = TOLERANCE,
    latency: float = LATENCY_LIMIT,
    window: tuple[float, float] | None = None,
) -> Options:
    """Return the options; what is None is left to the logs and the catalogue."""
    return Options(
        robot=None if robot is None else str(robot),
        soil=None if soil is None else str(soil),
        column_map=None if column_map is None else str(column_map),
        topics=tuple((topics or {}).items()),
        model=None if model is None else Path(model),
        effects=None if effects is None else Path(effects),
        tolerance=tolerance,
        latency=latency,
        window=window,
    )


def execution_of(jobs: int, scheduler: str | None, cache: bool) -> Execution:
    """Return where the work is done and what is remembered."""
    return Execution(jobs, scheduler, Cache() if cache else None)
