"""Plotted lines of one trial: what is drawn, its entity, name, unit, colour and samples.

All numbers are SI, the same as in the motion and run CSV files.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain, cycle

import numpy as np
import rerun as rr

from granite_lab.comparison.record import Comparison
from granite_lab.logs.trial import Array, Trial
from granite_lab.parameters import WHEELS
from granite_lab.reporting.recording.stream import Writer

Rgb = tuple[int, int, int]

# Okabe and Ito's colours, told apart by every kind of colour vision, the dark blue lightened for a dark
# ground. As in the report's figures, blue tones are measured and orange tones simulated.
SKY, BLUE, ORANGE, VERMILION = (86, 180, 233), (40, 120, 215), (230, 159, 0), (213, 94, 0)
GREEN, PURPLE, GREY = (0, 158, 115), (204, 121, 167), (150, 150, 150)
MEASURED, SIMULATED = SKY, ORANGE
OF_WHEELS = (SKY, GREEN, BLUE, PURPLE)

FINE, MEDIUM, COARSE = 0.01, 0.02, 0.04
"""Spacing of lines [s]: sensors and simulation; single wheels, residuals and currents; ±2σ lines and biases.

The estimated velocity and pitch keep every sample; the others keep enough for the eye.
"""
MOST_ROWS = 20_000
"""A line of more samples is thinned, so that a log of an hour still opens."""

RESIDUALS = {
    "residual_velocity": ("m/s", {"velocity": "body"}),
    "residual_wheel": ("m/s", {f"wheel_{wheel}": f"wheel {wheel}" for wheel in WHEELS}),
    "residual_slip": ("-", {"slip_f": "front", "slip_r": "rear"}),
    "residual_torque": ("N m", {"torque_f": "front", "torque_r": "rear"}),
    "residual_pitch": ("rad", {"pitch": "pitch"}),
    "residual_accel": ("m/s²", {"accel": "specific force, forward"}),
    "residual_pitch_rate": ("rad/s", {"pitch_rate": "pitch rate"}),
}
"""Plot of residuals to unit and channels with their names."""


@dataclass(frozen=True, eq=False)
class Line:
    """One entity of a plot: a line, or several that share their stamps.

    Attributes:
        entity: path below the trial's root; its first part names the plot.
        names: (K,) in the legend, unit included.
        t: (N,) time since command start [s].
        value: (N,) or (N, K) samples; NaN makes a gap.
        colours: (K,) red, green, blue.
        width: in points of the screen.
        step: smallest spacing that is kept [s].
        dots: single dots, not joined by lines.
    """

    entity: str
    names: tuple[str, ...]
    t: Array
    value: Array
    colours: tuple[Rgb, ...]
    width: float = 1.5
    step: float = 0.0
    dots: bool = False

    def thinned(self) -> Line:
        """Return the line with every n-th sample only, where that is enough."""
        rows = len(self.t)
        spacing = (self.t[-1] - self.t[0]) / max(rows - 1, 1)
        n = max(1, round(self.step / spacing) if spacing > 0 else 1, -(-rows // MOST_ROWS))
        return replace(self, t=self.t[::n], value=self.value[::n])


def command_start(comparison: Comparison) -> float:
    """Return the log's own time [s] at which the comparison's clock reads zero."""
    motion = comparison.motion
    if len(motion.t) == len(comparison.t):
        return float(np.median(motion.t - comparison.t))
    start = comparison.fit.t_start.value
    return start if np.isfinite(start) else motion.t_start.value


def lines_of(trial: Trial, comparison: Comparison) -> Iterator[Line]:
    """Yield every line of a trial; one without a single finite sample is left out."""
    for line in chain(
        _motion(trial, comparison),
        _axles(comparison),
        _residuals(comparison),
        _sensors(trial, comparison),
        _filter(comparison),
    ):
        value = np.where(np.isfinite(line.value), line.value, np.nan)
        if not np.isnan(value).all():
            yield replace(line, value=value).thinned()


def _band(
    entity: str, name: str, t: Array, value: Array, std: Array, colour: Rgb, step: float = 0
) -> Iterator[Line]:
    """Yield a line and the two thin lines two standard deviations beside it."""
    yield Line(entity, (name,), t, value, (colour,), 2.0, step)
    both = np.column_stack([value - 2 * std, value + 2 * std])
    label = "±2σ " + re.sub("^(measured|estimated|meas.) ", "", name)
    yield Line(f"{entity}_2sigma", (label,) * 2, t, both, (colour,) * 2, 0.7, COARSE)


def _motion(trial: Trial, comparison: Comparison) -> Iterator[Line]:
    motion, run = comparison.motion, comparison.run
    start = command_start(comparison)
    t = motion.t - start
    yield Line("velocity/desired", ("desired [m/s]",), run.t, run["v_desired_mps"], (GREY,), step=FINE)
    yield Line("velocity/wheels", ("wheels [m/s]",), t, _mean(motion.v_wheel), (GREEN,), step=FINE)
    yield from _band("velocity/measured", "measured [m/s]", t, motion.v, motion.v_std, MEASURED)
    yield Line("velocity/simulated", ("simulated [m/s]",), run.t, run["v_mps"], (SIMULATED,), 2.0, FINE)
    if trial.reference_v is not None:
        reference = trial.reference_v
        yield Line(
            "velocity/reference", ("reference [m/s]",), reference.t - start, reference.value, (PURPLE,)
        )
    yield from _band("pitch/measured", "measured [rad]", t, motion.pitch, motion.pitch_std, MEASURED)
    yield Line("pitch/simulated", ("simulated [rad]",), run.t, run["pitch_rad"], (SIMULATED,), 2.0, FINE)
    for entity, unit, value in (("wheel_velocity", "m/s", motion.v_wheel), ("wheel_slip", "-", motion.slip)):
        names = tuple(f"{wheel} [{unit}]" for wheel in WHEELS)
        yield Line(f"{entity}/measured", names, t, value, OF_WHEELS, step=MEDIUM)


def _axles(comparison: Comparison) -> Iterator[Line]:
    """Yield slip and torque of the axles, front and rear."""
    c, run = comparison, comparison.run
    for axle, name, cold, warm in (("f", "front", SKY, ORANGE), ("r", "rear", BLUE, VERMILION)):
        for kind, unit, signal in (("slip", "-", f"slip_{axle}"), ("torque", "N m", f"torque_{axle}_Nm")):
            channel = f"{kind}_{axle}"
            if channel in c.measured:
                label = f"meas. {name} [{unit}]"
                value, std = c.measured[channel], c.measured_std[channel]
                yield from _band(f"{kind}/measured_{name}", label, c.t, value, std, cold, FINE)
            label = f"sim. {name} [{unit}]"
            yield Line(f"{kind}/simulated_{name}", (label,), run.t, run[signal], (warm,), 2.0, FINE)


def _residuals(comparison: Comparison) -> Iterator[Line]:
    """Yield simulated minus measured per channel."""
    c = comparison
    for plot, (unit, channels) in RESIDUALS.items():
        known = [k for k in channels if k in c.measured and k in c.simulated]
        if known:
            value = np.column_stack([c.simulated[k] - c.measured[k] for k in known])
            names = tuple(f"{channels[k]} [{unit}]" for k in known)
            colours = OF_WHEELS if len(channels) == len(WHEELS) else (MEASURED, BLUE)
            yield Line(f"{plot}/difference", names, c.t, value, colours[: len(known)], step=MEDIUM)


def _sensors(trial: Trial, comparison: Comparison) -> Iterator[Line]:
    """Yield what the sensors read, beside what the model says they should."""
    c, start = comparison, command_start(comparison)
    for channel, unit, plot in (("accel", "m/s²", "specific_force"), ("pitch_rate", "rad/s", "pitch_rate")):
        if channel in c.measured:
            yield Line(
                f"{plot}/measured", (f"measured [{unit}]",), c.t, c.measured[channel], (MEASURED,), 1.0, FINE
            )
            name = (f"simulated [{unit}]",)
            yield Line(f"{plot}/simulated", name, c.t, c.simulated[channel], (SIMULATED,), 2.0, FINE)
    if trial.imu is not None:
        names = tuple(f"sensor's {axis} [m/s²]" for axis in "xyz")
        t, force = trial.imu.t - start, trial.imu.specific_force
        yield Line("imu/specific_force", names, t, force, (SKY, GREEN, PURPLE), 1.0, MEDIUM)
    if trial.currents is not None:
        names = tuple(f"{wheel} [A]" for wheel in WHEELS)
        yield Line(
            "current/measured",
            names,
            trial.currents.t - start,
            trial.currents.current,
            OF_WHEELS,
            1.0,
            MEDIUM,
        )


def _filter(comparison: Comparison) -> Iterator[Line]:
    """Yield the estimated biases, and the innovations in units of their predicted std."""
    start = command_start(comparison)
    health, t = comparison.motion.health, comparison.motion.t - start
    for plot, unit, value, std in (
        ("accel_bias", "m/s²", health.accel_bias, health.accel_bias_std),
        ("gyro_bias", "rad/s", health.gyro_bias, health.gyro_bias_std),
    ):
        yield from _band(f"{plot}/estimated", f"estimated [{unit}]", t, value, std, MEASURED, COARSE)
    scale = np.where(health.innovation_std > 0, health.innovation_std, np.nan)
    kinds = tuple(dict.fromkeys(health.kind))
    for kind, colour in zip(kinds, cycle((*OF_WHEELS, VERMILION, GREY))):
        own = np.array([k == kind for k in health.kind])
        ratio = (health.innovation / scale)[own]
        name = (f"{kind.replace('_', ' ')} [σ]",)
        yield Line(
            f"innovation/{kind}", name, health.t[own] - start, ratio, (colour,), 1.3, COARSE, dots=True
        )


def robot_slip(comparison: Comparison) -> Iterator[Line]:
    """Yield the mean slip ratio of the wheels, measured and simulated, for overlays of many trials."""
    motion, run = comparison.motion, comparison.run
    t = motion.t - command_start(comparison)
    yield Line(
        "robot_slip/measured", ("measured [-]",), t, _mean(motion.slip), (MEASURED,), step=FINE
    ).thinned()
    mean = (run["slip_f"] + run["slip_r"]) / 2
    yield Line("robot_slip/simulated", ("simulated [-]",), run.t, mean, (SIMULATED,), step=FINE).thinned()


def _mean(values: Array) -> Array:
    """Return the mean over the wheels that were measured, NaN where none was; (N, 4) to (N,)."""
    known = np.isfinite(values)
    count = known.sum(axis=1)
    total = np.where(known, values, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def write_lines(writer: Writer, lines: Iterable[Line]) -> None:
    """Write the lines of a trial."""
    for line in lines:
        many = len(line.names)
        names, widths = line.names, [line.width] * many
        style = (
            rr.SeriesPoints(names=names, colors=line.colours, marker_sizes=widths)
            if line.dots
            else rr.SeriesLines(names=names, colors=line.colours, widths=widths)
        )
        writer.static(line.entity, style)
        columns = rr.Scalars.columns(scalars=line.value.ravel())
        writer.rows(line.entity, line.t, columns.partition([many] * len(line.t)) if many > 1 else columns)
