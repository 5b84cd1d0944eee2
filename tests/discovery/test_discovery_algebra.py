"""The elimination of the trials' own numbers agrees with plain least squares on the whole matrix."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import block_diag

from granite_lab.discovery.arrow import Block, covariance, project, step
from granite_lab.discovery.empirical import amounts, sparse
from granite_lab.discovery.screen import evidence

RNG = np.random.default_rng(4)
P, Q, TRIALS, ROWS = 3, 2, 4, 30


@pytest.fixture(scope="module")
def blocks() -> list[Block]:
    return [
        Block(RNG.normal(size=(ROWS, P)), RNG.normal(size=(ROWS, Q)), RNG.uniform(0.5, 2, P))
        for _ in range(TRIALS)
    ]


def dense(blocks: list[Block], prior: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return all derivatives with a row for each prior, trials first, and the priors' weights."""
    local = block_diag(*(b.local for b in blocks))
    matrix = np.hstack([local, np.vstack([b.shared for b in blocks])])
    weights = np.sqrt(np.concatenate([*(b.precision for b in blocks), prior]))
    return np.vstack([matrix, np.diag(weights)]), weights


def test_a_step_is_the_least_squares_solution(blocks: list[Block]) -> None:
    prior, centre = np.array([0.3, 0.0]), np.array([0.1, 0.0])
    residuals = [RNG.normal(size=ROWS) for _ in blocks]
    own = [RNG.normal(size=P) for _ in blocks]
    shared = RNG.normal(size=Q)
    free = np.full(Q, np.inf)
    move = step(blocks, residuals, own, shared, (prior, centre), (-free, free))
    matrix, weights = dense(blocks, prior)
    pulled = weights * np.concatenate([*own, shared - centre])
    expected = np.linalg.lstsq(matrix, np.concatenate([*residuals, -pulled]), rcond=None)[0]
    assert np.allclose(np.concatenate([*move.local, move.shared]), expected, atol=1e-8)


def test_a_bound_is_kept_and_the_others_move_on(blocks: list[Block]) -> None:
    prior = np.zeros(Q)
    truth = np.array([2.0, -1.0])
    residuals = [b.shared @ truth for b in blocks]
    own = [np.zeros(P) for _ in blocks]
    bounds = (np.array([-9.0, -9.0]), np.array([0.5, 9.0]))
    move = step(blocks, residuals, own, np.zeros(Q), (prior, np.zeros(Q)), bounds)
    assert move.shared[0] == pytest.approx(0.5)
    fixed = [b.shared @ (truth - np.array([0.5, 0.0])) for b in blocks]
    alone = [Block(b.local, b.shared[:, 1:], b.precision) for b in blocks]
    free = np.full(1, np.inf)
    rest = step(alone, fixed, own, np.zeros(1), (prior[:1], np.zeros(1)), (-free, free))
    assert move.shared[1] == pytest.approx(rest.shared[0], rel=1e-6)


def test_what_survives_the_projection_is_what_no_nuisance_explains(blocks: list[Block]) -> None:
    prior = np.array([0.3, 1.0])
    columns = [RNG.normal(size=(ROWS, 2)) for _ in blocks]
    projection = project(blocks, columns, prior)
    matrix, _ = dense(blocks, prior)
    whole = np.vstack([*columns, np.zeros((TRIALS * P + Q, 2))])
    left = whole - matrix @ np.linalg.lstsq(matrix, whole, rcond=None)[0]
    assert np.allclose(projection.gram, left.T @ left, atol=1e-8)
    assert np.allclose(np.vstack(projection.left), left[: TRIALS * ROWS], atol=1e-8)


def test_the_covariance_of_the_shared_numbers_is_that_of_plain_least_squares(blocks: list[Block]) -> None:
    prior = np.array([0.3, 1.0])
    matrix, _ = dense(blocks, prior)
    assert np.allclose(covariance(blocks, prior), np.linalg.inv(matrix.T @ matrix)[-Q:, -Q:], rtol=1e-8)


def test_many_numbers_need_a_larger_drop_than_one() -> None:
    assert evidence(30.0, 1) == 30.0
    assert evidence(30.0, 10) == pytest.approx(11.0, abs=0.5)  # chi2 law: both 0.09 %
    assert evidence(5000.0, 48) == pytest.approx(evidence(4000.0, 48) + 1000.0, rel=0.02)


def test_the_sparse_law_picks_the_columns_that_made_the_signal() -> None:
    X = RNG.normal(size=(400, 12))
    signal = 3 * X[:, 4] - 2 * X[:, 9] + 0.1 * RNG.normal(size=400)
    gram, b = X.T @ X, X.T @ signal
    chosen, drop = sparse(gram, b, least=20.0)
    assert sorted(chosen) == [4, 9]
    assert drop == pytest.approx(signal @ signal, rel=0.01)
    assert dict(zip(chosen, amounts(gram, b, chosen), strict=True)) == pytest.approx({4: 3, 9: -2}, abs=0.02)


def test_the_sparse_law_picks_nothing_from_noise() -> None:
    X = RNG.normal(size=(400, 12))
    noise = RNG.normal(size=400)
    assert sparse(X.T @ X, X.T @ noise, least=20.0) == ([], 0.0)
