"""Damped least squares that stays where the model has a solution, and the scales that go with it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from granite_lab.errors import EstimateError
from granite_lab.inference.bench import RAKED, SAND
from granite_lab.inference.constants import CLOSE, REACH, UPDATES, WORTH
from granite_lab.inference.normal import Normal, Posterior, Scales, least_within
from granite_lab.inference.point import SHARED, Point, Slopes
from granite_lab.inference.problem import Problem
from granite_lab.inference.scales import (
    FIRST,
    change,
    learn_discrepancy,
    learn_scales,
    log_prior,
    per_trial_scales,
    posterior_at,
)
from granite_lab.inference.shelf import Shelved
from granite_lab.logs.trial import Array

LEAST, LEAST_OF_ROUGH = 0.002, 0.2
"""Drop of the objective below which no further step is taken: a thousandth of a log likelihood, so that no
number is further from the optimum than 0.045 of its std. Of a rough fit, which serves to learn the noise or
to rank sets of effects, a tenth."""

NO_FURTHER = CLOSE**2
"""The same where steps with new derivatives no longer lower the objective, for the integrator's errors are as
large: no number is then further from the optimum than a tenth of its std."""

STALLS = 2
"""How often new derivatives may bring nothing before a fit ends."""

NO_RANK = 2 * WORTH
"""Drop of the objective with new derivatives below which a rough fit ends: a further effect must bring more,
so that the rank of sets does not change."""

TRUSTED, TRUSTED_ROUGH = CLOSE, 0.4
"""How far from one the drop over the promised one may be for the derivatives to be kept, far from the
optimum; of a rough fit."""

NEAR = 1.0
"""Promised drop below which a step of Gauss and Newton is taken although the objective does not fall. Within
one std its changes show kinks of the model and derivatives at the centre of a command, not the optimum."""

AS_GOOD, AS_GOOD_ROUGH = CLOSE, NEAR
"""How far a fit may move, in std of the numbers, with derivatives that count as those of the point; a rough
one."""

LEAST_OF_LOUD = 0.01
"""Promised drop, as a share of the objective, below which a fit ends where the noise is louder than
repetitions show: the model is wrong, its kinks are sharper than the noise, and half a percent of its rms does
not change that. Such a fit has not converged."""

STRENGTH = ("cohesion", "friction_angle")
"""Numbers of the sand that say nothing where another limit of the shear stress rules in (10)."""

WITHIN = REACH**2
"""Promised drop below which a fine fit shortens a step in place of damping it: three std."""

LEAST_PACE = 1 / 8
"""Least share of a step of Gauss and Newton that a fine fit tries. Damping would keep numbers of little
influence where they are."""

LEAST_DAMPED = 0.01
"""Damping below which there is none."""

MOST_DAMPED = 1e3
"""Damping at which a fit ends: steps are then a thousandth of those of Gauss and Newton."""

SETTLED = 0.02
"""Change of the logarithm of a scale at which scales and numbers are at their joint optimum: the numbers then
hardly move."""

ROUNDS = 40
"""Most steps of a fit; convention."""

NONE = Normal((), 0, 0)
"""Normal equations of a state whose derivatives are new."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Where a fit ended.

    Attributes:
        point: where.
        scales: learnt there.
        large: derivatives of the responses near the point, and the normal equations at it.
        residuals: per trial (C, n) measured minus predicted, NaN where nothing was measured.
        posterior: of the parameters.
        evidence: logarithm of the marginal likelihood with the priors of the scales, up to a constant; at the
            point, so that nothing is credited that was not reached.
        promised: how far an undamped step within the bounds should lower the objective, twice the negative
            logarithm of likelihood and priors.
        converged: the point is an optimum, together with the scales: nothing is promised. That of a rough fit
            never is.
    """

    point: Point
    scales: Scales
    large: Shelved[tuple[Slopes, Normal]]
    residuals: tuple[Array, ...]
    posterior: Posterior
    evidence: float
    promised: float
    converged: bool

    @property
    def common_std(self) -> Array:
        """(e,) std of the numbers of effects that all trials share, as `Point.common`."""
        variances = np.diag(self.posterior.covariance)
        return np.sqrt(np.maximum(variances[variances.size - self.point.common.size :], 0.0))

    @property
    def slopes(self) -> Slopes:
        """The derivatives of the responses near the point."""
        return self.large.value[0]

    @property
    def normal(self) -> Normal:
        """The normal equations at the point."""
        return self.large.value[1]


@dataclass(frozen=True, eq=False)
class _State:
    """A point with what was simulated there; the normal equations' columns may be of a point nearby."""

    point: Point
    slopes: Slopes
    residuals: tuple[Array, ...]
    white: tuple[Array, ...]
    normal: Normal


def fit(
    problem: Problem,
    start: Point,
    scales: Scales = FIRST,
    *,
    slopes: Slopes | None = None,
    rounds: int = ROUNDS,
    least: float = LEAST,
) -> Fit:
    """Iterate to the joint optimum of numbers and scales; a simulation without a solution shortens the step.

    Args:
        problem: the trials, with the noise.
        start: where to begin.
        scales: to begin with.
        slopes: derivatives near the start, if they are known.
        rounds: most steps; with none the problem is made linear at the start, under the scales as given.
        least: promised drop of the objective at which the fit has converged.

    Raises:
        EstimateError: a simulation at the start has no solution.
    """
    fine, away = least <= LEAST, 0.0 if slopes is None else AS_GOOD
    scales = replace(scales, priors={**per_trial_scales(problem, start, start.vector), **scales.priors})
    states = [_begun(problem, start, slopes, central=fine)]  # taken from here, so that nobody else holds one
    converged = False
    if rounds:
        scales = _learnt(problem, states[0], scales, 1)
        state, scales, converged = _descended(problem, states.pop(), scales, rounds, least, away)
        if fine and (other := _unlimited(problem, state, scales, rounds)) is not None:
            (state, scales), converged = other, True
    else:
        state = states.pop()
    post = posterior_at(problem, state.point, state.normal, scales)
    evidence = post.evidence + log_prior(problem, scales, bool(state.point.effects))
    if rounds:  # nothing is credited beyond a bound, nor what the derivatives promise and was not found
        evidence -= post.promised / 2
    return Fit(
        point=state.point,
        scales=scales,
        large=Shelved((state.slopes, state.normal.alone())),  # without what was kept for a next step
        residuals=state.residuals,
        posterior=post,
        evidence=evidence,
        promised=_promise(problem, state, scales, 0.0)[2],
        converged=converged and fine,
    )


def _begun(problem: Problem, start: Point, slopes: Slopes | None, *, central: bool) -> _State:
    """Return the state at which a fit begins.

    Raises:
        EstimateError: a simulation has no solution.
    """
    responses = simulated(problem, start)
    slopes = slopes or problem.slopes(start, central=central)
    if slopes is None or responses is None:
        raise EstimateError(
            "the robot cannot be simulated on this soil", "check the robot's and the soil's file"
        )
    residuals = problem.residuals(start, responses)
    normal = problem.normal(start, slopes, residuals)
    return _State(start, slopes, residuals, problem.white(residuals), normal)


@dataclass
class _Pace:
    """How long the steps are.

    The damping follows the drop over the promised one (H. B. Nielsen, Damping parameter in Marquardt's
    method, IMM-REP-1999-05, Technical University of Denmark).

    Attributes:
        damping: of the next step.
        growth: factor by which it grows where a step fails.
        share: of a step that is taken.
    """

    damping: float = 0.0
    growth: float = 2.0
    share: float = 1.0

    def quicken(self, ratio: float) -> None:
        """Follow a step that brought this share of what it promised."""
        damping = self.damping * max(1 / 3, 1 - (2 * ratio - 1) ** 3)
        self.damping, self.growth = damping if damping > LEAST_DAMPED else 0.0, 2.0
        if 2 * ratio > 1:
            self.share = min(1.0, 2 * self.share)

    def shorten(self) -> bool:
        """Follow a step of Gauss and Newton that failed; return False where no shorter one is tried."""
        self.share /= 2
        return self.share >= LEAST_PACE

    def damp(self) -> bool:
        """Follow any step that failed; return False where no further damping is tried."""
        self.damping, self.growth = max(self.growth * self.damping, 10 * LEAST_DAMPED), 2 * self.growth
        return self.damping <= MOST_DAMPED


@dataclass(frozen=True)
class _Goal:
    """When a fit ends.

    Numbers that each trial has of its own are many, and each may be as far from the optimum of a fine fit as
    a single one.

    Attributes:
        fine: only such a fit takes differences to both sides.
        private: how many numbers all trials have of their own, as the phase of a wheel.
        least: promised drop at which the point is an optimum.
        near: how far from a point derivatives count as its own [std].
        trusted: how far from one the drop over the promised one may be for derivatives to be kept.
    """

    fine: bool
    private: int
    least: float
    near: float
    trusted: float

    @classmethod
    def of(cls, problem: Problem, point: Point, least: float) -> _Goal:
        """Return the goal of a fit of a point's effects that ends at some promised drop."""
        fine = least <= LEAST
        private = len(problem.parameters(point.effects, per_trial=True)) * len(problem.trials)
        numbers = 1 + private if fine else 1
        near, trusted = (AS_GOOD, TRUSTED) if fine else (AS_GOOD_ROUGH, TRUSTED_ROUGH)
        return cls(fine, private, least * numbers, near * float(np.sqrt(numbers)), trusted)


def _descended(
    problem: Problem, state: _State, scales: Scales, rounds: int, least: float, away: float = 0.0
) -> tuple[_State, Scales, bool]:
    """Return where steps by Levenberg and Marquardt end, the scales there, and whether that is an optimum.

    Args:
        problem, scales, rounds, least: as in `fit`.
        state: where to begin.
        away: how far the point is from where its derivatives were taken [std].
    """
    goal = _Goal.of(problem, state.point, least)
    pace, before = _Pace(), np.inf  # `before`: what the last step promised
    since, stalled, each = np.inf, 0, False  # what derivatives brought, how often nothing; one set a trial
    for _ in range(rounds):
        here, aim, promised = _promise(problem, state, scales, pace.damping)
        loud = scales.loud and not goal.fine
        enough = LEAST_OF_LOUD * here if loud else goal.least
        if loud and promised < enough and (away == 0 or pace.damping > 0):
            break
        if pace.damping > 0 and promised < goal.least:
            pace.damping = 0.0
            continue
        if promised < goal.least and away < goal.near:
            new = _learnt(problem, state, scales)
            settled, scales = change(scales, new) < (SETTLED if goal.fine else CLOSE), new
            if settled:
                return state, scales, True
            continue
        drop, tried = -np.inf, None
        if promised >= goal.least:
            part = problem.stepped(state.point, pace.share * (aim.vector - state.point.vector))
            drop, tried = _tried(problem, state, scales, here, part)
        ratio = drop / (promised * pace.share * (2 - pace.share)) if promised > 0 else -np.inf
        near = promised < NEAR and pace.damping == 0
        closer = goal.fine and near and drop > -NEAR and promised < before / 2
        other = away == 0 and goal.private > 0 and not each and promised > NO_RANK
        fresh, before = away == 0 and not other, promised if near and tried is not None else np.inf
        if tried is not None and (drop > 0 or closer):
            state, away, since = tried, away + pace.share * float(np.sqrt(promised)), since + drop
            keep = away < goal.near if near else abs(ratio - 1) < goal.trusted
            pace.quicken(ratio)
        elif fresh:
            short = goal.fine and pace.damping == 0 and promised < WITHIN
            keep = pace.shorten() if short else pace.damp() and (goal.fine or promised >= NEAR)
            if not keep:
                break
        else:
            keep, each, since = False, each or other, np.inf if other else since
        if not keep:
            stalled += since < max(enough, NO_FURTHER * goal.private if goal.fine else NO_RANK)
            more = stalled < (STALLS if goal.fine else 1)
            slopes = problem.slopes(state.point, central=goal.fine, each=each) if more else None
            if slopes is None:
                break
            state, tried = replace(state, slopes=slopes, normal=NONE), None  # the old ones are given up first
            state, away, since = _weighed(problem, state), 0.0, 0.0
        if not keep or near:
            scales = _learnt(problem, state, scales, 1)
    _, _, promised = _promise(problem, state, scales, 0.0)
    return state, scales, bool(goal.fine and away < goal.near and promised < NO_FURTHER * (1 + goal.private))


def _unlimited(problem: Problem, state: _State, scales: Scales, rounds: int) -> tuple[_State, Scales] | None:
    """Return the optimum at which the strength of the sand limits nothing, None where none is likelier.

    Where the friction on the tyre rules in (10), cohesion and angle of friction say nothing. A fit that comes
    from where they rule ends at the edge of that region, in a second optimum.
    """
    shared = np.where([name in STRENGTH for name in SHARED], 0.0, state.point.shared)
    if np.array_equal(shared, state.point.shared):
        return None
    raked = np.array([name in STRENGTH for name in SAND[:RAKED]])
    trials = [np.concatenate([np.where(raked, 0.0, x[:RAKED]), x[RAKED:]]) for x in state.point.trials]
    here, _, _ = _promise(problem, state, scales, 0.0)
    rise, there = _tried(
        problem, state, scales, here, replace(state.point, shared=shared, trials=tuple(trials))
    )
    slopes = problem.slopes(there.point, central=True) if there is not None and rise > -NEAR else None
    if there is None or slopes is None:
        return None
    there = _weighed(problem, replace(there, slopes=slopes))
    other, theirs, converged = _descended(problem, there, scales, rounds, LEAST)
    better = converged and _evidence(problem, other, theirs) > _evidence(problem, state, scales)
    return (other, theirs) if better else None


def _evidence(problem: Problem, state: _State, scales: Scales) -> float:
    """Return the logarithm of the marginal likelihood at a point."""
    post = posterior_at(problem, state.point, state.normal, scales)
    return post.evidence - post.promised / 2 + log_prior(problem, scales, bool(state.point.effects))


def _learnt(problem: Problem, state: _State, scales: Scales, passes: int = UPDATES) -> Scales:
    """Return the scales at a point."""
    return learn_scales(problem, state.point, state.normal, state.white, scales, passes)


def _promise(problem: Problem, state: _State, scales: Scales, damping: float) -> tuple[float, Point, float]:
    """Return the objective at a point, where a damped step leads, and the drop that it promises."""
    M, _ = state.normal.marginal(scales)
    std, mean = problem.prior(state.point, scales)
    here = M[-1, -1] + float(np.sum(((state.point.vector - mean) / std) ** 2))
    aim = _aim(problem, state.point, M, std, mean - state.point.vector, damping)
    return here, aim, here - _linear(M, std, mean, state.point, aim)


def _tried(
    problem: Problem, state: _State, scales: Scales, here: float, aim: Point
) -> tuple[float, _State | None]:
    """Return how far the objective falls with a step, and the state there; None without a solution."""
    responses = simulated(problem, aim)
    if responses is None:
        return -np.inf, None
    std, mean = problem.prior(aim, scales)
    residuals = problem.residuals(aim, responses)
    white = problem.white(residuals)
    there = sum(state.normal.misfits(white, scales).values()) + float(
        np.sum(((aim.vector - mean) / std) ** 2)
    )
    return here - there, _State(aim, state.slopes, residuals, white, state.normal.at(white))


def _weighed(problem: Problem, state: _State) -> _State:
    """Return a state with the normal equations by its derivatives."""
    return replace(state, normal=problem.normal(state.point, state.slopes, state.residuals))


def under(problem: Problem, fitted: Fit, scales: Scales) -> Fit:
    """Return a fit, linear about its point, under the scales that another model has learnt for the priors.

    A model that lacks something widens the priors of what stands in for it; those of a model that lacks
    nothing say how much the trials really differ.
    """
    adopted = replace(fitted.scales, priors=scales.priors)
    adopted = learn_discrepancy(problem, fitted.normal, fitted.point, adopted)
    post = posterior_at(problem, fitted.point, fitted.normal, adopted)
    evidence = post.evidence + log_prior(problem, adopted, bool(fitted.point.effects))
    return replace(fitted, scales=adopted, posterior=post, evidence=evidence)


def taken(problem: Problem, fitted: Fit, scales: Scales) -> Fit:
    """Return a fit, linear about its point, under scales that are taken for granted."""
    return replace(
        fitted, scales=scales, posterior=posterior_at(problem, fitted.point, fitted.normal, scales)
    )


def simulated(problem: Problem, point: Point) -> tuple[Array, ...] | None:
    """Return the response of every trial; None where one has no solution."""
    responses = problem.respond([problem.task(point, i) for i in range(len(problem.trials))])
    return None if responses is None else tuple(responses)


def _aim(problem: Problem, point: Point, M: Array, std: Array, pull: Array, damping: float) -> Point:
    """Return where the damped step leads: the least of the linear problem within the bounds."""
    p = std.size
    N, right = M[:p, :p] + np.diag(std**-2.0), M[:p, -1] + pull / std**2
    low, high = (side - point.vector for side in problem.bounds(point))
    return problem.stepped(point, least_within(N, right, low, high, damping))


def _linear(M: Array, std: Array, mean: Array, point: Point, aim: Point) -> float:
    """Return the objective that the derivatives promise at another point."""
    p = std.size
    x = aim.vector - point.vector
    squares = M[-1, -1] - 2 * x @ M[:p, -1] + x @ M[:p, :p] @ x
    return float(squares + np.sum(((aim.vector - mean) / std) ** 2))
