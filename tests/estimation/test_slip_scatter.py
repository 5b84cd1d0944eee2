"""How much slip scatters is heard in the trial itself."""

from __future__ import annotations

import numpy as np
import pytest

from granite_lab.estimation import estimate, identification
from granite_lab.estimation.error_model import SlipModel
from granite_lab.parameters import load_robot
from tests.truth.long_drives import Drive, cycles, drive


@pytest.mark.parametrize("mean", [0.006, 0.012, 0.03])
@pytest.mark.parametrize("spread", [0.1, 0.4])
def test_variance_is_the_mean_over_the_posterior(mean: float, spread: float) -> None:
    """A log-normal posterior of the scatter, sampled."""
    peak = np.log(mean)
    places = np.round((peak - np.log(0.01)) / np.log(2.0)) + np.array([-1.0, 0.0, 1.0])
    scores = [-0.5 * ((np.log(0.01 * 2.0**p) - peak) / spread) ** 2 for p in places]
    found = identification.expected(int(places[1]), *scores)
    draws = np.exp(np.random.default_rng(0).normal(peak, spread, 400_000))
    assert found == pytest.approx(np.sqrt(np.mean(draws**2)), rel=0.01)


def test_scatter_stays_within_its_bounds_where_the_likelihood_tells_nothing() -> None:
    for best, scores in ((-6, (0.0, 0.0, 0.0)), (6, (0.0, 0.0, 0.0)), (0, (-1e-6, 0.0, -1e-6))):
        assert (
            identification.LEAST_SCATTER
            <= identification.expected(best, *scores)
            <= identification.MOST_SCATTER
        )


def found_in(truth: Drive, monkeypatch: pytest.MonkeyPatch) -> float:
    """The scatter that the estimation of a drive settles on."""
    found: list[SlipModel] = []
    original = identification.identify_scatter

    def spy(problem, offset):
        found.append(original(problem, offset))
        return found[-1]

    monkeypatch.setattr("granite_lab.estimation.chain.identify_scatter", spy)
    estimate(truth.trial, load_robot("granite", "industrial"))
    return found[-1].scatter


def test_sand_that_scatters_more_is_heard_to_do_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """The truth wanders within half a second, smoothly; what counts is its speed of change."""
    calm, rough = (
        found_in(drive(3, cycles(1, 16.0), scatter=scatter, accel=3e-4, gyro=2e-5), monkeypatch)
        for scatter in (0.005, 0.03)
    )
    assert rough / calm == pytest.approx(6.0, rel=0.5)
