"""Intervals of shares and means that come from few trials."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binomtest

from benchmarks.intervals import alike, around, excludes, wilson


@pytest.mark.parametrize(("hits", "trials"), [(0, 10), (10, 10), (19, 20), (95, 100), (50, 100)])
def test_wilson_interval_is_scipys(hits: int, trials: int) -> None:
    expected = binomtest(hits, trials).proportion_ci(method="wilson")
    assert wilson(hits / trials, trials) == pytest.approx((expected.low, expected.high), abs=1e-4)


def test_only_an_interval_beside_the_aim_excludes_it() -> None:
    assert excludes((0.80, 0.91), (0.92, 0.98))
    assert excludes((0.985, 1.0), (0.92, 0.98))
    assert not excludes((0.88, 0.93), (0.92, 0.98))
    assert not excludes((0.90, 1.0), (0.92, 0.98))


def test_interval_of_a_mean_stays_within_what_is_possible() -> None:
    assert around(0.99, 0.02, 0.0, 1.0) == pytest.approx((0.9508, 1.0))


def test_shares_of_one_source_are_called_different_as_often_as_chance_says() -> None:
    rng = np.random.default_rng(1)
    trials = [100] * 16
    p = [alike((rng.binomial(100, 0.93, 16) / 100).tolist(), trials) for _ in range(400)]
    assert 0.02 < np.mean(np.array(p) < 0.05) < 0.09
    assert alike([0.93] * 15 + [0.7], trials) < 1e-6
