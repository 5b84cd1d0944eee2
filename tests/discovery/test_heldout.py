"""Trials that are left out are predicted as by a fit without them."""

from __future__ import annotations

import numpy as np
import pytest

from granite_lab.discovery.heldout import closed, predict
from granite_lab.inference.constants import REST_SHARE
from granite_lab.inference.discrepancy import MOTION, REST
from granite_lab.inference.fit import Fit
from granite_lab.inference.gap import tolerated
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array
from tests.inference.stub import problem_of
from tests.inference.test_gap import linear

pytestmark = pytest.mark.usefixtures("one_blas_thread")
TOLERANCE = 0.02
CHANNELS = ("pitch_rate", "wheel", "current_f")


def dense(problem: Problem, found: Fit) -> list[tuple[Array, Array, Array, Array]]:
    """Return per trial its own columns, the shared ones, residual and covariance of what is tolerated."""
    rows = []
    for i, t in enumerate(problem.trials):
        command = next(c for c, own in enumerate(problem.commands) if i in own)
        J = problem.columns(i, found.point, found.slopes)
        C = np.diag(np.concatenate([1 / w.inverse for w in problem.whiteners[i]]) ** 2)
        for c, basis in problem._plain[command].items():
            at = problem.rows[i][c]
            for kind, share in ((MOTION, TOLERANCE), (REST, REST_SHARE)):
                B = basis.columns[:, basis.kind == kind]
                C[at, at] += share**2 * B @ B.T
        n = found.point.trials[i].size
        assert len(t.channels) == len(CHANNELS)
        rows.append((J[:, :n], J[:, n:], found.residuals[i].ravel(), C))
    return rows


def refitted(problem: Problem, found: Fit, trials: list[int]) -> Array:
    """Return the shared numbers that a fit to some trials alone gives."""
    rows, first = dense(problem, found), [x.size for x in found.point.trials]
    std, _ = problem.prior(found.point, found.scales)
    shared = std[sum(first) :]
    N, b = np.diag(shared**-2.0), np.zeros(shared.size)
    for i in trials:
        own, J, y, C = rows[i]
        width = std[sum(first[:i]) : sum(first[: i + 1])]
        S = C + (own * width**2) @ own.T  # its own numbers integrated out
        N += J.T @ np.linalg.solve(S, J)
        b += J.T @ np.linalg.solve(S, y)
    return np.asarray(np.linalg.solve(N, b))


def misfit(problem: Problem, found: Fit, trial: int, shared: Array) -> float:
    own, J, y, C = dense(problem, found)[trial]
    first = [x.size for x in found.point.trials]
    std, _ = problem.prior(found.point, found.scales)
    width = std[sum(first[:trial]) : sum(first[: trial + 1])]
    left = y - J @ shared
    return float(left @ np.linalg.solve(C + (own * width**2) @ own.T, left))


def test_each_trial_is_predicted_as_by_a_refit_without_it() -> None:
    problem = problem_of((0, 0, 1, 1, 2), CHANNELS)
    found = linear(problem, np.random.default_rng(1), 0.1)
    predicted = predict(problem, found, TOLERANCE)
    everyone = refitted(problem, found, [0, 1, 2, 3, 4])
    for i in range(5):
        others = refitted(problem, found, [j for j in range(5) if j != i])
        command = next(own for own in problem.commands if i in own)
        elsewhere = refitted(problem, found, [j for j in range(5) if j not in command])
        assert predicted.own[i] == pytest.approx(misfit(problem, found, i, everyone), rel=1e-4)
        assert predicted.left_out[i] == pytest.approx(misfit(problem, found, i, others), rel=1e-4)
        assert predicted.speed_left_out[i] == pytest.approx(misfit(problem, found, i, elsewhere), rel=1e-4)
    assert (predicted.left_out > predicted.own).all()
    # of a command with one trial both are the same
    assert predicted.left_out[4] == pytest.approx(predicted.speed_left_out[4], rel=1e-9)


def test_numbers_of_the_priors_scales_are_those_of_the_fit() -> None:
    """What is tolerated says nothing of how much trials differ."""
    problem = problem_of((0, 1), CHANNELS)
    found = linear(problem, np.random.default_rng(1), 0.0)
    assert tolerated(found.scales, TOLERANCE).priors == found.scales.priors


def test_what_is_expected_of_trials_is_what_an_exact_model_leaves() -> None:
    problem = problem_of((0, 0, 1, 1, 2, 2), CHANNELS)
    ratios = []
    for seed in range(20):
        predicted = predict(problem, linear(problem, np.random.default_rng(seed), 0.0), TOLERANCE)
        ratios.append(predicted.own.sum() / predicted.expected.sum())
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.02)


def test_the_share_that_is_closed_has_the_standard_error_of_the_jackknife() -> None:
    rng = np.random.default_rng(1)
    gap = rng.uniform(50, 150, 12)
    before = gap + 400
    after = before - gap * rng.normal(0.8, 0.1, 12)
    found = closed(before, after, gap)
    whole = (before - after).sum() / gap.sum()
    without = [(before - after)[np.arange(12) != i].sum() / gap[np.arange(12) != i].sum() for i in range(12)]
    assert found.value == pytest.approx(whole)
    assert found.std == pytest.approx(np.sqrt(11 / 12 * np.sum((without - np.mean(without)) ** 2)), rel=0.05)


def test_shares_are_nan_where_there_is_no_gap_or_no_trial_left_out() -> None:
    one, nothing = np.ones(3), np.full(3, np.nan)
    assert np.isnan(closed(one, one, 0 * one).value)
    assert np.isnan(closed(nothing, one, one).value)
    single = closed(np.array([3.0]), np.array([1.0]), np.array([4.0]))
    assert single.value == pytest.approx(0.5)
    assert np.isnan(single.std)
