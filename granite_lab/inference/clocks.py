"""One logger, one offset: the stamps of all trials of a set may be moved by the same time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Motion
from granite_lab.logs.trial import Trial

Clocked = tuple[list[Trial], list[Motion]]


def clocks(trials: Sequence[Trial], motions: Sequence[Motion]) -> tuple[Clocked, ...]:
    """Return how the stamps of encoders and currents may stand.

    Estimation finds the offset of each trial for itself, within several milliseconds, and applies only one
    that is clearly larger than an ordinary latency. Trials of one logger share their offset: differences of
    milliseconds between them would be taken for a gap of the model. Where most trials agree with the median
    of what was applied, all follow it. Where they disagree, either the clocks were set anew in each trial, or
    a body that follows its wheels late, more so at some speeds, was taken for an offset.

    Args:
        trials: as estimation corrected them.
        motions: their estimates, in the same order.

    Returns:
        both with the offset in stamps and starts; where they disagree, as they are and with the common one.
    """
    given = list(trials), list(motions)
    if len(trials) < 2:
        return (given,)
    applied = np.array([m.clock_applied for m in motions])
    std = np.array([m.clock_offset.std for m in motions])
    common = float(np.median(applied))
    alike = np.abs(applied - common) <= 2 * np.nan_to_num(std)
    if not applied.any():
        return (given,)
    pairs = [_moved(t, m, common) for t, m in zip(trials, motions, strict=True)]
    together = [t for t, _ in pairs], [m for _, m in pairs]
    return (together,) if 2 * int(alike.sum()) > len(trials) else (given, together)


def _moved(trial: Trial, motion: Motion, common: float) -> tuple[Trial, Motion]:
    """Return a trial whose stamps of encoders, currents and command are moved by the common offset."""
    by = common - motion.clock_applied
    moved = replace(trial, **trial.on_its_clock(by))
    start = Estimate(motion.t_start.value + by, motion.t_start.std)
    return moved, replace(motion, clock_applied=common, t_start=start)
