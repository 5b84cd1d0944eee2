"""`inspect_logs`: what a log seems to be, how sure that is, and the column map of it."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from granite_lab.errors import InputError, at
from granite_lab.logs.bag import read_bag
from granite_lab.logs.cells import Cells, load
from granite_lab.logs.guess import called, guess
from granite_lab.logs.layouts import Column, Layout, Maps, Match, given_maps, match, no_match
from granite_lab.logs.quantities import (
    ColumnReport,
)
from granite_lab.logs.reader import assemble
from granite_lab.logs.sensors.doubt import some_of
from granite_lab.logs.sensors.stamps import GAP_PERIODS
from granite_lab.logs.sensors.standstill import standstills
from granite_lab.logs.sensors.wheels import MotionGuess, look
from granite_lab.logs.source import read_source, recognise
from granite_lab.logs.table import Table, open_table
from granite_lab.logs.trial import Array, Trial, is_bag, name_of, parts_of
from granite_lab.parameters import load_robot
from granite_lab.parameters.quantity import toml_line
from granite_lab.rounding import significant
from granite_lab.shown import Shown

_KNOWN = 0.95  # how sure a recognised layout is

_HEAD = """\
# A column map: edit it, then read the log with --map THIS_FILE.
# Channels: t, t_add, imu_ax … imu_az, imu_gx … imu_gz, enc_fl … enc_rr, cur_fl … cur_rr,
# v_cmd, tow, ref_x, ref_y, ref_v, ref_lat, ref_lon. A wrong sign is scale = -1."""

# A column without settings, and the keys that may be set.
_PLAIN, _SETTINGS = Column(to=()), ("scale", "wrap", "counts_per_rev", "increment")


@dataclass(frozen=True)
class StreamReport:
    """The clock of one sensor: [s] and [Hz]; jitter is the std of the steps."""

    what: str
    samples: int
    start: float
    end: float
    rate: float
    jitter: float
    gaps: int
    longest_gap: float


@dataclass(frozen=True)
class FileReport:
    """One file."""

    path: Path
    dialect: Table | None = None  # how its text is laid out; None if it is no text
    layout: str = ""  # the column map that fits; "" if none does and columns were guessed
    confidence: float = 0.0  # in the layout as a whole, 0 to 1
    entries: tuple[ColumnReport, ...] = ()  # as a column map lists them; of several clocks the first counts
    head: tuple[tuple[str, object], ...] = ()  # what a column map says about the file as a whole
    streams: tuple[StreamReport, ...] = ()  # clocks of the sensors
    rests: tuple[tuple[float, float], ...] = ()  # standstills [s]
    motion: MotionGuess | None = None  # a first look at the motion; None without wheels
    doubts: tuple[str, ...] = ()  # everything the reader was not sure of, wraps and saturation included
    problem: str = ""  # why the file cannot be read as it is
    hint: str = ""  # what to do about that
    trial: Trial | None = field(default=None, compare=False, repr=False)  # in SI; None if it cannot be read

    @property
    def columns(self) -> tuple[ColumnReport, ...]:
        """What the columns are, in the order of the file."""
        return tuple(sorted(self.entries, key=lambda column: column.place))

    def to_map_toml(self) -> str:
        """Return a column map of what was recognised, which reads the file when given as ``--map``.

        Raises:
            InputError: the file is no table.
        """
        if not self.entries:
            raise InputError(self.problem, self.hint or "only a table of numbers can be mapped")
        name = re.sub(r"[^A-Za-z0-9_]+", "_", name_of(self.path)) or "log"
        lines = [_HEAD, *_pairs(("name", name), ("title", f"written from {self.path.name}"), *self.head)]
        if (text := self.dialect) is not None:
            lines += ["", "[table]", *_pairs(("delimiter", text.delimiter_name), ("decimal", text.decimal))]
            if text.headers and text.header_line == 0:
                lines += _pairs(("names", [column.name for column in self.columns]))
        for column in self.entries:
            lines += ["", *_entry(column)]
        return "\n".join(lines) + "\n"

    def as_json(self) -> dict[str, Any]:
        """Return the report as plain data."""
        table, motion = self.dialect, self.motion
        return {
            "path": str(self.path), "layout": self.layout or None, "confidence": self.confidence,
            "text": table and {
                "encoding": table.encoding, "delimiter": table.delimiter_name, "decimal": table.decimal,
                "header_line": table.header_line, "first_row": table.data_line,
            },
            "columns": [column.as_json() for column in self.columns],
            "streams": [dataclasses.asdict(stream) for stream in self.streams],
            "standstills_s": [list(interval) for interval in self.rests],
            "motion": motion and {
                "velocity_mps": motion.velocity, "acceleration_mps2": motion.acceleration,
                "distance_m": motion.distance, "confidence": motion.confidence,
                "variant_mps": motion.variant.velocity if motion.variant else None,
            },
            "doubts": list(self.doubts), "problem": self.problem or None, "hint": self.hint or None,
        }  # fmt: skip


@dataclass(frozen=True)
class Inspection(Shown):
    """What was recognised in some logs, file by file."""

    files: tuple[FileReport, ...]

    def __repr__(self) -> str:
        lines = [f.problem or f"{f.path.name}: {len(f.columns)} columns" for f in self.files[:3]]
        more = [f"and {len(self.files) - 3} more"] * (len(self.files) > 3)
        return f"Inspection({'; '.join([*lines, *more])})"

    def to_map_toml(self, index: int = 0) -> str:
        """Return the column map of one of the files.

        Raises:
            InputError: the file is no table.
        """
        return self.files[index].to_map_toml()

    def as_json(self) -> dict[str, Any]:
        """Return everything as plain data."""
        return {"schema": "granite-lab/inspect/1", "files": [report.as_json() for report in self.files]}

    def to_frame(self) -> pd.DataFrame:
        """Return one row a column of each file: what it feeds, in which unit, and how sure that is."""
        rows = [
            (str(f.path), c.name, " ".join(c.to), c.unit, c.confidence, c.low, c.high, c.filled)
            for f in self.files
            for c in f.columns
        ]
        names = ["path", "column", "channels", "unit", "confidence", "low", "high", "filled"]
        return pd.DataFrame(rows, columns=names)


def _entry(column: ColumnReport) -> list[str]:
    """Return the lines of one column in a map; without channels they are comments."""
    low, high = (significant(end, 4) for end in (column.low, column.high))
    span = f"; values from {low} to {high}" if column.filled > 0 else ""
    sure = f"{column.confidence:.0%} sure, " if column.to else ""
    why = re.sub(r"[\x00-\x1f\x7f]+", " ", f"# {sure}{column.why}{span}")
    body = ["[[column]]", *_pairs(("name", column.name), ("to", column.to))]
    body += _pairs(("unit", column.unit), *column.settings) if column.unit or column.to else []
    return [why, *(line if column.to else f"# {line}" for line in body)]


def _pairs(*pairs: tuple[str, object]) -> list[str]:
    return [toml_line(key, value) for key, value in pairs]


def inspect_logs(
    paths: Sequence[str | Path],
    *,
    map: Maps = None,  # noqa: A002  # the option is called --map
    robot: str | Path | None = None,
    topics: Mapping[str, str] | None = None,
) -> Inspection:
    """Look at logs of known or unknown layout; a folder with a file a sensor stands for these.

    A file that cannot be used is not an error here but a `problem` in its report. What else may be said is
    as in `read_trial`.

    Raises:
        UsageError: unknown robot or column map.
    """
    maps = given_maps(map)
    files = [file for path in paths for file in parts_of(Path(path)) or [Path(path)]]
    return Inspection(tuple(_inspect(path, maps, topics, robot) for path in files))


def _inspect(
    path: Path,
    maps: Sequence[Layout],
    topics: Mapping[str, str] | None,
    robot: str | Path | None,
) -> FileReport:
    """Look at one file: by its layout, or else by guess."""
    report, fit = FileReport(path), None
    try:
        fit = recognise(path, maps, topics)
        table = fit.table
    except InputError as error:
        report = replace(report, problem=error.message, hint=error.hint)
        try:
            said = maps[0].table if len(maps) == 1 else None
            table = read_bag(path, {}, None)[0] if is_bag(path) else open_table(path, said)
        except InputError:
            return report
        if table.width <= 1 and is_bag(path):
            return report
    try:
        cells = _cells(table)
    except InputError as error:
        return replace(report, problem=report.problem or error.message, hint=report.hint or error.hint)
    columns, doubts = cells.columns, _named_alike(table) if fit is None else _passed_over(fit, maps)
    entries = _recognised(fit) if fit is not None else guess(table, columns)
    used = {column.place for column in entries}
    entries += [_unused(table, columns, place) for place in range(table.width) if place not in used]
    entries = [_ranged(entry, columns[entry.place]) if entry.place in columns else entry for entry in entries]
    text = table if table.data_line else None
    report = replace(report, dialect=text, entries=tuple(entries), doubts=tuple(doubts))
    if fit is not None:
        keys = ("robot", "rows", "split", "gravity_removed")
        head = tuple((key, value) for key in keys if (value := getattr(fit.layout, key)))
        report = replace(report, layout=fit.layout.name, confidence=_KNOWN, head=head)
    else:
        sure = min((column.confidence for column in entries if column.to), default=0.0)
        report = replace(report, confidence=sure)
        if not any("t" in column.to for column in entries):
            return replace(report, doubts=(*report.doubts, *_damage(table, cells)))
    try:
        source = read_source(fit or _bound(report, table), cells=cells)
        trial = assemble(path, [("", source)], robot, whole=False)
    except InputError as error:
        lines = (*report.doubts, error.message) if error.message != report.problem else report.doubts
        return replace(
            report, problem=report.problem or error.message, hint=report.hint or error.hint, doubts=lines
        )
    return _measured(report, trial, robot)


def _measured(report: FileReport, trial: Trial, robot: str | Path | None) -> FileReport:
    """Add what the samples say: clocks, standstills, motion, doubts, and the units found right."""
    the_robot = load_robot(robot or trial.info.robot or "granite")
    still, motion = tuple(standstills(trial, the_robot)), look(trial, the_robot)
    entries = tuple(
        replace(column, unit=next((trial.units[to] for to in column.to if to in trial.units), column.unit))
        for column in report.entries
    )
    head = dict(report.head)
    if trial.imu is not None:
        head = {key: value for key, value in head.items() if key != "gravity_removed"}
        head |= {"gravity_removed": True} if trial.imu.gravity_removed else {}
    return replace(
        report, entries=entries, head=tuple(head.items()), streams=_streams(trial), rests=still,
        motion=motion, doubts=tuple(dict.fromkeys(report.doubts + trial.warnings)), trial=trial,
    )  # fmt: skip


def _cells(table: Table) -> Cells:
    """Read every column that holds numbers or dates."""
    dates = [place for place in range(table.width) if table.is_dated(place)]
    wanted = [place for place in range(table.width) if place in dates or table.is_numeric(place)]
    return load(table, wanted, dates)


def _damage(table: Table, cells: Cells) -> list[str]:
    """Return warnings about damaged rows of a table that is not read further."""
    try:
        return cells.whole(table, ())[1]
    except InputError as error:
        return [error.message]


def _passed_over(fit: Match, maps: Sequence[Layout]) -> list[str]:
    """Return a warning that no given map fits a file that the catalogue knows."""
    if not maps or fit.layout in maps or is_bag(fit.table.path):
        return []
    try:
        why = no_match([match(layout, fit.table) for layout in maps], given=True).message
    except InputError as error:
        why = error.message
    return [f"read by layout '{fit.layout.name}', for no given map fits: {why}"]


def _named_alike(table: Table) -> list[str]:
    """Return a warning about names that occur more than once."""
    listed = [f"'{name}' ({', '.join(f'column {k + 1}' for k in places)})" for name, places in table.repeated]
    if not listed:
        return []
    first = table.repeated[0][1]
    remedy = f"in a column map they are {' and '.join(repr(table.names[k]) for k in first[:2])}, …"
    where = at(table.path.name, table.header_line or None)
    return [f"{where}: names that occur more than once: {some_of(listed, 6)}; {remedy}"]


def _ranged(column: ColumnReport, values: Array) -> ColumnReport:
    """Add lowest and highest value and the filled share of a column."""
    seen = values[np.isfinite(values)]
    if len(seen) == 0:
        return column
    return replace(column, low=float(seen.min()), high=float(seen.max()), filled=len(seen) / len(values))


def _recognised(fit: Match) -> list[ColumnReport]:
    """Report the columns of a known layout, in the order of its map."""
    why, reports = f"layout '{fit.layout.name}'", dict[int, ColumnReport]()
    several = sum(b.channel == "t" for b in fit.bindings) > 1
    for b in fit.bindings:
        settings = [(k, value) for k in _SETTINGS if (value := getattr(b.spec, k)) != getattr(_PLAIN, k)]
        settings += [("optional", True)] if b.channel == "t" and several else []
        to = (*reports[b.place].to, b.channel) if b.place in reports else (b.channel,)
        reports[b.place] = ColumnReport(
            b.name, b.place, to, b.unit.name, _KNOWN, why, settings=tuple(settings)
        )
    return list(reports.values())


def _unused(table: Table, columns: Mapping[int, Array], place: int) -> ColumnReport:
    """Report a column that nothing is taken from, with what it may be."""
    if place not in columns:
        return ColumnReport(table.names[place], place, why="not used; texts or empty")
    guessed = called(table, place)
    suggestion = f"its name suggests {', '.join(guessed.to)} [{guessed.unit}]" if guessed.to else guessed.why
    return replace(guessed, to=(), confidence=0.0, why=f"not used; {suggestion}")


def _bound(report: FileReport, table: Table) -> Match:
    """Bind the guessed columns by their names; refuse those that a map gives with blanks around them."""
    columns = tuple(Column(to=e.to, name=e.name, unit=e.unit) for e in report.entries if e.to)
    fit = match(Layout(name=report.path.stem, column=columns), table)
    if fit.missing:
        raise InputError(report.problem)
    return fit


def _streams(trial: Trial) -> tuple[StreamReport, ...]:
    """Describe the clock of every sensor."""
    reports: list[StreamReport] = []
    sensors = {
        "imu": trial.imu, "encoders": trial.wheels, "motor currents": trial.currents,
        "command": trial.command, "towing force": trial.tow,
        "reference": trial.reference_x or trial.reference_v,
    }  # fmt: skip
    for name, stream in sensors.items():
        if stream is not None:
            t, steps = stream.t, np.diff(stream.t)
            period = float(np.median(steps))
            gap = steps > GAP_PERIODS * period
            clock = (float(t[0]), float(t[-1]), 1 / period, float(steps[~gap].std()))
            reports.append(StreamReport(name, len(t), *clock, int(gap.sum()), float(steps.max())))
    return tuple(reports)
