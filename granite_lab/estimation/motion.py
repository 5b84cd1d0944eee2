"""The record of what a trial's motion was, with a standard deviation beside each number."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate, Part
from granite_lab.logs.counters import mean_known
from granite_lab.logs.sensors.doubt import Grade
from granite_lab.logs.trial import Array, Series, Trial
from granite_lab.parameters import WHEELS, Variant
from granite_lab.shown import Shown

if TYPE_CHECKING:
    import pandas as pd


PhaseName = Literal["rest", "accelerate", "steady", "brake"]

NAN = float("nan")

TELLING = 0.05
"""A slip ratio whose std is larger than this tells little of k_92, which falls by 0.3 over 0.17 of slip ratio
(paper, Table 3) [-]."""

LEAST_WAY = 0.05
"""A way of the wheels shorter than this tells no slip ratio [m]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Health:
    """How the filter fared; what the report draws.

    U scalar updates met their predictions; biases are at the IMU's N stamps.

    Attributes:
        t: (U,) stamps of the updates [s].
        kind: (U,) which update: "zero_velocity", "zero_rate", "wheel" and so on.
        innovation, innovation_std: (U,) innovation and its predicted std, in the update's unit.
        nis: mean normalised innovation squared per update kind (1 is ideal); for the zero-velocity
            updates of those that end a motion, since the ones after only repeat them.
        whiteness: correlation of successive normalised innovations per update kind (0 is ideal).
        ljung_box: probability per update kind that white innovations would correlate as much over ten
            lags by chance; NaN for too few.
        accel_bias, accel_bias_std: (N,) of the forward accelerometer, with tilt [m/s^2].
        gyro_bias, gyro_bias_std: (N,) of the pitch gyro [rad/s].
        rests: intervals (start, end) [s] in which the robot stood still.
        gaps, plateaus: intervals [s] of missing and of saturated IMU samples.
        grade: "good"; "fair": usable within a std that had to grow; "poor": look twice.
        reasons: for the grade, one clause each.
        verdict: one sentence in plain words.
    """

    t: Array
    kind: tuple[str, ...]
    innovation: Array
    innovation_std: Array
    nis: dict[str, float]
    whiteness: dict[str, float] = field(default_factory=dict)
    ljung_box: dict[str, float] = field(default_factory=dict)
    accel_bias: Array
    accel_bias_std: Array
    gyro_bias: Array
    gyro_bias_std: Array
    rests: tuple[tuple[float, float], ...]
    gaps: tuple[tuple[float, float], ...] = ()
    plateaus: tuple[tuple[float, float], ...] = ()
    grade: Grade = "poor"
    reasons: tuple[str, ...] = ()
    verdict: str

    @property
    def good(self) -> bool:
        """The filter's own checks passed."""
        return self.grade == "good"

    def __repr__(self) -> str:
        return f"Health(grade='{self.grade}')"


@dataclass(frozen=True, eq=False, kw_only=True)
class BodyMotion:
    """How the body moves: R, at N stamps.

    Attributes:
        x, x_std: (N,) distance travelled since the start [m].
        v, v_std: (N,) velocity [m/s].
        pitch, pitch_std: (N,) [rad], positive nose down.
    """

    x: Array
    x_std: Array
    v: Array
    v_std: Array
    pitch: Array
    pitch_std: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class WheelMotion:
    """How the wheels move and slip, at N stamps, in the order of WHEELS.

    Attributes:
        v_wheel, v_wheel_std: (N, 4) circumferential velocity v_o [m/s].
        slip, slip_std: (N, 4) slip ratio of each wheel by (1), NaN at rest.
        slip_velocity, slip_velocity_std: (N,) wheel minus body velocity, mean of the wheels [m/s].
    """

    v_wheel: Array
    v_wheel_std: Array
    slip: Array
    slip_std: Array
    slip_velocity: Array
    slip_velocity_std: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Totals:
    """What a trial comes to.

    Attributes:
        steady: start and end of the steady part [s].
        slip_ratio: λ_R by (2) over the steady part, or over the longest straight one where none is steady.
        slip_parts: what its std is made of; empty where it has none.
        distance: total distance travelled [m].
        distance_wheels: distance without slip, as the wheels measured it [m].
    """

    steady: tuple[float, float]
    slip_ratio: Estimate
    slip_parts: tuple[Part, ...] = ()
    distance: Estimate
    distance_wheels: Estimate


@dataclass(frozen=True, eq=False, kw_only=True)
class Clocks:
    """How the clocks of a trial lie to each other.

    Attributes:
        t_start: instant at which the command began [s], with its std.
        clock_offset: how far the encoders' clock lies behind the IMU's [s]: their stamps are early by it,
            and it is to be added to them; NaN std: unobservable.
        clock_applied: how much of `clock_offset` is in the stamps of the corrected trial already [s].
    """

    t_start: Estimate
    clock_offset: Estimate
    clock_applied: float = 0.0

    @property
    def clock_left(self) -> Estimate:
        """What is still to be added to the stamps of encoders and currents of the corrected trial [s]."""
        return Estimate(self.clock_offset.value - self.clock_applied, self.clock_offset.std)

    @property
    def stamps_late(self) -> Estimate:
        """By how much the stamps of encoders and currents come after the IMU's [s]; negative: early."""
        return Estimate(-self.clock_offset.value + 0.0, self.clock_offset.std)


@dataclass(frozen=True, eq=False, kw_only=True)
class Motion(BodyMotion, WheelMotion, Totals, Clocks, Shown):
    """The estimated motion of one trial, at the IMU's stamps (N samples).

    Attributes:
        trial: name of the trial.
        virtual: the log was written by a simulator.
        t: (N,) the log's own time [s].
        phase: (N,) one of rest, accelerate, steady, brake.
        variant: recognised or given motion of Table 2, or as measured where it is none of it; a `Course`
            where the log or its metadata tell another command, or where the wheels drive the simulation.
        variant_source: "given", "recognised", "measured", "logged", "stated" or "wheels".
        noise: noise identified from this trial, by name, with the unit in the name.
        health: the filter's health.
        warnings: the reader's and the estimator's doubts, one line each.
    """

    trial: str
    virtual: bool
    t: Array
    phase: tuple[PhaseName, ...]
    variant: Variant
    variant_source: str
    noise: dict[str, float]
    health: Health
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        slip, distance = self.slip_ratio, self.distance
        return (
            f"Motion('{self.trial}'{', virtual' if self.virtual else ''}: {self.variant.velocity:g} m/s, "
            f"slip ratio {slip.value:.4f} ± {slip.std:.4f}, "
            f"distance {distance.value:.4f} ± {distance.std:.4f} m, {len(self.t)} samples, {self.health!r})"
        )

    def to_frame(self) -> pd.DataFrame:
        """Return the motion as a table, one row an IMU stamp, units in the column names."""
        import pandas as pd  # noqa: PLC0415, heavy

        columns: dict[str, object] = {"t_s": self.t}

        def add(name: str, unit: str, value: Array, std: Array) -> None:
            columns[f"{name}{unit}"], columns[f"{name}_std{unit}"] = value, std

        add("x", "_m", self.x, self.x_std)
        add("v", "_mps", self.v, self.v_std)
        add("pitch", "_rad", self.pitch, self.pitch_std)
        for i, wheel in enumerate(WHEELS):
            add(f"v_wheel_{wheel}", "_mps", self.v_wheel[:, i], self.v_wheel_std[:, i])
            add(f"slip_{wheel}", "", self.slip[:, i], self.slip_std[:, i])
        add("slip_velocity", "_mps", self.slip_velocity, self.slip_velocity_std)
        add("accel_bias", "_mps2", self.health.accel_bias, self.health.accel_bias_std)
        add("gyro_bias", "_radps", self.health.gyro_bias, self.health.gyro_bias_std)
        columns["phase"] = list(self.phase)
        return pd.DataFrame(columns)


def slips_of(motion: Motion) -> Iterator[tuple[Estimate, str]]:
    """Yield the slip ratios by (2) over the steady part and over the whole way, where they are known."""
    if math.isfinite(motion.slip_ratio.value):
        yield motion.slip_ratio, "in the steady part"
    rolled = motion.distance_wheels.value
    if abs(rolled) > LEAST_WAY:
        yield Estimate(1.0 - motion.distance.value / rolled, motion.distance.std / abs(rolled)), "over all"


def no_slip_is_known(motions: Sequence[Motion]) -> bool:
    """Whether there are trials, and none has a slip ratio, steady or over all, that is known to `TELLING`."""
    return bool(motions) and not any(slip.std <= TELLING for m in motions for slip, _ in slips_of(m))


@dataclass(frozen=True)
class Judgement:
    """An estimate against a reference, over the stamps that both cover.

    Attributes:
        quantity: "velocity" or "distance": what the reference gives.
        samples: how many stamps were compared.
        rmse: root mean square of estimate minus reference [m/s] or [m].
        bias: mean of estimate minus reference, same unit.
        rmse_wheels: the same with the wheels' velocity (distance) in place of the body's.
        nees: mean of the squared error over the stated variance; 1 is ideal.
        coverage: share of errors within two stated std; 0.95 is ideal.
        slip: apparent slip ratio by (2), one less the reference's way over the wheels', from the first
            to the last common stamp.

    Without an estimate of the body's motion (no IMU) rmse, bias, nees and coverage are NaN.
    """

    quantity: str
    samples: int
    rmse: float
    bias: float
    rmse_wheels: float
    nees: float
    coverage: float
    slip: float = NAN


def judge(motion: Motion, trial: Trial, reference_std: float = 0.0) -> tuple[Judgement, ...]:
    """Compare a motion with the external reference of its trial, on the IMU's clock.

    Its velocity may miss the estimate by the std `reference_std` [m/s] beyond the estimate's own.

    Returns:
        one judgement per quantity that the reference gives.

    Raises:
        EstimateError: the trial has no reference, or it does not overlap the motion.
    """
    wheels = mean_known(motion.v_wheel)
    judgements = []
    if trial.reference_v is not None:
        error_std = np.hypot(motion.v_std, reference_std)
        judgements.append(_compare("velocity", motion.t, (motion.v, wheels, error_std), trial.reference_v))
    if trial.reference_x is not None:
        rolled = np.cumsum(np.nan_to_num(wheels) * np.diff(motion.t, prepend=motion.t[0]))
        judgements.append(_compare("distance", motion.t, (motion.x, rolled, motion.x_std), trial.reference_x))
    if not judgements:
        raise EstimateError(
            f"{motion.trial}: there is no external reference to judge by",
            "a reference is a column ref_v_mps or ref_x_m",
        )
    return tuple(judgements)


def _compare(quantity: str, t: Array, series: tuple[Array, Array, Array], reference: Series) -> Judgement:
    """Compare estimate, wheels and the former's std with a reference, at its stamps.

    A distance counts from the first common stamp.
    """
    inside = (reference.t >= t[0]) & (reference.t <= t[-1]) & np.isfinite(reference.value)
    stamps, truth = reference.t[inside], reference.value[inside]
    if stamps.size < 2:
        raise EstimateError(f"the reference's {quantity} does not overlap the log", "check its clock")
    estimate, wheels, error_std = (np.interp(stamps, t, values) for values in series)
    if quantity == "distance":
        estimate, wheels, truth = (s - s[0] for s in (estimate, wheels, truth))

    def length(values: Array) -> float:
        finite = np.isfinite(values)
        if quantity == "distance":
            return float(values[-1] - values[0])
        return float(np.trapezoid(values[finite], stamps[finite]))

    rolled = length(wheels)
    error, error_wheels = estimate - truth, wheels - truth
    ratio = np.abs(error) / np.where(error_std > 0, error_std, np.inf)
    within = np.where(np.isnan(ratio), NAN, ratio <= 2.0)
    rows = np.stack([error**2, error_wheels**2, error, ratio**2, within])
    square, square_wheels, bias, nees, coverage = mean_known(rows).tolist()
    rmse, rmse_wheels = math.sqrt(square), math.sqrt(square_wheels)
    return Judgement(
        quantity=quantity, samples=stamps.size, rmse=rmse, bias=bias, rmse_wheels=rmse_wheels,
        nees=nees, coverage=coverage,
        slip=1.0 - length(truth) / rolled if abs(rolled) > LEAST_WAY else NAN,
    )  # fmt: skip
