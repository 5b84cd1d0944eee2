"""How an estimate compares with an external reference, which it has never seen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from granite_lab.errors import EstimateError
from granite_lab.estimation.motion import Motion
from granite_lab.logs.trial import Array, Series, Trial

NAN = float("nan")

SHORTEST = 0.05
"""A way of the wheels shorter than this tells no slip ratio [m]."""


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
        slip: apparent slip ratio by (2), one less the reference's way over the wheels', from the first
            to the last common stamp.
        reference_std: std of the reference itself, which coverage and NEES allow for, same unit.

    Without an estimate of the body's motion (no IMU) rmse, bias, improvement, nees and coverage are NaN.
    """

    quantity: str
    samples: int
    rmse: float
    bias: float
    rmse_wheels: float
    improvement: float
    nees: float
    coverage: float
    slip: float = NAN
    reference_std: float = 0.0


def judge(motion: Motion, trial: Trial, reference_std: float = 0.0) -> tuple[Judgement, ...]:
    """Compare a motion with the external reference of its trial.

    Args:
        motion: the estimate.
        trial: with `reference_v` or `reference_x`, on the IMU's clock.
        reference_std: std of the reference's velocity [m/s], by which its samples may miss the estimate
            beyond the estimate's own std.

    Returns:
        one judgement per quantity that the reference gives.

    Raises:
        EstimateError: the trial has no reference, or it does not overlap the motion.
    """
    wheels = _mean_wheel(motion)
    found = []
    if trial.reference_v is not None:
        spread = np.hypot(motion.v_std, reference_std)
        judged = _compare("velocity", motion.t, motion.v, spread, wheels, trial.reference_v)
        found.append(replace(judged, reference_std=reference_std))
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
    way, rolled = (travelled(stamps, s, from_start) for s in (truth, by_wheels))
    error, error_wheels = estimate - truth, by_wheels - truth
    rmse, rmse_wheels = (_rms(e) for e in (error, error_wheels))
    known = np.isfinite(error)
    ratio = (np.abs(error) / np.where(spread > 0, spread, np.inf))[known]
    return Judgement(
        quantity=quantity, samples=stamps.size, rmse=rmse,
        bias=float(np.mean(error[known])) if known.any() else NAN, rmse_wheels=rmse_wheels,
        improvement=rmse_wheels / rmse if rmse > 0 else NAN,
        nees=float(np.mean(ratio**2)) if known.any() else NAN,
        coverage=float(np.mean(ratio <= 2.0)) if known.any() else NAN,
        slip=1.0 - way / rolled if abs(rolled) > SHORTEST else NAN,
    )  # fmt: skip


def travelled(t: Array, value: Array, is_distance: bool) -> float:
    """Way between the first and the last stamp [m], of a distance or by integrating a velocity."""
    known = np.isfinite(value)
    if is_distance:
        return float(value[known][-1] - value[known][0]) if known.any() else NAN
    return float(np.trapezoid(value[known], t[known]))


def _rms(error: Array) -> float:
    known = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(known**2))) if known.size else NAN
