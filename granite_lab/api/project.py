"""`granite-lab.toml` beside the logs: what holds for all trials there, and which are left out."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from granite_lab.errors import InputError, UsageError
from granite_lab.logs.named import is_log, name_of, trial_files
from granite_lab.parameters.catalogue import find, forget
from granite_lab.parameters.quantity import build, read_toml

FILE = "granite-lab.toml"


@dataclass(frozen=True)
class Excluded:
    """A trial that is left out.

    Attributes:
        trial: its name, that of the log without the ending.
        reason: why, one sentence.
    """

    trial: str
    reason: str


@dataclass(frozen=True)
class Project:
    """What the file says. A relative path starts at the file's folder; an empty text says nothing.

    Attributes:
        robot, soil, map: names of the catalogue or .toml files.
        out: folder in which each command makes its own folder of results.
        exclude: trials that are left out.
    """

    robot: str = ""
    soil: str = ""
    map: str = ""
    out: str = ""
    exclude: tuple[Excluded, ...] = ()


@dataclass(frozen=True)
class Chosen:
    """Trials, and what is said about all of them.

    Attributes:
        files: the logs that are taken.
        robot, soil, column_map: names or files; None leaves it to the log and the catalogue.
        out: folder for folders of results.
        left_out: trials that are excluded.
    """

    files: tuple[Path, ...]
    robot: str | None
    soil: str | None
    column_map: str | None
    out: Path = Path("reports")
    left_out: tuple[Excluded, ...] = ()


def project_in(folder: Path) -> Project:
    """Return what the file of a folder says, with full paths; nothing where there is no file.

    Raises:
        InputError: unknown key, robot, soil or map; an excluded trial that is not there or has no reason.
    """
    path = folder / FILE
    if not path.is_file():
        return Project()
    read = build(Project, read_toml(path), str(path))
    named: dict[str, str] = {}
    for key, kind in (("robot", "robots"), ("soil", "soils"), ("map", "loggers")):
        text = getattr(read, key)
        if not text:
            continue
        try:
            file = find(kind, text)
        except UsageError as error:
            raise InputError(f"{path}: {key} = '{text}': {error.message}", error.hint) from None
        own = text.endswith(".toml") or "/" in text
        named[key] = str(folder / file) if own else text
        if own and not (folder / file).is_file():
            raise InputError(f"{path}: {key} = '{text}': no such file", f"paths start at {folder}")
    logs = [name_of(log) for log in folder.iterdir() if is_log(log)]
    for i, item in enumerate(read.exclude, 1):
        if item.trial not in logs:
            close = difflib.get_close_matches(item.trial, logs, n=1)
            raise InputError(
                f"{path}: [exclude.{i}]: trial = '{item.trial}': no such log in this folder",
                f"did you mean '{close[0]}'?" if close else "write the log's name without its ending",
            )
        if not item.reason.strip():
            raise InputError(f"{path}: [exclude.{i}]: reason is empty", "say why the trial is left out")
    return Project(**named, out=str(folder / read.out) if read.out else "", exclude=read.exclude)


def choose(
    logs: str | Path | Sequence[str | Path],
    robot: str | Path | None = None,
    soil: str | Path | None = None,
    column_map: str | Path | None = None,
    *,
    everything: bool = False,
) -> Chosen:
    """Return which trials are taken and what is said about them; what is given wins over the file.

    Args:
        logs: paths of logs, or of folders with logs.
        robot, soil, column_map: as given.
        everything: take trials that are excluded, too.

    Raises:
        UsageError: no log, all of them excluded, or files of several folders that disagree.
        InputError: the file beside the logs is wrong.
    """
    forget()
    files = trial_files(logs)
    projects = {folder: project_in(folder) for folder in dict.fromkeys(path.parent for path in files)}
    given = {"robot": robot, "soil": soil, "map": column_map, "out": None}
    said: dict[str, str | None] = {key: None if value is None else str(value) for key, value in given.items()}
    for key, value in given.items():
        if value is not None:
            continue
        values = {getattr(project, key): folder for folder, project in projects.items()}
        if len(values) > 1:
            raise UsageError(
                f"{' and '.join(str(folder / FILE) for folder in values.values())}: not the same {key}",
                f"give --{key}, or logs of one folder",
            )
        said[key] = next(iter(values)) or None
    reasons = {(folder, e.trial): e for folder, p in projects.items() for e in p.exclude if not everything}
    taken = tuple(path for path in files if (path.parent, name_of(path)) not in reasons)
    left_out = tuple(reasons[path.parent, name_of(path)] for path in files if path not in taken)
    if not taken:
        raise UsageError(
            f"{files[0].parent / FILE}: excludes {'all trials' if len(files) > 1 else files[0].name}",
            f"reason given: {left_out[0].reason}",
        )
    out = Path(said["out"] or "reports")
    return Chosen(taken, said["robot"], said["soil"], said["map"], out, left_out)
