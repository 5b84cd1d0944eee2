"""Logs that a command takes where none are named: those of the project, of `ingest`, or the samples.

`ingest` keeps a list of the logs whose motion it has written, beside the tables of motion.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from granite_lab.api.arguments import options_of
from granite_lab.api.project import FILE, named_logs, project_in
from granite_lab.errors import InputError, LabError, UsageError
from granite_lab.estimate import Estimate
from granite_lab.files import readable, write_text
from granite_lab.logs.trial import name_of, trial_files
from granite_lab.options import Options

LIST, SCHEMA = "ingest.json", "granite-lab/ingested/1"
"""Name and schema of the list beside the tables of motion."""

SAMPLES = Path("data") / "samples"

ABOUT = ("robot", "soil", "column_map", "topics", "window")
"""Parameters that say something of the logs, as `options_of` has them."""

KNOWN = ("rests", "body_rests", "distance_measured", "use_reference", "ref_v_std", "ref_x_std", "changes")
"""Parameters that say what is known of the trials, likewise."""

ALONE = ("imu", "encoders", "currents", "reference", "rows", "variant")
"""Parameters of `ingest` that no other command has."""


@dataclass(frozen=True)
class Listed:
    """A log whose motion was written.

    Attributes:
        log, table: paths of the log and of its table of motion.
        options: (name, value) of what was said of the log, as options of the command line.
        alone: names of further parameters that were given, which `ingest` alone has.
    """

    log: Path
    table: Path
    options: tuple[tuple[str, str], ...] = ()
    alone: tuple[str, ...] = ()


@dataclass(frozen=True)
class AtHand:
    """Logs that are taken, keywords that they were ingested with, and what is said of both."""

    logs: tuple[Path, ...]
    said: Mapping[str, Any]
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
    if found := ingested_in(results):
        logs = tuple(dict.fromkeys(one.log for one in found))
        where = ", ".join(dict.fromkeys(str(one.table.parent) for one in found))
        said = _said_of(found)
        given = " ".join(f"--{name} {value}" for name, value in found[0].options)
        told = f" with {given}" if given else ""
        return AtHand(logs, said, f"logs: {_counted(logs)}, ingested{told} ({where})")
    if (folder / SAMPLES).is_dir() and (logs := tuple(trial_files(folder / SAMPLES))):
        return AtHand(logs, {}, f"logs: {_counted(logs)}, samples ({folder / SAMPLES})")
    raise UsageError(
        "no trials given",
        f"name one or more logs, or a folder of them; or name them in {FILE}; or ingest them first",
    )


def _counted(logs: Sequence[Path]) -> str:
    return str(logs[0]) if len(logs) == 1 else f"{len(logs)} logs"


def _said_of(found: Sequence[Listed]) -> dict[str, Any]:
    """Return the keywords that all logs were ingested with; raise a UsageError where there are none."""
    for one in found:
        if one.alone:
            names = ", ".join(f"--{name}" for name in one.alone)
            raise UsageError(
                f"{one.log}: ingested with {names}, which only ingest has",
                "say it in the TOML file beside the log, as v_desired_mps, or name the logs to take",
            )
        if one.options != found[0].options:
            raise UsageError(
                f"{one.log} and {found[0].log}: ingested with different options", "name the logs to take"
            )
    options = Options.from_given(found[0].options)
    said = {name: getattr(options, name) for name in ABOUT} | {"topics": dict(options.topics)}
    if (info := options.info) is not None:
        said |= {name: getattr(info, name) for name in KNOWN}
        said["changes"] = dict(info.changes)
        if info.distance_measured is not None:
            std = math.nan if info.distance_measured_std is None else info.distance_measured_std
            said["distance_measured"] = Estimate(info.distance_measured, std)
    return {name: value for name, value in said.items() if value}


def ingested_in(results: Path) -> tuple[Listed, ...]:
    """Return what the lists of `ingest` in a folder of results name, by name; removed tables do not count.

    Raises:
        InputError: a list cannot be read, or a log on it is gone.
    """
    found = [one for path in sorted(results.rglob(LIST)) for one in _read(path)]
    there = [one for one in found if one.table.is_file()]
    for one in there:
        if not one.log.exists():
            raise InputError(
                f"{one.log}: is gone since it was ingested", f"remove {one.table}, or name the logs to take"
            )
    return tuple(sorted(there, key=lambda one: name_of(one.log)))


def _read(path: Path) -> list[Listed]:
    """Return the entries of a list; paths in it start at its folder."""
    try:
        document = json.loads(path.read_bytes())
        if document["schema"] != SCHEMA:
            raise ValueError
        return [
            Listed(
                log=Path(os.path.normpath(path.parent / row["log"])), table=path.parent / row["table"],
                options=tuple((str(name), str(value)) for name, value in row["options"]),
                alone=tuple(map(str, row["alone"])),
            )
            for row in document["trials"]
        ]  # fmt: skip
    except OSError as error:
        raise readable(error, path) from None
    except (ValueError, KeyError, TypeError):
        raise InputError(
            f"{path}: is no list of ingested logs", "remove it and ingest the logs again"
        ) from None


def refuse_others(folder: Path, tables: Iterable[Path]) -> None:
    """Refuse to replace files in a folder of tables that `ingest` did not write, such as a log.

    Raises:
        LabError: there is one among the tables that are to be written.
    """
    path = folder / LIST
    mine = {one.table for one in (_read(path) if path.exists() else ())}
    for table in tables:
        if table.exists() and table not in mine:
            raise LabError(f"{table}: was not written by ingest", "move it away, or choose another --out")


def remember(folder: Path, tables: Mapping[Path, Path], said: Mapping[str, Any]) -> Path:
    """Add logs to the list of ingested ones in a folder, and return its path.

    Args:
        folder: of the tables.
        tables: logs to their tables of motion.
        said: keywords of `ingest` that were given.

    Raises:
        InputError: what stands in its place is no such list.
        LabError: the list cannot be written.
    """
    path = folder / LIST
    stated = {name: said[name] for name in ABOUT + KNOWN if said.get(name) is not None}
    options = options_of(**stated).given()
    alone = tuple(name for name in ALONE if said.get(name))
    known = {one.table: one for one in (_read(path) if path.exists() else ())}
    known |= {table: Listed(log, table, options, alone) for log, table in tables.items()}
    rows = [
        {
            "log": Path(os.path.relpath(one.log, folder)).as_posix(), "table": one.table.name,
            "options": [list(pair) for pair in one.options], "alone": list(one.alone),
        }
        for one in known.values()
    ]  # fmt: skip
    rows.sort(key=lambda row: str(row["table"]))
    write_text(path, json.dumps({"schema": SCHEMA, "trials": rows}, indent=1) + "\n")
    return path
