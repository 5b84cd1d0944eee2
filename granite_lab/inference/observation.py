"""What the sensors of one trial read, in bins, and the same bins of a simulation.

The comparison is made in sensor space. The signal of a sensor is integrated by trapezoids between
its own stamps and the integral is read at the edges of the bins; wheel angles are read at the edges
themselves. A simulation is first interpolated at the very stamps, so that whatever the binning does
to the measurement it does to the simulation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from granite_lab.errors import EstimateError
from granite_lab.inference.binning import CURRENTS, Binning, Stream, at_edges_or_between
from granite_lab.inference.constants import BIN, SMOOTH, THREE_SIGMA
from granite_lab.inference.noise import FEWEST_BINS
from granite_lab.inference.pool import SIGNALS
from granite_lab.logs.sensors.imu import mounted
from granite_lab.logs.sensors.stamps import GAP_PERIODS
from granite_lab.logs.trial import Array, Trial
from granite_lab.model.command import duration, phase_of
from granite_lab.parameters import GRAVITY, Robot, Variant, is_driven

COVERED = 0.3
"""Least share of the bins that sensors must cover; convention."""

BEFORE, AFTER = SMOOTH[1], THREE_SIGMA * SMOOTH[1]
"""How much rest before the command and how much time after its end is compared [s]: as long as transients
last, and until they have faded."""

UNITS = {
    "accel_x": "m/s^2",
    "accel_z": "m/s^2",
    "pitch_rate": "rad/s",
    "wheel": "rad",
    "wheel_split": "rad",
    "current_f": "A",
    "current_r": "A",
    "current_side": "A",
}
"""Channel to unit. "wheel" is the mean angle of all wheels and "wheel_split" front minus rear: the
jitter of the encoders' stamps is common to both axles, so that only these two have independent noise."""

CHANNELS = tuple(UNITS)

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Observation:
    """One trial in bins.

    Attributes:
        name: of the trial.
        variant: the command.
        t_start: first estimate of the command's start [s, the log's time].
        edges: (n+1,) edges of the bins [s, the log's time].
        streams: channel to its samples; only the channels that were logged.
        values: channel to (n,) binned measurement, NaN where a bin cannot be filled.
        step: smallest step of the wheels' angle [rad].
        gravity_removed: the logger has taken gravity out, and it was put back along z.
        scaled: as of `ImuStream`.
    """

    name: str
    variant: Variant
    t_start: float
    edges: Array
    streams: Mapping[str, Stream]
    values: Mapping[str, Array]
    step: float
    gravity_removed: bool
    scaled: float = 1.0

    def rounding(self, channel: str) -> float:
        """Return the std of the rounding of a channel of the wheels' angles [rad], 0 for others.

        Repetitions are rounded alike and do not show it.
        """
        return self.step / float(np.sqrt(12)) if channel.startswith("wheel") else 0.0

    @property
    def width(self) -> float:
        """Width of a bin [s]."""
        return float(self.edges[1] - self.edges[0])

    @property
    def bins(self) -> int:
        """Number of bins n."""
        return self.edges.size - 1

    @property
    def t(self) -> Array:
        """(n,) time of each bin's middle since the first estimate of the command's start [s]."""
        return (self.edges[1:] + self.edges[:-1]) / 2 - self.t_start

    @property
    def phase(self) -> tuple[str, ...]:
        """Commanded phase of each bin."""
        return tuple(phase_of(self.t, self.variant))

    @cached_property
    def binned(self) -> Binning:
        """What takes simulated `SIGNALS` to the bins of each channel that was logged."""
        return Binning(self.streams, self.edges, self.t_start)


def observe(
    trial: Trial,
    robot: Robot,
    variant: Variant,
    t_start: float,
    *,
    width: float = BIN,
    lasting: float | None = None,
) -> Observation:
    """Put a trial into bins.

    Args:
        trial: the log.
        robot: gives the mounting of the IMU.
        variant: what was commanded.
        t_start: start of the command [s, the log's time].
        width: of a bin [s], see `bin_width`.
        lasting: time from its start to the end of the longest repetition [s]; by default to its own.

    Raises:
        EstimateError: the log has no sensor that covers the time of the command.
    """
    streams = _streams(trial, robot)
    if is_driven(variant):  # what turns the wheels is no measurement to compare with
        streams = {name: s for name, s in streams.items() if not s.is_angle}
    if robot.drive is None:  # its currents tell no torques
        streams = {name: s for name, s in streams.items() if s.sensor != CURRENTS}
    if not streams:
        raise EstimateError(f"trial '{trial.name}' has no sensor to compare with", "check its columns")
    before = round(BEFORE / width)
    lasting = duration(variant) if lasting is None else lasting
    after = int(np.ceil((lasting + AFTER) / width))
    edges: Array = t_start + width * np.arange(-before, after + 1, dtype=np.float64)
    streams = {name: _from_zero(s, edges[before]) if s.is_angle else s for name, s in streams.items()}
    values = {name: _masked(s, edges) for name, s in streams.items()}
    covered = np.isfinite(np.concatenate(list(values.values()))).mean()
    if covered < COVERED:
        raise EstimateError(
            f"trial '{trial.name}': its sensors cover {100 * covered:.0f} % of the time of the command",
            "check the start of the command",
        )
    step = trial.wheels.step if trial.wheels is not None and trial.wheels.rate is None else 0.0
    imu = trial.imu
    removed, scaled = (imu.gravity_removed, imu.scaled) if imu is not None else (False, 1.0)
    return Observation(trial.name, variant, t_start, edges, streams, values, step, removed, scaled)


def bin_width(trial: Trial, robot: Robot) -> float:
    """Return `BIN`, or the multiple of it that the slowest sensor of a trial needs [s]."""
    slowest = max((float(np.median(np.diff(s.t))) for s in _streams(trial, robot).values()), default=BIN)
    return BIN * max(1.0, float(np.ceil(np.round(slowest / BIN, 1))))  # stamps jitter


def _from_zero(stream: Stream, start: float) -> Stream:
    """Return the angle counted from where the wheel stood before the command."""
    return replace(stream, value=stream.value - np.interp(start, stream.t, stream.value))


def _streams(trial: Trial, robot: Robot) -> dict[str, Stream]:
    streams: dict[str, Stream] = {}
    if trial.imu is not None:
        mounting = Rotation.identity() if trial.imu.robot_axes else mounted(robot)
        force = mounting.apply(np.nan_to_num(trial.imu.specific_force))
        rate = mounting.apply(np.nan_to_num(trial.imu.angular_rate))
        if trial.imu.gravity_removed:
            force = force + np.array([0.0, 0.0, GRAVITY])
        finite = np.isfinite(trial.imu.specific_force), np.isfinite(trial.imu.angular_rate)
        for k, (name, values, fine) in enumerate(
            (
                ("accel_x", force[:, 0], np.asarray(finite[0][:, [0, 2]].all(axis=1))),
                ("accel_z", force[:, 2], np.asarray(finite[0][:, [0, 2]].all(axis=1))),
                ("pitch_rate", rate[:, 1], np.asarray(finite[1][:, 1])),
            )
        ):
            interval = float(np.median(np.diff(trial.imu.t)))
            for channel, stream in _stream(name, trial.imu.t, values, fine, k, is_angle=False).items():
                streams[channel] = replace(stream, window=interval)  # an IMU integrates from sample to sample
    offset = trial.info.clock_offset or 0.0
    if trial.wheels is not None:
        streams |= _axles("wheel", trial.wheels.t + offset, trial.wheels.angle)
        if {"wheel_f", "wheel_r"} <= streams.keys():
            front, rear = streams.pop("wheel_f"), streams.pop("wheel_r")
            if np.array_equal(front.t, rear.t):
                mean, split = (front.value + rear.value) / 2, front.value - rear.value
                streams["wheel"] = Stream(front.t, mean, (front.weights + rear.weights) / 2, True)
                streams["wheel_split"] = Stream(front.t, split, front.weights - rear.weights, True)
            else:
                streams["wheel"] = front
        elif streams.keys() & {"wheel_f", "wheel_r"}:
            streams["wheel"] = streams.pop("wheel_f" if "wheel_f" in streams else "wheel_r")
    if trial.currents is not None:
        stamps, table = trial.currents.t + offset, trial.currents.current
        currents = _of_sides(stamps, table) if robot.motors == "side" else _axles("current", stamps, table)
        # currents jump at a corner of the command: of a stamp that jitters a mean is expected there
        window = float(np.sqrt(12)) * robot.encoders.jitter
        streams |= {name: replace(s, window=window) for name, s in currents.items()}
    return streams


def _of_sides(t: Array, table: Array) -> dict[str, Stream]:
    """Return the mean current of the motors of both sides, each of which turns a front and a rear wheel.

    By (24) it is the sum of the currents that a motor for each of the two would draw.
    """
    axles = _axles("current", t, table)
    if len(axles) < 2:
        return {}
    front, rear = axles["current_f"], axles["current_r"]
    return {"current_side": replace(front, weights=front.weights + rear.weights)}


def _axles(kind: str, t: Array, table: Array) -> dict[str, Stream]:
    """Return the means of the wheels of each axle that were logged."""
    streams: dict[str, Stream] = {}
    first = SIGNALS.index("enc_f_rad" if kind == "wheel" else "cur_f_A")
    for k, axle in enumerate("fr"):
        wheels = table[:, 2 * k : 2 * k + 2]
        wheels = wheels[:, np.isfinite(wheels).sum(axis=0) > 1]
        if wheels.shape[1]:
            fine: Mask = np.asarray(np.isfinite(wheels).all(axis=1))
            streams |= _stream(
                f"{kind}_{axle}", t, wheels.mean(axis=1), fine, first + k, is_angle=kind == "wheel"
            )
    return streams


def _stream(
    name: str, t: Array, values: Array, fine: Mask, signal: int, *, is_angle: bool
) -> dict[str, Stream]:
    if fine.sum() < FEWEST_BINS:
        return {}
    return {name: Stream(t[fine], np.asarray(values[fine]), np.eye(len(SIGNALS))[signal], is_angle)}


def _masked(stream: Stream, edges: Array) -> Array:
    """Return the binned measurement, NaN where the stamps leave a gap of more than three periods."""
    values: Array = at_edges_or_between(stream, edges) @ stream.value
    gaps = np.diff(stream.t)
    for k in np.flatnonzero(gaps > (GAP_PERIODS + 0.5) * np.median(gaps)):
        values[(edges[1:] > stream.t[k]) & (edges[:-1] < stream.t[k + 1])] = np.nan
    outside = (edges[:-1] < stream.t[0]) | (edges[1:] > stream.t[-1])
    values[outside] = np.nan
    return values
