"""Difference of the clocks' rates, by their offsets at the first and at the last ramp.

The offset that shows where the robot sets off and the one where it brakes are the same, unless one of the
two clocks is fast. Which of them is wrong, no log tells. A body on soft tyres or with play in its gears
swings on after the wheels have stopped: the standstill then looks late, but the ramp before it does not.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from granite_lab.estimate import Estimate
from granite_lab.estimation.clock import LEFT_OVER, STILL, WIDE, posterior
from granite_lab.estimation.problem import Problem
from granite_lab.estimation.smoother import nominal_of
from granite_lab.estimation.wheels import Rolling
from granite_lab.logs.counters import interpolated
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.sensors.ramps import LARGEST, STEP, changing, correlate
from granite_lab.logs.sensors.stamps import FASTEST
from granite_lab.logs.sensors.standstill import Interval

SLOW, FULL = 0.1, 0.9
"""A ramp lies between these shares of the constant speed."""

REACH, APART = 0.12, 0.04
"""Offsets are compared up to this far from where ramps correlate best, and so far apart [s]."""

SHOWN = 2.5
"""Rates differ where they do so by this many std: by chance one log in eighty seems to."""


class Ramp(NamedTuple):
    """A ramp of the wheels' speed on their own clock [s]."""

    begin: float
    end: float

    @property
    def middle(self) -> float:
        """[s]."""
        return 0.5 * (self.begin + self.end)


def outer_ramps(rolling: Rolling) -> tuple[Ramp, Ramp] | None:
    """Return the first ramp on which the wheels gain their usual speed, and the last that ends it."""
    finite = np.isfinite(rolling.speed)
    t, pace = rolling.t[finite], np.abs(rolling.speed[finite])
    fast = pace > 0.6 * pace.max(initial=0.0)
    if not fast.any():
        return None
    usual = float(np.median(pace[fast]))
    full, slow = np.flatnonzero(pace > FULL * usual), np.flatnonzero(pace < SLOW * usual)
    before = slow[slow < full[0]]
    if not before.size or slow[-1] < full[-1]:
        return None
    # wheels that coast to rest tell little: the ramp ends where the pace is halved
    half = np.flatnonzero(pace < 0.5 * usual)
    after = half[half > full[-1]]
    return Ramp(float(t[before[-1]]), float(t[full[0]])), Ramp(float(t[full[-1]]), float(t[after[0]]))


class Lag(NamedTuple):
    """The clock offset by one ramp [s]: by the likelihood of it and its standstill; by its shape alone."""

    likely: Estimate
    shape: float


def lag_at(problem: Problem, ramp: Ramp, most: float, also: float | None = None) -> Lag | None:
    """Return the clock offset by one ramp, within `most` [s] of none; None if it does not show.

    A slow ramp looks alike over half a second: the likelihood judges the offset by its shape and one that may
    hold `also` [s], and all between.
    """
    rolling = problem.rolling
    assert rolling is not None
    grid = np.arange(ramp.begin - most - 1.0, ramp.end + most + 1.0, STEP)
    wheel = changing(np.gradient(rolling.speed_at(grid), STEP))
    near = (grid > ramp.begin - STILL) & (grid < ramp.end + STILL)
    force = changing(interpolated(grid, problem.imu.t, problem.imu.forward))
    reach = round(most / STEP)
    _, best, clearness = correlate(force, np.where(near, wheel, 0.0), reach)
    if clearness == 0.0:
        return None
    centre = (best - reach) * STEP
    lowest, highest = sorted((centre, centre if also is None else also))
    window: Interval = (ramp.begin + lowest - 2.0 * STILL, ramp.end + highest + 2.0 * STILL)
    cut = replace(problem.cut(*window, centre), spins=False, spacing=WIDE)
    offsets = np.arange(lowest - REACH, highest + REACH + 0.5 * APART, APART)
    mean, std = posterior([(cut, nominal_of(cut, centre))], Estimate(0.0, np.inf), offsets)
    return Lag(Estimate(mean, float(np.hypot(std, LEFT_OVER))), centre)


def clock_rate(problem: Problem) -> Estimate:
    """Return by how much the encoders' clock is too slow against the IMU's: how their offset changes in time.

    Of the changes by likelihood and by shape the smaller one counts, none where they contradict each other.
    The std is NaN where no ramps show it, or where both sensors are stamped together.
    """
    rolling = problem.rolling
    ramps = None if rolling is None else outer_ramps(rolling)
    if rolling is None or ramps is None or np.isin(rolling.t, problem.imu.t).mean() > 0.5:
        return Estimate(0.0)
    length = ramps[1].middle - ramps[0].middle
    first = lag_at(problem, ramps[0], LARGEST)
    last = first and lag_at(problem, ramps[1], LARGEST + FASTEST * length, first.likely.value)
    if first is None or last is None:
        return Estimate(0.0)
    likely, shape = last.likely.value - first.likely.value, last.shape - first.shape
    change = min(likely, shape, key=abs) if likely * shape > 0.0 else 0.0
    # Stamps that were spread evenly are off by their scatter, at one ramp by other samples than at the other.
    spread = np.sqrt(2.0) * problem.stamp_std
    return Estimate(
        change / length, float(np.linalg.norm([first.likely.std, last.likely.std, spread])) / length
    )


def doubt_rate(problem: Problem) -> list[Doubt]:
    """Return the doubt about clocks that run at different rates.

    Where the encoders' clock is wrong by a share, so is the speed of the wheels; where the IMU's is, so is
    the body's, and the distance by twice as much. Which it is, is unknown.
    """
    rate = clock_rate(problem)
    if not abs(rate.value) > SHOWN * rate.std:
        return []
    runs = f"{100 * abs(rate.value):.1f} ± {100 * rate.std:.1f} % {'slow' if rate.value > 0 else 'fast'}"
    seen = f"the encoders' clock runs {runs} against the IMU's"
    remedy = "stamp both by one clock; which of them is right no log tells"
    return [Doubt(seen, remedy=remedy, grade="fair", std=float(np.sqrt(2.0)) * abs(rate.value))]
