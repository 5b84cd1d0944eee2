"""A fit: numbers and scales at their joint optimum, with posterior and evidence there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from granite_lab.errors import EstimateError
from granite_lab.inference.descent import NEAR, TO_OPTIMUM, Descent, Goal, evidence_at, predict_drop, state_at
from granite_lab.inference.normal import NormalEquations, Posterior, Scales
from granite_lab.inference.point import Derivatives, Point
from granite_lab.inference.problem import Problem
from granite_lab.inference.scales import (
    FIRST,
    evidence_with_prior,
    learn_discrepancy,
    per_trial_scales,
    posterior_at,
)
from granite_lab.inference.spill import Spillable
from granite_lab.logs.trial import Array


@dataclass(frozen=True, eq=False)
class Fit:
    """Where a fit ended.

    Attributes:
        point: where.
        scales: learnt there.
        spillable: derivatives of the responses near the point, and the normal equations at it.
        residuals: per trial (C, n) measured minus predicted, NaN where nothing was measured.
        posterior: of the parameters.
        evidence: logarithm of the marginal likelihood with the priors of the scales, up to a constant; at the
            point, so that nothing is credited that was not reached.
        further: (p,) step within the bounds that the derivatives still predict to lower the objective.
        predicted_drop: of the objective by that step, see `predict_drop`.
        fine: it went as far as a fine fit goes.
        converged: point and scales are at their joint optimum: no drop is predicted. A rough fit never is.
    """

    point: Point
    scales: Scales
    spillable: Spillable[tuple[Derivatives, NormalEquations]]
    residuals: tuple[Array, ...]
    posterior: Posterior
    evidence: float
    further: Array
    predicted_drop: float
    fine: bool
    converged: bool

    @property
    def std(self) -> Array:
        """(p,) std of all numbers: by the posterior, and by the step to an optimum that was not reached."""
        return np.sqrt(np.fmax(np.diag(self.posterior.covariance), 0.0) + self.further**2)

    @property
    def common_std(self) -> Array:
        """(e,) std of the numbers of effects that all trials share, as `Point.common`."""
        return self.std[self.further.size - self.point.common.size :]

    @property
    def derivatives(self) -> Derivatives:
        """The derivatives of the responses near the point."""
        return self.spillable.value[0]

    @property
    def normal(self) -> NormalEquations:
        """The normal equations at the point."""
        return self.spillable.value[1]


def fit(
    problem: Problem,
    start: Point,
    scales: Scales = FIRST,
    goal: Goal = TO_OPTIMUM,
    derivatives: Derivatives | None = None,
) -> Fit:
    """Iterate to the joint optimum of numbers and scales; a simulation without a solution shortens the step.

    Args:
        problem: the trials, with the noise.
        start: where to begin.
        scales: to begin with.
        goal: how far to go.
        derivatives: derivatives near the start, if they are known.

    Raises:
        EstimateError: a simulation at the start has no solution.
    """
    scales = replace(scales, priors={**per_trial_scales(problem, start, start.vector), **scales.priors})
    state = state_at(problem, start, derivatives, per_trial=goal.fine)
    if state is None:
        raise EstimateError(
            "the robot cannot be simulated on this soil", "check the robot's and the soil's file"
        )
    descent = Descent(state, scales, goal, 0.0 if derivatives is None else NEAR, goal.fine)
    converged = False
    if goal.rounds:
        descent.learn(problem, 1)
        converged = descent.run(problem)
    state, scales = descent.state, descent.scales
    post, evidence = evidence_at(problem, state, scales)
    if not goal.rounds:  # what the optimum of the linear problem would reach
        evidence += post.predicted_drop / 2
    _, aim, predicted_drop = predict_drop(problem, state, scales)
    return Fit(
        point=state.point,
        scales=scales,
        spillable=Spillable((state.derivatives, state.normal.without_rows())),  # rows serve only a next step
        residuals=state.residuals,
        posterior=post,
        evidence=evidence,
        further=aim.vector - state.point.vector,
        predicted_drop=predicted_drop,
        fine=goal.fine,
        converged=converged,
    )


def with_priors(problem: Problem, fitted: Fit, scales: Scales) -> Fit:
    """Return a fit, linear about its point, under the scales that another model has learnt for the priors.

    A model that lacks something widens the priors of what stands in for it; those of a model that lacks
    nothing say how much the trials really differ.
    """
    adopted = replace(fitted.scales, priors=scales.priors)
    adopted = learn_discrepancy(problem, fitted.normal, fitted.point, adopted)
    post = posterior_at(problem, fitted.point, fitted.normal, adopted)
    evidence = evidence_with_prior(problem, fitted.point, post, adopted)
    return replace(fitted, scales=adopted, posterior=post, evidence=evidence)


def with_scales(problem: Problem, fitted: Fit, scales: Scales) -> Fit:
    """Return a fit, linear about its point, under scales that are taken for granted."""
    return replace(
        fitted, scales=scales, posterior=posterior_at(problem, fitted.point, fitted.normal, scales)
    )
