"""From trials to what the fit needs: which command each was, when it began, and its bins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from granite_lab.discovery.nuisance import TrialModel
from granite_lab.discovery.observation import bin_width, observe
from granite_lab.errors import EstimateError, InputError
from granite_lab.estimation.motion import Motion
from granite_lab.logs.trial import Trial
from granite_lab.parameters import Robot, Variant, load_variants

TURNED = 0.005
"""Wheel angle by which the command has certainly begun [rad]; half a millimetre on the circumference."""


def trial_models(
    trials: Sequence[Trial], robot: Robot, motions: Sequence[Motion] | None = None
) -> tuple[list[TrialModel], tuple[Variant, ...]]:
    """Put all trials into bins of one width.

    Args:
        trials: the logs.
        robot: of all of them.
        motions: their estimates, which know command and start best.

    Returns:
        the trials, and the commands they are numbered by.

    Raises:
        InputError: nothing says what was commanded.
        EstimateError: a trial has no sensor to compare with.
    """
    if not trials:
        raise InputError("no trial to look at", "give at least one log")
    known: Sequence[Motion | None] = motions or [None] * len(trials)
    commands = [variant_of_trial(t, m) for t, m in zip(trials, known, strict=True)]
    starts = [start_of(t, m, v, robot.wheels.radius) for t, m, v in zip(trials, known, commands, strict=True)]
    variants = tuple(sorted(set(commands), key=lambda v: (v.velocity, v.acceleration, v.distance)))
    width = max(bin_width(t, robot) for t in trials)
    models = [
        TrialModel(observe(t, robot, v, s, width=width), variants.index(v), robot)
        for t, v, s in zip(trials, commands, starts, strict=True)
    ]
    return models, variants


def variant_of_trial(trial: Trial, motion: Motion | None) -> Variant:
    """Return what was commanded: as the log says, as the estimate recognised it, or by Table 2.

    Raises:
        InputError: nothing says it.
    """
    if motion is not None:
        return motion.variant
    info = trial.info
    if info.v_desired is not None:
        for known in load_variants():
            if abs(known.velocity - info.v_desired) < 1e-6:
                return Variant(
                    velocity=known.velocity,
                    acceleration=info.a_max or known.acceleration,
                    distance=info.distance or known.distance,
                )
        if info.a_max is not None and info.distance is not None:
            return Variant(velocity=info.v_desired, acceleration=info.a_max, distance=info.distance)
    raise InputError(
        f"trial '{trial.name}': velocity, acceleration and distance of the command are not known",
        "add '# v_desired_mps = …', '# a_max_mps2 = …' and '# distance_m = …' to the log",
    )


def start_of(trial: Trial, motion: Motion | None, variant: Variant, radius: float) -> float:
    """Return the start of the command [s, the log's time].

    The wheels turn TURNED only some time after it, which the command's acceleration tells.

    Raises:
        EstimateError: neither command nor wheels show it.
    """
    if motion is not None and np.isfinite(motion.t_start.value):
        return motion.t_start.value
    if trial.command is not None:
        driving = np.flatnonzero(np.nan_to_num(trial.command.value) > 0)
        if driving.size and driving[0] > 0:
            return float(trial.command.t[driving[0]] + trial.command.t[driving[0] - 1]) / 2
    if trial.wheels is not None:
        turned = np.nanmax(np.abs(trial.wheels.angle - np.nanmedian(trial.wheels.angle[:5], axis=0)), axis=1)
        moving = np.flatnonzero(turned > TURNED)
        if moving.size:
            late = np.sqrt(2 * TURNED * radius / variant.acceleration)
            return float(trial.wheels.t[moving[0]] - late)
    raise EstimateError(f"trial '{trial.name}': the start of the command cannot be found", "check its wheels")
