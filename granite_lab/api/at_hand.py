"""Logs that a command takes where none are named: those of the project, of `ingest`, or the samples.

`ingest` keeps a list of the logs whose motion it has written, beside the tables of motion.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from granite_lab.api.arguments import options_of
from granite_lab.api.project import FILE, named_logs, project_in
from granite_lab.errors import InputError, LabError, UsageError
from granite_lab.estimate import Estimate
from granite_lab.files import read_json, write_text
from granite_lab.logs.trial import name_of, trial_files

LIST, SCHEMA = "ingest.json", "granite-lab/ingested/2"
"""Name and schema of the list beside the tables of motion."""

SAMPLES = Path("data") / "samples"

OF_INGEST_ALONE = ("imu", "encoders", "currents", "reference", "rows", "variant")
"""Keywords of `ingest` that no other verb has."""

OF_WORK = ("logs", "strict", "jobs")
"""Keywords of `ingest` that do not concern a log."""


@dataclass(frozen=True)
class Entry:
    """A log whose motion was written: its path, that of its table, and the keywords given to `ingest`."""

    log: Path
    table: Path
    keywords: Mapping[str, Any]


@dataclass(frozen=True)
class AtHand:
    """Logs that are taken, the keywords that they were ingested with, and a line that names both."""

    logs: tuple[Path, ...]
    keywords: Mapping[str, Any]
    line: str


def logs_at_hand(folder: Path = Path()) -> AtHand:
    """Return the logs that a command takes where none are named.

    These are the logs that ``granite-lab.toml`` in the folder names, or those beside it; else those that
    `ingest` has read, by its lists in the project's folder of results; else the samples.

    Args:
        folder: in which the command is run.

    Raises:
        UsageError: there are none, or `ingest` read them with options that differ or that it alone has.
        InputError: the project's file or a list of `ingest` is wrong, or a log on it is gone.
    """
    if logs := named_logs(folder):
        return AtHand(logs, {}, f"logs: {_counted(logs)}, by {folder / FILE}")
    results = Path(project_in(folder).out or folder / "reports")
    if entries := ingested_in(results):
        logs = tuple(dict.fromkeys(entry.log for entry in entries))
        where = ", ".join(dict.fromkeys(str(entry.table.parent) for entry in entries))
        keywords = _shared(entries)
        given = " ".join(f"--{name} {value}" for name, value in options_of(keywords).given())
        options = f" with {given}" if given else ""
        return AtHand(logs, keywords, f"logs: {_counted(logs)}, ingested{options} ({where})")
    if (folder / SAMPLES).is_dir() and (logs := tuple(trial_files(folder / SAMPLES))):
        return AtHand(logs, {}, f"logs: {_counted(logs)}, samples ({folder / SAMPLES})")
    raise UsageError(
        "no trials given",
        f"name one or more logs, or a folder of them; or name them in {FILE}; or ingest them first",
    )


def _counted(logs: Sequence[Path]) -> str:
    return str(logs[0]) if len(logs) == 1 else f"{len(logs)} logs"


def _shared(entries: Sequence[Entry]) -> Mapping[str, Any]:
    """Return the keywords that all logs were ingested with; raise a UsageError where there are none."""
    first = entries[0]
    for entry in entries:
        if alone := [f"--{name}" for name in OF_INGEST_ALONE if name in entry.keywords]:
            raise UsageError(
                f"{entry.log}: ingested with {', '.join(alone)}, which only ingest has",
                "say it in the TOML file beside the log, as v_desired_mps, or name the logs to take",
            )
        if entry.keywords != first.keywords:
            raise UsageError(
                f"{entry.log} and {first.log}: ingested with different options", "name the logs to take"
            )
    return first.keywords


def ingested_in(results: Path) -> tuple[Entry, ...]:
    """Return what the lists of `ingest` in a folder of results name, by name; removed tables do not count.

    Raises:
        InputError: a list cannot be read, or a log on it is gone.
    """
    listed = [entry for path in sorted(results.rglob(LIST)) for entry in _read(path)]
    entries = [entry for entry in listed if entry.table.is_file()]
    for entry in entries:
        if not entry.log.exists():
            raise InputError(
                f"{entry.log}: is gone since it was ingested",
                f"remove {entry.table}, or name the logs to take",
            )
    return tuple(sorted(entries, key=lambda entry: name_of(entry.log)))


def _read(path: Path) -> list[Entry]:
    """Return the entries of a list, whose paths start at its folder; no entries where there is no list."""
    if not path.exists():
        return []
    hint = "remove it and ingest the logs again"
    document = read_json(path, hint, SCHEMA)
    try:
        return [
            Entry(
                Path(os.path.normpath(path.parent / row["log"])), path.parent / row["table"],
                {
                    name: Estimate(**value) if name == "distance_measured" else value
                    for name, value in row["keywords"].items()
                },
            )
            for row in document["trials"]
        ]  # fmt: skip
    except (KeyError, TypeError, AttributeError):
        raise InputError(f"{path}: is no list of ingested logs", hint) from None


def refuse_others(folder: Path, tables: Iterable[Path]) -> None:
    """Refuse to replace files in a folder of tables that `ingest` did not write, such as a log.

    Raises:
        LabError: there is one among the tables that are to be written.
    """
    written = {entry.table for entry in _read(folder / LIST)}
    for table in tables:
        if table.exists() and table not in written:
            raise LabError(f"{table}: was not written by ingest", "move it away, or choose another --out")


def remember(folder: Path, tables: Mapping[Path, Path], keywords: Mapping[str, Any]) -> None:
    """Add logs to the list of ingested ones in a folder.

    Args:
        folder: of the tables.
        tables: logs to their tables of motion.
        keywords: those of `ingest` besides the logs; None stands for what was not given.

    Raises:
        InputError: what stands in its place is no such list.
        LabError: the list cannot be written.
    """
    given = {name: value for name, value in keywords.items() if name not in OF_WORK and value is not None}
    entries = {entry.table: entry for entry in _read(folder / LIST)}
    entries |= {table: Entry(log, table, given) for log, table in tables.items()}
    rows = [
        {
            "log": Path(os.path.relpath(entry.log, folder)).as_posix(),
            "table": table.name,
            "keywords": entry.keywords,
        }
        for table, entry in sorted(entries.items())
    ]
    text = json.dumps({"schema": SCHEMA, "trials": rows}, indent=1, default=_plain)
    write_text(folder / LIST, f"{text}\n")


def _plain(value: Path | Estimate) -> Any:
    return str(value) if isinstance(value, Path) else asdict(value)
