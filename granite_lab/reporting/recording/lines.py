"""Plotted lines of one trial: what is drawn, its entity, name, unit, colour and samples.

Measured lines are thin and drawn over simulated ones, which are wide: both are seen where they agree.
Rerun draws the entities of a plot in the order of their names, hence ``from_model`` before ``measured``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import cycle

import numpy as np
import rerun as rr

from granite_lab.comparison.record import Comparison
from granite_lab.discovery.finding import Finding, Residual
from granite_lab.logs.trial import Array, Trial
from granite_lab.parameters import WHEELS
from granite_lab.reporting.recording.stream import Writer
from granite_lab.reporting.summary import mean_of_known

Rgb = tuple[int, int, int]

# Okabe and Ito's colours, told apart by every kind of colour vision, the dark blue lightened for a dark
# ground. As in the report's figures, blue tones are measured and orange tones simulated.
SKY, BLUE, ORANGE, VERMILION = (86, 180, 233), (40, 120, 215), (230, 159, 0), (213, 94, 0)
GREEN, PURPLE, GREY = (0, 158, 115), (204, 121, 167), (150, 150, 150)
MEASURED, SIMULATED = SKY, ORANGE
OF_WHEELS = (SKY, GREEN, BLUE, PURPLE)
OF_TRIALS = (SKY, PURPLE, GREEN, BLUE, GREY)
THIN, WIDE = 1.5, 4.0
"""Widths of measured and of simulated lines, in points of the screen."""

FINE, MEDIUM, COARSE = 0.01, 0.02, 0.04
"""Spacing of lines [s], enough for the eye: channels; differences and single wheels; innovations."""
MOST_ROWS = 20_000
"""A line of more samples is thinned, so that a log of an hour still opens."""

SHOWN = {
    "-": ("%", 100.0), "rad": ("°", 180 / np.pi), "rad/s": ("°/s", 180 / np.pi), "m/s^2": ("m/s²", 1.0),
}  # fmt: skip
"""Unit of a record to the unit that is shown, and its factor; other units are shown as they are."""

CHANNELS = {
    "velocity": {"velocity": ""},
    "slip": {"slip_f": "front", "slip_r": "rear"},
    "torque": {"torque_f": "front", "torque_r": "rear"},
    "pitch": {"pitch": ""},
    "wheel_velocity": {f"wheel_{wheel}": wheel for wheel in WHEELS},
    "specific_force": {"accel": ""},
    "pitch_rate": {"pitch_rate": ""},
}
"""Plot to the channels of the comparison that it shows, and what tells them apart."""


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
        widths: (K,) in points of the screen.
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
    widths: tuple[float, ...] = (THIN,)
    std: Array | None = None
    step: float = 0.0
    dots: bool = False

    def shown(self) -> Line:
        """Return the line as drawn: in the shown unit, thinned, NaN for what is not finite."""
        rows = len(self.t)
        spacing = (self.t[-1] - self.t[0]) / max(rows - 1, 1)
        n = max(1, round(self.step / spacing) if spacing > 0 else 1, -(-rows // MOST_ROWS))
        unit, factor = SHOWN.get(self.unit, (self.unit, 1.0))
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


def command_start(comparison: Comparison) -> float:
    """Return the log's own time [s] at which the comparison's clock reads zero."""
    motion = comparison.motion
    if len(motion.t) == len(comparison.t):
        return float(np.median(motion.t - comparison.t))
    start = comparison.fit.t_start.value
    return start if np.isfinite(start) else motion.t_start.value


def lines_of(trial: Trial, comparison: Comparison, finding: Finding | None = None) -> list[Line]:
    """Return every line of a trial as shown; one without a single finite sample is left out.

    Args:
        trial, comparison: what was logged, and measured beside simulated.
        finding: of the search for the missing effect; its simulations join the plots.
    """
    motion, start = comparison.motion, command_start(comparison)
    run, t = comparison.run, motion.t - start
    wheels = mean_of_known(motion.v_wheel, 1)
    lines = [
        Line("velocity/desired", ("desired",), "m/s", run.t, run["v_desired_mps"], (GREY,), step=FINE),
        Line("velocity/wheels", ("wheels, measured",), "m/s", t, wheels, (GREEN,), step=FINE),
        Line("wheel_slip/measured", WHEELS, "-", t, motion.slip, OF_WHEELS, (THIN,) * 4, step=MEDIUM),
        *_channels(comparison), *_innovations(comparison),
    ]  # fmt: skip
    if (known := trial.reference_v) is not None:
        t = known.t - start
        lines.append(Line("velocity/reference", ("reference",), "m/s", t, known.value, (PURPLE,)))
    if (drawn := trial.currents) is not None:
        t, value = drawn.t - start, drawn.current
        lines.append(Line("current/measured", WHEELS, "A", t, value, OF_WHEELS, (1.0,) * 4, step=MEDIUM))
    if finding is not None:
        lines += _found(finding, comparison)
    return [line for line in (line.shown() for line in lines) if not np.isnan(line.value).all()]


def _channels(c: Comparison) -> Iterator[Line]:
    """Yield each channel of the comparison as simulated and as measured, and the difference."""
    for plot, channels in CHANNELS.items():
        ids, unit = list(channels), c.units[next(iter(channels))] or "-"
        ghosts = {"front, simulated": ids[0], "rear, simulated": ids[-1]}
        ghosts = ghosts if len(ids) > 1 else {"simulated": ids[0]}
        value = np.column_stack([c.simulated[k] for k in ghosts.values()])
        yield _simulated(plot, tuple(ghosts), unit, c.t, value, (SIMULATED, VERMILION)[: len(ghosts)])
        step, drawn = (FINE, (SKY, BLUE)) if len(ids) < len(WHEELS) else (MEDIUM, OF_WHEELS)
        colours = dict(zip(ids, drawn, strict=False))
        known = [k for k in ids if k in c.measured]
        for k in known:
            entity, name = f"{plot}/measured_{channels[k]}", f"{channels[k]}, measured"
            names, value, std = (name.removeprefix(", "),), c.measured[k], c.measured_std[k]
            yield Line(entity.rstrip("_"), names, unit, c.t, value, (colours[k],), std=std, step=step)
        if known:
            gap = np.column_stack([c.simulated[k] - c.measured[k] for k in known])
            labels, few = tuple(channels[k] or "difference" for k in known), tuple(colours[k] for k in known)
            widths = (THIN,) * len(known)
            yield Line(f"residual_{plot}/difference", labels, unit, c.t, gap, few, widths, step=MEDIUM)


def _innovations(comparison: Comparison) -> Iterator[Line]:
    """Yield the innovations of the filter, in units of their predicted std."""
    start, health = command_start(comparison), comparison.motion.health
    scale = np.where(health.innovation_std > 0, health.innovation_std, np.nan)
    for kind, colour in zip(dict.fromkeys(health.kind), cycle((*OF_WHEELS, VERMILION, GREY))):
        own = np.array([k == kind for k in health.kind])
        ratio = (health.innovation / scale)[own]
        entity, names = f"innovation/{kind}", (kind.replace("_", " "),)
        t = health.t[own] - start
        yield Line(entity, names, "σ", t, ratio, (colour,), (1.3,), step=COARSE, dots=True)


def residuals_of(finding: Finding, comparison: Comparison) -> list[Residual]:
    """Return what a search holds of the comparison's trial."""
    return [r for r in finding.residuals if r.trial == comparison.motion.trial]


def _found(finding: Finding, comparison: Comparison) -> Iterator[Line]:
    """Yield what the sensors read beside the simulation without and with what was found.

    Wheel angles grow all the time, so that of them the difference to the simulation is drawn.
    """
    effect, later = ("without the effect", "with the effect"), (VERMILION, GREEN)
    many = 2 if finding.effects else 1
    for r in residuals_of(finding, comparison):
        t = r.t + r.t_start - command_start(comparison)
        both = np.column_stack([r.before, r.after][:many])
        names = effect if many > 1 else ("simulated",)
        if r.unit == "rad":
            both = r.measured[:, None] - both
        else:
            yield Line(f"found_{r.channel}/measured", ("measured",), r.unit, t, r.measured, (MEASURED,))
        yield _simulated(f"found_{r.channel}", names, r.unit, t, both, later[:many])


def overlaid(row: str, name: str, comparison: Comparison, colour: Rgb) -> list[Line]:
    """Return velocity and mean slip of one trial, as shown, in plots of a row that many trials share."""
    motion, run = comparison.motion, comparison.run
    t, last = motion.t - command_start(comparison), rr.escape_entity_path_part(name)
    slip = (run["slip_f"] + run["slip_r"]) / 2
    lines = []
    for plot, unit, simulated, measured in (
        (f"{row}/velocity", "m/s", run["v_mps"], motion.v),
        (f"{row}/slip", "-", slip, mean_of_known(motion.slip, 1)),
    ):
        wide = _simulated(plot, ("simulated",), unit, run.t, simulated, (SIMULATED,))
        lines.append(replace(wide, entity=f"{wide.entity}/{last}"))
        lines.append(Line(f"{plot}/measured/{last}", (name,), unit, t, measured, (colour,), step=FINE))
    return [line.shown() for line in lines]


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
                names=line.names, units=[line.unit] * many, colors=line.colours, widths=line.widths
            )
            bands = {} if line.std is None else {"variances": np.square(line.std).ravel()}
            columns = rr.Measurements.columns(values=line.value.ravel(), **bands)
        writer.static(line.entity, style)
        writer.rows(line.entity, line.t, columns.partition([many] * len(line.t)) if many > 1 else columns)
