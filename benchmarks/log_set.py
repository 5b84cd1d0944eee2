"""The runs of one data set, each estimate beside its reference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from benchmarks.against_truth import Array, Velocities
from granite_lab.errors import LabError
from granite_lab.estimation import Motion
from granite_lab.logs.sensors.standstill import Interval
from granite_lab.logs.trial import Trial
from granite_lab.parameters import load_robot, load_soil
from tests.truth.motion import estimate


@dataclass(frozen=True, eq=False)
class LogSet:
    """The runs of one data set.

    Attributes:
        runs: velocities, at the stamps of the reference, or of the IMU if there is none.
        motions: what was estimated, by name of the run.
        refused: why a run was refused, by name.
    """

    runs: list[Velocities] = field(default_factory=list)
    motions: dict[str, Motion] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)

    def add(
        self, name: str, trial: Trial, robot: str, rests: Sequence[Interval] = (), soil: str = "dry_sand"
    ) -> None:  # fmt: skip
        """Estimate a log and put its velocity beside the reference, or note why it was refused."""
        try:
            motion = estimate(trial, load_robot(robot), rests=rests, soil=load_soil(soil))
        except LabError as refusal:
            self.refused[name] = refusal.message
            return
        reference, (logged, wheels) = trial.reference_v, wheel_speed(trial, robot)
        t = motion.t if reference is None else reference.t
        t = t[(t >= max(motion.t[0], logged[0])) & (t <= min(motion.t[-1], logged[-1]))]
        truth = np.full(t.size, np.nan) if reference is None else np.interp(t, reference.t, reference.value)
        v, std = (np.interp(t, motion.t, values) for values in (motion.v, motion.v_std))
        alone = np.interp(t, logged, wheels)
        self.runs.append(Velocities(name, t, truth, v, std, alone, motion.health.grade))
        self.motions[name] = motion


def wheel_speed(trial: Trial, robot: str) -> tuple[Array, Array]:
    """Stamps (K) [s] and mean velocity of the wheels (K) [m/s], as logged."""
    wheels, radius = trial.wheels, load_robot(robot).wheels.radius
    assert wheels is not None
    rate = np.gradient(wheels.angle, wheels.t, axis=0) if wheels.rate is None else wheels.rate
    known = np.isfinite(rate).any(axis=1)
    return wheels.t[known], radius * np.nanmean(rate[known], axis=1)
