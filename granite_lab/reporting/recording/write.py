"""Recordings of one trial and of a whole study, with the pages of text in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, count, cycle
from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from granite_lab.comparison.record import Comparison
from granite_lab.discovery.finding import Finding
from granite_lab.logs.trial import Trial
from granite_lab.reporting.content import StudyResult
from granite_lab.reporting.recording.events import Interval, intervals_of, write_events
from granite_lab.reporting.recording.layout import OVERLAY, blueprint, overlay, trial_layout
from granite_lab.reporting.recording.lines import OF_TRIALS, Line, lines_of, overlaid, write_lines
from granite_lab.reporting.recording.scene import write_scene
from granite_lab.reporting.recording.stream import Writer, drawable, recording, root_of
from granite_lab.reporting.render import to_markdown


def record_trial(trial: Trial, comparison: Comparison, path: Path, *, finding: Finding | None = None) -> Path:
    """Write the Rerun recording of one trial, layout included.

    Args:
        trial: as logged.
        comparison: measured beside simulated.
        path: of the ``.rrd`` file; written whole or not at all.
        finding: of the search for the missing effect: where the simulation differs is shown as bars, and
            its simulations without and with the effect are drawn beside what was measured.

    Returns:
        `path`.

    Raises:
        LabError: the file cannot be written.
    """
    content = _Content(trial, comparison, finding)
    with recording(path, trial.name, blueprint(content.layout("", trial.name))) as stream:
        content.write(Writer(stream))
    return path


def record_study(result: StudyResult, path: Path, *, finding: Finding | None = None) -> Path:
    """Write one recording of all trials of a study, on one clock that starts with each trial's command.

    Each trial stands below an entity of its own name and has a tab of its own; the first tab lays the
    velocities and slips of all trials over each other. Arguments and errors as in `record_trial`.
    """
    names = _distinct([drawable(r.trial.name) for r in result.trials])
    known = zip(names, result.trials, strict=True)
    contents = {name: _Content(r.trial, r.comparison, finding) for name, r in known}
    speeds: dict[float, list[str]] = {}
    for name, own in contents.items():
        speeds.setdefault(own.comparison.motion.variant.velocity, []).append(name)
    tabs, rows = [], {}
    for i, speed in enumerate(sorted(speeds)):
        layouts = [contents[name].layout(root_of(name), name) for name in speeds[speed]]
        tabs.append(rrb.Tabs(*layouts, name=f"{speed:.3g} m/s"))
        rows[f"{speed:.3g} m/s"] = [
            line
            for name, colour in zip(speeds[speed], cycle(OF_TRIALS))
            for line in overlaid(f"{OVERLAY}/{i}", name, contents[name].comparison, colour)
        ]
    first = overlay(rows, max(map(len, speeds.values())))
    with recording(path, result.name, blueprint(rrb.Tabs(first, *tabs, active_tab=0))) as stream:
        Writer(stream).static("key", _page("recording_key.md", virtual=result.virtual, study=True))
        write_lines(Writer(stream), chain(*rows.values()))
        for name, own in contents.items():
            own.write(Writer(stream, root_of(name)))
    return path


def _distinct(names: Sequence[str]) -> list[str]:
    """Return the names, later ones numbered where they repeat."""
    seen: list[str] = []
    for name in names:
        again = (f"{name} ({k})" for k in count(2))
        seen.append(next(unique for unique in chain([name], again) if unique not in seen))
    return seen


@dataclass(frozen=True)
class _Content:
    """What a recording holds of one trial."""

    trial: Trial
    comparison: Comparison
    finding: Finding | None

    @cached_property
    def lines(self) -> list[Line]:
        return lines_of(self.trial, self.comparison, self.finding)

    @cached_property
    def bars(self) -> list[Interval]:
        return intervals_of(self.comparison, self.finding)

    def layout(self, root: str, name: str) -> rrb.Horizontal:
        lanes = len({bar.channel for bar in self.bars})
        return trial_layout(root, self.lines, lanes=lanes, name=drawable(name))

    def write(self, writer: Writer) -> None:
        write_lines(writer, self.lines)
        write_scene(writer, self.comparison)
        write_events(writer, self.comparison, self.bars, self.finding)
        motion = self.comparison.motion
        writer.static("key", _page("recording_key.md", virtual=motion.virtual, study=False))


def _page(template: str, **content: object) -> Any:
    """Return a Markdown document."""
    return rr.TextDocument(drawable(to_markdown(template, **content).strip()), media_type="text/markdown")
