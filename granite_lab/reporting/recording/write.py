"""Recordings of one trial and of a whole study."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from granite_lab import __version__
from granite_lab.comparison.record import Comparison
from granite_lab.discovery.finding import Finding
from granite_lab.logs.trial import Trial
from granite_lab.reporting.content import StudyResult
from granite_lab.reporting.recording.about import about, properties
from granite_lab.reporting.recording.discovered import found_events, found_lines, intervals_of
from granite_lab.reporting.recording.events import Event, Interval, lanes_of, within, write_events
from granite_lab.reporting.recording.layout import blueprint, extent_of, overlay, trial_layout
from granite_lab.reporting.recording.scene import write_scene
from granite_lab.reporting.recording.signals import Line, lines_of, robot_slip, write_lines
from granite_lab.reporting.recording.stream import Writer, recording, root_of


def record_trial(
    trial: Trial,
    comparison: Comparison,
    path: Path,
    *,
    intervals: Sequence[Interval] = (),
    finding: Finding | None = None,
) -> Path:
    """Write the Rerun recording of one trial, layout included.

    Args:
        trial: as logged.
        comparison: measured beside simulated.
        path: of the ``.rrd`` file; written whole or not at all.
        intervals: where simulation and measurement disagree; each channel becomes a lane of bars.
        finding: of the search for the missing effect: its intervals join `intervals`, and its
            simulations before and after are drawn beside what was measured.

    Returns:
        `path`.

    Raises:
        LabError: the file cannot be written.
    """
    lines, bars, events = _contents(trial, comparison, intervals, finding)
    layout = trial_layout("", lines, lanes=lanes_of(bars), name=trial.name)
    with recording(path, trial.name, blueprint(layout)) as stream:
        stream.send_property("trial", properties(trial, comparison))
        _write(Writer(stream), trial, comparison, lines, bars, events)
    return path


def _contents(
    trial: Trial, comparison: Comparison, intervals: Sequence[Interval], finding: Finding | None
) -> tuple[list[Line], list[Interval], list[Event]]:
    """Return the lines, bars and further log lines of a trial."""
    lines, bars = list(lines_of(trial, comparison)), list(intervals)
    events: list[Event] = []
    if finding is not None:
        lines += found_lines(finding, comparison)
        bars += intervals_of(finding, comparison)
        events += found_events(finding, comparison)
    return lines, within(bars, comparison), events


def record_study(result: StudyResult, path: Path, *, finding: Finding | None = None) -> Path:
    """Write one recording of all trials of a study, on one clock that starts with each trial's command.

    Each trial stands below an entity of its own name and has a tab of its own; the first tab lays the
    velocities and slips of all trials over each other.

    Args:
        result: the study.
        path: of the ``.rrd`` file.
        finding: of the search for the missing effect, as in `record_trial`.

    Returns:
        `path`.

    Raises:
        LabError: the file cannot be written.
    """
    trials = dict(zip(_distinct([r.trial.name for r in result.trials]), result.trials, strict=True))
    contents = {k: _contents(r.trial, r.comparison, (), finding) for k, r in trials.items()}
    lines = {k: [*contents[k][0], *robot_slip(r.comparison)] for k, r in trials.items()}
    groups: dict[str, list[str]] = {}
    for name, own in sorted(trials.items(), key=lambda item: item[1].comparison.motion.variant.velocity):
        groups.setdefault(f"{own.comparison.motion.variant.velocity:.3g} m/s", []).append(name)
    layouts = {k: trial_layout(root_of(k), lines[k], lanes=lanes_of(contents[k][1]), name=k) for k in trials}
    tabs = [rrb.Tabs(*(layouts[name] for name in names), name=speed) for speed, names in groups.items()]
    extents = {
        speed: extent_of([x for name in names for x in lines[name]]) for speed, names in groups.items()
    }
    content = rrb.Tabs(overlay(groups, extents), *tabs, active_tab=0)
    with recording(path, result.name, blueprint(content)) as stream:
        stream.send_property(
            "study",
            rr.AnyValues(
                name=result.name,
                virtual=result.virtual,
                version=__version__,
                trials=list(trials),
                failures=[f"{f.trial}: {f.message}" for f in result.failures] or ["none"],
            ),
        )
        for name, own in trials.items():
            root = root_of(name)
            stream.send_property(root.removeprefix("/"), properties(own.trial, own.comparison))
            _, bars, events = contents[name]
            _write(Writer(stream, root), own.trial, own.comparison, lines[name], bars, events)
    return path


def _distinct(names: Sequence[str]) -> list[str]:
    """Return the names, later ones numbered where they repeat."""
    seen: list[str] = []
    for name in names:
        unique, k = name, 2
        while unique in seen:
            unique, k = f"{name} ({k})", k + 1
        seen.append(unique)
    return seen


def _write(
    writer: Writer,
    trial: Trial,
    comparison: Comparison,
    lines: Sequence[Line],
    intervals: Sequence[Interval],
    events: Sequence[Event],
) -> None:
    write_lines(writer, lines)
    write_scene(writer, comparison)
    write_events(writer, comparison, intervals, events)
    writer.static("about", about(trial, comparison))
