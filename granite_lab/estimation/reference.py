"""The external reference of a trial as a measurement: motion capture, RTK, a laser, with its stated std.

A position along the path counts from an origin that is not that of the wheels: their difference is a state,
by the covariance at the start. Positions in a plane or on the globe show the speed and not its sign, which
the wheels show. Velocities that were computed from several positions share them, so that only every one of as
many counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate
from granite_lab.estimation.wheels import Rolling
from granite_lab.logs.counters import integral, interpolated
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.trial import Array, Series, Trial, part

TOLD = 3.0
"""Speeds by positions in a plane are magnitudes: below this many std they may be noise alone."""

PAUSE = 2.0
"""A reference that pauses for longer than this in motion [s] leaves the velocity to drift."""

LOST = Doubt(
    "the reference is not used: the robot is slower than three std of the speeds by its positions",
    remedy="state the std of the positions over seconds (ref_x_std_m), or log a velocity",
)
"""Speeds by positions in a plane show no direction where they hide in their noise."""

STEP, FARTHEST = 0.05, 2.0
"""Of the lags at which reference and wheels are compared, and the largest of them [s]."""

SHOWN = 9.0
"""By so much twice the log-likelihood grows for a lag that is three std from none."""


@dataclass(frozen=True, eq=False)
class Readings:
    """A reference as the filter takes it.

    Attributes:
        kind: what is measured.
        t: (U,) stamps on the IMU's clock [s].
        value: (U,) [m/s] or [m].
        std: of each.
    """

    kind: Literal["reference_v", "reference_x"]
    t: Array
    value: Array
    std: float

    def distance(self, begin: float, end: float) -> Estimate | None:
        """Return the way from one instant to another [s], with its std [m].

        None where the reference misses a part of it.
        """
        t = np.concatenate(([begin], self.t[(self.t > begin) & (self.t < end)], [end]))
        if self.t.size < 2 or np.diff(t).max() > PAUSE:
            return None
        x = np.interp(t, self.t, self.value)
        if self.kind == "reference_x":
            return Estimate(float(x[-1] - x[0]), math.sqrt(2.0) * self.std)
        return Estimate(float(np.trapezoid(x, t)), self.std * (end - begin) / math.sqrt(t.size))

    def moved(self) -> Array:
        """(U,) way since the first reading [m]."""
        return self.value - self.value[0] if self.kind == "reference_x" else integral(self.t, self.value)


def lag_of(readings: Readings, rolling: Rolling, offset: float) -> float:
    """Return by how much a reference tells of the motion after the wheels do [s]; 0 where none shows.

    None shows where the farthest lag fits best: wheels that spin go another way than the body. Speeds over
    steps are compared at all lags, the wheels' times a factor: the slip does not count. The wheels' clock
    lies behind by `offset` [s].
    """
    if readings.t.size < 2:
        return 0.0
    stamps = rolling.t + offset
    grid = np.arange(max(readings.t[0], stamps[0]), min(readings.t[-1], stamps[-1]), STEP)
    if grid.size < 2.0 * FARTHEST / STEP:
        return 0.0
    speed = np.diff(np.interp(grid, readings.t, readings.moved()))
    lags = np.arange(-FARTHEST, FARTHEST + STEP / 2, STEP)
    left = np.array([_left(speed, np.diff(interpolated(grid - lag, stamps, rolling.mean))) for lag in lags])
    best, none = int(np.argmin(left)), int(np.argmin(np.abs(lags)))
    if (
        best in (0, lags.size - 1)
        or left[best] <= 0.0
        or speed.size * math.log(left[none] / left[best]) < SHOWN
    ):
        return 0.0
    return float(lags[best])


def _left(x: Array, like: Array) -> float:
    """Return the residual sum of squares of the regression of x (G,) on `like` (G,), through the origin."""
    size = float(like @ like)
    return float(np.sum((x - (like @ x / size if size else 0.0) * like) ** 2))


def readings_of(trial: Trial, rolling: Rolling | None, offset: float) -> tuple[Readings, ...]:
    """Return the reference of a trial as measurements; nothing where it is not to be used.

    Args:
        trial: with the std of its reference.
        rolling: tells the direction, on a clock that lies behind the IMU's by `offset` [s].

    Raises:
        EstimateError: it is to be used, but there is none, or its std is not stated.
    """
    info = trial.info
    if not info.use_reference:
        return ()
    readings = []
    position, speed = trial.reference_x, trial.reference_v
    if position is not None and position.places == 1 and info.ref_x_std:
        readings.append(_readings("reference_x", position, info.ref_x_std))
    if speed is not None and (std := _speed_std(trial)):
        speeds = _readings("reference_v", part(speed, slice(None, None, speed.places)), std)
        if position is None or position.places > 1:
            readings.append(_ahead(speeds, rolling, offset) if position is not None else speeds)
        elif not readings or speed.places == 1:
            readings.append(speeds)
    if readings:
        return tuple(readings)
    if position is None and speed is None:
        raise EstimateError(
            f"{trial.name}: there is no external reference to use",
            "a reference is a column ref_v_mps or ref_x_m, or a file given with --reference",
        )
    keys = ["ref_v_std_mps"] * (speed is not None) + ["ref_x_std_m"] * (position is not None)
    raise EstimateError(
        f"{trial.name}: the reference cannot be used as a measurement: its std is not known",
        f"write {' or '.join(f'{key} = …' for key in keys)} into the TOML file beside the log",
    )


def _speed_std(trial: Trial) -> float:
    """Return the std of a reference's velocity [m/s]: as stated, or by that of the places it comes from."""
    info, speed = trial.info, trial.reference_v
    if info.ref_v_std:
        return info.ref_v_std
    if speed is None or speed.places == 1 or not info.ref_x_std:
        return 0.0
    # of the slope of a line through n places, a step apart: σ / step / sqrt(n (n² - 1) / 12)
    n, step = speed.places, float(np.median(np.diff(speed.t)))
    return info.ref_x_std / step / math.sqrt(n * (n**2 - 1) / 12)


def _readings(kind: Literal["reference_v", "reference_x"], series: Series, std: float) -> Readings:
    finite = np.isfinite(series.value)
    return Readings(kind, series.t[finite], series.value[finite], std)


def _ahead(speeds: Readings, rolling: Rolling | None, offset: float) -> Readings:
    """Return speeds signed by the direction of the wheels; speeds that hide in their noise are left out."""
    kept = speeds.value > TOLD * speeds.std
    t, value = speeds.t[kept], speeds.value[kept]
    if rolling is not None and t.size:
        value = value * np.where(rolling.speed_at(t, offset) < 0, -1.0, 1.0)
    return replace(speeds, t=t, value=value)
