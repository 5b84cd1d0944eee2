"""Which files are trials: what a user names, or what lies in a folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from granite_lab.errors import UsageError
from granite_lab.files import is_folder

BAGS = (".bag", ".mcap", ".db3")
"""File name endings of recordings by ROS."""


def is_bag(path: Path) -> bool:
    """Say whether a path is a recording by ROS: a file, or the folder of a ROS 2 recording."""
    return path.suffix.lower() in BAGS if not is_folder(path) else (path / "metadata.yaml").is_file()


def name_of(path: Path) -> str:
    """Return the name of a trial: its file's without the ending, or its folder's."""
    return path.name if is_folder(path) else (path.with_suffix("") if is_packed(path) else path).stem


def is_packed(path: Path) -> bool:
    """Say whether a file is a compressed table: ``.csv.gz`` or ``.csv.zip``."""
    return path.name.lower().endswith((".csv.gz", ".csv.zip"))


def sidecar(log: Path) -> Path:
    """Return where metadata of a log may stand beside it: ``trial.toml`` for ``trial.csv.gz``."""
    return (log.with_suffix("") if is_packed(log) else log).with_suffix(".toml")


def _logs_in(folder: Path) -> list[Path]:
    """Return the logs in a folder; of one that also lies there compressed, only the plain file."""
    plain = [*folder.glob("*.csv"), *(p for p in folder.iterdir() if is_bag(p))]
    names = {name_of(path) for path in plain}
    packed = [p for p in folder.iterdir() if is_packed(p) and name_of(p) not in names]
    return sorted([*plain, *packed])


def trial_files(paths: Sequence[str | Path] | str | Path) -> list[Path]:
    """Return the logs that were named; a folder stands for the logs in it.

    Logs are CSV files (``.csv.gz`` and ``.csv.zip``, too), ROS 1 bags (``.bag``), MCAP files, and
    folders of ROS 2 recordings.

    Raises:
        UsageError: nothing was named, a folder holds no log, or two logs have one name.
    """
    named = [Path(paths)] if isinstance(paths, (str, Path)) else [Path(path) for path in paths]
    if not named:
        raise UsageError("no trials given", "name one or more logs, or a folder of them")
    files: list[Path] = []
    for path in named:
        if is_folder(path) and not is_bag(path):
            found = _logs_in(path)
            if not found:
                raise UsageError(
                    f"{path}: the folder holds no log (.csv, .bag, .mcap)", "name the logs themselves"
                )
            files += found
        else:
            files.append(path)
    unique = list(dict.fromkeys(files))
    names = [name_of(path) for path in unique]
    for name in names:
        if names.count(name) > 1:
            raise UsageError(
                f"two logs are called '{name}'", "rename one: results carry the name of their log"
            )
    return unique
