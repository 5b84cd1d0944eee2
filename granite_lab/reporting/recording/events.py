"""What happens when: phases and intervals as coloured bars, filter events and doubts as log lines."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import rerun as rr

from granite_lab.comparison.record import Comparison
from granite_lab.discovery.finding import Finding
from granite_lab.reporting.answers import missing_answer
from granite_lab.reporting.names import latency_in_words
from granite_lab.reporting.recording import lines
from granite_lab.reporting.recording.lines import Rgb, command_start, residuals_of
from granite_lab.reporting.recording.stream import Writer, drawable
from granite_lab.reporting.rounding import plus_minus, significant
from granite_lab.reporting.words import sensor

PHASES = {
    "rest": lines.GREY, "accelerate": lines.GREEN, "steady": lines.BLUE, "brake": lines.PURPLE
}  # fmt: skip
DIFFERS = "simulation_differs"
"""First part of the lanes that show where simulation and measurement disagree."""
CALM = "none"
OUTLIER = 4.0
"""Innovation, in its predicted std, from which a measurement update is worth a line."""
MOST_OUTLIERS = 20


class Interval(NamedTuple):
    """A bar: start and end since command start [s], its channel, which is a lane, and what it says."""

    start: float
    end: float
    channel: str
    label: str


class Event(NamedTuple):
    """One log line: time since command start [s], text, and level, "INFO" or "WARN"."""

    t: float
    text: str
    level: str = "INFO"


def intervals_of(comparison: Comparison, finding: Finding | None) -> list[Interval]:
    """Return where a search found the simulation to differ, on the comparison's clock, within the log.

    A disagreement that was found is shared by the repetitions of a command: it holds for each of its trials.
    """
    own = residuals_of(finding, comparison) if finding is not None else []
    if finding is None or not own:
        return []
    start = command_start(comparison)
    late = own[0].t_start - start
    low, high = float(comparison.motion.t[0] - start), float(comparison.motion.t[-1] - start)
    found = [
        Interval(
            max(d.start + late, low), min(d.end + late, high),
            sensor(d.channel), f"{significant(100 * d.share, 2)} %",
        )
        for d in finding.where
        if d.variant == own[0].variant
    ]  # fmt: skip
    return [one for one in found if one.start < one.end]


def write_events(
    writer: Writer, comparison: Comparison, intervals: Sequence[Interval], finding: Finding | None
) -> None:
    """Write phases, standstills, intervals of disagreement and log lines."""
    motion = comparison.motion
    start = command_start(comparison)
    t = motion.t - start
    first = [0] + [i for i in range(1, len(t)) if motion.phase[i] != motion.phase[i - 1]]
    _lane(writer, "phase", {float(t[i]): motion.phase[i] for i in first}, dict(PHASES))
    rests = [Interval(a - start, b - start, "", "at rest") for a, b in motion.health.rests]
    _bars(writer, "robot_at_rest", float(t[0]), rests, lines.GREY)
    for channel in sorted({i.channel for i in intervals}):
        own = [i for i in intervals if i.channel == channel]
        lane = re.sub(r"\W+", "_", channel)
        _bars(writer, f"{DIFFERS}/{rr.escape_entity_path_part(lane)}", float(t[0]), own, lines.VERMILION)
    events = [*_events(comparison), *_updates(comparison, start), *_found(comparison, finding)]
    for one in intervals:
        what = f"simulated {one.channel} differs from the measured one by {one.label} of its rms"
        events.append(Event(one.start, f"{what}, {one.start:.2f} s to {one.end:.2f} s", "WARN"))
    events.sort(key=lambda e: e.t)
    text = [drawable(f"{e.t:6.2f} s  {e.text}") for e in events]
    stamps = np.clip([e.t for e in events], t[0], t[-1])
    writer.rows("events", stamps, rr.TextLog.columns(text=text, level=[e.level for e in events]))


def _lane(writer: Writer, name: str, states: dict[float, str], colours: dict[str, Rgb]) -> None:
    """Write one lane: times since command start [s] to the state from then on."""
    visible = [state != CALM for state in colours]
    style = rr.StateConfiguration(values=list(colours), colors=list(colours.values()), visible=visible)
    writer.static(name, style)
    writer.rows(name, np.array(list(states)), rr.StateChange.columns(state=list(states.values())))


def _bars(writer: Writer, name: str, low: float, intervals: Sequence[Interval], colour: Rgb) -> None:
    """Write one lane of bars from time `low` on; where bars of a lane overlap, the later one shows."""
    states: dict[float, str] = {low: CALM}
    for one in sorted(intervals, key=lambda i: i.start):
        before = {t: state for t, state in states.items() if t <= one.start}
        states = before | {max(one.start, low): one.label, one.end: CALM}
    _lane(writer, name, states, {CALM: lines.GREY} | dict.fromkeys(set(states.values()) - {CALM}, colour))


def _events(comparison: Comparison) -> Iterator[Event]:
    motion, fit, run = comparison.motion, comparison.fit, comparison.run
    start = command_start(comparison)
    begin = float(motion.t[0] - start)
    kind = "virtual trial (written by a simulator)" if motion.virtual else "trial of a real robot"
    yield Event(begin, f"{kind}, {motion.variant.velocity:g} m/s, variant {motion.variant_source}")
    for warning in motion.warnings:
        yield Event(begin, warning, "WARN")
    yield Event(begin, f"filter: {motion.health.verdict}", "INFO" if motion.health.good else "WARN")
    for note in fit.notes:
        yield Event(begin, f"fit: {note}")
    if fit.status != "ok":
        yield Event(begin, f"fit of k_92: {fit.status.replace('_', ' ')}", "WARN")
    yield Event(0.0, f"command starts, at {plus_minus(motion.t_start, 's')} of the log's own time")
    t1, t2 = motion.steady
    slip = f"measured {plus_minus(motion.slip_ratio, '%', 100)}, simulated {100 * run.slip_ratio:.1f} %"
    yield Event(t2 - start, f"slip λ_R (2) over the steady part of {t2 - t1:.2f} s: {slip}")


def _found(comparison: Comparison, finding: Finding | None) -> Iterator[Event]:
    """Yield what a search found, at the start of the trial; for a trial that it left out, why."""
    if finding is None:
        return
    t = float(comparison.motion.t[0] - command_start(comparison))
    for trial, reason in finding.dropped:
        if trial == comparison.motion.trial:
            yield Event(t, f"left out of the search: {reason}", "WARN")
    if residuals_of(finding, comparison):
        answer = missing_answer(finding)
        text = f"{answer.question} {answer.verdict}. {answer.text}"
        yield Event(t, text, "INFO" if finding.verdict == "none" else "WARN")
        if latency := latency_in_words(finding.latency):
            yield Event(t, latency)


def _updates(comparison: Comparison, start: float) -> Iterator[Event]:
    """Yield where runs of measurement updates begin, and the updates that fit badly."""
    health = comparison.motion.health
    for kind in dict.fromkeys(health.kind):
        own = np.array([k == kind for k in health.kind])
        t = health.t[own] - start
        pause = 5 * float(np.median(np.diff(t))) if len(t) > 2 else np.inf
        for run in np.split(t, np.flatnonzero(np.diff(t) > max(pause, 0.25)) + 1):
            mean = f"mean normalized innovation squared of all: {health.nis.get(kind, np.nan):.2f}"
            what = f"{kind.replace('_', '-')} updates: {len(run)}, until {run[-1]:.2f} s"
            yield Event(float(run[0]), f"{what} ({mean})")
    ratio = np.abs(health.innovation) / np.where(health.innovation_std > 0, health.innovation_std, np.inf)
    for i in [i for i in np.argsort(-ratio) if ratio[i] > OUTLIER][:MOST_OUTLIERS]:
        text = f"{health.kind[i].replace('_', '-')} update {ratio[i]:.1f} times its std off"
        yield Event(float(health.t[i] - start), text, "WARN")
