"""Errors drawn from the posterior of the smoother have the covariances that the smoother states."""

import numpy as np
import pytest

from benchmarks.chance import coverages, errors
from granite_lab.estimation.chain import finish, solve
from granite_lab.estimation.error_model import PD, V, std_of
from granite_lab.parameters import load_robot, load_soil
from tests.truth.trials import generate

COUNT = 1000


def test_errors_are_drawn_with_the_covariance_of_any_two_nodes_and_fill_two_std_by_95_percent() -> None:
    truth, robot = generate(7, velocity=0.3), load_robot("granite")
    solution = solve(truth.trial, robot, soil=load_soil())
    found, rng = solution.smoothed, np.random.default_rng(1)
    drawn = errors(found, COUNT, rng)
    std = std_of(found.P, {V: 1.0, PD: -1.0})
    assert np.std(drawn, axis=0) == pytest.approx(std, rel=0.1, abs=1e-5)
    moving = np.flatnonzero(solution.nodes.moving)
    one, other = (int(moving[place * moving.size // 3]) for place in (1, 2))
    block = found.cross(one, other)[np.ix_([V, PD], [V, PD])]
    covariance = block[0, 0] - block[0, 1] - block[1, 0] + block[1, 1]
    measured = float(np.mean(drawn[:, one] * drawn[:, other]))
    assert measured == pytest.approx(covariance, abs=4.0 * std[one] * std[other] / np.sqrt(COUNT))
    motion = finish(truth.trial, robot, solution)[1]
    at = np.isin(motion.phase, ["accelerate", "steady", "brake"])
    shares = coverages(motion, solution, at, COUNT, rng)
    assert shares.mean() == pytest.approx(0.954, abs=0.01)
    assert np.std(shares) > 0.02  # far more than of independent samples
