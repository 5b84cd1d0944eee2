"""The record of one trial as it was logged: streams with their own stamps, SI units, robot axes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

R = TypeVar("R")


def part(record: R, keep: npt.NDArray[np.bool_] | slice) -> R:
    """Return a record of samples with some of them only: every array in it is cut, the rest stays."""
    held: Any = record
    arrays = {name: values[keep] for name, values in vars(held).items() if isinstance(values, np.ndarray)}
    cut: R = replace(held, **arrays)
    return cut


@dataclass(frozen=True, eq=False)
class ImuStream:
    """Samples of the inertial measurement unit, at its place; NaN in a column that was not logged."""

    t: Array  # (N,) stamps [s], strictly increasing
    specific_force: Array  # (N, 3) [m/s^2]; +9.81 on z at rest in the robot's axes (x forward, y left, z up)
    angular_rate: Array  # (N, 3) [rad/s]; y positive nose down
    gravity_removed: bool = False  # by the logger
    robot_axes: bool = False  # the mounting rotation has been applied, as in a corrected trial


@dataclass(frozen=True, eq=False)
class WheelStream:
    """Samples of the wheel encoders, in the order of `granite_lab.parameters.WHEELS`."""

    t: Array  # (M,) stamps [s], strictly increasing
    angle: Array  # (M, 4) accumulated wheel angle [rad], unwrapped; NaN where a wheel was not sampled
    rate: Array | None = None  # (M, 4) [rad/s] where the logger gives rates; then `angle` is its integral
    step: float = 0.0  # smallest step of the angle [rad] or of a logged rate [rad/s] (0: not known)


@dataclass(frozen=True, eq=False)
class CurrentStream:
    """Motor currents (K, 4) [A] in the order of the wheels, NaN where not logged, at stamps (K,) [s]."""

    t: Array
    current: Array


@dataclass(frozen=True, eq=False)
class Series:
    """One logged quantity (K,), in the unit that its holder names, at stamps (K,) [s]."""

    t: Array
    value: Array


@dataclass(frozen=True)
class InputFile:
    """A file that went into a result."""

    path: Path
    sha256: str


@dataclass(frozen=True)
class TrialInfo:
    """What is known about a trial besides its samples; None where nobody said."""

    robot: str | None = None  # name of the catalogue or path of a TOML file, as the soil
    soil: str | None = None
    v_desired: float | None = None  # of the desired motion [m/s], as the next two
    a_max: float | None = None  # [m/s^2]
    distance: float | None = None  # [m]
    repetition: int | None = None
    virtual: bool = False  # a simulator wrote the log
    clock_offset: float | None = None  # known offset of the encoder clock behind the IMU's [s]
    extra: dict[str, str] = field(default_factory=dict, hash=False)  # other metadata of the file, as text


@dataclass(frozen=True)
class Correction:
    """One thing that estimation changed in a log."""

    what: str
    where: str  # the channel, and the instant or interval if it is not the whole log
    value: float  # size of the change, or how many samples it concerns
    std: float  # of the value; NaN where it is no measurement
    unit: str


@dataclass(frozen=True, eq=False)
class Trial:
    """One trial, as it was logged or as estimation corrected it (`granite_lab.estimation.correct`)."""

    name: str  # stem of the log's file
    info: TrialInfo
    imu: ImuStream | None = None  # None where the log has none, as the others
    wheels: WheelStream | None = None
    currents: CurrentStream | None = None
    command: Series | None = None  # commanded velocity [m/s]
    reference_x: Series | None = None  # external reference [m]; judges the estimate, never enters it
    reference_v: Series | None = None  # the same [m/s]
    warnings: tuple[str, ...] = ()  # every doubt the reader had, one line each
    inputs: tuple[InputFile, ...] = ()
    layout: str = "canonical"  # name of the column map that was used
    corrections: tuple[Correction, ...] = ()  # what estimation changed
