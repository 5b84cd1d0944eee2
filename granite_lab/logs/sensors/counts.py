"""Whether the steps of logged wheel angles are those of the encoder that the robot's file names.

A logger that turns counts into radians by another number of counts a turn, or by another gear, scales all
angles alike. That looks like slip. But an angle goes in whole counts, so that its steps tell by what number
they were divided: over the candidates the mean of cos(2 pi d / step), for the differences d of successive
angles, is near 1 at the true step and near 0 elsewhere.
"""

from __future__ import annotations

import math

import numpy as np

from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.trial import Array, WheelStream

LEAST, MOST = 0.01, 0.2
"""Shares by which the steps may differ from the file's. Grids that differ less cannot be told apart; one that
differs more is of another encoder, of which the file says nothing."""

FEWEST_COUNTS, MOST_COUNTS = 20, 2000
"""Differences of fewer counts than this are on many grids; more than this make too fine a search."""

ENOUGH = 400
"""So many differences are looked at, the first of a log: six digits hide the steps of large numbers."""

CYCLE = 0.05
"""Steps of the search, in cycles of the longest difference."""

AT_ONCE = 64
"""So many candidates are compared at once: their numbers stay in the processor's cache."""

FALSE_ALARM = 1e-4
"""Probability with which differences that are on no grid seem to be on one; convention."""


def other_counts(wheels: WheelStream, counts: float) -> Doubt | None:
    """Return the doubt about angles whose steps are not those of the file's `counts` a turn, but near them.

    None where the log shows no steps: these are coarser, or were lost by rounding.
    """
    if not counts or wheels.rate is not None:
        return None
    nominal = 2.0 * math.pi / counts
    if any(step and abs(step / nominal - 1.0) > MOST for step in wheels.resolution):
        return None
    turns = np.abs(np.diff(wheels.angle, axis=0)).ravel()
    turns = turns[(turns >= FEWEST_COUNTS * nominal) & (turns <= MOST_COUNTS * nominal)][:ENOUGH]
    if turns.size == 0:
        return None
    spacing = CYCLE * nominal / float(turns.max())
    off = np.arange(-MOST, MOST, spacing)
    score = _on_grid(turns, nominal * (1.0 + off))
    best = int(np.argmax(score))
    share, step = float(off[best]), nominal * float(1.0 + off[best])
    decimals = 10.0 ** np.arange(math.ceil(math.log10(step)), math.floor(math.log10(turns.min() / 4.0)) + 1)
    coarser = _on_grid(turns, np.concatenate([step * np.arange(2, 6), decimals]))
    elsewhere = score[(np.abs(off - share) > LEAST) | (np.abs(off) <= LEAST)]
    rival = max(float(elsewhere.max()), float(coarser.max()))
    # the phase of a whole multiple scatters normally, with a variance of 2 (1 - score); half a step of the
    # search off its place it seems to scatter, too. Wheels that turn alike tell as much as one
    independent, missed = turns.size / wheels.angle.shape[1], 0.5 * (math.pi * CYCLE) ** 2
    clearer = 0.5 * independent * math.log(max(1.0 - rival, missed) / max(1.0 - float(score[best]), missed))
    if min(independent * float(score[best]) ** 2, clearer) < math.log(score.size / FALSE_ALARM):
        return None
    return Doubt(
        f"the wheel angles go in steps of a turn over {2.0 * math.pi / step:.0f}, and the robot's file says "
        f"{counts:.0f} counts a turn: the logger divides by a wrong number, or the file is wrong",
        remedy="correct counts_per_rev or the log; ten turns on a hard floor tell which",
        grade="fair", rolled_std=math.sqrt(0.5) * abs(share),
    )  # fmt: skip


def _on_grid(turns: Array, steps: Array) -> Array:
    """(K,) how well turns (N,) are whole multiples of each of the steps (K,): 1 for all, 0 by chance."""
    found = np.empty(steps.size)
    for first in range(0, steps.size, AT_ONCE):
        some = slice(first, first + AT_ONCE)
        cycles = turns / steps[some, None]
        cycles -= np.rint(cycles)
        phase = cycles.astype(np.float32)  # of which cosines are quick
        phase *= np.float32(2.0 * math.pi)
        found[some] = np.cos(phase, out=phase).mean(axis=1, dtype=np.float64)
    return found
