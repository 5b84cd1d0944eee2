"""`discover`: where model and trials disagree, and which effect is missing."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from granite_lab import __version__
from granite_lab.api.calls import checked
from granite_lab.api.options import execution_of, options_of
from granite_lab.api.project import Chosen, choose
from granite_lab.api.records import sifted
from granite_lab.discovery.finding import Finding
from granite_lab.effects import library, load_effects
from granite_lab.estimation.motion import Motion
from granite_lab.inference.constants import LATENCY_LIMIT, TOLERANCE
from granite_lab.logs.trial import Trial
from granite_lab.parameters.catalogue import in_force
from granite_lab.reporting.content import Source, command_of
from granite_lab.running import Options
from granite_lab.running.fingerprint import code
from granite_lab.running.folder import claimed
from granite_lab.running.guard import Guard
from granite_lab.running.reading import to_search
from granite_lab.running.search import names_of, save_found, search

Logs = str | Path | Sequence[str | Path]


@checked
def discover(
    logs: Logs,
    *,
    robot: str | Path | None = None,
    soil: str | Path | None = None,
    column_map: str | Path | None = None,
    topics: Mapping[str, str] | None = None,
    window: tuple[float, float] | None = None,
    effects: str | Path | None = None,
    out: str | Path | None = None,
    tolerance: float = TOLERANCE,
    latency: float = LATENCY_LIMIT,
    strict: bool = False,
    jobs: int = 0,
    scheduler: str | None = None,
    cache: bool = True,
    progress: Callable[[str, int], None] = lambda *_: None,
) -> Finding:
    """Find the physical effect that the model lacks.

    Args:
        logs: paths of logs, or of folders with logs; all of one robot on one soil.
        robot, soil: names or files; without them the first log says which.
        column_map: name or file of a column map.
        topics: of bags, ``imu``, ``joints`` and ``odom`` to the name of a topic.
        window: begin and end of what is taken of every log [s of the log], infinite where open.
        effects: your own effect file (.py), whose effects become candidates beside the library's.
            It is run: use only code you trust.
        out: folder for the report, finding.json, design.json (for `plan_next`) and model.toml; without it
            nothing is written.
        tolerance: discrepancy that does not matter, as a share of a channel's rms in motion.
        latency: largest delay between the stamps of two sensors that passes for latency [s].
        strict: a log that cannot be used is an error; else it is left out and stands in `notes`.
        jobs: number of processes; 0 means one per core.
        scheduler: address of a Dask scheduler that does the work.
        cache: remember results, and take those that still hold.
        progress: told what is being done and how many simulations are done so far.

    Returns:
        the finding; its table has a row for each candidate. Its `failures` say what could not be written.

    Raises:
        InputError: a log cannot be used, or nothing says what was commanded.
        EstimateError: a trial has no sensor to compare with, or the simulation fails.
    """
    choice = choose(logs, robot, soil, column_map)
    options = options_of(
        robot=choice.robot, soil=choice.soil, column_map=choice.column_map, topics=topics,
        effects=effects, tolerance=tolerance, latency=latency, window=window,
    )  # fmt: skip
    files = choice.files
    execution = execution_of(jobs, scheduler, cache)
    read, failed = sifted(files, to_search(files, options, execution), strict=strict)
    trials, motions = [trial for trial, _ in read], [motion for _, motion in read]
    finding = search(trials, options, motions=motions, execution=execution, progress=progress)
    finding = with_left_out(finding, choice, failed)
    if out is not None:
        with claimed(Path(out)):
            finding = write_found(finding, options, trials, motions, Path(out), files, jobs).finding
    return finding


def with_left_out(finding: Finding, choice: Chosen, failed: Sequence[tuple[str, str]] = ()) -> Finding:
    """Return a finding whose notes also list trials that are excluded or failed, with the reason."""
    left_out = (*((item.trial, f"excluded: {item.reason}") for item in choice.left_out), *failed)
    return replace(finding, notes=(*finding.notes, *(f"{name} left out: {why}" for name, why in left_out)))


class Written(NamedTuple):
    """What `write_found` wrote: the finding, first page and model file, None where one failed."""

    finding: Finding
    page: Path | None
    model: Path | None


def write_found(
    finding: Finding,
    options: Options,
    trials: Sequence[Trial],
    motions: Sequence[Motion],
    folder: Path,
    files: Sequence[Path],
    jobs: int,
) -> Written:
    """Write model, design and report; what fails costs nothing of the others.

    Args:
        finding: of a search.
        options: of it.
        trials, motions: that were searched.
        folder: to write into.
        files: the logs.
        jobs: number of processes that draw.

    Returns:
        the finding, with what could not be written among its `failures`, and the paths.
    """
    from granite_lab.reporting import write_discovery, write_finding  # noqa: PLC0415, heavy

    known = library() | (load_effects(options.effects) if options.effects else {})
    guard = Guard(folder)
    model = save_found(finding, options, trials, motions, guard)

    def told() -> Finding:
        return replace(finding, failures=(*finding.failures, *guard.lines))

    source = source_of(files, trials, options)
    page = guard.run(
        "report",
        lambda: write_discovery(told(), folder, source, model=model, effects=known, jobs=jobs),
    )
    if page is None:
        guard.run("finding", lambda: write_finding(told(), folder, model))
    return Written(told(), page, model)


def source_of(files: Sequence[Path], trials: Sequence[Trial], options: Options) -> Source:
    """Return where a finding comes from: command, inputs, parameters and code."""
    rows = in_force(*names_of(trials, options))
    given = options.given()
    return Source(
        version=__version__,
        command=command_of("discover", files, given),
        inputs=tuple(file for trial in trials for file in trial.inputs),
        parameters=tuple((f"{p.group}.{p.key}", f"{p.value:g}", p.unit, p.origin) for p in rows),
        options=given,
        code=code(search=True),
    )
