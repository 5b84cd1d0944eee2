"""What a saved model predicts: simulations of what was left out, nothing standing in for what is missing.

`heldout` refits the sand and the gains of each trial that is left out. Whoever simulates a saved model has
only the numbers that all trials share. A set of effects whose sand has moved far to make up for a wrong one
may predict well in the first sense, and in the second worse than the paper's model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from granite_lab.discovery.heldout import Equations, shared_step, units
from granite_lab.inference.constants import TINY
from granite_lab.inference.fit import Fit
from granite_lab.inference.nuisances import TrialModel
from granite_lab.inference.point import SHARED, Point
from granite_lab.inference.pool import SAND, SAND_PER_TRIAL
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array
from granite_lab.model.command import distances_at

VELOCITY = "velocity"
"""The signal beside the channels: the error of the acceleration, integrated from rest to rest. Slip shows
there, and hardly in the acceleration itself."""

SHORTER = (1.0, 0.5, 0.0)
"""Parts of the step to the numbers that other speeds ask for, the first that has a solution; convention."""


def loss_of_model(problem: Problem, fit: Fit, tolerance: float) -> Array | None:
    """Return what simulations leave of the speeds that were left out, of the trials with few speeds.

    The numbers that all trials share are those that the others ask for; see `_squared_errors`. Linear as the
    step to them is, it may end where the robot digs itself in: then it is halved, and last those of the fit
    are taken. NaN for a unit without a solution for these, too. None where no unit has one, or a trial leaves
    the numbers open.
    """
    equations = Equations(problem, fit)
    order = [i for out in problem.commands for i in out]
    rows = []
    for out in units(problem):
        try:
            step = shared_step(equations, tolerance, [k for k, i in enumerate(order) if i not in out])
        except np.linalg.LinAlgError:
            return None
        whole = np.append(np.zeros(fit.point.vector.size - step.size), step)
        errors = (_squared_errors(problem, problem.stepped(fit.point, f * whole), out) for f in SHORTER)
        rows.append(next((row for row in errors if row is not None), None))
    return _stacked(rows)


def loss_of_files(problem: Problem, baseline: Fit) -> Array | None:
    """Return the same of the model with the sand and a_θ of the files.

    Args:
        problem: the trials.
        baseline: a fit without effects, of which start, tilt and offsets of the trials are taken.
    """
    point = baseline.point.at_files(len(SAND))
    return _stacked([_squared_errors(problem, point, out) for out in units(problem)])


def predicts_worse(after: Array | None, before: Array | None, tolerance: float) -> bool:
    """Tell whether simulations predict what was left out worse than others, by more than a standard error.

    Each signal counts by the logarithm of the ratio of its mean squares: minus twice the log likelihood per
    independent value of normal errors of unknown variance (G. E. P. Box and N. R. Draper, Biometrika 52,
    1965, 355-365, for independent responses). Errors within the tolerance do not count.

    Args:
        after, before: as `loss_of_model` or `loss_of_files` return them.
        tolerance: as a share of a channel's rms.
    """
    if after is None or before is None:
        return after is None and before is not None
    comparable = np.isfinite(after).any(axis=0) & np.isfinite(before).any(axis=0)
    solved = np.isfinite(after).any(axis=1) & np.isfinite(before).any(axis=1)
    after, before = (np.maximum(x[solved][:, comparable], tolerance**2) for x in (after, before))
    more = np.nansum(np.log(after / before), axis=1)
    scatter = np.std(more, ddof=1) if more.size > 1 else 0.0
    return bool(more.sum() > np.sqrt(more.size) * scatter)


def share_closed(after: Array, before: Array, tolerance: float) -> float:
    """Return the share of the gap that simulations of what was left out close; below zero where they open it.

    Args:
        after, before: as `loss_of_model` and `loss_of_files` return them.
        tolerance: as a share of a channel's rms.
    """
    both = np.isfinite(after) & np.isfinite(before)
    left, whole = (float(np.sum(np.fmax(x[both] - tolerance**2, 0.0))) for x in (after, before))
    return 1 - left / whole if whole > 0 else float("nan")


def _squared_errors(problem: Problem, point: Point, trials: Sequence[int]) -> Array | None:
    """Return per signal the mean square in motion, over that of the signal; mean over some trials.

    The sand is the mean of the other trials', and the gains are those of the files. NaN for a channel that
    was not logged.
    """
    names = [*dict.fromkeys(c for t in problem.trials for c in t.channels), VELOCITY]
    others = [x[:SAND_PER_TRIAL] for i, x in enumerate(point.trials) if i not in trials]
    sand = np.mean(others, axis=0) if others else np.zeros(SAND_PER_TRIAL)
    gains = [name.endswith("gain") for name in SHARED]
    filed = tuple(_as_filed(t, x, sand) for t, x in zip(problem.trials, point.trials, strict=True))
    point = replace(point, shared=np.where(gains, 0.0, point.shared), trials=filed)
    runs = problem.respond([problem.task(point, i) for i in trials])
    if runs is None:
        return None
    table = np.full((len(trials), len(names)), np.nan)
    for row, i, run in zip(table, trials, runs, strict=True):
        trial, x, command = problem.trials[i], point.trials[i], problem.command_of[i]
        left = trial.measured - trial.predict(run, x[: trial.size], point.sensors)
        for c, values in zip(trial.channels, left, strict=True):
            size, moving = problem.rms_of(command, c)
            squares = values[moving & np.isfinite(values)] ** 2
            if size > 0 and squares.size:
                row[names.index(c)] = squares.mean() / size**2
        if "accel_x" in trial.channels:
            _, moving = problem.rms_of(command, "accel_x")
            row[-1] = _of_velocity(trial, left[trial.channels.index("accel_x")], moving)
    counts = np.isfinite(table).sum(axis=0)
    return np.asarray(np.where(counts > 0, np.nansum(table, axis=0) / np.fmax(counts, 1), np.nan))


def _of_velocity(trial: TrialModel, error: Array, moving: NDArray[np.bool_]) -> float:
    """Return the mean square of the velocity's error in motion over that of the desired velocity.

    Args:
        trial: the trial.
        error: (n,) of the acceleration [m/s^2].
        moving: (n,) where the robot moves; before and behind it stands.
    """
    o = trial.observation
    velocity = np.cumsum(np.nan_to_num(error)) * o.width
    first, last = np.flatnonzero(moving)[[0, -1]]
    drift = np.interp(np.arange(velocity.size), [first, last], velocity[[first, last]])
    desired = np.gradient(distances_at(o.t + o.width / 2, o.variant), o.width)
    return float(np.mean((velocity - drift)[moving] ** 2) / max(np.mean(desired[moving] ** 2), TINY))


def _stacked(rows: Sequence[Array | None]) -> Array | None:
    """Return the rows of all units, NaN for those without a solution; None where no unit has one."""
    empty = next((np.full_like(row, np.nan) for row in rows if row is not None), None)
    return None if empty is None else np.stack([empty if row is None else row for row in rows])


def _as_filed(trial: TrialModel, x: Array, sand: Array) -> Array:
    """Return the numbers of a trial in some sand, gains as filed; the others are those of its mounting."""
    own = np.where([s.name.endswith("gain") for s in trial.slacks], 0.0, x[: trial.size])
    return np.concatenate([sand, own[SAND_PER_TRIAL:], x[trial.size :]])
