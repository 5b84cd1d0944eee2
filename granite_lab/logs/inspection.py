"""`inspect_logs`: what a log seems to be, and how sure that is."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from granite_lab.errors import InputError
from granite_lab.logs.clocks import GAP_PERIODS
from granite_lab.logs.dialect import Dialect, is_number, sniff
from granite_lab.logs.guess import Guess, by_name, guess
from granite_lab.logs.inspected import ColumnReport, FileReport, Inspection, StreamReport
from granite_lab.logs.layouts import Column, Layout
from granite_lab.logs.mapfile import Entry
from granite_lab.logs.matching import Match, choose
from granite_lab.logs.named import is_bag
from granite_lab.logs.reader import Maps, assemble
from granite_lab.logs.source import Source
from granite_lab.logs.sources import given_maps, open_source
from granite_lab.logs.stretches import look, rests
from granite_lab.logs.table import is_dated, load
from granite_lab.logs.trial import Array, Trial
from granite_lab.parameters import load_robot


def inspect_logs(
    paths: Sequence[str | Path],
    *,
    map: Maps = None,  # noqa: A002  # the option is called --map
    robot: str | Path | None = None,
    rows: str | None = None,
    topics: Mapping[str, str] | None = None,
) -> Inspection:
    """Look at logs of known or unknown layout.

    A file that cannot be used is not an error here but a `problem` in its report.

    Args:
        paths: the files.
        map: column maps, by name or path.
        robot: name or file of the robot.
        rows: which rows to take, as ``run_id = 4``.
        topics: of a bag, ``imu``, ``joints`` and ``odom`` to the name of a topic.

    Raises:
        UsageError: unknown robot or column map.
    """
    maps = given_maps(map)
    return Inspection(tuple(_inspect(Path(path), maps, robot, rows, topics) for path in paths))


def _inspect(
    path: Path,
    maps: Sequence[Layout],
    robot: str | Path | None,
    rows: str | None,
    topics: Mapping[str, str] | None,
) -> FileReport:
    """Look at one file."""
    if is_bag(path):
        return _inspect_bag(path, maps, robot, topics)
    try:
        table = maps[0].table if len(maps) == 1 else None
        dialect = sniff(path, table)
    except InputError as error:
        return FileReport(path, None, "", 0.0, problem=error.message)
    columns, doubts = _numbers(path, dialect)
    problem = ""
    found: Match | None = None
    try:
        found = choose(path, dialect, maps)
    except InputError as error:
        problem = error.message
    if found is not None:
        reports, layout, name, confidence = _recognised(found, columns), found.layout, found.layout.name, 0.95
        entries = _entries_of(found)
    else:
        dates = [_key(dialect, place) for place in columns if is_dated(dialect, place)]
        guesses = guess({_key(dialect, place): values for place, values in columns.items()}, dates)
        reports, entries = _guessed(dialect, columns, guesses)
        layout, name = _layout_of(path, entries), ""
        used = [g.confidence for g in guesses if g.to]
        confidence = min(used, default=0.0)
    more, stubs = _unused(dialect, columns, {report.place for report in reports})
    reports = sorted([*reports, *more], key=lambda report: report.place)
    entries = [*entries, *stubs]  # in the order of the map: of several clocks the first counts
    head = tuple((key, value) for key, value in _head(layout))
    report = FileReport(
        path, dialect, name, confidence, tuple(reports), doubts=tuple(doubts), problem=problem,
        entries=tuple(entries), head=head,
    )  # fmt: skip
    return _with_samples(report, layout, robot, rows)


def _inspect_bag(
    path: Path, maps: Sequence[Layout], robot: str | Path | None, topics: Mapping[str, str] | None
) -> FileReport:
    """Look at a recording by ROS: its topics say what is in it."""
    try:
        source = open_source(path, maps, topics=topics)
    except InputError as error:
        return FileReport(path, None, "", 0.0, problem=error.message)
    report = FileReport(
        path, None, source.match.layout.name, 0.95, tuple(_recognised(source.match, source.columns)),
        entries=tuple(_entries_of(source.match)),
    )  # fmt: skip
    return _sampled(report, source, robot)


def _numbers(path: Path, dialect: Dialect) -> tuple[dict[int, Array], list[str]]:
    """Read every column that holds numbers; a faulty one becomes a doubt."""
    doubts: list[str] = []
    columns: dict[int, Array] = {}
    candidates: list[int] = []
    dates: list[int] = []
    for place in range(dialect.width):
        cells = [row[place].strip() for row in dialect.sample if row[place].strip()]
        if is_dated(dialect, place):
            dates.append(place)
        elif cells and sum(is_number(cell, dialect.decimal) for cell in cells) > 0.5 * len(cells):
            candidates.append(place)
    candidates = sorted(candidates + dates)
    try:
        return load(path, dialect, candidates, dates) if candidates else ({}, doubts)
    except InputError:
        for place in candidates:
            try:
                columns |= load(path, dialect, [place], [place] if place in dates else [])[0]
            except InputError as error:
                doubts.append(error.message)
    return columns, doubts


def _key(dialect: Dialect, place: int) -> str:
    """Name a column so that the name is unique."""
    name = dialect.headers[0][place] if dialect.headers else f"column {place + 1}"
    again = dialect.headers and dialect.headers[0].index(name) != place
    return f"{name} ({place + 1})" if again else name


def _range(values: Array) -> tuple[float, float, float]:
    """Return lowest and highest value and the filled share of a column."""
    seen = values[np.isfinite(values)]
    if len(seen) == 0:
        return math.nan, math.nan, 0.0
    return float(seen.min()), float(seen.max()), len(seen) / len(values)


def _recognised(found: Match, columns: dict[int, Array]) -> list[ColumnReport]:
    """Report the columns of a known layout."""
    reports = []
    for place in dict.fromkeys(b.place for b in found.bindings):
        bound = [b for b in found.bindings if b.place == place]
        low, high, filled = _range(columns.get(place, np.zeros(0)))
        why = f"layout '{found.layout.name}'"
        to = tuple(b.channel for b in bound)
        reports.append(
            ColumnReport(bound[0].name, place, to, bound[0].unit.name, 0.95, why, low, high, filled)
        )
    return reports


def _entries_of(found: Match) -> list[Entry]:
    """Write down the columns of a known layout as entries of a map."""
    entries = []
    for place in dict.fromkeys(b.place for b in found.bindings):
        bound = [b for b in found.bindings if b.place == place]
        spec = bound[0].spec
        defaults = {f.name: f.default for f in dataclasses.fields(Column)}
        keys = ("scale", "wrap", "counts_per_rev", "increment")
        settings = tuple((k, getattr(spec, k)) for k in keys if getattr(spec, k) != defaults[k])
        to = tuple(b.channel for b in bound)
        if "t" in to and sum(b.channel == "t" for b in found.bindings) > 1:
            settings = (*settings, ("optional", True))
        entries.append(Entry(bound[0].name, place, to, bound[0].unit.name, settings))
    return entries


def _guessed(
    dialect: Dialect, columns: dict[int, Array], guesses: Sequence[Guess]
) -> tuple[list[ColumnReport], list[Entry]]:
    """Report the columns of an unknown layout."""
    reports, entries = [], []
    for (place, values), one in zip(columns.items(), guesses, strict=True):
        name = dialect.headers[0][place] if dialect.headers else one.name
        low, high, filled = _range(values)
        reports.append(
            ColumnReport(name, place, one.to, one.unit, one.confidence, one.why, low, high, filled)
        )
        note = f"{one.confidence:.0%} sure ({one.why}); values from {low:.6g} to {high:.6g}"
        # Two columns of one name cannot be told apart by a map.
        clear = not dialect.headers or dialect.headers[0].count(name) == 1
        entries.append(Entry(name, place, one.to if clear else (), one.unit, note=note))
    return reports, entries


def _unused(
    dialect: Dialect, columns: dict[int, Array], used: set[int]
) -> tuple[list[ColumnReport], list[Entry]]:
    """Report the columns that nothing is taken from, with what they may be, and write stubs for them."""
    reports, entries = [], []
    for place in sorted(set(range(dialect.width)) - used):
        name = dialect.headers[0][place] if dialect.headers else f"column {place + 1}"
        values = columns.get(place)
        low, high, filled = _range(np.zeros(0) if values is None else values)
        one = by_name(name) if values is not None else None
        why = "not used; texts or empty" if values is None else "not used; not recognised"
        unit = one.unit if one else ""
        if one is not None:
            why = f"not used; its name suggests {', '.join(one.to)} [{unit}]"
        reports.append(ColumnReport(name, place, (), unit, 0.0, why, low, high, filled))
        note = why if values is None else f"{why}; values from {low:.6g} to {high:.6g}"
        entries.append(Entry(name, place, (), unit, note=note))
    return reports, entries


def _layout_of(path: Path, entries: Sequence[Entry]) -> Layout:
    """Make a layout of guessed columns."""
    columns = tuple(
        Column(to=e.to, name=e.name, pattern="" if e.name else "()", unit=e.unit) for e in entries if e.to
    )
    return Layout(name=path.stem, column=columns)


def _head(layout: Layout) -> list[tuple[str, object]]:
    """Return what a written map takes over from the layout."""
    keys = ("robot", "rows", "split", "gravity_removed")
    return [(key, getattr(layout, key)) for key in keys if getattr(layout, key)]


def _with_samples(
    report: FileReport, layout: Layout, robot: str | Path | None, rows: str | None
) -> FileReport:
    """Read the file by the layout and look at its samples."""
    try:
        if not report.layout and not any("t" in e.to for e in report.entries):
            return report
        return _sampled(report, open_source(report.path, [layout], rows), robot)
    except InputError as error:
        return dataclasses.replace(
            report, problem=report.problem or error.message, doubts=(*report.doubts, error.message)
        )


def _sampled(report: FileReport, source: Source, robot: str | Path | None) -> FileReport:
    """Add what the samples show."""
    try:
        trial = assemble({"": source}, robot, whole=False)
    except InputError as error:
        return dataclasses.replace(
            report, problem=report.problem or error.message, doubts=(*report.doubts, error.message)
        )
    the_robot = load_robot(trial.info.robot or "granite")
    return dataclasses.replace(
        report,
        streams=tuple(_streams(trial)),
        rests=tuple(rests(trial, the_robot)),
        motion=look(trial, the_robot),
        doubts=report.doubts + trial.warnings,
        trial=trial,
    )


def _streams(trial: Trial) -> list[StreamReport]:
    """Describe the clock of every sensor."""
    sensors = {
        "imu": trial.imu,
        "encoders": trial.wheels,
        "motor currents": trial.currents,
        "command": trial.command,
        "reference": trial.reference_x or trial.reference_v,
    }
    reports = []
    for what, stream in sensors.items():
        if stream is None:
            continue
        steps = np.diff(stream.t)
        period = float(np.median(steps))
        usual = steps[steps <= GAP_PERIODS * period]
        gaps = int((steps > GAP_PERIODS * period).sum())
        jitter, longest = float(usual.std()), float(steps.max())
        start, end = float(stream.t[0]), float(stream.t[-1])
        reports.append(StreamReport(what, len(stream.t), start, end, 1 / period, jitter, gaps, longest))
    return reports
