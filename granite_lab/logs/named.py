"""Which files are trials: what a user names, or what lies in a folder."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from granite_lab.errors import UsageError
from granite_lab.files import is_folder
from granite_lab.logs.quantities import WORDS

BAGS = (".bag", ".mcap", ".db3")
"""File name endings of recordings by ROS."""

_TABLES = (".csv", ".csv.gz", ".csv.zip", ".mat")


def is_bag(path: Path) -> bool:
    """Say whether a path is a recording by ROS: a file, or the folder of a ROS 2 recording."""
    return path.suffix.lower() in BAGS if not is_folder(path) else (path / "metadata.yaml").is_file()


def is_packed(path: Path) -> bool:
    """Say whether a file is a compressed table: ``.csv.gz`` or ``.csv.zip``."""
    return path.name.lower().endswith((".csv.gz", ".csv.zip"))


def is_log(path: Path) -> bool:
    """Say whether a path in a folder of trials is one of them."""
    if is_folder(path):
        return is_bag(path) or bool(parts_of(path))
    return is_bag(path) or path.name.lower().endswith(_TABLES)


def parts_of(folder: Path) -> list[Path]:
    """Return the files of a folder that holds one trial, a file a sensor; none if it is no such folder.

    Every table in it is called after a sensor, as ``imu.csv`` and ``WheelEncoders.csv``.
    """
    if not is_folder(folder) or is_bag(folder):
        return []
    try:
        tables = sorted(path for path in folder.iterdir() if path.name.lower().endswith(_TABLES))
    except OSError:  # it may not be searched
        return []
    parts, others = [], 0
    for path in tables:
        spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name_of(path)).lower()
        words = set(re.findall(r"[a-z]+|[^\W_a-z]+", spaced)) - WORDS["file_filler"]
        if words and words <= WORDS["sensor_file"]:
            parts.append(path)
        others += bool(words) and words <= WORDS["other_file"]
    return parts if len(parts) > 1 and len(parts) + others == len(tables) else []


def name_of(path: Path) -> str:
    """Return the name of a trial: its file's without the ending, or its folder's."""
    return path.name if is_folder(path) else (path.with_suffix("") if is_packed(path) else path).stem


def sidecar(log: Path) -> Path:
    """Return where metadata of a log may stand beside it: ``trial.toml`` for ``trial.csv.gz``."""
    return log.parent / f"{name_of(log)}.toml"


def trial_files(paths: Sequence[str | Path] | str | Path) -> list[Path]:
    """Return the logs that were named; a folder stands for the logs in it.

    Logs are CSV files (``.csv.gz`` and ``.csv.zip``, too), MATLAB files (``.mat``), ROS 1 bags (``.bag``),
    MCAP files, folders of ROS 2 recordings, and folders with a file a sensor (`parts_of`).

    Raises:
        UsageError: nothing was named, a folder holds no log, or two logs have one name.
    """
    named = [Path(paths)] if isinstance(paths, (str, Path)) else [Path(path) for path in paths]
    if not named:
        raise UsageError("no trials given", "name one or more logs, or a folder of them")
    files: list[Path] = []
    for path in named:
        if not is_folder(path) or is_log(path):
            files.append(path)
            continue
        found = sorted(log for log in path.iterdir() if is_log(log))
        if not found:
            raise UsageError(
                f"{path}: the folder holds no log (.csv, .mat, .bag, .mcap)", "name the logs themselves"
            )
        plain = {name_of(log) for log in found if not is_packed(log)}
        files += [log for log in found if not (is_packed(log) and name_of(log) in plain)]
    unique = list(dict.fromkeys(files))
    names = [name_of(path) for path in unique]
    for name in names:
        if names.count(name) > 1:
            raise UsageError(
                f"two logs are called '{name}'", "rename one: results carry the name of their log"
            )
    return unique
