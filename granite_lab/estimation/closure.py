"""Closure of the integrated IMU: its velocity at standstills, and its distance against a reference.

From one standstill to the next the integral of the specific force returns to zero within its noise. What is
left beyond that is a bias that changed in motion, or a vibration that sampling folded to slow frequencies.
The filter spreads it over the motion as the noise allows. When it came, no log tells. Nor does a log tell
whether the IMU or a reference is wrong where their distances differ.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.special import expit

from granite_lab.estimate import Estimate
from granite_lab.estimation.error_model import PD, SIZE, P, SlipModel, V, X, std_of
from granite_lab.estimation.problem import Problem
from granite_lab.estimation.reference import lag_of
from granite_lab.estimation.smoother import Solution, settle, smooth
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.rounding import plus_minus

SPACING = 0.05
"""Of the filter's nodes [s]: what is left at rest builds up over seconds."""

CONTRADICTS = 3.0
"""A number more than this many std outside of what is possible contradicts its std."""

RULED_OUT = 0.01
"""Probability below which a way is said to be wrong; convention."""

FOLLOWS = 0.25
"""Time within which a body follows its wheels on sand [s]."""


def motion_by_imu(problem: Problem, offset: float) -> Solution:
    """Return the motion by the IMU and standstills alone; the wheels' stamps are moved by `offset` [s]."""
    # biases that changed at an unknown instant are what is looked for
    known = tuple(restart for restart in problem.faults.restarts if restart.gap)
    faults = replace(problem.faults, restarts=known)
    without = replace(problem, rolling=None, reference=(), coasts=False, faults=faults, spacing=SPACING)
    return smooth(settle(without, Estimate(offset), robust=False))


def left_at_rest(problem: Problem, by_imu: Solution, offset: float) -> list[Estimate]:
    """Return the velocities that the IMU alone leaves where the body's is known, and what noise allows [m/s].

    It is known at standstills, and where a log begins or ends with slow wheels: they allow for anything
    between none of their speed and twice it. The wheels' stamps are moved by `offset` [s].
    """
    rolling = problem.rolling
    assert rolling is not None
    came, t = by_imu.smoothed.innovations, by_imu.nominal.t
    stops = came.fresh("zero_velocity")
    left = [Estimate(-x, math.sqrt(s)) for x, s in zip(came.value[stops], came.variance[stops], strict=True)]
    v_std = std_of(by_imu.smoothed.P, {V: 1.0, PD: -1.0})
    for node, moves in ((0, problem.rests[0][0] > t[0]), (-1, problem.rests[-1][1] < t[-1])):
        if moves:
            wheels = float(rolling.speed_at(t[node], offset))
            body = float(by_imu.nominal.v[node] + by_imu.smoothed.x[node, V] - by_imu.smoothed.x[node, PD])
            left.append(Estimate(body - wheels, math.hypot(v_std[node], wheels)))
    return [x for x in left if np.isfinite(x.value)]


def doubt_closure(problem: Problem, offset: float) -> list[Doubt]:
    """Return the doubts about an IMU that does not come to rest with the robot, and about a reference.

    An error that comes at an unknown instant leaves any velocity between none and all of what is left, each
    as likely.
    """
    rolling = problem.rolling
    if rolling is None or problem.far or not problem.rests or not np.isfinite(rolling.speed).any():
        return []
    by_imu = motion_by_imu(problem, offset)
    doubts = _doubt_reference(problem, by_imu, offset)
    beyond = [x for x in left_at_rest(problem, by_imu, offset) if abs(x.value) > CONTRADICTS * x.std]
    if not beyond:
        return doubts
    worst = max(beyond, key=lambda x: abs(x.value))
    rest = plus_minus(worst, "m/s") if abs(worst.value) >= 1.0 else plus_minus(worst, "mm/s", 1e3)
    seen = (
        f"the IMU comes to rest at {rest}: its bias changed in "
        "motion, or vibration is folded to slow frequencies"
    )
    pace = float(np.nanmax(np.abs(rolling.speed)))
    # a reference knows the way whatever the IMU does
    between = _between_standstills(problem)
    ways = [r.distance(*between) for r in problem.reference] if between else []
    known = [way.std / rolling.path_length for way in ways if way]
    std = min([abs(worst.value) / (math.sqrt(12.0) * pace), *known])
    remedy = "stand still for 2 s at both ends; mount the IMU stiffly, with its low-pass on"
    return [*doubts, Doubt(seen, remedy=remedy, grade="fair", std=std)]


def _between_standstills(problem: Problem) -> tuple[float, float] | None:
    """Return the end of the first and the begin of the last standstill [s]; None where they are one."""
    begin, end = problem.rests[0][1], problem.rests[-1][0]
    return (begin, end) if end > begin else None


def _doubt_reference(problem: Problem, by_imu: Solution, offset: float) -> list[Doubt]:
    """Return the doubts about a reference that goes another way than the IMU, or at another time.

    Between the first and the last standstill the IMU tells the way, too. Where both differ beyond their
    std, either may be right: the error is all of the difference, or none. The odds are even unless one of
    them goes farther than the wheels roll.
    """
    rolling, doubts = problem.rolling, list[Doubt]()
    assert rolling is not None
    between = _between_standstills(problem)
    for readings in problem.reference:
        late = lag_of(readings, rolling, offset)
        if abs(late) > FOLLOWS:
            order = "after" if late > 0 else "before"
            seen = f"the reference tells of the motion {abs(late):.1f} s {order} the wheels"
            doubts.append(Doubt(seen, remedy="correct its stamps", grade="fair"))
        if between is None or (distance := readings.distance(*between)) is None:
            continue
        own = _way(by_imu, *between)
        miss = abs(distance.value - own.value)
        if miss > CONTRADICTS * math.hypot(distance.std, own.std):
            seen = (
                f"between the standstills the reference goes {distance.value:.2f} m, the IMU alone "
                f"{own.value:.2f} ± {own.std:.2f} m"
            )
            wrong = _probability_of_imu(own.value, distance.value, rolling.path_length)
            std = math.sqrt(wrong) * math.hypot(miss, math.sqrt(2.0) * own.std) / rolling.path_length
            remedy = "check scale, clock and std of the reference" if wrong > RULED_OUT else "check the IMU"
            doubts.append(Doubt(seen, remedy=remedy, grade="fair", std=std))
    return doubts


def _probability_of_imu(own: float, reference: float, rolled: float) -> float:
    """Return the probability that the IMU's way is right and the reference's is not, all ways in [m].

    Driven wheels roll at least as far as the body goes, but for a slip ratio on a slope or a wrong radius of
    about that on soft ground.
    """
    beyond = (max(0.0, abs(way) / rolled - 1.0) / SlipModel.steady for way in (own, reference))
    imu, other = (-0.5 * x**2 for x in beyond)
    return float(expit(imu - other))


def _way(solution: Solution, begin: float, end: float) -> Estimate:
    """Return the way from one instant to another [s] of a motion, with its std [m]."""
    i, j = (int(np.argmin(np.abs(solution.nodes.t - edge))) for edge in (begin, end))
    way, weights = solution.travelled[j] - solution.travelled[i], np.zeros(SIZE)
    weights[[X, P]] = 1.0, -1.0
    return Estimate(float(way), solution.smoothed.std_of_change(weights, i, j))
