"""Estimates and references of the real logs, at common stamps."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from granite_lab.api.logs import Ingested, ingest
from granite_lab.logs.streams import WINDOW, slope

Array = NDArray[np.float64]

CAR_RUNS = (4, 21, 22)
HUSKY_STOP = (236.5, 246.8)
"""The one full stop of the Husky with GPS, by the notes of the data set [s]."""

BOREAL = ("SNOW_{}_01", "SANDY_LOAM_{}_01", "SANDY_LOAM_{}_06")
STEADY_FROM = 1.5
"""The three-wheeled robot has sped up after this [s]."""

BLOCK = 20.0
"""Over so long a stretch the noise of GPS averages out [s]."""

DIVISIONS = ((0.0, 0.05), (0.05, 0.10), (0.10, 0.20), (0.20, 9.9))
"""Magnitudes of the true slip ratio by which the car's samples are divided."""


@dataclass(frozen=True)
class Figures:
    """An estimate, or the wheels alone, against a reference velocity [m/s]."""

    rmse: float
    bias: float
    scatter: float
    samples: int


@dataclass(frozen=True, eq=False)
class Comparison:
    """One run, at the reference's stamps (K samples).

    Attributes:
        name: of the run.
        item: log, robot and motion.
        t, reference: (K,) stamps [s] and reference velocity [m/s].
        v, std, wheels: (K,) estimate, its std and the wheels' speed [m/s].
        spread: (K,) std of estimate and reference together [m/s].
        cost: processor time [s].
    """

    name: str
    item: Ingested
    t: Array
    reference: Array
    v: Array
    std: Array
    wheels: Array
    spread: Array
    cost: float

    @property
    def estimate(self) -> Figures:
        """The estimate's figures."""
        return figures(self.v - self.reference)

    @property
    def by_wheels(self) -> Figures:
        """The wheels' figures."""
        return figures(self.wheels - self.reference)

    @property
    def improvement(self) -> float:
        """RMSE of the wheels over RMSE of the estimate."""
        return self.by_wheels.rmse / self.estimate.rmse

    def coverage(self, spread: Array) -> float:
        """Share of errors within two std."""
        return float(np.mean(np.abs(self.v - self.reference) <= 2 * spread))

    @property
    def nees(self) -> float:
        """Mean of squared error over variance, the reference's noise allowed for."""
        return float(np.mean(((self.v - self.reference) / self.spread) ** 2))

    @property
    def true_slip(self) -> Array:
        """(K,) slip ratio by the reference."""
        return 1.0 - self.reference / np.maximum(np.abs(self.wheels), 0.02)

    def where(self, keep: NDArray[np.bool_]) -> tuple[Figures, Figures]:
        """Figures of estimate and wheels over some samples."""
        return figures((self.v - self.reference)[keep]), figures((self.wheels - self.reference)[keep])


@dataclass(frozen=True)
class Sliding:
    """A run of the three-wheeled robot: distances from `STEADY_FROM` on [m], and apparent slip ratio."""

    name: str
    rolled: float
    camera: float

    @property
    def slip(self) -> float:
        """Apparent slip ratio by (2)."""
        return 1.0 - self.camera / self.rolled


def figures(error: Array) -> Figures:
    """Root mean square, mean and std of errors; NaN of none."""
    if not error.size:
        return Figures(*3 * (float("nan"),), 0)
    return Figures(
        float(np.sqrt(np.mean(error**2))), float(np.mean(error)), float(np.std(error)), int(error.size)
    )


def timed(run: Callable[[], Iterable[Ingested]]) -> tuple[Ingested, float]:
    """Return the first log of a run, and the processor time it took [s]."""
    begin = time.process_time()
    first = next(iter(run()))
    return first, time.process_time() - begin


def mean_wheel(item: Ingested) -> Array:
    """(N,) mean of the wheels' velocities [m/s]; NaN where none is known."""
    known = np.isfinite(item.motion.v_wheel)
    total = np.where(known, item.motion.v_wheel, 0.0).sum(axis=1)
    return np.where(known.any(axis=1), total / np.maximum(known.sum(axis=1), 1), np.nan)


def car(data: Path, run: int) -> Comparison:
    """Small car on a floor, against motion capture, whose noise is far below the errors."""
    path = data / "f1tenth_optitrack" / "hoons_all_test.csv"
    item, cost = timed(lambda: ingest(path, rows=f"run_id = {run}"))
    motion, reference = item.motion, item.trial.reference_v
    assert reference is not None
    v, std, wheels = (np.interp(reference.t, motion.t, s) for s in (motion.v, motion.v_std, mean_wheel(item)))
    return Comparison(f"run {run}", item, reference.t, reference.value, v, std, wheels, std, cost)


def husky(data: Path) -> Comparison:
    """Husky against GPS; everything as the slope of a line through five fixes, as the GPS speed is."""
    folder = data / "husky_gps"
    item, cost = timed(
        lambda: ingest(folder / "imu.csv", encoders=folder / "odom.csv", reference=folder / "fix.csv")
    )
    motion, reference = item.motion, item.trial.reference_v
    assert reference is not None
    wheels = mean_wheel(item)
    logged = motion.t[np.isfinite(wheels)]
    inside = (reference.t >= logged[0]) & (reference.t <= logged[-1])
    t = reference.t[inside]
    steps = np.diff(motion.t, prepend=motion.t[0])

    def smoothed(velocity: Array) -> Array:
        return slope(t, np.interp(t, motion.t, np.cumsum(np.nan_to_num(velocity) * steps)))

    std = np.interp(t, motion.t, motion.v_std)
    spread = np.hypot(std, gps_noise(item))
    # the path's speed has no sign; the robot never drives backwards in this log
    return Comparison(
        "Husky", item, t, reference.value[inside], smoothed(motion.v), std, smoothed(wheels), spread, cost,
    )  # fmt: skip


def gps_noise(item: Ingested) -> float:
    """Std of the GPS speed [m/s], by how it differs from the wheels' changes from one window to the next.

    Of the robot's own motion little is left in the difference of GPS and wheels, and of a steady slip
    nothing in its changes; windows that share no fix are `WINDOW` samples apart.
    """
    reference, motion = item.trial.reference_v, item.motion
    assert reference is not None
    wheels = mean_wheel(item)
    known = np.isfinite(wheels)
    beside = reference.value - np.interp(reference.t, motion.t[known], wheels[known])
    return float(1.4826 * np.median(np.abs(np.diff(beside[::WINDOW]))) / np.sqrt(2.0))


def over(comparison: Comparison, length: float = BLOCK) -> tuple[Figures, Figures]:
    """Figures of the mean velocities of estimate and wheels over stretches of `length` [s]."""
    block = ((comparison.t - comparison.t[0]) / length).astype(int)
    count = np.maximum(np.bincount(block), 1)

    def mean(error: Array) -> Array:
        return np.asarray((np.bincount(block, error) / count)[:-1])

    return figures(mean(comparison.v - comparison.reference)), figures(
        mean(comparison.wheels - comparison.reference)
    )


def yaw_lag(data: Path) -> float:
    """Lag of the Husky's odometry behind its IMU [s], by yaw rate, which the estimator does not use.

    Positive where the encoders' stamps must be moved to later times.
    """
    import pandas as pd  # noqa: PLC0415, only here

    imu, odometry = (pd.read_csv(data / "husky_gps" / name) for name in ("imu.csv", "odom.csv"))
    t = np.arange(imu.stamp.iloc[0] + 2.0, imu.stamp.iloc[-1] - 2.0, 0.02)
    yaw = np.interp(t, imu.stamp, imu.wy)  # gravity lies on the sensor's y axis
    shifts = np.arange(-1.0, 1.0, 0.02)
    alike = [np.corrcoef(yaw, np.interp(t, odometry.stamp + s, odometry.wz))[0, 1] for s in shifts]
    return float(shifts[int(np.argmax(alike))])


def sliding(data: Path) -> list[Sliding]:
    """Three-wheeled robot on four surfaces: apparent slip by its camera; there is no IMU."""
    found = []
    for path in sorted((data / "robotino_slip").glob("*.csv")):
        item = next(iter(ingest(path)))
        reference, t = item.trial.reference_x, item.motion.t
        assert reference is not None
        steady = t > STEADY_FROM
        rolled = float(np.trapezoid(mean_wheel(item)[steady], t[steady]))
        found.append(Sliding(path.stem, rolled, float(np.ptp(reference.value[reference.t > STEADY_FROM]))))
    return found


def kobuki(data: Path) -> Ingested:
    """Two-wheeled robot whose 16-bit counters wrap."""
    return next(iter(ingest(data / "kobuki" / "kobuki_core_uint16_wrap.csv")))


def boreal(data: Path) -> list[tuple[str, Ingested]]:
    """Husky on sandy loam and snow: no reference and no standstill."""
    folder = data / "borealtc_husky"
    found = []
    for name in BOREAL:
        imu, wheels = (folder / f"{name.format(part)}.csv" for part in ("imu", "pro"))
        found.append((name.replace("_{}", ""), next(iter(ingest(imu, encoders=wheels)))))
    return found
