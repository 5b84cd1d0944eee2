"""Gauss and Newton's method with shortened steps, to the joint optimum of numbers and scales."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from granite_lab.inference.constants import NEGLIGIBLE, UPDATES
from granite_lab.inference.derivatives import differentiate
from granite_lab.inference.normal import NormalEquations, Posterior, Scales, least_within
from granite_lab.inference.point import Derivatives, Point
from granite_lab.inference.problem import Problem
from granite_lab.inference.scales import between, change, evidence_with_prior, learn_scales, posterior_at
from granite_lab.logs.trial import Array

LEAST, LEAST_OF_ROUGH = 0.002, 2.0
"""Drop of the objective below which no further step is taken: a thousandth of a log likelihood, so that no
number is further from the optimum than 0.045 of its std. Of a rough fit, which serves to learn the noise or
to rank sets of effects, a whole one, a third of what a further effect must bring."""

NO_FURTHER = NEGLIGIBLE**2
"""Predicted drop below which a fine fit has converged that ran out of steps, or finds a step to lead up: no
number is further from the optimum than a tenth of its std."""

TRUSTED, TRUSTED_ROUGH = NEGLIGIBLE, 0.4
"""How far from one the ratio of the actual to the predicted drop may be for the derivatives to be kept; of a
rough fit."""

NEAR, NEAR_ROUGH = NEGLIGIBLE, 1.0
"""How far from where they were taken derivatives may tell that a fit ends, in std of the numbers; of a rough
fit."""

LEAST_OF_POOR = 0.01
"""Predicted drop, as a share of the objective, below which a rough fit ends where the model is off by more
than formulas are: it is wrong, and half a percent of the rms of what it leaves does not change that."""

LEAST_FRACTION = 1 / 1024
"""Least fraction of a step that is tried; convention."""

AS_PREDICTED, TOO_LITTLE = 0.75, 0.25
"""Ratio of the actual to the expected drop above which the next step may be twice as long, and below which it
is half as long; usual for trust regions (Nocedal and Wright, Numerical Optimization, 2nd ed., 2006,
algorithm 4.1)."""

SETTLED = 0.02
"""Change of the logarithm of a scale at which scales and numbers are at their joint optimum: the numbers then
hardly move."""

ROUNDS = 40
"""Most steps of a fit; convention."""

NONE = NormalEquations((), 0, 0)
"""Normal equations of a state whose derivatives are new."""


@dataclass(frozen=True)
class Goal:
    """How far a fit goes.

    Attributes:
        fine: to the optimum, with derivatives at each trial's own numbers. A rough fit serves to learn the
            noise or to rank sets of effects, and takes them at the centre of each input.
        rounds: most steps; with none the problem is made linear at the start, under the scales as given.
        evidence: of another model. A fit ends where it promises to make up for less than a share of what it
            lacks of it, see `Descent`.
        share: all by default: a fit that stays below is of no use. Less for one whose distance is reported.
    """

    fine: bool = True
    rounds: int = ROUNDS
    evidence: float = -np.inf
    share: float = 1.0


TO_OPTIMUM, ROUGH, AT_START = Goal(), Goal(fine=False), Goal(fine=False, rounds=0)


@dataclass(frozen=True, eq=False)
class State:
    """A point with what was simulated there.

    Attributes:
        point: the numbers.
        origin: the simulations repeat the steps of those there, so that the objective is as smooth as the
            model: where the derivatives were taken, or a later point whose steps had to be shorter.
        derivatives: derivatives of the responses there.
        residuals: per trial (C, n) measured minus predicted.
        white: per trial (C n,) the same, whitened.
        normal: normal equations; their columns are by `derivatives`.
    """

    point: Point
    origin: Point
    derivatives: Derivatives
    residuals: tuple[Array, ...]
    white: tuple[Array, ...]
    normal: NormalEquations


@dataclass
class Descent:
    """A descent under way; it alone holds its state, so that derivatives leave memory when they are renewed.

    It ends early where neither its derivatives promise what `Goal.evidence` asks for, nor the rate at which
    the evidence grew in the last `UPDATES` steps. Far from an optimum derivatives promise far too little.

    Attributes:
        state: where it stands.
        scales: learnt there.
        goal: how far it goes.
        distance: how far the point is from where its derivatives were taken [std].
        per_trial: derivatives are taken at each trial's own numbers.
        behind: they are taken to smaller numbers.
        turned: they were turned to the other side at this point.
        fraction: of a step that is taken.
        settled: the scales are those of an optimum of the numbers. Near it a fine fit keeps them in between:
            scales that are learnt at each step move the optimum by more than a last step does.
        jump: how far the scales moved when they were last learnt at an optimum of the numbers, see `change`.
        reached: evidence before each step, where the goal asks for some.
    """

    state: State
    scales: Scales
    goal: Goal
    distance: float = 0.0
    per_trial: bool = False
    behind: bool = False
    turned: bool = False
    fraction: float = 1.0
    settled: bool = False
    jump: float = np.inf
    reached: list[float] = field(default_factory=list)

    def run(self, problem: Problem) -> bool:
        """Go towards the goal; tell whether the end is an optimum of numbers and scales."""
        fine = self.goal.fine
        least = LEAST if fine else LEAST_OF_ROUGH
        near, trusted = (NEAR, TRUSTED) if fine else (NEAR_ROUGH, TRUSTED_ROUGH)
        for _ in range(self.goal.rounds):
            objective, aim, predicted = predict_drop(problem, self.state, self.scales)
            if self._ends_early(objective, predicted) or self._is_beaten(problem, predicted):
                break
            if predicted < max(least, NEGLIGIBLE) and self.distance < near and not self.settled:
                self._settle(problem)
                continue
            if predicted < least and self.distance < near:
                break
            ratio = self._step(problem, objective, aim, predicted) if predicted >= least else 0.0
            if ratio <= 0 and self.distance == 0:
                self.fraction /= 2
                if (self.settled and predicted < NO_FURTHER) or not self._goes_on(problem):
                    break
            elif abs(ratio - 1) > trusted:
                if not self._differentiate(problem):
                    break
                if predicted > LEAST_OF_ROUGH or not fine:
                    self.learn(problem, 1)
        if not fine or (self.distance > near and not self._differentiate(problem)):
            return False
        _, _, predicted = predict_drop(problem, self.state, self.scales)
        return bool(predicted < NO_FURTHER and self.settled)

    def learn(self, problem: Problem, passes: int = UPDATES) -> None:
        """Learn the scales at the point."""
        state = self.state
        self.scales = learn_scales(problem, state.point, state.normal, state.white, self.scales, passes)

    def _goes_on(self, problem: Problem) -> bool:
        """Tell whether anything may help where a step leads up.

        Derivatives at centres are wrong where trials differ much; those to one side, at a kink of the model.
        """
        if self.fraction < NEGLIGIBLE and not (self.per_trial and self.turned):
            self.turned, self.behind = self.per_trial, self.behind ^ self.per_trial
            self.per_trial, self.fraction = True, 1.0
            return self._differentiate(problem)
        if self.fraction < LEAST_FRACTION and not self.settled:
            self._settle(problem)
            self.fraction = 1.0
        return self.fraction >= LEAST_FRACTION

    def _ends_early(self, objective: float, predicted: float) -> bool:
        """Tell whether a rough fit of a wrong model has come as far as matters."""
        is_poor = not self.goal.fine and self.scales.is_misfit and self.distance == 0
        return is_poor and predicted < LEAST_OF_POOR * objective

    def _is_beaten(self, problem: Problem, predicted: float) -> bool:
        """Tell whether the fit promises too little of the evidence that the goal asks for."""
        if np.isneginf(self.goal.evidence):
            return False
        _, evidence = evidence_at(problem, self.state, self.scales)
        self.reached.append(evidence)
        if len(self.reached) <= UPDATES:
            return False
        growth = (evidence - self.reached[-1 - UPDATES]) / UPDATES
        further = max(predicted / 2, growth * (self.goal.rounds - len(self.reached)))
        return bool(further < self.goal.share * (self.goal.evidence - evidence))

    def _settle(self, problem: Problem) -> None:
        """Learn the scales at an optimum of the numbers; half as far where they would jump to and fro."""
        before = self.scales
        self.learn(problem)
        moved = change(before, self.scales)
        self.settled = moved < (SETTLED if self.goal.fine else NEGLIGIBLE)
        if moved > self.jump / 2:
            self.scales = between(before, self.scales)
        self.jump = moved

    def _step(self, problem: Problem, objective: float, aim: Point, predicted: float) -> float:
        """Take a fraction of a step if it leads down; return the ratio of the actual to the expected drop."""
        point = self.state.point
        part = problem.stepped(point, self.fraction * (aim.vector - point.vector))
        drop, state = simulate_at(problem, self.state, self.scales, objective, part)
        if drop <= 0 and predicted >= LEAST_OF_ROUGH:
            # steps of integration that are far too long for these numbers let a stiff run diverge
            drop, state = simulate_at(problem, replace(self.state, origin=part), self.scales, objective, part)
        ratio = drop / (predicted * self.fraction * (2 - self.fraction))
        if state is not None and drop > 0:
            self.state, self.distance = state, self.distance + self.fraction * float(np.sqrt(predicted))
            self.turned = False
            if ratio > AS_PREDICTED:
                self.fraction = min(1.0, 2 * self.fraction)
            elif ratio < TOO_LITTLE:
                self.fraction /= 2
        return ratio

    def _differentiate(self, problem: Problem) -> bool:
        """Take derivatives at the point; return False where a simulation has no solution."""
        self.state = replace(self.state, normal=NONE)  # the old ones leave memory first
        old, point = self.state, self.state.point
        new = state_at(problem, point, per_trial=self.per_trial, behind=self.behind)
        if new is None:
            normal = problem.normal(old.point, old.derivatives, old.residuals)
            self.state = replace(old, normal=normal)
            return False
        self.state, self.distance = new, 0.0
        return True


def state_at(
    problem: Problem,
    point: Point,
    derivatives: Derivatives | None = None,
    *,
    per_trial: bool = False,
    behind: bool = False,
) -> State | None:
    """Return the state at a point; None where a simulation has no solution.

    Args:
        problem: the trials.
        point: where.
        derivatives: there, if they are known.
        per_trial: take derivatives at each trial's own numbers.
        behind: take them to smaller numbers.
    """
    responses = simulated(problem, point)
    derivatives = derivatives or differentiate(problem, point, per_trial=per_trial, behind=behind)
    if responses is None or derivatives is None:
        return None
    residuals = problem.residuals(point, responses)
    normal = problem.normal(point, derivatives, residuals)
    return State(point, point, derivatives, residuals, problem.white(residuals), normal)


def evidence_at(problem: Problem, state: State, scales: Scales) -> tuple[Posterior, float]:
    """Return the posterior, linear about a point, and the logarithm of the evidence that the point reaches.

    Nothing is credited that the derivatives promise further on, beyond a bound or not.
    """
    post = posterior_at(problem, state.point, state.normal, scales)
    return post, evidence_with_prior(problem, state.point, post, scales) - post.predicted_drop / 2


def predict_drop(problem: Problem, state: State, scales: Scales) -> tuple[float, Point, float]:
    """Return the objective at a point, where a step leads, and the drop that is predicted for it.

    The objective is twice the negative logarithm of likelihood and priors, up to a constant.
    """
    M, _ = state.normal.marginal(scales)
    std, mean = problem.prior(state.point, scales)
    objective = M[-1, -1] + _prior_misfit(state.point, std, mean)
    aim = _aim(problem, state.point, M, std, mean - state.point.vector)
    return objective, aim, objective - _linear(M, std, mean, state.point, aim)


def simulate_at(
    problem: Problem, state: State, scales: Scales, objective: float, aim: Point
) -> tuple[float, State | None]:
    """Return how far the objective falls with a step, and the state there; None without a solution."""
    responses = simulated(problem, aim, state.origin)
    if responses is None:
        return -np.inf, None
    std, mean = problem.prior(aim, scales)
    residuals = problem.residuals(aim, responses)
    white = problem.white(residuals)
    there = sum(state.normal.misfits(white, scales).values()) + _prior_misfit(aim, std, mean)
    return objective - there, replace(
        state, point=aim, residuals=residuals, white=white, normal=state.normal.at(white)
    )


def simulated(problem: Problem, point: Point, origin: Point | None = None) -> tuple[Array, ...] | None:
    """Return per trial the (8, M) response, by the steps of that at an origin; None without a solution."""
    responses = problem.respond([problem.task(point, i, origin) for i in range(len(problem.trials))])
    return None if responses is None else tuple(responses)


def misfit_at(problem: Problem, point: Point, scales: Scales) -> float:
    """Return the misfit of a point without a discrepancy, with that of the priors; inf without a solution.

    It is what can be had without derivatives, to choose between starts.
    """
    responses = simulated(problem, point)
    if responses is None:
        return np.inf
    white = problem.white(problem.residuals(point, responses))
    return float(sum(w @ w for w in white)) + _prior_misfit(point, *problem.prior(point, scales))


def _prior_misfit(point: Point, std: Array, mean: Array) -> float:
    """Return the sum of squares of the numbers about the means of their priors [std]."""
    return float(np.sum(((point.vector - mean) / std) ** 2))


def _aim(problem: Problem, point: Point, M: Array, std: Array, pull: Array) -> Point:
    """Return where a step leads: the least of the linear problem within the bounds."""
    p = std.size
    N, right = M[:p, :p] + np.diag(std**-2.0), M[:p, -1] + pull / std**2
    low, high = (side - point.vector for side in problem.bounds(point))
    return problem.stepped(point, least_within(N, right, low, high))


def _linear(M: Array, std: Array, mean: Array, point: Point, aim: Point) -> float:
    """Return the objective that the derivatives predict at another point."""
    p = std.size
    x = aim.vector - point.vector
    squares = M[-1, -1] - 2 * x @ M[:p, -1] + x @ M[:p, :p] @ x
    return float(squares + _prior_misfit(aim, std, mean))
