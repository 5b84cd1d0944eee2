"""Whether the IMU alone comes to rest when the robot does: a witness of what only motion adds to it.

From one standstill to the next the integral of the specific force returns to zero within its noise. What is
left beyond that is a bias that changed in motion, or a vibration that sampling folded to slow frequencies.
The filter spreads it over the motion as the noise allows. When it came, no log tells.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from granite_lab.estimate import Estimate
from granite_lab.estimation.error_model import PD, V, std_of
from granite_lab.estimation.problem import Problem
from granite_lab.estimation.smoother import settle, smooth
from granite_lab.logs.sensors.doubt import Doubt

SPACING = 0.05
"""Of the filter's nodes [s]: what is left at rest builds up over seconds."""

CONTRADICTS = 3.0
"""A number more than this many std outside of what is possible contradicts its std."""


def left_at_rest(problem: Problem, offset: float) -> list[Estimate]:
    """Return the velocities that the IMU alone leaves where the body's is known, and what noise allows [m/s].

    It is known at standstills, and where a log begins or ends with slow wheels: they allow for anything
    between none of their speed and twice it. The wheels' stamps are moved by `offset` [s].
    """
    rolling = problem.rolling
    assert rolling is not None
    # biases that changed at an unknown instant are what is looked for
    known = tuple(restart for restart in problem.faults.restarts if restart.gap)
    faults = replace(problem.faults, restarts=known)
    without = replace(problem, rolling=None, coasts=False, faults=faults, spacing=SPACING)
    alone = smooth(settle(without, Estimate(offset), robust=False))
    came, t = alone.smoothed.innovations, alone.nominal.t
    stops = came.fresh("zero_velocity")
    left = [Estimate(-x, math.sqrt(s)) for x, s in zip(came.value[stops], came.variance[stops], strict=True)]
    v_std = std_of(alone.smoothed.P, {V: 1.0, PD: -1.0})
    for node, moves in ((0, problem.rests[0][0] > t[0]), (-1, problem.rests[-1][1] < t[-1])):
        if moves:
            wheels = float(rolling.speed_at(t[node], offset))
            body = float(alone.nominal.v[node] + alone.smoothed.x[node, V] - alone.smoothed.x[node, PD])
            left.append(Estimate(body - wheels, math.hypot(v_std[node], wheels)))
    return [x for x in left if np.isfinite(x.value)]


def doubt_closure(problem: Problem, offset: float) -> list[Doubt]:
    """Return the doubt about an IMU that does not come to rest with the robot.

    An error that comes at an unknown instant leaves any velocity between none and all of what is left, each
    as likely.
    """
    rolling = problem.rolling
    if rolling is None or problem.far or not problem.rests or not np.isfinite(rolling.speed).any():
        return []
    beyond = [x for x in left_at_rest(problem, offset) if abs(x.value) > CONTRADICTS * x.std]
    if not beyond:
        return []
    worst = max(beyond, key=lambda x: abs(x.value))
    seen = (
        f"the IMU comes to rest at {1e3 * worst.value:.0f} ± {1e3 * worst.std:.0f} mm/s: its bias changed in "
        "motion, or vibration is folded to slow frequencies"
    )
    pace = float(np.nanmax(np.abs(rolling.speed)))
    std = abs(worst.value) / (math.sqrt(12.0) * pace)
    remedy = "stand still for 2 s at both ends; mount the IMU stiffly, with its low-pass on"
    return [Doubt(seen, remedy=remedy, grade="fair", std=std)]
