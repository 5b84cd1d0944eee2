"""Intervals by the likelihood: those of the covariance on a straight curve, and right on one that bends."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from granite_lab.estimate import Estimate
from granite_lab.fitting.fit import K92Fit
from granite_lab.fitting.likelihood import a_theta_interval, k92_interval
from tests.fitting.made_up import made_up_fit

STD = 0.01  # of λ_R


def straight(k: float) -> float:
    return 0.26 - 0.7 * k


def bent(k: float) -> float:
    return 0.26 - 0.4 * math.sqrt(k + 0.0025)


def fit(curve, root: float) -> K92Fit:
    grid = sorted({*np.linspace(0, 1, 41), *np.linspace(0, 0.2, 41)})
    slope = (curve(root + 1e-6) - curve(root - 1e-6)) / 2e-6
    std = STD / abs(slope)
    points = tuple((float(k), curve(k)) for k in grid)
    slip = Estimate(curve(root), STD)
    return made_up_fit("virtual", 0.7, Estimate(root, std), slip, std_measurement=std, curve=points)


def test_a_straight_curve_gives_the_interval_of_the_covariance():
    trials = [fit(straight, 0.3), fit(straight, 0.32)]
    assert k92_interval(trials, (0.29, 0.33)) == pytest.approx((0.29, 0.33), abs=1e-6)
    v, own = np.array([0.2, 0.3]), np.array([STD / 0.7] * 2) ** 2
    k = np.exp(-4.9 * v)
    trials = [fit(straight, x) for x in k]
    std = 1 / math.sqrt(float(((v * k) ** 2 / own).sum()))
    low, high = a_theta_interval(trials, v, own, 0 * own, Estimate(4.9, std), 0.5)
    assert (low, high) == pytest.approx((4.9 - 0.5 * std, 4.9 + 0.5 * std), abs=0.05 * std)


def test_on_a_bent_curve_the_ends_have_the_slip_ratios_of_its_ends():
    root = 0.04
    one = fit(bent, root)
    low, high = k92_interval([one], one.k92.interval(1.96))
    assert bent(low) == pytest.approx(bent(root) + 1.96 * STD, abs=2e-4)
    assert bent(high) == pytest.approx(bent(root) - 1.96 * STD, abs=2e-4)
    assert high - root > 1.1 * (root - low)  # skewed away from the bound


def test_near_the_bound_the_interval_ends_at_it():
    low, high = k92_interval([fit(bent, 0.004)], fit(bent, 0.004).k92.interval(1.96))
    assert low == 0.0
    assert 0.004 < high < 0.1


def test_the_interval_of_a_theta_holds_the_truth_as_often_as_it_says():
    rng, v, a = np.random.default_rng(1), np.array([0.4, 0.5, 0.6, 0.7]), 4.919
    true = np.exp(-a * v)
    inside, draws = 0, 300
    for _ in range(draws):
        trials = []
        for k in true:
            seen = bent(k) + STD * rng.standard_normal()
            root = max(((0.26 - seen) / 0.4) ** 2 - 0.0025, 1e-3)
            trials.append(dataclasses.replace(fit(bent, root), slip_measured=Estimate(seen, STD)))
        own = np.array([t.k92.std for t in trials]) ** 2
        weight = (v * true) ** 2 / own
        low, high = a_theta_interval(trials, v, own, 0 * own, Estimate(a, 1 / math.sqrt(weight.sum())), 1.96)
        inside += low <= a <= high
    assert inside / draws == pytest.approx(0.95, abs=0.04)


@pytest.mark.parametrize(("moved", "by_likelihood"), [(0.05, False), (0.2, True)])
def test_the_likelihood_is_used_where_it_differs_by_more_than_a_tenth_of_the_half(moved, by_likelihood):
    one, half = fit(straight, 0.3), 0.02
    linear = 0.28 - moved * half, 0.32 - moved * half  # the likelihood gives 0.28 to 0.32
    found = k92_interval([one], linear)
    assert (found != linear) == by_likelihood
    assert found[0] == pytest.approx(0.28 if by_likelihood else linear[0])


def test_without_a_curve_the_interval_is_that_of_the_covariance():
    assert k92_interval([dataclasses.replace(fit(straight, 0.3), curve=())], (0.1, 0.4)) == (0.1, 0.4)
