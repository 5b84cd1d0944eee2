"""`discover`, which effect the model lacks, and `plan_next`, the trial that would tell."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Unpack

from granite_lab.api.calls import Arg, checked
from granite_lab.api.project import Logs, Search, choose
from granite_lab.api.records import Origin, Studied
from granite_lab.discovery.finding import DESIGN, Finding
from granite_lab.errors import InputError
from granite_lab.files import refuse_special
from granite_lab.reporting.content import StudyResult
from granite_lab.running import each_trial, sifted
from granite_lab.running.output import claimed

if TYPE_CHECKING:
    from granite_lab.planning.plan import Plan


@checked
def discovered(logs: Logs, *, out: str | Path | None = None, **said: Unpack[Search]) -> Studied:
    """Run `discover`, and say what was written; it is a study without trials."""
    choice, progress = choose(logs, said), said["progress"]
    from granite_lab.running.reading import corrected  # noqa: PLC0415, heavy
    from granite_lab.running.search import search  # noqa: PLC0415, heavy
    from granite_lab.study import source_of, write  # noqa: PLC0415, heavy

    execution, options = choice.execution, choice.options
    outcomes = each_trial(corrected, choice.files, options, execution=execution)
    read, failed = sifted(choice.files, outcomes, strict=said["strict"])
    left_out = (*choice.excluded, *failed)
    trials, motions = [trial for trial, _ in read], [motion for _, motion in read]
    finding = search(trials, options, motions=motions, execution=execution, progress=progress)
    notes = (*finding.notes, *(f"{one.trial} left out: {one.message}" for one in left_out))
    source, name = source_of("discover", choice.files, trials, options), Path(out or "").resolve().name
    result, written = StudyResult(name, (), (), None, source, replace(finding, notes=notes)), None
    if out is not None:
        progress("writing the report", 0)
        with claimed(Path(out)):
            written = write(result, options, Path(out), read)
        result = replace(result, finding=written.finding or result.finding)
    lines = (f"{trial.name}: {line}" for trial in trials for line in trial.warnings)
    return Studied(result, Origin(source, left_out, (*lines, *execution.tidied())), written)


@checked
def discover(logs: Logs, *, out: str | Path | None = None, **said: Unpack[Search]) -> Finding:
    """Find the physical effect that the model lacks.

    Args:
        logs: paths of logs, or of folders with logs; all of one robot on one soil.
        out: folder for the report, finding.json, design.json (for `plan_next`) and model.toml; without it
            nothing is written.

    Returns:
        the finding; its table has a row for each candidate. Its `failures` say what could not be written.

    Raises:
        InputError: a log cannot be used, or nothing says what was commanded.
        EstimateError: a trial has no sensor to compare with, or the simulation fails.
    """
    finding = discovered(logs, out=out, **said).result.finding
    assert finding is not None
    return finding


@checked
def plan_next(
    folder: str | Path,
    *,
    room: Annotated[float | None, Arg(low=0.1)] = None,
    max_speed: Annotated[float | None, Arg(low=0.02)] = None,
    effects: str | Path | None = None,
    jobs: Annotated[int, Arg(low=0)] = 0,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> Plan:
    """Propose the most useful next trial.

    Args:
        folder: folder written by `discover` or `study`.
        room: longest way the sand allows [m]; the longest so far by default.
        max_speed: fastest command [m/s]; 1.25 times the fastest so far by default.
        effects: your own effect file (.py). It is executed: use only code you trust.
        jobs: number of processes; 0 means one per core.
        progress: told how many trials are looked at, and of how many.

    Returns:
        the proposals; the table has a row for each.

    Raises:
        InputError: the folder holds no search.
        UsageError: a named effect is neither in the library nor in the effect file.
        EstimateError: the trials at hand cannot be simulated.
    """
    refuse_special(Path(folder))
    path = Path(folder) / DESIGN
    if not path.is_file():
        raise InputError(
            f"{folder}: holds no search for a missing effect ('{DESIGN}' is missing)",
            f"run 'granite-lab discover TRIALS… --out {folder}', or 'study' without --no-discover, first",
        )
    from granite_lab.effects import library  # noqa: PLC0415, heavy
    from granite_lab.planning.design import load_design  # noqa: PLC0415, heavy
    from granite_lab.planning.plan import plan_next as rank  # noqa: PLC0415, heavy

    return rank(
        load_design(path), library(effects),
        room=room, max_speed=max_speed, jobs=jobs or os.cpu_count() or 1, progress=progress,
    )  # fmt: skip
