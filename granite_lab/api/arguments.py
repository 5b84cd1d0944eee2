"""Arguments that several functions of the API share: their types, and how they become records."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

from granite_lab.errors import UsageError
from granite_lab.estimate import Estimate
from granite_lab.inference.constants import LATENCY_LIMIT, TOLERANCE
from granite_lab.logs.trial import TrialInfo
from granite_lab.options import Options
from granite_lab.parameters.changes import checked
from granite_lab.parameters.course import DriveBy
from granite_lab.running import Cache, Execution

Logs = str | Path | Sequence[str | Path]
"""Paths of logs, or of folders with logs."""

File = str | Path | None
"""Path, or for robots, soils and column maps a name of the catalogue."""

Window = tuple[float, float] | None
"""Begin and end of the part to use of every log [s, the log's time], infinite where open."""

Topics = Mapping[str, str] | None
"""Of bags, ``imu``, ``joints`` and ``odom`` to the name of a topic."""


Changes = Mapping[str, float] | None
"""Numbers in place of those of robot and soil, by the keys of their files, ``robot.wheels.radius_m``."""

Exclude = Mapping[str, str] | None
"""Trials that are left out, by the names of their logs without the ending, and why."""

Rests = Sequence[tuple[float, float]]
"""Intervals of standstill (start, end) [s, the log's time]."""


STANDSTILLS = ("rests", "body_rests")
"""Arguments that name intervals of standstill."""


def text(given: File) -> str | None:
    """Return a name or a path as text."""
    return None if given is None else str(given)


def path(given: File) -> Path | None:
    """Return a path."""
    return None if given is None else Path(given)


def options_of(said: Mapping[str, Any]) -> Options:
    """Return what a verb was told of logs and trials as a record.

    Args:
        said: arguments by their names, such as the `locals()` of a verb that has just begun; those that say
            nothing of logs are passed over.

    Raises:
        UsageError: nothing drives like that, or a std is not above zero.
        InputError: as `parameters.changes.checked`.
    """
    drive, known_drives = said.get("drive", "auto"), get_args(DriveBy)
    if drive not in known_drives:
        raise UsageError(f"--drive {drive}: not known", f"one of: {', '.join(known_drives)}")
    stds: dict[str, Any] = {name: said.get(name) for name in ("ref_v_std", "ref_x_std")}
    for name, std in stds.items():
        refuse_outside(name.replace("_", "-"), std, 1e-6)
    tape = said.get("distance_measured") or Estimate(math.nan)
    rests: dict[str, Any] = {
        name: tuple((float(a), float(b)) for a, b in said.get(name) or ()) for name in STANDSTILLS
    }
    info = TrialInfo(
        **rests, **stds,
        distance_measured=tape.value if math.isfinite(tape.value) else None,
        distance_measured_std=tape.std if math.isfinite(tape.std) else None,
        use_reference=bool(said.get("use_reference")), changes=checked(said.get("changes") or {}),
    )  # fmt: skip
    return Options(
        text(said.get("robot")), text(said.get("soil")), text(said.get("column_map")), rows=said.get("rows"),
        model=path(said.get("model")), effects=path(said.get("effects")), drive=drive,
        info=None if info == TrialInfo() else info, topics=tuple((said.get("topics") or {}).items()),
        window=said.get("window"), exclude=tuple((said.get("exclude") or {}).items()),
        tolerance=said.get("tolerance", TOLERANCE), latency=said.get("latency", LATENCY_LIMIT),
    )  # fmt: skip


def refuse_outside(name: str, value: float | None, low: float, high: float = math.inf) -> None:
    """Raise a UsageError for the number of an option that is out of its limits; None is in any."""
    if value is not None and not low <= value <= high:
        limits = f"{low:g} to {high:g}" if high < math.inf else f"{low:g} or more"
        raise UsageError(f"--{name} {value:g} is out of range", f"expected a number of {limits}")


def execution_of(jobs: int, scheduler: str | None = None, *, cache: bool = False) -> Execution:
    """Return how work over trials is done; raise a UsageError for a negative number of processes."""
    refuse_outside("jobs", jobs, 0)
    return Execution(jobs, scheduler, Cache() if cache else None)
