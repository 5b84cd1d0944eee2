"""Measured and simulated time histories averaged over the same bins.

Both sides are averaged alike, or a part of a bin's width would pass for a clock offset: velocity
and current as differences of their integrals, wheel speed as differences of the wheel's angle, all
at the bins' edges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid

from granite_lab.errors import EstimateError
from granite_lab.estimation.motion import Motion
from granite_lab.logs.trial import Array, Trial
from granite_lab.model import Run
from granite_lab.model.command import duration
from granite_lab.parameters import Robot

AXLES = {"f": (0, 1), "r": (2, 3)}
"""Columns of WHEELS that form a pair; the model's pairs are symmetric (section 3.3)."""

CHANNELS = ("velocity", "wheel_f", "wheel_r", "current_f", "current_r")
"""[m/s], [m/s], [m/s], [A], [A]."""

BIN = 0.05
"""Width of a bin [s]: a seventh of the time constant with which the robot settles."""

BEFORE, AFTER = 0.25, 0.5
"""How much of the standstill and of the coasting is looked at [s]."""

_VELOCITY_FLOOR = 1e-3  # smallest std of a velocity [m/s] that is believed


@dataclass(frozen=True, eq=False)
class Bins:
    """What was measured, per bin.

    Attributes:
        edges: (B + 1,) [s, the log's time].
        values: channel to (B,) means; NaN where the bin has no sample.
        std: channel to (B,) std of a mean.
    """

    edges: Array
    values: dict[str, Array]
    std: dict[str, Array]

    @property
    def width(self) -> float:
        """Width of a bin [s]."""
        return float(self.edges[1] - self.edges[0])


class SimulatedBins:
    """A run, ready to be averaged over any bins."""

    def __init__(self, run: Run) -> None:
        self.t = run.t
        self._integrals = {"velocity": cumulative_trapezoid(run["v_mps"], run.t, initial=0)}
        for axle in AXLES:
            self._integrals[f"wheel_{axle}"] = run.robot.wheels.radius * run[f"enc_{axle}_rad"]
            self._integrals[f"current_{axle}"] = cumulative_trapezoid(run[f"cur_{axle}_A"], run.t, initial=0)

    def __call__(self, channel: str, edges: Array, t_start: float) -> Array:
        """Return the means (B,) between edges [s, the log's time] when the command begins at `t_start`."""
        integral = np.interp(edges - t_start, self.t, self._integrals[channel])
        return np.asarray(np.diff(integral) / np.diff(edges))


def measured_bins(motion: Motion, trial: Trial, robot: Robot, t_start: float) -> Bins:
    """Average a trial's velocity, wheel speeds and currents over bins.

    Args:
        motion: velocity with its std.
        trial: the encoders' angles and the currents as logged; their clock is brought to the IMU's.
        robot: wheel radius and sensors.
        t_start: about when the command begins [s].

    Raises:
        EstimateError: the log covers less than half a second of the motion.
    """
    lag = motion.clock_offset.value if np.isfinite(motion.clock_offset.value) else 0.0
    periods = [BIN / 2] + [
        float(np.median(np.diff(stream.t)))
        for stream in (trial.wheels, trial.currents)
        if stream is not None and stream.t.size > 1
    ]
    width = 2 * max(periods)
    begin = max(motion.t[0], t_start - BEFORE)
    end = min(motion.t[-1], t_start + duration(motion.variant) + AFTER)
    if end - begin < 0.5:
        raise EstimateError(
            f"{motion.trial}: the log covers {max(0.0, end - begin):.2f} s of the motion",
            "the trajectory fit needs the whole motion; check the start time",
        )
    edges = begin + width * np.arange(int((end - begin) / width) + 1)

    values = {"velocity": _mean(motion.t, motion.v, edges)}
    centres = (edges[1:] + edges[:-1]) / 2
    std = {"velocity": np.maximum(np.interp(centres, motion.t, motion.v_std), _VELOCITY_FLOOR)}
    for axle, columns in AXLES.items():
        name = f"wheel_{axle}"
        if trial.wheels is not None:
            t, r = trial.wheels.t + lag, robot.wheels.radius
            pair = [r * _slope(t, trial.wheels.angle[:, i], edges) for i in columns]
            step = trial.wheels.step if trial.wheels.rate is None else 0.0
            # quantisation of two edges, and the jitter of their stamps
            quantised = r * step / (np.sqrt(6) * width)
            speed = np.nan_to_num(np.abs(_mean_of(pair)))
            std[name] = np.hypot(quantised, np.sqrt(2) * robot.encoders.jitter / width * speed) + 1e-4
        else:
            pair = [_mean(motion.t, motion.v_wheel[:, i], edges) for i in columns]
            std[name] = np.interp(centres, motion.t, _mean_of(list(motion.v_wheel_std.T[list(columns)])))
        values[name] = _mean_of(pair)

        name = f"current_{axle}"
        values[name] = np.full(centres.size, np.nan)
        std[name] = np.full(centres.size, np.nan)
        if trial.currents is not None:
            t = trial.currents.t + lag
            pair = []
            for i in columns:
                column = trial.currents.current[:, i]
                offset = standstill_mean(t, column, t_start)[0]
                pair.append(_mean(t, column - offset, edges))
            values[name] = _mean_of(pair)
            samples = np.maximum(1, np.histogram(t, edges)[0])
            noise = np.hypot(robot.currents.noise, robot.currents.step / np.sqrt(12))
            std[name] = noise / np.sqrt(2 * samples)
    return Bins(edges, values, std)


def standstill_mean(t: Array, signal: Array, t_start: float) -> tuple[float, int]:
    """Return the mean of a signal while the robot waits for the command, and how many samples that is.

    The last 50 ms before the start are left out. Without samples the mean is 0: nothing is known.
    """
    still = (t < t_start - 0.05) & np.isfinite(signal)
    count = int(still.sum())
    return (float(signal[still].mean()), count) if count else (0.0, 0)


def _mean_of(columns: list[Array]) -> Array:
    """Return the mean of those columns that have a value, NaN where none has."""
    stack = np.array(columns)
    known = np.isfinite(stack)
    total = np.where(known, stack, 0.0).sum(axis=0)
    return np.where(known.any(axis=0), total / np.maximum(1, known.sum(axis=0)), np.nan)


def _mean(t: Array, signal: Array, edges: Array) -> Array:
    """Return the time averages (B,) of a sampled signal between edges, NaN without a sample."""
    good = np.isfinite(signal)
    if good.sum() < 2:
        return np.full(edges.size - 1, np.nan)
    return _slope(t[good], cumulative_trapezoid(signal[good], t[good], initial=0), edges)


def _slope(t: Array, signal: Array, edges: Array) -> Array:
    """Return the gain (B,) of a sampled signal over each bin per second, NaN without a sample."""
    good = np.isfinite(signal)
    if good.sum() < 2:
        return np.full(edges.size - 1, np.nan)
    gain = np.diff(np.interp(edges, t[good], signal[good])) / np.diff(edges)
    return np.where(np.histogram(t[good], edges)[0] > 0, gain, np.nan)
