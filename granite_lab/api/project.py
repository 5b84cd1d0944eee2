"""Choice of trials, and their metadata from options and from `granite-lab.toml` beside the logs."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any

from granite_lab.api.arguments import Logs
from granite_lab.effects import library
from granite_lab.effects.model_file import load_model
from granite_lab.errors import InputError, UsageError, nearest
from granite_lab.files import refuse_special, sha256
from granite_lab.logs.trial import Stated, TrialInfo, is_log, name_of, over, trial_files
from granite_lab.options import Options
from granite_lab.origin import EXCLUDED, Failure
from granite_lab.parameters.catalogue import clear_cache, find, load_robot, load_soil
from granite_lab.parameters.quantity import build, quantity, read_toml

FILE = "granite-lab.toml"


@dataclass(frozen=True)
class Excluded:
    """A trial that is left out, by the name of its log without the ending, and why."""

    trial: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class OfTrial(Stated):
    """Metadata of one trial, which is named by its log without the ending."""

    name: str


@dataclass(frozen=True)
class Project:
    """Content of the file. A relative path starts at the file's folder; an empty text stands for no entry.

    It holds for the logs in its folder, and for those that it names if it lies where a command is run.

    Attributes:
        robot, soil, map: names of the catalogue or .toml files.
        out: folder in which each command makes its own folder of results.
        exclude: trials that are left out.
        logs: paths of logs, or of folders with logs.
        use_reference, ref_v_std, ref_x_std: as in `TrialInfo`, for all trials.
        trial: metadata of single trials.
    """

    robot: str = ""
    soil: str = ""
    map: str = ""
    out: str = ""
    exclude: tuple[Excluded, ...] = ()
    logs: tuple[str, ...] = ()
    use_reference: bool = False
    ref_v_std: float | None = quantity("m/s", 1e-6, 10, "std of the reference's velocity", "", None)
    ref_x_std: float | None = quantity("m", 1e-6, 100, "std of the reference's position", "", None)
    trial: tuple[OfTrial, ...] = ()

    def info_of(self, name: str) -> TrialInfo:
        """Return the metadata of a trial."""
        of_trial = next((entry.info for entry in self.trial if entry.name == name), TrialInfo())
        common = TrialInfo(
            use_reference=self.use_reference, ref_v_std=self.ref_v_std, ref_x_std=self.ref_x_std
        )
        return over(of_trial, common)


@dataclass(frozen=True)
class Chosen:
    """Logs to analyse, options for all of them, and the trials that are left out."""

    files: tuple[Path, ...]
    options: Options
    excluded: tuple[Failure, ...]


def project_in(folder: Path) -> Project:
    """Return the project of a folder, with full paths; an empty one where there is no file.

    Raises:
        InputError: unknown key, robot, soil or map; no such log; an excluded trial that is not there or lacks
            a reason.
    """
    path = folder / FILE
    if not path.is_file():
        return Project()
    read = build(Project, read_toml(path), str(path))
    named: dict[str, Any] = {}
    for key, kind in (("robot", "robots"), ("soil", "soils"), ("map", "loggers")):
        text = getattr(read, key)
        if not text:
            continue
        try:
            file = find(kind, text)
        except UsageError as error:
            raise InputError(f"{path}: {key} = '{text}': {error.message}", error.hint) from None
        is_path = text.endswith(".toml") or "/" in text
        named[key] = str(folder / file) if is_path else text
        if is_path and not (folder / file).is_file():
            raise InputError(f"{path}: {key} = '{text}': no such file", f"paths start at {folder}")
    for text in read.logs:
        if not (folder / text).exists():
            raise InputError(f"{path}: logs: '{text}': does not exist", f"paths start at {folder}")
    named_too = tuple(str(folder / text) for text in read.logs)
    logs = [name_of(log) for log in _logs_of(folder, named_too)]
    mentioned = [(f"[exclude.{i}]: trial", item.trial) for i, item in enumerate(read.exclude, 1)]
    mentioned += [(f"[trial.{i}]: name", item.name) for i, item in enumerate(read.trial, 1)]
    for where, name in mentioned:
        if name not in logs:
            raise InputError(f"{path}: {where} = '{name}': no such log in this folder", _meant(name, logs))
    for i, item in enumerate(read.exclude, 1):
        if not item.reason.strip():
            raise InputError(f"{path}: [exclude.{i}]: reason is empty", "say why the trial is left out")
    out = str(folder / read.out) if read.out else ""
    return replace(read, **named, out=out, logs=named_too)


def _meant(name: str, logs: Sequence[str]) -> str:
    """Return the hint for a name that none of the logs has."""
    return nearest(name, logs) or "write the log's name without its ending"


def _logs_of(folder: Path, named: Sequence[str]) -> list[Path]:
    """Return the logs in a folder of a project, and those that its file names."""
    beside = [log for log in sorted(folder.iterdir()) if is_log(log)]
    return [*beside, *(trial_files(named) if named else ())]


def named_logs(folder: Path) -> tuple[Path, ...]:
    """Return the logs that the file of a folder names, else those beside it; no logs where there is no file.

    Raises:
        InputError, UsageError: the file is wrong, or a folder that it names holds no log.
    """
    project = project_in(folder)
    if project.logs:
        return tuple(trial_files(project.logs))
    return tuple(_logs_of(folder, ())) if (folder / FILE).is_file() else ()


def _projects_of(files: Sequence[Path]) -> dict[Path, tuple[Path, Project]]:
    """Return for each log the project that holds for it, behind the folder in which its file lies."""
    if files and not any(map(os.path.exists, files)):
        refuse_special(files[0])  # raises an error with the reason
    working = Path()
    project = project_in(working)
    listed = {path.resolve() for path in (trial_files(project.logs) if project.logs else ())}
    beside = {folder: project_in(folder) for folder in dict.fromkeys(path.parent for path in files)}
    return {
        path: (working, project)
        if path.resolve() in listed and not (path.parent / FILE).is_file()
        else (path.parent, beside[path.parent])
        for path in files
    }


def choose(logs: Logs, options: Options, *, everything: bool = False) -> Chosen:
    """Choose the trials and complete the options by the projects' files; an option overrides a file.

    Args:
        logs: paths of logs, or of folders with logs.
        options: as given.
        everything: include trials that are excluded.

    Raises:
        UsageError: no log, all of them excluded, files of several folders that disagree, or a name that is
            not known.
        InputError: no log is there, or a file of robot, soil, map, model or effects is wrong.
    """
    clear_cache()
    files = trial_files(logs)
    project_of = _projects_of(files)
    projects = dict(project_of.values())
    infos = [(str(path), project.info_of(name_of(path))) for path, (_, project) in project_of.items()]
    options = replace(
        options,
        of_trials=tuple((path, info) for path, info in infos if info != TrialInfo()),
        robot=_agreed(projects, "robot", options.robot),
        soil=_agreed(projects, "soil", options.soil),
        column_map=_agreed(projects, "map", options.column_map),
    )
    reasons = {} if everything else _reasons(project_of, dict(options.exclude))
    taken = tuple(path for path in files if path not in reasons)
    excluded = tuple(Failure(name_of(path), f"{EXCLUDED}{reason}") for path, reason in reasons.items())
    if not taken:
        where = "--exclude" if options.exclude else project_of[files[0]][0] / FILE
        raise UsageError(
            f"{where}: excludes {'all trials' if len(files) > 1 else files[0].name}",
            f"reason given: {excluded[0].reason}",
        )
    # Each named file is read once here, so that a wrong one ends the command before any work.
    changes = options.info.changes if options.info else ()
    load_robot(options.robot or "granite", changes=changes)
    load_soil(options.soil or "dry_sand", changes)
    if options.column_map:
        from granite_lab.logs.layouts import given_maps  # noqa: PLC0415, heavy

        given_maps(options.column_map)
    if options.effects:
        library(options.effects)
    if options.model:
        load_model(options.model, options.effects)
    return Chosen(taken, options, excluded)


def _reasons(project_of: Mapping[Path, tuple[Path, Project]], given: Mapping[str, str]) -> dict[Path, str]:
    """Return the logs that are left out, with the reason; a reason by an option replaces that of the file.

    Raises:
        UsageError: a trial that is given is none of the logs, or lacks a reason.
    """
    names = [name_of(path) for path in project_of]
    for trial, reason in given.items():
        if trial not in names:
            raise UsageError(f"--exclude {trial}: no such log", _meant(trial, names))
        if not reason.strip():
            raise UsageError(f"--exclude {trial}: the reason is empty", "say why the trial is left out")
    reasons_of = {
        path: {item.trial: item.reason for item in project.exclude} | dict(given)
        for path, (_, project) in project_of.items()
    }
    return {path: reasons[name_of(path)] for path, reasons in reasons_of.items() if name_of(path) in reasons}


def results_folder(logs: Logs, name: str) -> Path:
    """Return the folder of that name in which a command writes: in the project's folder of results.

    Where a report of other logs stands there, its name is numbered, so that none overwrites another.

    Raises:
        UsageError, InputError: as of `choose`.
    """
    files = trial_files(logs)
    place = Path(_agreed(dict(_projects_of(files).values()), "out", None) or "reports")
    numbered = (place / (name if k == 1 else f"{name}-{k}") for k in count(1))
    return next(folder for folder in numbered if not _of_others(folder, files))


def _of_others(folder: Path, files: Sequence[Path]) -> bool:
    """Say whether a folder holds a report of a study to which none of the logs went in."""
    try:
        inputs = json.loads((folder / "report.json").read_bytes())["provenance"]["inputs"]
        hashes = {str(entry["sha256"]) for entry in inputs}
        return bool(hashes) and all(path.is_file() and sha256(path) not in hashes for path in files)
    except (OSError, ValueError, KeyError, TypeError):  # no report, or not one of a study
        return False


def _agreed(projects: Mapping[Path, Project], key: str, given: str | None) -> str | None:
    """Return the option, else the entry of all projects; raise a UsageError where these differ."""
    values = {getattr(project, key): folder for folder, project in projects.items()}
    if given is None and len(values) > 1:
        raise UsageError(
            f"{' and '.join(str(folder / FILE) for folder in values.values())}: not the same {key}",
            f"give --{key}, or logs of one folder",
        )
    return given if given is not None else next(iter(values)) or None
