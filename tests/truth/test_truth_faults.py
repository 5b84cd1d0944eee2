"""Faults do what they say and nothing else.

Most show in a warning of the estimate, which `tests/estimation/test_faults.py` demands; here are the others.
"""

from __future__ import annotations

import numpy as np
import pytest

from granite_lab.logs.trial import Trial
from tests.truth import faults, generate


@pytest.fixture(scope="module")
def trial() -> Trial:
    return generate(11, velocity=0.5, duration=3.0, still=(1.0, 1.0), reference=True).trial


@pytest.mark.parametrize("how", ["frozen", "zero", "missing"])
def test_dead_encoder_repeats_itself_and_counts_on_or_is_missing(trial: Trial, how: str) -> None:
    dead = faults.dead_encoder(trial, "rl", 2.0, 3.0, how)
    t, angle, good = dead.wheels.t, dead.wheels.angle[:, 2], trial.wheels.angle[:, 2]
    inside, after = (t >= 2.0) & (t <= 3.0), t > 3.0
    if how == "missing":
        assert np.array_equal(np.isnan(angle), inside)
        assert angle[-1] == good[-1]
    else:
        assert np.ptp(angle[inside]) == 0
        assert angle[inside][0] == pytest.approx(good[t < 2.0][-1] if how == "frozen" else 0.0)
        assert np.diff(angle[after]) == pytest.approx(np.diff(good[after]))
    others = [0, 1, 3]
    assert np.array_equal(dead.wheels.angle[:, others], trial.wheels.angle[:, others])


def test_faults_that_no_warning_tells_of(trial: Trial) -> None:
    angle, t = trial.wheels.angle, trial.imu.t
    assert np.array_equal(faults.swapped(trial, "fl", "rr").wheels.angle, angle[:, [3, 1, 2, 0]])
    assert faults.random_dropouts(trial, 1, 0.2).imu.t.size == pytest.approx(0.8 * t.size, rel=0.1)
    assert np.diff(faults.wheel_dropout(trial, 2.0, 2.3).wheels.t).max() > 0.29
    assert np.diff(faults.imu_dropout(trial, 0.5, 0.8).imu.t).max() > 0.29
    assert faults.shifted_time(trial, 1.7e9).imu.t == pytest.approx(t + 1.7e9)
    short = faults.cut(trial, 2.0, 3.0)
    assert 2.0 <= short.imu.t[0] < short.imu.t[-1] <= 3.0
    assert not short.wheels.angle[0].any()
    assert short.wheels.angle[-1] == pytest.approx(5.2, abs=0.2)
