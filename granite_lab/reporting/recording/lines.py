"""One trial over time in a recording: plotted lines, bars of phases and intervals, and log lines.

Measured lines are thin and drawn over wide simulated ones, so that both are visible where they agree.
Rerun draws the entities of a plot in the order of their names, hence ``from_model`` before ``measured``.
Entities have the names that the report gives to quantities: words, joined by underscores.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import cycle
from typing import NamedTuple

import numpy as np
import rerun as rr

from granite_lab.comparison.compare import Comparison
from granite_lab.discovery.finding import Finding, Residual
from granite_lab.logs.counters import mean_known
from granite_lab.logs.trial import Array
from granite_lab.parameters import WHEELS
from granite_lab.reporting.answers import missing_answer
from granite_lab.reporting.names import latency_in_words, sensor, sensors_in_words
from granite_lab.reporting.recording.stream import Writer, drawable
from granite_lab.rounding import axis_unit, percent, plus_minus, significant

Rgb = tuple[int, int, int]

# Okabe and Ito's colours, told apart by every kind of colour vision, the dark blue lightened for a dark
# ground. As in the report's figures, blue tones are measured and orange tones simulated.
SKY, BLUE, ORANGE, VERMILION = (86, 180, 233), (40, 120, 215), (230, 159, 0), (213, 94, 0)
GREEN, PURPLE, GREY = (0, 158, 115), (204, 121, 167), (150, 150, 150)
MEASURED, SIMULATED = SKY, ORANGE
OF_WHEELS = (SKY, GREEN, BLUE, PURPLE)
THIN, WIDE = 1.5, 4.0
"""Widths of measured and of simulated lines, in points of the screen."""

FINE, MEDIUM, COARSE = 0.01, 0.02, 0.04
"""Spacing of lines [s], enough for the eye: channels; differences and single wheels; innovations."""
MOST_ROWS = 20_000
"""A line of more samples is thinned, so that a log of an hour still opens."""

CHANNELS = {
    "velocity": {"velocity": ""},
    "slip": {"slip_f": "front", "slip_r": "rear"},
    "torque": {"torque_f": "front", "torque_r": "rear"},
    "pitch": {"pitch": ""},
    "wheel_speed": {f"wheel_{w}": w for w in WHEELS},
    "forward_acceleration": {"accel": ""},
    "pitch_rate": {"pitch_rate": ""},
}
"""Plot to the channels of the comparison that it shows, and what distinguishes them."""


@dataclass(frozen=True, eq=False)
class Line:
    """One entity of a plot: a line, or several that share their stamps.

    Attributes:
        entity: path below the trial's root; its first part names the plot.
        names: (K,) in the legend, without unit.
        unit: of the samples, as in the records until `shown` turns it into the one that is drawn.
        t: (N,) time since command start [s].
        value: (N,) or (N, K) samples; NaN makes a gap.
        colours: (K,) red, green, blue.
        widths: (K,) in points of the screen; empty where all are `THIN`.
        std: as `value`, drawn as a band of one standard deviation on both sides.
        step: smallest spacing that is kept [s].
        dots: single dots, not joined by lines.
    """

    entity: str
    names: tuple[str, ...]
    unit: str
    t: Array
    value: Array
    colours: tuple[Rgb, ...]
    widths: tuple[float, ...] = ()
    std: Array | None = None
    step: float = 0.0
    dots: bool = False

    def shown(self) -> Line:
        """Return the line as drawn: in the shown unit, thinned, NaN for what is not finite."""
        rows = len(self.t)
        spacing = float(np.ptp(self.t)) / (rows - 1) if rows > 1 else 0.0
        n = max(1, round(self.step / spacing) if spacing > 0 else 1, -(-rows // MOST_ROWS))
        unit, factor = axis_unit(self.unit)
        value = factor * self.value[::n]
        std = None if self.std is None else factor * self.std[::n]
        return replace(
            self, unit=unit, t=self.t[::n], value=np.where(np.isfinite(value), value, np.nan), std=std
        )


def _simulated(
    plot: str, names: tuple[str, ...], unit: str, t: Array, value: Array, colours: tuple[Rgb, ...]
) -> Line:
    """Return wide lines that measured ones are drawn over; a second colour is narrower."""
    widths = tuple(WIDE if colour == colours[0] else WIDE - 1.5 for colour in colours)
    return Line(f"{plot}/from_model", names, unit, t, value, colours, widths, step=FINE)


def lines_of(comparison: Comparison, finding: Finding | None = None) -> list[Line]:
    """Return every line of a trial as shown, with simulations of a finding; none without a finite sample."""
    motion, start = comparison.motion, comparison.start
    run, t = comparison.run, motion.t - start
    wheels = mean_known(motion.v_wheel, 1)
    lines = [
        Line("velocity/desired", ("desired",), "m/s", run.t, run["v_desired_mps"], (GREY,), step=FINE),
        Line("velocity/wheels", ("wheels, measured",), "m/s", t, wheels, (GREEN,), step=FINE),
        Line("slip_of_each_wheel/measured", WHEELS, "-", t, motion.slip, OF_WHEELS, step=MEDIUM),
        *_channels(comparison), *_innovations(comparison),
    ]  # fmt: skip
    if (reference := comparison.trial.reference_v) is not None:
        t = reference.t - start
        lines.append(Line("velocity/reference", ("reference",), "m/s", t, reference.value, (PURPLE,)))
    if (drawn := comparison.trial.currents) is not None:
        t, value = drawn.t - start, drawn.current
        lines.append(
            Line("motor_current/measured", WHEELS, "A", t, value, OF_WHEELS, (1.0,) * 4, step=MEDIUM)
        )
    if finding is not None:
        lines += _augmented(finding, comparison)
    return [line for line in (line.shown() for line in lines) if not np.isnan(line.value).all()]


def _channels(c: Comparison) -> Iterator[Line]:
    """Yield each channel of the comparison as simulated and as measured, and the difference."""
    for plot, channels in CHANNELS.items():
        ids, unit = list(channels), c.units[next(iter(channels))]
        ghosts = {"front, simulated": ids[0], "rear, simulated": ids[-1]}
        ghosts = ghosts if len(ids) > 1 else {"simulated": ids[0]}
        value = np.column_stack([c.simulated[k] for k in ghosts.values()])
        yield _simulated(plot, tuple(ghosts), unit, c.t, value, (SIMULATED, VERMILION)[: len(ghosts)])
        step, drawn = (FINE, (SKY, BLUE)) if len(ids) < len(WHEELS) else (MEDIUM, OF_WHEELS)
        colours = dict(zip(ids, drawn, strict=False))
        measured = [k for k in ids if k in c.measured]
        for k in measured:
            entity, name = f"{plot}/measured_{channels[k]}", f"{channels[k]}, measured"
            names, value, std = (name.removeprefix(", "),), c.measured[k], c.measured_std[k]
            yield Line(entity.rstrip("_"), names, unit, c.t, value, (colours[k],), std=std, step=step)
        if measured:
            gap = np.column_stack([c.simulated[k] - c.measured[k] for k in measured])
            labels = tuple(channels[k] or "difference" for k in measured)
            few, entity = tuple(colours[k] for k in measured), f"difference_{plot}/simulated_minus_measured"
            yield Line(entity, labels, unit, c.t, gap, few, step=MEDIUM)


def _innovations(comparison: Comparison) -> Iterator[Line]:
    """Yield the innovations of the filter, in units of their predicted std."""
    start, health = comparison.start, comparison.motion.health
    scale = np.where(health.innovation_std > 0, health.innovation_std, np.nan)
    for kind, colour in zip(dict.fromkeys(health.kind), cycle((*OF_WHEELS, VERMILION, GREY))):
        of_kind = np.array([k == kind for k in health.kind])
        ratio = (health.innovation / scale)[of_kind]
        entity, names = f"innovation/{kind}", (kind.replace("_", " "),)
        t = health.t[of_kind] - start
        yield Line(entity, names, "σ", t, ratio, (colour,), (1.3,), step=COARSE, dots=True)


def fitted_plot(channel: str) -> str:
    """Return the plot of a sensor as the search fitted it."""
    return f"fitted_{entity_of(sensor(channel))}"


def entity_of(name: str) -> str:
    """Return a name of the report as an entity."""
    return str(rr.escape_entity_path_part(re.sub(r"\W+", "_", name)))


def residuals_of(finding: Finding, comparison: Comparison) -> list[Residual]:
    """Return what a search holds of the comparison's trial."""
    return [r for r in finding.residuals if r.trial == comparison.motion.trial]


def _augmented(finding: Finding, comparison: Comparison) -> Iterator[Line]:
    """Yield what the sensors read beside the simulation without and with what was found.

    Wheel angles grow all the time, so that of them the difference to the simulation is drawn.
    """
    effect, later = ("without the effect", "with the effect"), (VERMILION, GREEN)
    many = 2 if finding.terms else 1
    for r in residuals_of(finding, comparison):
        t = r.t + r.t_start - comparison.start
        both = np.column_stack([r.before, r.after][:many])
        names, plot = effect if many > 1 else ("simulated",), fitted_plot(r.channel)
        if r.unit == "rad":
            both = r.measured[:, None] - both
        else:
            yield Line(f"{plot}/measured", ("measured",), r.unit, t, r.measured, (MEASURED,))
        yield _simulated(plot, names, r.unit, t, both, later[:many])


def write_lines(writer: Writer, lines: Iterable[Line]) -> None:
    """Write lines and dots; of lines, the viewer itself puts the unit behind the name."""
    for line in lines:
        many = len(line.names)
        if line.dots:
            names = [f"{name} [{line.unit}]" for name in line.names]
            style = rr.SeriesPoints(names=names, colors=line.colours, marker_sizes=line.widths)
            columns = rr.Scalars.columns(scalars=line.value.ravel())
        else:
            style = rr.Measurements.from_fields(
                names=line.names, units=[line.unit] * many, colors=line.colours,
                widths=line.widths or (THIN,) * many,
            )  # fmt: skip
            bands = {} if line.std is None else {"variances": np.square(line.std).ravel()}
            columns = rr.Measurements.columns(values=line.value.ravel(), **bands)
        writer.static(line.entity, style)
        writer.rows(line.entity, line.t, columns.partition([many] * len(line.t)) if many > 1 else columns)


PHASES = {
    "rest": ("rest", GREY), "accelerate": ("accel.", GREEN), "steady": ("steady", BLUE),
    "brake": ("brake", PURPLE),
}  # fmt: skip
"""Phase to its label, which short bars have room for, and its colour."""
DIFFERS = "simulation_differs"
"""First part of the lanes that show where simulation and measurement disagree."""
STANDSTILL = "standstill"
CALM = "none"
OUTLIER = 4.0
"""Innovation, in its predicted std, from which a measurement update is worth a line."""
MOST_OUTLIERS = 20


class Interval(NamedTuple):
    """A bar: start and end since command start [s], its channel, which is a lane, and share of its rms."""

    start: float
    end: float
    channel: str
    share: float

    @property
    def label(self) -> str:
        """The share [%] without its sign, so that a short bar has room for it."""
        return significant(100 * self.share, 2)


class Event(NamedTuple):
    """One log line: time since command start [s], text, and level, "INFO" or "WARN"."""

    t: float
    text: str
    level: str = "INFO"


def intervals_of(comparison: Comparison, finding: Finding | None) -> list[Interval]:
    """Return where a search found the simulation to differ, on the comparison's clock, within the log.

    A disagreement that was found is shared by the repetitions of a command: it holds for each of its trials.
    Those of a sensor that touch become one, with the largest share.
    """
    residuals = residuals_of(finding, comparison) if finding is not None else []
    if finding is None or not residuals:
        return []
    start = comparison.start
    late = residuals[0].t_start - start
    low, high = float(comparison.motion.t[0] - start), float(comparison.motion.t[-1] - start)
    merged: list[Interval] = []
    for d in sorted(finding.where, key=lambda d: (d.channel, d.start)):
        begin, end = max(d.start + late, low), min(d.end + late, high)
        if d.variant != residuals[0].variant or begin >= end:
            continue
        bar, last = Interval(begin, end, sensor(d.channel), d.share), merged[-1] if merged else None
        if last is not None and last.channel == bar.channel and begin <= last.end + MEDIUM:
            share = max(bar.share, last.share)
            merged[-1] = Interval(last.start, max(end, last.end), bar.channel, share)
        else:
            merged.append(bar)
    return merged


def write_events(
    writer: Writer, comparison: Comparison, intervals: Sequence[Interval], finding: Finding | None
) -> None:
    """Write phases, standstills, intervals of disagreement and log lines."""
    motion = comparison.motion
    start = comparison.start
    t = motion.t - start
    first = [0] + [i for i in range(1, len(t)) if motion.phase[i] != motion.phase[i - 1]]
    _lane(writer, "phase", {float(t[i]): motion.phase[i] for i in first}, PHASES)
    rests = [(a - start, b - start, "at rest") for a, b in motion.health.rests]
    _bars(writer, STANDSTILL, float(t[0]), rests, GREY)
    for channel in sorted({i.channel for i in intervals}):
        bars = [(i.start, i.end, i.label) for i in intervals if i.channel == channel]
        _bars(writer, f"{DIFFERS}/{entity_of(channel)}", float(t[0]), bars, VERMILION)
    events = [*_events(comparison), *_updates(comparison), *_of_search(comparison, finding)]
    for bar in intervals:
        sentence = f"simulated {bar.channel} differs from the measured one by up to {bar.label} % of its rms"
        events.append(Event(bar.start, f"{sentence}, {bar.start:.2f} s to {bar.end:.2f} s", "WARN"))
    events.sort(key=lambda e: e.t)
    text = [drawable(f"{e.t:6.2f} s  {e.text}") for e in events]
    stamps = np.clip([e.t for e in events], t[0], t[-1])
    writer.rows("events", stamps, rr.TextLog.columns(text=text, level=[e.level for e in events]))


def _lane(writer: Writer, name: str, states: dict[float, str], looks: dict[str, tuple[str, Rgb]]) -> None:
    """Write one lane: times since command start [s] to the state from then on, and each state's looks."""
    labels, colours = zip(*looks.values(), strict=True)
    style = rr.StateConfiguration(
        values=list(looks), labels=labels, colors=colours, visible=[state != CALM for state in looks]
    )
    writer.static(name, style)
    writer.rows(name, np.array(list(states)), rr.StateChange.columns(state=list(states.values())))


def _bars(
    writer: Writer, name: str, low: float, bars: Sequence[tuple[float, float, str]], colour: Rgb
) -> None:
    """Write one lane of bars (start, end and label), which do not overlap, from time `low` on."""
    states = {low: CALM}
    for start, end, label in sorted(bars):
        states |= {max(start, low): label, end: CALM}
    _lane(writer, name, states, {CALM: ("", GREY)} | {label: (label, colour) for _, _, label in bars})


def _events(comparison: Comparison) -> Iterator[Event]:
    motion, fit, run = comparison.motion, comparison.fit, comparison.run
    start = comparison.start
    begin = float(motion.t[0] - start)
    kind = "virtual trial (written by a simulator)" if motion.virtual else "trial of a real robot"
    yield Event(begin, f"{kind}, {motion.variant.velocity:g} m/s, variant {motion.variant_source}")
    for warning in motion.warnings:
        yield Event(begin, warning, "WARN")
    yield Event(begin, f"filter: {motion.health.verdict}", "INFO" if motion.health.good else "WARN")
    for note in fit.notes:
        yield Event(begin, f"fit: {sensors_in_words(note)}")
    for warning in fit.warnings:
        yield Event(begin, warning, "WARN")
    if fit.status != "ok":
        yield Event(begin, f"fit of k_92: {fit.status.replace('_', ' ')}", "WARN")
    yield Event(0.0, f"command starts, at {plus_minus(motion.t_start, 's')} of the log's own time")
    t1, t2 = motion.steady
    slip = f"measured {plus_minus(motion.slip_ratio, '%', 100)}, simulated {percent(run.slip_ratio)}"
    yield Event(t2 - start, f"slip λ_R (2) over the steady part of {t2 - t1:.2f} s: {slip}")


def _of_search(comparison: Comparison, finding: Finding | None) -> Iterator[Event]:
    """Yield what a search found, at the start of the trial; for a trial that it left out, why."""
    if finding is None:
        return
    t = float(comparison.motion.t[0] - comparison.start)
    for trial, reason in finding.dropped:
        if trial == comparison.motion.trial:
            yield Event(t, f"left out of the search: {reason}", "WARN")
    if residuals_of(finding, comparison):
        answer = missing_answer(finding)
        text = f"{answer.question} {answer.verdict}. {answer.text}"
        yield Event(t, text, "INFO" if finding.verdict == "none" else "WARN")
        if latency := latency_in_words(finding.latency):
            yield Event(t, latency)


def _updates(comparison: Comparison) -> Iterator[Event]:
    """Yield where runs of measurement updates begin, and the updates that fit badly."""
    start, health = comparison.start, comparison.motion.health
    for kind in dict.fromkeys(health.kind):
        of_kind = np.array([k == kind for k in health.kind])
        t = health.t[of_kind] - start
        pause = 5 * float(np.median(np.diff(t))) if len(t) > 2 else np.inf
        for run in np.split(t, np.flatnonzero(np.diff(t) > max(pause, 0.25)) + 1):
            nis = significant(health.nis.get(kind, np.nan), 2)
            text = f"{kind.replace('_', '-')} updates: {len(run)}, until {run[-1]:.2f} s"
            yield Event(float(run[0]), f"{text} (mean normalised innovation squared of all: {nis})")
    ratio = np.abs(health.innovation) / np.where(health.innovation_std > 0, health.innovation_std, np.inf)
    for i in [i for i in np.argsort(-ratio) if ratio[i] > OUTLIER][:MOST_OUTLIERS]:
        text = f"{health.kind[i].replace('_', '-')} update {ratio[i]:.1f} times its std off"
        yield Event(float(health.t[i] - start), text, "WARN")
