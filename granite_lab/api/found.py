"""Where a discovery stands: in what `discover` wrote, or in the report of a study."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from granite_lab.errors import InputError
from granite_lab.reporting.json_report import SCHEMA as REPORT

FILES = ("finding.json", "report.json")
"""Names under which `discover` and `study` write it."""

STUDIES = (REPORT, "granite-lab/study/1")
"""Schemas of documents that hold a discovery among other things."""


def newest_in(folder: Path) -> Path:
    """Return the file with the discovery that was last written into a folder.

    Raises:
        InputError: the folder holds none.
    """
    there = [folder / name for name in FILES if (folder / name).is_file()]
    if not there:
        raise InputError(
            f"{folder}: holds no finding ('finding.json' is missing)",
            f"run 'granite-lab discover TRIALS… --out {folder}' first",
        )
    return max(there, key=lambda path: path.stat().st_mtime)


def finding_in(path: Path, read: Callable[[Path], Mapping[str, Any]]) -> Mapping[str, Any]:
    """Return the document of a discovery, also out of that of a study.

    Args:
        path: the file.
        read: what reads a file that is no study's.

    Raises:
        InputError: the file cannot be read, or is of a study that did not search.
    """
    document = _study(path)
    if document is None:
        return read(path)
    found = document.get("discovery")
    if not isinstance(found, Mapping):
        raise InputError(
            f"{path}: this study did not search for a missing effect",
            "run 'granite-lab study' without --no-discover, or 'granite-lab discover'",
        )
    return found


def _study(path: Path) -> Mapping[str, Any] | None:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    is_study = isinstance(document, dict) and document.get("schema") in STUDIES
    return document if is_study else None
