"""The std that a finding states of its numbers."""

import numpy as np
import pytest

from granite_lab.discovery.numbers import Numbers
from granite_lab.inference.constants import FORMULA_ERROR
from granite_lab.inference.fit import Fit, fit
from granite_lab.inference.normal import posterior
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array
from tests.inference.stub import drawn, measure, predicted, problem_of

pytestmark = pytest.mark.usefixtures("one_blas_thread")


def fitted(*effects: str) -> tuple[Problem, Fit]:
    """Return trials at two speeds with some effects, and the fit with these."""
    rng, problem = np.random.default_rng(3), problem_of((0, 0, 1, 1))
    point = drawn(problem, rng, common=0.3)
    for id_ in effects:
        point = problem.with_effect(point, id_, (0.5,))
    measure(problem, point, rng)
    return problem, fit(problem, point)


def refitted(problem: Problem, result: Fit, wrong: list[Array]) -> Array:
    """Return how far the numbers move where the trials measure something more."""
    std, mean = problem.prior(result.point, result.scales)
    steps = []
    for more in ([0 * w for w in wrong], wrong):
        residuals = [r + w for r, w in zip(result.residuals, more, strict=True)]
        normal = problem.normal(result.point, result.derivatives, residuals)
        pull = mean - result.point.vector
        steps.append(posterior(*normal.marginal(result.scales), std**-2.0, pull).step)
    return np.asarray(steps[1] - steps[0])


def test_the_std_by_errors_of_formulas_is_the_scatter_of_fits_to_traces_that_are_wrong_at_random() -> None:
    problem, result = fitted("push", "pull")
    rng, shown = np.random.default_rng(0), predicted(problem, result.point)
    without = [predicted(problem, problem.without_effect(result.point, id_)) for id_ in ("push", "pull")]

    def moved(error: Array) -> Array:
        """Return how far an error of each effect, command and channel moves the numbers."""
        wrong = [
            sum(error[e, problem.command_of[i], :, None] * (shown[i] - without[e][i]) for e in range(2))
            for i in range(len(problem.trials))
        ]
        return refitted(problem, result, wrong)

    shape = 2, len(problem.commands), shown[0].shape[0]
    errors = FORMULA_ERROR[0] * rng.normal(size=(300, *shape))
    each = np.stack([moved(one.reshape(shape)) for one in np.eye(int(np.prod(shape)))])
    moves = errors.reshape(300, -1) @ each  # the equations are linear
    np.testing.assert_allclose(moves[0], moved(errors[0]), rtol=1e-6, atol=1e-9 * np.abs(moves).max())
    stated, scatter = Numbers(problem, result).by_formulas, np.std(moves, axis=0)
    matters = scatter > 0.01 * scatter.max()
    assert matters.sum() > 10
    np.testing.assert_allclose(stated[matters], scatter[matters], rtol=0.2)  # 300 draws: 4 %


def test_without_effects_no_formula_is_wrong() -> None:
    problem, result = fitted()
    assert not Numbers(problem, result).by_formulas.any()
