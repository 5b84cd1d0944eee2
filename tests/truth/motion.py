"""The motion of a trial with what a test knows of it."""

from collections.abc import Sequence
from dataclasses import replace

from granite_lab.estimate import Estimate
from granite_lab.estimation import Motion, correct
from granite_lab.logs.trial import Trial
from granite_lab.parameters import Robot, Soil


def estimate(
    trial: Trial,
    robot: Robot,
    *,
    rests: Sequence[tuple[float, float]] = (),
    distance_measured: Estimate | None = None,
    soil: Soil | None = None,
) -> Motion:
    """Return the second of what `correct` returns; the body stands in `rests` [s], the distance is in [m]."""
    info = replace(trial.info, body_rests=(*trial.info.body_rests, *rests))
    if distance_measured is not None:
        tape = {
            "distance_measured": distance_measured.value,
            "distance_measured_std": distance_measured.std,
        }
        info = replace(info, **tape)
    return correct(replace(trial, info=info), robot, soil=soil)[1]
