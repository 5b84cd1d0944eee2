"""The record of what a trial's motion was, with a standard deviation beside each number."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import pandas as pd

from granite_lab.estimate import Estimate, Part
from granite_lab.logs.trial import Array
from granite_lab.parameters import WHEELS, Variant
from granite_lab.shown import Shown

Grade = Literal["good", "fair", "poor"]
PhaseName = Literal["rest", "accelerate", "steady", "brake"]


@dataclass(frozen=True, eq=False)
class Health:
    """How the filter fared; what the report draws.

    Attributes:
        t: (K,) stamps of the scalar measurement updates [s].
        kind: (K,) which update: "zero_velocity", "zero_rate", "wheel_rest" and so on.
        innovation: (K,) innovation in the update's unit.
        innovation_std: (K,) its predicted std, same unit.
        nis: mean normalised innovation squared per update kind (1 is ideal); for the zero-velocity
            updates of those that end a motion, since the ones after only repeat them.
        accel_bias: (N,) forward accelerometer bias with tilt [m/s^2], with `accel_bias_std`.
        gyro_bias: (N,) pitch gyro bias [rad/s], with `gyro_bias_std`.
        rests: intervals (start, end) [s] in which the robot stood still.
        verdict: one sentence in plain words.
        good: the filter's own checks passed.
        whiteness: correlation of successive normalised innovations per update kind (0 is ideal).
        ljung_box: probability per update kind that white innovations would correlate as much over ten
            lags by chance; NaN for too few.
        grade: "good"; "fair": usable within a std that had to grow; "poor": look twice.
        gaps, plateaus: intervals [s] of missing and of saturated IMU samples.
    """

    t: Array
    kind: tuple[str, ...]
    innovation: Array
    innovation_std: Array
    nis: dict[str, float]
    accel_bias: Array
    accel_bias_std: Array
    gyro_bias: Array
    gyro_bias_std: Array
    rests: tuple[tuple[float, float], ...]
    verdict: str
    good: bool
    whiteness: dict[str, float] = field(default_factory=dict)
    ljung_box: dict[str, float] = field(default_factory=dict)
    gaps: tuple[tuple[float, float], ...] = ()
    plateaus: tuple[tuple[float, float], ...] = ()
    grade: Grade = "poor"

    def __repr__(self) -> str:
        return f"Health(grade='{self.grade}')"


@dataclass(frozen=True, eq=False)
class Motion(Shown):
    """The estimated motion of one trial, at the IMU's stamps (N samples).

    Attributes:
        trial: name of the trial.
        virtual: the log was written by a simulator.
        t: (N,) the log's own time [s].
        x, x_std: (N,) distance travelled by R since the start [m].
        v, v_std: (N,) body velocity of R [m/s].
        pitch, pitch_std: (N,) [rad], positive nose down.
        v_wheel: (N, 4) circumferential wheel velocity v_o [m/s], wheel order of WHEELS.
        v_wheel_std: (N, 4) its std [m/s].
        slip, slip_std: (N, 4) slip ratio of each wheel by (1), NaN at rest.
        slip_velocity, slip_velocity_std: (N,) wheel minus body velocity, mean of the wheels [m/s].
        phase: (N,) one of rest, accelerate, steady, brake.
        slip_ratio: λ_R by (2) over the steady part.
        distance: total distance travelled [m].
        distance_wheels: distance without slip, as the wheels measured it [m].
        steady: start and end of the steady part [s].
        t_start: instant at which the command began [s], with its std.
        clock_offset: how far the encoders' clock lies behind the IMU's [s]: their stamps are early by it,
            and it is to be added to them; NaN std: unobservable.
        variant: recognised or given motion of Table 2, or as measured where it is none of it.
        variant_source: "given", "recognised" or "measured".
        noise: noise identified from this trial, by name, with the unit in the name.
        health: the filter's health.
        warnings: the reader's and the estimator's doubts, one line each.
        clock_applied: how much of `clock_offset` is in the stamps of the corrected trial already [s].
        slip_parts: what the std of `slip_ratio` is made of; empty where it has none.
    """

    trial: str
    virtual: bool
    t: Array
    x: Array
    x_std: Array
    v: Array
    v_std: Array
    pitch: Array
    pitch_std: Array
    v_wheel: Array
    v_wheel_std: Array
    slip: Array
    slip_std: Array
    slip_velocity: Array
    slip_velocity_std: Array
    phase: tuple[PhaseName, ...]
    slip_ratio: Estimate
    distance: Estimate
    distance_wheels: Estimate
    steady: tuple[float, float]
    t_start: Estimate
    clock_offset: Estimate
    variant: Variant
    variant_source: str
    noise: dict[str, float]
    health: Health
    warnings: tuple[str, ...] = field(default=())
    clock_applied: float = 0.0
    slip_parts: tuple[Part, ...] = ()

    def __repr__(self) -> str:
        slip, way = self.slip_ratio, self.distance
        return (
            f"Motion('{self.trial}'{', virtual' if self.virtual else ''}: {self.variant.velocity:g} m/s, "
            f"slip ratio {slip.value:.4f} ± {slip.std:.4f}, distance {way.value:.4f} ± {way.std:.4f} m, "
            f"{len(self.t)} samples, {self.health!r})"
        )

    @property
    def clock_left(self) -> Estimate:
        """What is still to be added to the stamps of encoders and currents of the corrected trial [s]."""
        return Estimate(self.clock_offset.value - self.clock_applied, self.clock_offset.std)

    @property
    def stamps_late(self) -> Estimate:
        """By how much the stamps of encoders and currents come after the IMU's [s]; negative: early."""
        return Estimate(-self.clock_offset.value + 0.0, self.clock_offset.std)

    def to_frame(self) -> pd.DataFrame:
        """Return the motion as a table, one row an IMU stamp, units in the column names."""
        columns: dict[str, object] = {
            "t_s": self.t,
            "x_m": self.x,
            "x_std_m": self.x_std,
            "v_mps": self.v,
            "v_std_mps": self.v_std,
            "pitch_rad": self.pitch,
            "pitch_std_rad": self.pitch_std,
        }
        for i, wheel in enumerate(WHEELS):
            columns[f"v_wheel_{wheel}_mps"] = self.v_wheel[:, i]
            columns[f"v_wheel_{wheel}_std_mps"] = self.v_wheel_std[:, i]
            columns[f"slip_{wheel}"] = self.slip[:, i]
            columns[f"slip_{wheel}_std"] = self.slip_std[:, i]
        columns["slip_velocity_mps"] = self.slip_velocity
        columns["slip_velocity_std_mps"] = self.slip_velocity_std
        columns["accel_bias_mps2"] = self.health.accel_bias
        columns["accel_bias_std_mps2"] = self.health.accel_bias_std
        columns["gyro_bias_radps"] = self.health.gyro_bias
        columns["gyro_bias_std_radps"] = self.health.gyro_bias_std
        columns["phase"] = list(self.phase)
        return pd.DataFrame(columns)
