"""Arguments that several functions of the API share: their types, and how they become records."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast, get_args

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


def text(given: File) -> str | None:
    """Return a name or a path as text."""
    return None if given is None else str(given)


def path(given: File) -> Path | None:
    """Return a path."""
    return None if given is None else Path(given)


def options_of(arguments: Mapping[str, Any]) -> Options:
    """Return the options of a verb on logs and trials as a record.

    Args:
        arguments: of the verb, as ``locals()`` has them at its first line; names that `options` lacks are
            ignored.

    Raises:
        UsageError, InputError: as `options`.
    """
    return options(**{name: value for name, value in arguments.items() if name in options.__annotations__})


def options(
    *,
    robot: File = None, soil: File = None, column_map: File = None, topics: Topics = None,
    window: Window = None, changes: Changes = None, rows: str | None = None, exclude: Exclude = None,
    rests: Rests = (), body_rests: Rests = (), distance_measured: Estimate | None = None,
    use_reference: bool = False, ref_v_std: float | None = None, ref_x_std: float | None = None,
    drive: str = "auto", model: File = None, effects: File = None,
    tolerance: float = TOLERANCE, latency: float = LATENCY_LIMIT,
) -> Options:  # fmt: skip
    """Return options on logs and trials as a record; verbs have these arguments, types and defaults.

    Raises:
        UsageError: `drive` is not known, or a std is not above zero.
        InputError: as `parameters.changes.checked`.
    """
    if drive not in (drives := get_args(DriveBy)):
        raise UsageError(f"--drive {drive}: not known", f"one of: {', '.join(drives)}")
    for name, std in (("ref-v-std", ref_v_std), ("ref-x-std", ref_x_std)):
        refuse_outside(name, std, 1e-6)
    tape = distance_measured or Estimate(math.nan)
    info = TrialInfo(
        rests=tuple((float(a), float(b)) for a, b in rests),
        body_rests=tuple((float(a), float(b)) for a, b in body_rests),
        distance_measured=tape.value if math.isfinite(tape.value) else None,
        distance_measured_std=tape.std if math.isfinite(tape.std) else None,
        use_reference=use_reference, ref_v_std=ref_v_std, ref_x_std=ref_x_std,
        changes=checked(changes or {}),
    )  # fmt: skip
    return Options(
        text(robot), text(soil), text(column_map), rows=rows, model=path(model), effects=path(effects),
        info=None if info == TrialInfo() else info, topics=tuple((topics or {}).items()),
        window=window and (window[0], window[1]),
        exclude=tuple((exclude or {}).items()), tolerance=tolerance, latency=latency,
        drive=cast(DriveBy, drive),
    )  # fmt: skip


def refuse_outside(name: str, value: float | None, low: float, high: float = math.inf) -> None:
    """Raise a UsageError where the number of an option is outside its limits; None is accepted."""
    if value is not None and not low <= value <= high:
        limits = f"{low:g} to {high:g}" if high < math.inf else f"{low:g} or more"
        raise UsageError(f"--{name} {value:g} is out of range", f"expected a number of {limits}")


def execution_of(jobs: int, scheduler: str | None = None, *, cache: bool = False) -> Execution:
    """Return where and how trials are processed; raise a UsageError for a negative number of processes."""
    refuse_outside("jobs", jobs, 0)
    return Execution(jobs, scheduler, Cache() if cache else None)
