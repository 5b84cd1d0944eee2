"""One cell of the estimation benchmark: seeded trials, how each estimate fared, and all together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchmarks.against_truth import rms
from benchmarks.intervals import alike, wilson
from granite_lab.errors import LabError
from granite_lab.estimation.motion import Health, Motion
from granite_lab.parameters import load_robot
from tests.truth import TruthTrial, generate
from tests.truth.motion import estimate

Array = npt.NDArray[np.float64]

KINDS = ("wheel", "specific_force", "zero_rate")
"""Measurement updates whose innovations are judged; zero velocity is met too closely to say much."""


@dataclass(frozen=True)
class Cell:
    """A kind of trial: IMU grade, duration [s], velocity [m/s], offset of the encoders' clock [s]."""

    grade: str
    duration: float
    velocity: float
    offset: float = 0.0


@dataclass(frozen=True)
class Score:
    """How one estimate fared against its truth; errors are estimate minus truth.

    Attributes:
        v_square, v_nees: mean squared error of v [m^2/s^2] and of error over std, while moving.
        v_within: share of the moving samples with the error within 2 std.
        distance, distance_std: relative error of the distance and its stated std.
        slip, slip_std: error of λ_R over the steady part the estimator chose, and its stated std.
        offset, offset_std: error of the clock offset [s] and its std; NaN std where not observable.
        white: correlation of successive normalised innovations for each of KINDS.
        refused: the reason, where no estimate was given; then all numbers are NaN.
    """

    v_square: float = np.nan
    v_nees: float = np.nan
    v_within: float = np.nan
    distance: float = np.nan
    distance_std: float = np.nan
    slip: float = np.nan
    slip_std: float = np.nan
    offset: float = np.nan
    offset_std: float = np.nan
    white: tuple[float, ...] = (np.nan, np.nan, np.nan)
    refused: str = ""


def successive_correlation(health: Health, kind: str) -> float:
    """Return the correlation of successive normalised innovations of one kind of update; 0 is white."""
    chosen = np.array([k == kind for k in health.kind], dtype=bool)
    if chosen.sum() < 10:
        return float("nan")
    z = health.innovation[chosen] / health.innovation_std[chosen]
    z = z - z.mean()
    return float((z[1:] * z[:-1]).sum() / (z**2).sum())


def draw(cell: Cell, seed: int) -> TruthTrial:
    """Draw a trial of this kind."""
    return generate(
        seed, velocity=cell.velocity, duration=cell.duration, grade=cell.grade, clock_offset=cell.offset
    )


def score(cell: Cell, seed: int) -> Score:
    """Draw a trial of this kind, estimate its motion and judge it."""
    truth = draw(cell, seed)
    try:
        motion = estimate(truth.trial, load_robot("granite", cell.grade))
    except LabError as refusal:
        return Score(refused=refusal.message)
    return judged(cell, truth, motion)


def judged(cell: Cell, truth: TruthTrial, motion: Motion) -> Score:
    """Judge an estimate."""
    moving = (motion.t > truth.start) & (motion.t < truth.stop + 0.5)
    error = (motion.v - truth.at(motion.t, "v"))[moving]
    z = error / motion.v_std[moving]
    travelled = float(truth.x[-1])
    return Score(
        v_square=float(np.mean(error**2)),
        v_nees=float(np.mean(z**2)),
        v_within=float(np.mean(np.abs(z) < 2)),
        distance=motion.distance.value / travelled - 1,
        distance_std=motion.distance.std / travelled,
        slip=motion.slip_ratio.value - truth.slip_ratio_between(*motion.steady),
        slip_std=motion.slip_ratio.std,
        offset=motion.clock_offset.value - cell.offset,
        offset_std=motion.clock_offset.std,
        white=tuple(successive_correlation(motion.health, kind) for kind in KINDS),
    )


@dataclass(frozen=True)
class Summary:
    """Many scores of one cell.

    Attributes:
        trials, refused: how many were drawn, and how many of them got no estimate.
        v_rmse, v_worst: RMS error of v over all trials, and of the worst 5 % of trials [m/s].
        nees: mean NEES of v per degree of freedom; v_cover: share of samples within 2 std.
        nees_error, v_cover_error, slip_error: standard errors of nees, v_cover and slip_mean by the
            scatter of the trials, for the samples of one trial hang together.
        distance_rmse, distance_cover: relative.
        slip_mean, slip_size, slip_cover: of λ_R: mean and mean absolute error.
        slip_stated: root mean square of the std that the estimates of λ_R state.
        offset_rmse, offset_mean [s], offset_cover, observable: of the clock offset.
        white: mean correlation of successive innovations for each of KINDS.
    """

    trials: int
    refused: int
    v_rmse: float = np.nan
    v_worst: float = np.nan
    nees: float = np.nan
    v_cover: float = np.nan
    distance_rmse: float = np.nan
    distance_cover: float = np.nan
    slip_mean: float = np.nan
    slip_cover: float = np.nan
    offset_rmse: float = np.nan
    offset_mean: float = np.nan
    offset_cover: float = np.nan
    observable: float = np.nan
    white: tuple[float, ...] = (np.nan, np.nan, np.nan)
    nees_error: float = np.nan
    v_cover_error: float = np.nan
    slip_size: float = np.nan
    slip_error: float = np.nan
    slip_stated: float = np.nan


def summarise(scores: list[Score]) -> Summary:
    """Put the scores of a cell together; refused trials count only as such."""
    good = [s for s in scores if not s.refused]
    if not good:
        return Summary(len(scores), len(scores))

    def column(name: str) -> Array:
        return np.array([getattr(s, name) for s in good], dtype=float)

    def cover(name: str) -> float:
        error, std = column(name), column(f"{name}_std")
        stated = np.isfinite(std)
        return float(np.mean(np.abs(error[stated]) < 2 * std[stated])) if stated.any() else float("nan")

    def error_of_mean(name: str) -> float:
        return float(np.std(column(name)) / np.sqrt(len(good)))

    stated = np.isfinite(column("offset_std"))
    offset = column("offset")[stated] if stated.any() else np.array([np.nan])
    return Summary(
        trials=len(scores),
        refused=len(scores) - len(good),
        v_rmse=float(np.sqrt(column("v_square").mean())),
        v_worst=float(np.sqrt(np.quantile(column("v_square"), 0.95))),
        nees=float(column("v_nees").mean()),
        v_cover=float(column("v_within").mean()),
        distance_rmse=rms(column("distance")),
        distance_cover=cover("distance"),
        slip_mean=float(column("slip").mean()),
        slip_cover=cover("slip"),
        offset_rmse=rms(offset),
        offset_mean=float(offset.mean()),
        offset_cover=cover("offset"),
        observable=float(stated.mean()),
        white=tuple(float(w) for w in np.nanmean(np.array([s.white for s in good]), axis=0)),
        nees_error=error_of_mean("v_nees"),
        v_cover_error=error_of_mean("v_within"),
        slip_size=float(np.mean(np.abs(column("slip")))),
        slip_error=error_of_mean("slip"),
        slip_stated=rms(column("slip_std")),
    )


def together(cells: list[Summary]) -> str:
    """Say what the coverages are over all cells, and whether the cells differ by more than chance."""
    trials = [s.trials - s.refused for s in cells]
    told = []
    for name, shares in (
        ("distance", [s.distance_cover for s in cells]), ("λ_R", [s.slip_cover for s in cells]),
    ):  # fmt: skip
        mean = float(np.average(shares, weights=trials))
        low, high = wilson(mean, sum(trials))
        each = f"{100 * mean:.1f} % ({100 * low:.1f}–{100 * high:.1f})"
        told.append(f"{name} {each}, p = {alike(shares, trials):.2f}")
    return (
        f"2σ coverage over all cells, with its 95 % interval: {'; '.join(told)}\n"
        "  (p: probability of the scatter between cells if all have the same coverage)."
    )
