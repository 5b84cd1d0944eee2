"""What happens when: phases and intervals as coloured bars, filter events and doubts as log lines."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
import rerun as rr

from granite_lab.comparison.record import Comparison
from granite_lab.reporting.recording.signals import BLUE, GREEN, GREY, PURPLE, VERMILION, Rgb, command_start
from granite_lab.reporting.recording.stream import Writer

PHASES = {"rest": GREY, "accelerate": GREEN, "steady": BLUE, "brake": PURPLE}
CALM = "none"
OUTLIER = 4.0
"""Innovation, in its predicted std, from which a measurement update is worth a line."""
MOST_OUTLIERS = 20


@dataclass(frozen=True)
class Interval:
    """A stretch of time in which simulation and measurement disagree.

    Attributes:
        start, end: time since command start [s].
        channel: of the comparison, such as "velocity"; each channel is one lane.
        label: what the bar says.
    """

    start: float
    end: float
    channel: str
    label: str = "disagrees"


@dataclass(frozen=True)
class Event:
    """One log line.

    Attributes:
        t: time since command start [s].
        text: the line.
        level: "INFO" or "WARN".
    """

    t: float
    text: str
    level: str = "INFO"


def within(intervals: Sequence[Interval], comparison: Comparison) -> list[Interval]:
    """Return the intervals cut to the time of the log, without those outside it."""
    τ = comparison.motion.t - command_start(comparison)
    cut = [replace(i, start=max(i.start, float(τ[0])), end=min(i.end, float(τ[-1]))) for i in intervals]
    return [i for i in cut if i.start < i.end]


def lanes_of(intervals: Sequence[Interval]) -> int:
    """Return how many lanes of bars `write_events` draws."""
    return 2 + len({i.channel for i in intervals})


def write_events(
    writer: Writer, comparison: Comparison, intervals: Sequence[Interval], further: Sequence[Event] = ()
) -> None:
    """Write phases, standstills, intervals of disagreement, log lines and further ones."""
    motion = comparison.motion
    start = command_start(comparison)
    t = motion.t - start
    first = [0] + [i for i in range(1, len(t)) if motion.phase[i] != motion.phase[i - 1]]
    _lane(writer, "phase", t[first].tolist(), [motion.phase[i] for i in first], dict(PHASES))
    rests = [Interval(a - start, b - start, "standstill", "at rest") for a, b in motion.health.rests]
    _bars(writer, "standstill", within(rests, comparison), t[0], GREY)
    for channel in sorted({i.channel for i in intervals}):
        own = [i for i in intervals if i.channel == channel]
        lane = re.sub(r"\W+", "_", channel)
        name = f"simulation_differs/{rr.escape_entity_path_part(lane)}"
        _bars(writer, name, own, t[0], VERMILION)
    events = sorted([*_events(comparison, intervals), *further], key=lambda e: e.t)
    levels = [e.level for e in events]
    stamps = np.clip([e.t for e in events], t[0], t[-1])
    writer.rows(
        "events", stamps, rr.TextLog.columns(text=[f"{e.t:6.2f} s  {e.text}" for e in events], level=levels)
    )


def _lane(
    writer: Writer,
    name: str,
    t: Sequence[float],
    states: Sequence[str],
    colours: dict[str, Rgb],
) -> None:
    values = list(colours)
    writer.static(
        f"bars/{name}",
        rr.StateConfiguration(
            values=values,
            labels=["" if v == CALM else v for v in values],
            colors=[colours[v] for v in values],
            visible=[v != CALM for v in values],
        ),
    )
    writer.rows(f"bars/{name}", np.asarray(t), rr.StateChange.columns(state=list(states)))


def _bars(writer: Writer, name: str, intervals: Sequence[Interval], low: float, colour: Rgb) -> None:
    """Write one lane of bars from time `low` on; where bars of a lane overlap, the later one shows."""
    changes: dict[float, str] = {float(low): CALM}
    for one in sorted(intervals, key=lambda i: i.start):
        changes = {t: s for t, s in changes.items() if t <= one.start} | {one.start: one.label, one.end: CALM}
    labels = dict.fromkeys(s for s in changes.values() if s != CALM)
    t = sorted(changes)
    _lane(writer, name, t, [changes[k] for k in t], {CALM: (60, 60, 60)} | dict.fromkeys(labels, colour))


def _events(comparison: Comparison, intervals: Sequence[Interval]) -> Iterator[Event]:
    motion, fit, run = comparison.motion, comparison.fit, comparison.run
    start = command_start(comparison)
    begin = float(motion.t[0] - start)
    kind = "virtual trial (written by a simulator)" if motion.virtual else "trial of a real robot"
    yield Event(begin, f"{kind}, {motion.variant.velocity:g} m/s, variant {motion.variant_source}")
    for warning in motion.warnings:
        yield Event(begin, warning, "WARN")
    verdict = motion.health.verdict
    yield Event(begin, f"filter: {verdict}", "INFO" if motion.health.good else "WARN")
    for note in fit.notes:
        yield Event(begin, f"fit: {note}")
    if fit.status != "ok":
        yield Event(begin, f"fit of k_92: {fit.status.replace('_', ' ')}", "WARN")
    yield Event(0.0, f"command starts ({start:.3f} ± {motion.t_start.std:.3f} s in the log's time)")
    for phase, rows in groupby(range(len(motion.t)), key=lambda i: motion.phase[i]):
        yield Event(float(motion.t[next(rows)] - start), f"phase: {phase}")
    for a, b in motion.health.rests:
        yield Event(a - start, f"standstill found: {a - start:.2f} s to {b - start:.2f} s")
    yield from _updates(comparison, start)
    for one in intervals:
        yield Event(one.start, f"{one.channel}: {one.label}, {one.start:.2f} s to {one.end:.2f} s", "WARN")
    t1, t2 = motion.steady
    λ = motion.slip_ratio
    slip = f"measured {λ.value:.4f} ± {λ.std:.4f}, simulated {run.slip_ratio:.4f}"
    yield Event(t2 - start, f"slip ratio λ_R (2) over the steady part of {t2 - t1:.2f} s: {slip}")


def _updates(comparison: Comparison, start: float) -> Iterator[Event]:
    """Yield where runs of measurement updates begin, and the updates that fit badly."""
    health = comparison.motion.health
    for kind in dict.fromkeys(health.kind):
        own = np.array([k == kind for k in health.kind])
        t = health.t[own] - start
        pause = 5 * float(np.median(np.diff(t))) if len(t) > 2 else np.inf
        for run in np.split(t, np.flatnonzero(np.diff(t) > max(pause, 0.25)) + 1):
            what = f"{kind.replace('_', '-')} updates: {len(run)}, until {run[-1]:.2f} s"
            nis = health.nis.get(kind)
            yield Event(float(run[0]), what + (f" (mean NIS of all {nis:.2f})" if nis is not None else ""))
    ratio = np.abs(health.innovation) / np.where(health.innovation_std > 0, health.innovation_std, np.inf)
    bad = [i for i in np.argsort(-ratio) if ratio[i] > OUTLIER][:MOST_OUTLIERS]
    for i in bad:
        text = f"{health.kind[i].replace('_', '-')} update {ratio[i]:.1f} times its std off"
        yield Event(float(health.t[i] - start), text, "WARN")
