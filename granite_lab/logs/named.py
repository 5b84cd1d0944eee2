"""Which files are trials: what a user names, or what lies in a folder."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from granite_lab.errors import UsageError
from granite_lab.files import is_folder
from granite_lab.logs.quantities import WORDS

_BAGS = (".bag", ".mcap", ".db3")  # endings of recordings by ROS
_PACKED = (".csv.gz", ".csv.zip")


def is_bag(path: Path) -> bool:
    """Say whether a path is a recording by ROS: a file, or the folder of a ROS 2 recording."""
    return path.suffix.lower() in _BAGS if not is_folder(path) else (path / "metadata.yaml").is_file()


def _is_table(path: Path, endings: tuple[str, ...] = (".csv", ".mat", *_PACKED)) -> bool:
    return path.name.lower().endswith(endings)


def is_log(path: Path) -> bool:
    """Say whether a path in a folder of trials is one of them."""
    return is_bag(path) or (bool(parts_of(path)) if is_folder(path) else _is_table(path))


def parts_of(folder: Path) -> list[Path]:
    """Return the files of a folder that holds one trial, a file a sensor; none if it is no such folder.

    Every table in it is called after a sensor, as ``imu.csv`` and ``WheelEncoders.csv``.
    """
    if not is_folder(folder) or is_bag(folder):
        return []
    try:
        tables = sorted(filter(_is_table, folder.iterdir()))
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
    return path.name if is_folder(path) else (path.with_suffix("") if _is_table(path, _PACKED) else path).stem


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
    named = [Path(path) for path in ([paths] if isinstance(paths, (str, Path)) else paths)]
    if not named:
        raise UsageError("no trials given", "name one or more logs, or a folder of them")
    files: list[Path] = []
    for path in named:
        inside = sorted(filter(is_log, path.iterdir())) if is_folder(path) and not is_log(path) else [path]
        if not inside:
            what = f"{path}: the folder holds no log (.csv, .mat, .bag, .mcap)"
            raise UsageError(what, "name the logs themselves")
        plain = {name_of(log) for log in inside if not _is_table(log, _PACKED)}
        packed = [log for log in inside if _is_table(log, _PACKED)] if path not in inside else []
        files += [log for log in inside if log not in packed or name_of(log) not in plain]
    unique = list(dict.fromkeys(files))
    names = [name_of(path) for path in unique]
    for name in names:
        if names.count(name) > 1:
            hint = "rename one: results carry the name of their log"
            raise UsageError(f"two logs are called '{name}'", hint)
    return unique
