"""What is locked to the angle of the wheels: orders of their turning in what the model leaves.

A quantity that repeats N times a turn is a line at order N at every speed, a resonance of the frame is not
(order tracking: R. B. Randall, Vibration-based Condition Monitoring, Wiley 2011). Its size follows either
the load of a wheel, which hardly changes, or the pull, which follows the acceleration of the robot.
"""

from __future__ import annotations

import math

import numpy as np

from granite_lab.discovery.lines import table_of_gains, without_strongest_command
from granite_lab.inference.constants import LEAST_GAIN
from granite_lab.inference.fit import Fit
from granite_lab.inference.gap import remaining
from granite_lab.inference.nuisances import TrialModel
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array

LUGS = (6, 30)
"""Least and largest number of lugs: lower orders are those of run-out and of what is not round, and treads of
measured wheels have 14 to 30 (`docs/validation.md`)."""

ORDERS = np.arange(1, 2 * LUGS[1] + 1)
"""Orders that are looked at: at twice the most lugs the slowest speed of Table 2 is still resolved."""


def gains(problem: Problem, fit: Fit) -> Array:
    """Return (w, c, n): gain of log likelihood by the criterion of Schwarz, per way, command and order.

    A way is where a line may show: in one channel or in all, its size constant or in proportion to the pull.

    Args:
        problem: the trials.
        fit: of them; `ORDERS` are looked for in what it leaves.
    """
    left = remaining(problem, fit)
    turns, pulls = zip(*(_of_trial(t, row) for t, row in zip(problem.trials, left, strict=True)), strict=True)
    return np.concatenate(
        [table_of_gains(problem, left, turns, ORDERS.astype(float), size) for size in (None, pulls)]
    )


def _of_trial(trial: TrialModel, left: Array) -> tuple[Array | None, Array | None]:
    """Return turns of the wheels and acceleration (n,) as a fit has them, None where that was not logged."""
    seen = {c: trial.measured[k] - left[k] for k, c in enumerate(trial.channels)}
    return seen["wheel"] / (2 * np.pi) if "wheel" in seen else None, seen.get("accel_x")


def lugs(problem: Problem, fit: Fit, filed: float) -> float:
    """Return the number of lugs that what a fit leaves shows, else that of the robot's file."""
    return standing_out(gains(problem, fit), filed)


def standing_out(table: Array, filed: float) -> float:
    """Return the order that stands out at all speeds, of those that lugs may have; else that of the file.

    It must be better than that of the file, and than none, by what one name among so many must be worth; the
    command that speaks for it most does not count.

    Args:
        table: (w, c, n) gain of each way, command and order.
        filed: number of lugs in the robot's file.
    """
    whole = without_strongest_command(table)
    possible = np.where(LUGS[0] <= ORDERS, whole, -np.inf)
    way, best = np.unravel_index(int(np.argmax(possible)), whole.shape)
    at_file = max(float(whole[:, round(filed) == ORDERS].max(initial=0.0)), 0.0)
    worth = LEAST_GAIN + math.log(whole.size)
    return float(ORDERS[best]) if possible[way, best] > at_file + worth else filed
