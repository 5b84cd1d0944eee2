"""Trials of one logger share the offset of their clocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Motion
from granite_lab.inference.clocks import one_clock
from granite_lab.logs.trial import Trial
from granite_lab.parameters import load_variants
from tests.fitting.made_up import made_up_trial
from tests.truth import faults

STD = 0.006


@pytest.fixture(scope="module")
def one() -> tuple[Motion, Trial]:
    motion, trial, *_ = made_up_trial(load_variants()[3], 0.8)
    return motion, trial


def moved(one: tuple[Motion, Trial], applied: Sequence[float]) -> tuple[list[Trial], list[Motion]]:
    """Return a trial as often as there are offsets, as estimation leaves it after applying each."""
    motion, trial = one
    trials, motions = [], []
    for by in applied:
        trials.append(faults.late(trial, by))
        start = replace(motion.t_start, value=motion.t_start.value + by)
        motions.append(replace(motion, clock_offset=Estimate(by, STD), clock_applied=by, t_start=start))
    return trials, motions


@pytest.mark.parametrize("applied", [(0.042, 0.036, 0.04, 0.0), (0.0, 0.022, 0.0, 0.0)])
def test_stamps_of_one_logger_are_moved_by_the_same(
    one: tuple[Motion, Trial], applied: tuple[float, ...]
) -> None:
    """Also where one trial alone would have been left as it is, or where it alone was moved."""
    trials, motions = one_clock(*moved(one, applied))
    common = float(np.median(applied))
    (expected,), (told,) = moved(one, [common])
    for trial, motion in zip(trials, motions, strict=True):
        assert motion.clock_applied == pytest.approx(common)
        assert motion.t_start.value == pytest.approx(told.t_start.value)
        for stream, wanted in ((trial.wheels, expected.wheels), (trial.currents, expected.currents)):
            np.testing.assert_allclose(stream.t, wanted.t, atol=1e-12)


def test_clocks_that_were_set_anew_in_each_trial_stay(one: tuple[Motion, Trial]) -> None:
    trials, motions = moved(one, (0.3, -0.2, 0.05, 0.12))
    after = one_clock(trials, motions)
    assert all(a is b for a, b in zip(after[0], trials, strict=True))
    assert all(a is b for a, b in zip(after[1], motions, strict=True))
