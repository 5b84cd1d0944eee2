"""`discover`: where model and trials disagree, and which effect is missing."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from granite_lab import __version__
from granite_lab.api.options import options_of
from granite_lab.api.records import all_good
from granite_lab.discovery import Finding
from granite_lab.effects import library, load_effects
from granite_lab.estimation.motion import Motion
from granite_lab.logs.named import trial_files
from granite_lab.logs.trial import Trial
from granite_lab.parameters.catalogue import in_force
from granite_lab.reporting.content import Source
from granite_lab.running import Execution, Options
from granite_lab.running.fingerprint import code
from granite_lab.running.folder import claimed
from granite_lab.running.reading import to_search
from granite_lab.running.search import names_of, save_found, search

Logs = str | Path | Sequence[str | Path]


def discover(
    logs: Logs,
    *,
    robot: str | Path | None = None,
    soil: str | Path | None = None,
    column_map: str | Path | None = None,
    topics: Mapping[str, str] | None = None,
    effects: str | Path | None = None,
    out: str | Path | None = None,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[str, int], None] = lambda *_: None,
) -> Finding:
    """Find the physical effect that the model lacks.

    Args:
        logs: paths of logs, or of folders with logs; all of one robot on one soil.
        robot, soil: names or files; without them the first log says which.
        column_map: name or file of a column map.
        topics: of bags, ``imu``, ``joints`` and ``odom`` to the name of a topic.
        effects: your own effect file (.py), whose effects become candidates beside the library's.
            It is run: use only code you trust.
        out: folder for the report, finding.json, design.json (for `plan_next`) and model.toml; without it
            nothing is written.
        seed: of the bootstrap that sets the thresholds.
        jobs: number of processes; 0 means one per core.
        progress: told what is being done and how many simulations are done so far.

    Returns:
        the finding; its table has a row for each candidate.

    Raises:
        InputError: a log cannot be used, or nothing says what was commanded.
        EstimateError: a trial has no sensor to compare with, or the simulation fails.
    """
    options = options_of(robot=robot, soil=soil, column_map=column_map, topics=topics, effects=effects)
    files = trial_files(logs)
    execution = Execution(jobs)
    trials, motions = split(all_good(to_search(files, options, execution)))
    finding = search(trials, options, motions=motions, seed=seed, execution=execution, progress=progress)
    if out is not None:
        from granite_lab.reporting import write_discovery  # noqa: PLC0415, heavy

        folder = Path(out)
        known = library() | (load_effects(Path(effects)) if effects else {})
        with claimed(folder):
            save_found(finding, options, trials, folder / "model.toml", motions)
            source = source_of(files, trials, options, seed)
            write_discovery(finding, folder, source, model=folder / "model.toml", effects=known, jobs=jobs)
    return finding


def split(read: Sequence[tuple[Trial, Motion | None]]) -> tuple[list[Trial], list[Motion] | None]:
    """Return trials, and their estimates where all have one."""
    motions = [motion for _, motion in read if motion is not None]
    return [trial for trial, _ in read], motions if len(motions) == len(read) else None


def source_of(files: Sequence[Path], trials: Sequence[Trial], options: Options, seed: int) -> Source:
    """Return where a finding comes from: command, inputs, parameters and code."""
    rows = in_force(*names_of(trials, options))
    given = (*options.given(), *((("seed", str(seed)),) if seed else ()))
    return Source(
        version=__version__,
        command=" ".join(["granite-lab discover", *map(str, files), *(f"--{k} {v}" for k, v in given)]),
        inputs=tuple(file for trial in trials for file in trial.inputs),
        parameters=tuple((f"{p.group}.{p.key}", f"{p.value:g}", p.unit, p.origin) for p in rows),
        options=given,
        code=code(search=True),
    )
