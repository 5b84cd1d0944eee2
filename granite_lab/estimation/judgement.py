"""How an estimate compares with an external reference, which it has never seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from granite_lab.errors import EstimateError
from granite_lab.estimation.motion import Motion
from granite_lab.logs.trial import Array, Series, Trial

NAN = float("nan")


@dataclass(frozen=True)
class Judgement:
    """An estimate against a reference, over the stamps that both cover.

    Attributes:
        quantity: "velocity" or "distance": what the reference gives.
        samples: how many stamps were compared.
        rmse: root mean square of estimate minus reference [m/s] or [m].
        bias: mean of estimate minus reference, same unit.
        rmse_wheels: the same with the wheels' velocity (distance) in place of the body's.
        improvement: rmse_wheels over rmse; above 1 the IMU helps.
        nees: mean of the squared error over the stated variance; 1 is ideal.
        coverage: share of errors within two stated std; 0.95 is ideal.
    """

    quantity: str
    samples: int
    rmse: float
    bias: float
    rmse_wheels: float
    improvement: float
    nees: float
    coverage: float


def judge(motion: Motion, trial: Trial) -> tuple[Judgement, ...]:
    """Compare a motion with the external reference of its trial.

    Args:
        motion: the estimate.
        trial: with `reference_v` or `reference_x`, on the IMU's clock.

    Returns:
        one judgement per quantity that the reference gives.

    Raises:
        EstimateError: the trial has no reference, or it does not overlap the motion.
    """
    wheels = _mean_wheel(motion)
    found = []
    if trial.reference_v is not None:
        found.append(_compare("velocity", motion.t, motion.v, motion.v_std, wheels, trial.reference_v))
    if trial.reference_x is not None:
        steps = np.diff(motion.t, prepend=motion.t[0])
        rolled = np.cumsum(np.nan_to_num(wheels) * steps)
        found.append(
            _compare("distance", motion.t, motion.x, motion.x_std, rolled, trial.reference_x, from_start=True)
        )
    if not found:
        raise EstimateError(
            f"{motion.trial}: there is no external reference to judge by",
            "a reference is a column ref_v_mps or ref_x_m",
        )
    return tuple(found)


def _mean_wheel(motion: Motion) -> Array:
    known = np.isfinite(motion.v_wheel)
    count = known.sum(axis=1)
    total = np.where(known, motion.v_wheel, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), NAN)


def _compare(
    quantity: str, t: Array, value: Array, std: Array, wheels: Array, reference: Series, *,
    from_start: bool = False,
) -> Judgement:  # fmt: skip
    """Compare at the reference's own stamps; a distance counts from the first common stamp."""
    inside = (reference.t >= t[0]) & (reference.t <= t[-1]) & np.isfinite(reference.value)
    stamps, truth = reference.t[inside], reference.value[inside]
    if stamps.size < 2:
        raise EstimateError(f"the reference's {quantity} does not overlap the log", "check its clock")
    estimate, by_wheels = np.interp(stamps, t, value), np.interp(stamps, t, wheels)
    spread = np.interp(stamps, t, std)
    if from_start:
        estimate, by_wheels, truth = (s - s[0] for s in (estimate, by_wheels, truth))
    error, error_wheels = estimate - truth, by_wheels - truth
    rmse, rmse_wheels = (float(np.sqrt(np.nanmean(e**2))) for e in (error, error_wheels))
    ratio = np.abs(error) / np.where(spread > 0, spread, np.inf)
    return Judgement(
        quantity=quantity, samples=stamps.size, rmse=rmse, bias=float(np.mean(error)),
        rmse_wheels=rmse_wheels,
        improvement=rmse_wheels / rmse if rmse > 0 else NAN, nees=float(np.mean(ratio**2)),
        coverage=float(np.mean(ratio <= 2.0)),
    )  # fmt: skip
