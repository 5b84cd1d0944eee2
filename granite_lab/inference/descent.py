"""Levenberg and Marquardt's descent to the optimum; derivatives are renewed only where they must be."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum, auto

import numpy as np

from granite_lab.inference.constants import LEAST_GAIN, NEGLIGIBLE, THREE_SIGMA, UPDATES
from granite_lab.inference.derivatives import differentiate
from granite_lab.inference.normal import NormalEquations, Scales, least_within
from granite_lab.inference.point import Derivatives, Point
from granite_lab.inference.problem import Problem
from granite_lab.inference.scales import change, learn_scales
from granite_lab.logs.trial import Array

LEAST, LEAST_OF_ROUGH = 0.002, 0.2
"""Drop of the objective below which no further step is taken: a thousandth of a log likelihood, so that no
number is further from the optimum than 0.045 of its std. Of a rough fit, which serves to learn the noise or
to rank sets of effects, a tenth."""

NO_FURTHER = NEGLIGIBLE**2
"""The same where steps with new derivatives no longer lower the objective, for the integrator's errors are as
large: no number is then further from the optimum than a tenth of its std."""

STALLS = 2
"""How often new derivatives may bring nothing before a fine fit ends; a rough one ends at the first."""

NO_RANK = 2 * LEAST_GAIN
"""Drop of the objective with new derivatives below which a rough fit ends: a further effect must bring more,
so that the rank of sets does not change."""

TRUSTED, TRUSTED_ROUGH = NEGLIGIBLE, 0.4
"""How far from one the ratio of the actual to the predicted drop may be for the derivatives to be kept, far
from the optimum; of a rough fit."""

NEAR = 1.0
"""Predicted drop below which a step of Gauss and Newton is taken although the objective does not fall. Within
one std its changes show kinks of the model and derivatives at the centre of a command, not the optimum."""

AS_GOOD, AS_GOOD_ROUGH = NEGLIGIBLE, NEAR
"""How far a fit may move, in std of the numbers, with derivatives that count as those of the point; a rough
one."""

LEAST_OF_POOR = 0.01
"""Predicted drop, as a share of the objective, below which a rough fit ends where the noise had to be taken
for larger than repetitions show: the model is wrong, its kinks are sharper than the noise, and half a percent
of its rms does not change that. Such a fit has not converged."""

SHORTENED = THREE_SIGMA**2
"""Predicted drop below which a fine fit ends where no shortened step leads down: three std. Further from the
optimum it damps its steps then."""

LEAST_FRACTION = 1 / 8
"""Least fraction of a step of Gauss and Newton that a fine fit tries. Damping keeps numbers of little
influence where they are, and leads aside in a valley."""

LEAST_DAMPED = 0.01
"""Damping below which there is none."""

MOST_DAMPED = 1e3
"""Damping at which a fit ends: steps are then a thousandth of those of Gauss and Newton."""

SETTLED = 0.02
"""Change of the logarithm of a scale at which scales and numbers are at their joint optimum: the numbers then
hardly move."""

NONE = NormalEquations((), 0, 0)
"""Normal equations of a state whose derivatives are new."""


@dataclass(frozen=True, eq=False)
class State:
    """A point with what was simulated there.

    Attributes:
        point: the numbers.
        derivatives: derivatives of the responses, of this point or of one nearby.
        residuals: per trial (C, n) measured minus predicted.
        white: per trial (C n,) the same, whitened.
        normal: normal equations; their columns are by `derivatives`.
    """

    point: Point
    derivatives: Derivatives
    residuals: tuple[Array, ...]
    white: tuple[Array, ...]
    normal: NormalEquations

    def with_equations(self, problem: Problem) -> State:
        """Return the state with the normal equations by its derivatives."""
        return replace(self, normal=problem.normal(self.point, self.derivatives, self.residuals))


@dataclass
class _StepLength:
    """How long the steps are.

    The damping follows the ratio of the actual to the predicted drop (H. B. Nielsen, Damping parameter in
    Marquardt's method, IMM-REP-1999-05, Technical University of Denmark).

    Attributes:
        damping: of the next step.
        growth: factor by which it grows where a step fails.
        fraction: of a step that is taken.
    """

    damping: float = 0.0
    growth: float = 2.0
    fraction: float = 1.0

    def lengthen(self, ratio: float) -> None:
        """Follow a step that was taken, with its ratio of actual to predicted drop."""
        damping = self.damping * max(1 / 3, 1 - (2 * ratio - 1) ** 3)
        self.damping, self.growth = damping if damping > LEAST_DAMPED else 0.0, 2.0
        if 2 * ratio > 1:
            self.fraction = min(1.0, 2 * self.fraction)

    def shorten(self) -> bool:
        """Follow a step of Gauss and Newton that failed; return False where no shorter one is tried."""
        self.fraction /= 2
        return self.fraction >= LEAST_FRACTION

    def damp(self) -> bool:
        """Follow any step that failed; return False where no further damping is tried."""
        self.fraction = 1.0
        self.damping, self.growth = max(self.growth * self.damping, 10 * LEAST_DAMPED), 2 * self.growth
        return self.damping <= MOST_DAMPED


@dataclass(frozen=True)
class Goal:
    """When a fit ends.

    Numbers that each trial has of its own are many, and each may be as far from the optimum of a fine fit as
    a single one.

    Attributes:
        fine: only such a fit takes differences to both sides.
        each_trial: a fine fit goes on with derivatives at each trial's own numbers.
        private: how many numbers of effects all trials have of their own, as the phase of a wheel.
        least: predicted drop below which the point is an optimum.
        near: how far from a point derivatives count as its own [std].
        trusted: how far from one the ratio of actual to predicted drop may be for derivatives to be kept.
    """

    fine: bool
    each_trial: bool
    private: int
    least: float
    near: float
    trusted: float

    @classmethod
    def of(cls, problem: Problem, point: Point, least: float, *, each_trial: bool) -> Goal:
        """Return the goal of a fit of a point's effects that ends at some predicted drop.

        Of trials that differ in numbers of effects, as the phase of a wheel, only their own derivatives tell.
        """
        fine = least <= LEAST
        private = len(problem.parameters(point.effects, per_trial=True)) * len(problem.trials)
        numbers = 1 + private if fine else 1
        near, trusted = (AS_GOOD, TRUSTED) if fine else (AS_GOOD_ROUGH, TRUSTED_ROUGH)
        apart = fine and (each_trial or private > 0)
        return cls(fine, apart, private, least * numbers, near * float(np.sqrt(numbers)), trusted)

    def stops_poor(self, scales: Scales) -> bool:
        """Tell whether the fit ends early because its model is wrong; a fine one never does."""
        return scales.poor_fit and not self.fine

    def no_gain(self, objective: float, scales: Scales) -> float:
        """Return the drop with new derivatives that counts as nothing, at a value of the objective."""
        least = LEAST_OF_POOR * objective if self.stops_poor(scales) else self.least
        return max(least, NO_FURTHER * self.private if self.fine else NO_RANK)


@dataclass(frozen=True, eq=False)
class _Step:
    """A step that was tried.

    Attributes:
        predicted: drop of the objective that the derivatives predict for the whole step.
        fraction: of it that was tried.
        newton: it is one of Gauss and Newton, without damping.
        drop: of the objective; minus infinity without a solution, or where none was tried.
        state: where it leads; None without a solution, or where none was tried.
    """

    predicted: float
    fraction: float
    newton: bool
    drop: float
    state: State | None

    @property
    def near(self) -> bool:
        """Whether the optimum is within one std."""
        return self.predicted < NEAR and self.newton

    @property
    def ratio(self) -> float:
        """The actual drop over the one that is predicted for this fraction of the step."""
        return self.drop / (self.predicted * self.fraction * (2 - self.fraction))

    @property
    def length(self) -> float:
        """How far it leads [std]."""
        return self.fraction * float(np.sqrt(self.predicted))


class _Next(Enum):
    """What follows a step."""

    STEP = auto()
    """Another step, with the same derivatives."""

    RENEW = auto()
    """Derivatives at the point."""

    END = auto()
    """Nothing: no step lowers the objective."""


@dataclass
class Descent:
    """A descent under way; it alone holds its state, so that derivatives leave memory when they are renewed.

    Attributes:
        state: where it stands.
        scales: learnt there.
        distance: how far the point is from where its derivatives were taken [std].
        per_trial: derivatives are taken at each trial's own numbers, not at the centre of its input.
        gained: drop of the objective since the derivatives were taken; infinite for those that it began with.
        stalls: how often new derivatives brought nothing.
        last_near: predicted drop of the last step if that was `near` and had a solution, else infinite.
        steps: how long they are.
    """

    state: State
    scales: Scales
    distance: float = 0.0
    per_trial: bool = False
    gained: float = np.inf
    stalls: int = 0
    last_near: float = np.inf
    steps: _StepLength = field(default_factory=_StepLength)

    def run(self, problem: Problem, goal: Goal, rounds: int) -> bool:
        """Descend; tell whether the end is an optimum of numbers and scales.

        A fine fit goes on with derivatives at each trial's own numbers, in at most so many rounds again.
        """
        at_optimum = self._descend(problem, goal, rounds)
        if goal.each_trial and self._may_go_apart(problem):
            self.per_trial, self.stalls, self.last_near, self.steps = True, 0, np.inf, _StepLength()
            at_optimum = self._differentiate(problem, goal) and self._descend(problem, goal, rounds)
        if at_optimum:
            return True
        if goal.fine and self.distance >= goal.near:
            self._differentiate(problem, goal)  # those of another point do not tell how far the optimum is
        _, _, predicted = predict_drop(problem, self.state, self.scales, 0.0)
        return bool(goal.fine and self.distance < goal.near and predicted < NO_FURTHER * (1 + goal.private))

    def _descend(self, problem: Problem, goal: Goal, rounds: int) -> bool:
        """Descend in at most so many rounds; tell whether it ended by settling at an optimum."""
        for _ in range(rounds):
            objective, aim, predicted = predict_drop(problem, self.state, self.scales, self.steps.damping)
            if self._is_hopeless(goal, objective, predicted):
                break
            if predicted < goal.least and self.steps.damping > 0:
                self.steps.damping = 0.0  # without damping more may be left
                continue
            if predicted < goal.least and self.distance < goal.near:
                if self._settles(problem, goal):
                    return True
                continue
            step = self._try(problem, goal, objective, aim, predicted)
            near, after = step.near, self._follow(problem, goal, step)
            del step  # it holds the derivatives, which may leave memory now
            if after is _Next.END:
                break
            if after is _Next.RENEW and not self._renew(problem, goal, goal.no_gain(objective, self.scales)):
                break
            if after is _Next.RENEW or near:
                self.learn(problem, 1)
        return False

    def _may_go_apart(self, problem: Problem) -> bool:
        """Tell whether trials may have other derivatives than the centre of their input, which are not taken.

        Sand differs from trial to trial, and (10) has a kink between them.
        """
        return not self.per_trial and len(problem.inputs) < len(problem.trials)

    def learn(self, problem: Problem, passes: int = UPDATES) -> None:
        """Learn the scales at the point."""
        state = self.state
        self.scales = learn_scales(problem, state.point, state.normal, state.white, self.scales, passes)

    def _is_hopeless(self, goal: Goal, objective: float, predicted: float) -> bool:
        """Tell whether a rough fit of a wrong model has come as far as matters.

        Derivatives of another point may predict too little: they are renewed first, unless steps are damped.
        """
        own = self.distance == 0 or self.steps.damping > 0
        return goal.stops_poor(self.scales) and predicted < LEAST_OF_POOR * objective and own

    def _settles(self, problem: Problem, goal: Goal) -> bool:
        """Learn the scales at an optimum of the numbers; tell whether they stay, which ends a fit."""
        before = self.scales
        self.learn(problem)
        return change(before, self.scales) < (SETTLED if goal.fine else NEGLIGIBLE)

    def _try(self, problem: Problem, goal: Goal, objective: float, aim: Point, predicted: float) -> _Step:
        """Simulate where the fraction of a step leads; at an optimum by derivatives of elsewhere try none."""
        fraction, newton = self.steps.fraction, self.steps.damping == 0
        drop, state = -np.inf, None
        if predicted >= goal.least:
            part = problem.stepped(self.state.point, fraction * (aim.vector - self.state.point.vector))
            drop, state = simulate_at(problem, self.state, self.scales, objective, part)
        return _Step(predicted, fraction, newton, drop, state)

    def _follow(self, problem: Problem, goal: Goal, step: _Step) -> _Next:
        """Move where a step leads, or find why it leads nowhere."""
        takes = step.drop > 0 or self._approaches(goal, step)
        self.last_near = step.predicted if step.near and step.state is not None else np.inf
        if takes and step.state is not None:
            return self._move(goal, step.state, step)
        if self.distance > 0:
            return _Next.RENEW  # it was predicted by derivatives of another point
        if self._may_go_apart(problem) and step.predicted > NO_RANK:
            if goal.each_trial:
                return _Next.END  # it goes on with the derivatives of each trial
            if goal.private > 0:
                self.per_trial, self.gained = True, np.inf
                return _Next.RENEW
        return self._shorten(goal, step)

    def _approaches(self, goal: Goal, step: _Step) -> bool:
        """Tell whether a step leads nearer to the optimum of a fine fit although the objective rises.

        Near the optimum the objective shows kinks of the model. There steps must shrink: each is predicted to
        bring less than half of the one before.
        """
        return goal.fine and step.near and step.drop > -NEAR and step.predicted < self.last_near / 2

    def _move(self, goal: Goal, state: State, step: _Step) -> _Next:
        """Take a step. Derivatives are kept near where they were taken, or where they predicted the drop."""
        self.state, self.distance, self.gained = state, self.distance + step.length, self.gained + step.drop
        keeps = self.distance < goal.near if step.near else abs(step.ratio - 1) < goal.trusted
        self.steps.lengthen(step.ratio)
        return _Next.STEP if keeps else _Next.RENEW

    def _shorten(self, goal: Goal, step: _Step) -> _Next:
        """Shorten the next step, or damp it, as the derivatives are those of the point.

        A rough fit ends near the optimum: what is left there changes no rank.
        """
        if goal.fine and step.newton:
            if self.steps.shorten():
                return _Next.STEP
            if step.predicted < SHORTENED:
                return _Next.END
        goes_on = self.steps.damp() and (goal.fine or step.predicted >= NEAR)
        return _Next.STEP if goes_on else _Next.END

    def _renew(self, problem: Problem, goal: Goal, no_gain: float) -> bool:
        """Take derivatives at the point; return False where the last ones brought too little."""
        self.stalls += self.gained < no_gain
        return self.stalls < (STALLS if goal.fine else 1) and self._differentiate(problem, goal)

    def _differentiate(self, problem: Problem, goal: Goal) -> bool:
        """Take derivatives at the point; return False where a simulation has no solution."""
        derivatives = differentiate(problem, self.state.point, central=goal.fine, per_trial=self.per_trial)
        if derivatives is None:
            return False
        self.state = replace(
            self.state, derivatives=derivatives, normal=NONE
        )  # the old ones leave memory first
        self.state, self.distance, self.gained = self.state.with_equations(problem), 0.0, 0.0
        return True


def predict_drop(
    problem: Problem, state: State, scales: Scales, damping: float
) -> tuple[float, Point, float]:
    """Return the objective at a point, where a damped step leads, and the drop that is predicted for it.

    The objective is twice the negative logarithm of likelihood and priors, up to a constant.
    """
    M, _ = state.normal.marginal(scales)
    std, mean = problem.prior(state.point, scales)
    objective = M[-1, -1] + _prior_misfit(state.point, std, mean)
    aim = _aim(problem, state.point, M, std, mean - state.point.vector, damping)
    return objective, aim, objective - _linear(M, std, mean, state.point, aim)


def simulate_at(
    problem: Problem, state: State, scales: Scales, objective: float, aim: Point
) -> tuple[float, State | None]:
    """Return how far the objective falls with a step, and the state there; None without a solution."""
    responses = simulated(problem, aim)
    if responses is None:
        return -np.inf, None
    std, mean = problem.prior(aim, scales)
    residuals = problem.residuals(aim, responses)
    white = problem.white(residuals)
    there = sum(state.normal.misfits(white, scales).values()) + _prior_misfit(aim, std, mean)
    return objective - there, State(aim, state.derivatives, residuals, white, state.normal.at(white))


def simulated(problem: Problem, point: Point) -> tuple[Array, ...] | None:
    """Return per trial the (8, M) response; None where one has no solution."""
    responses = problem.respond([problem.task(point, i) for i in range(len(problem.trials))])
    return None if responses is None else tuple(responses)


def _prior_misfit(point: Point, std: Array, mean: Array) -> float:
    """Return the sum of squares of the numbers about the means of their priors [std]."""
    return float(np.sum(((point.vector - mean) / std) ** 2))


def _aim(problem: Problem, point: Point, M: Array, std: Array, pull: Array, damping: float) -> Point:
    """Return where the damped step leads: the least of the linear problem within the bounds."""
    p = std.size
    N, right = M[:p, :p] + np.diag(std**-2.0), M[:p, -1] + pull / std**2
    low, high = (side - point.vector for side in problem.bounds(point))
    return problem.stepped(point, least_within(N, right, low, high, damping))


def _linear(M: Array, std: Array, mean: Array, point: Point, aim: Point) -> float:
    """Return the objective that the derivatives predict at another point."""
    p = std.size
    x = aim.vector - point.vector
    squares = M[-1, -1] - 2 * x @ M[:p, -1] + x @ M[:p, :p] @ x
    return float(squares + _prior_misfit(aim, std, mean))
