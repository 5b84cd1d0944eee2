"""Damped least squares that stays where the model has a solution, and the scales that go with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from granite_lab.errors import EstimateError
from granite_lab.inference.bench import RAKED, SAND
from granite_lab.inference.constants import FORMULA_ERROR, PSEUDO_TRIALS, SPREAD, TOLERANCE
from granite_lab.inference.discrepancy import FORMULA, MOTION
from granite_lab.inference.normal import Normal, Posterior, Scales, posterior
from granite_lab.inference.point import SHARED, Point, Slopes
from granite_lab.inference.problem import Problem
from granite_lab.inference.strengths import own_name, width_of
from granite_lab.logs.trial import Array

LEAST, LEAST_OF_ROUGH = 0.002, 0.2
"""Drop of the objective below which no further step is taken: a thousandth of a log likelihood, so that no
number is further from the optimum than 0.045 of its std. Of a fit that only serves to learn the noise, a
tenth."""

TRUSTED = 0.1
"""How far from one the drop over the promised one may be for the derivatives to be kept, far from the
optimum."""

NEAR = 1.0
"""Promised drop below which a step of Gauss and Newton is taken although the objective does not fall: within
a std it tells of kinks of the model and of derivatives at the centre of a command, not of the optimum."""

AS_GOOD = 0.5
"""How far a fit may move, in std of the numbers, with derivatives that count as those of the point."""

LEAST_OF_LOUD = 0.005
"""Promised drop, as a share of the objective, below which a fit ends where the noise is louder than
repetitions show: the model is wrong, its kinks are sharper than the noise, and a quarter of a percent of its
rms does not change that. Such a fit has not converged."""

STRENGTH = ("cohesion", "friction_angle")
"""Numbers of the sand that say nothing where another limit of the shear stress rules in (10)."""

LEAST_PACE = 1 / 8
"""Least share of a step that is taken near the optimum."""

LEAST_DAMPED = 0.01
"""Damping below which there is none."""

MOST_DAMPED = 1e3
"""Damping at which a fit ends: steps are then a thousandth of those of Gauss and Newton."""

SHARES = (TOLERANCE / 32, 32 * TOLERANCE)
FORMULAS = (FORMULA_ERROR[1] / 2**14, FORMULA_ERROR[1])
"""Smallest and largest scales of the discrepancy: none that matters, and all that a channel shows; of the
error of formulas, which is a share of traces that may be 10,000 times the noise (a wrong wheel radius)."""

LEAST_OWN = 1e-3
"""Least scale of the numbers that an effect has in each trial, as a share of their prior's range."""

UPDATES = 8
"""Most steps of the scales, each time they are learnt."""

CLOSE, SETTLED = 0.1, 0.02
"""Change of the logarithm of a scale at which it is learnt: a tenth of what its prior leaves open; and at
which scales and numbers are at their joint optimum: the numbers then hardly move."""

ROUNDS = 40
"""Most steps of a fit."""

FIRST = Scales(2 * TOLERANCE, FORMULA_ERROR[0])
"""Scales with which a search begins."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Where a fit ended.

    Attributes:
        point: where.
        scales: learnt there.
        slopes: derivatives of the responses near the point.
        responses: per trial the (8, M) response.
        residuals: per trial (C, n) measured minus predicted, NaN where nothing was measured.
        normal: the normal equations at the point.
        posterior: of the parameters.
        evidence: logarithm of the marginal likelihood with the priors of the scales, up to a constant; at the
            point, so that nothing is credited that was not reached.
        converged: the point is an optimum, together with the scales: an undamped step promises nothing.
    """

    point: Point
    scales: Scales
    slopes: Slopes
    responses: tuple[Array, ...]
    residuals: tuple[Array, ...]
    normal: Normal
    posterior: Posterior
    evidence: float
    converged: bool


@dataclass(frozen=True, eq=False)
class _State:
    """A point with what was simulated there; the normal equations' columns may be of a point nearby."""

    point: Point
    slopes: Slopes
    responses: tuple[Array, ...]
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
    scales = replace(scales, priors={**_own_scales(problem, start, start.vector), **scales.priors})
    slopes = slopes or problem.slopes(start)
    responses = simulated(problem, start)
    if slopes is None or responses is None:
        raise EstimateError(
            "the robot cannot be simulated on this soil", "check the robot's and the soil's file"
        )
    residuals = problem.residuals(start, responses)
    normal = problem.normal(start, slopes, residuals)
    state = _State(start, slopes, responses, residuals, problem.white(residuals), normal)
    converged = False
    if rounds:
        state, scales, converged = _descended(problem, state, learn(problem, state, scales, 1), rounds, least)
        if converged and least == LEAST:
            state, scales = _unlimited(problem, state, scales, rounds)
    post = _posterior(problem, state.point, state.normal, scales)
    evidence = post.evidence + log_prior(problem, scales, bool(state.point.effects))
    if rounds:  # nothing is credited beyond a bound, nor what the derivatives promise and was not found
        evidence -= post.promised / 2
    slopes, normal = replace(state.slopes), state.normal.alone()  # without what was kept for a next step
    return Fit(
        state.point, scales, slopes, state.responses, state.residuals, normal, post, evidence, converged
    )


def _descended(
    problem: Problem, state: _State, scales: Scales, rounds: int, least: float
) -> tuple[_State, Scales, bool]:
    """Return where steps by Levenberg and Marquardt end, the scales there, and whether that is an optimum.

    The damping follows the drop over the promised one (H. B. Nielsen, Damping parameter in Marquardt's
    method, IMM-REP-1999-05, Technical University of Denmark).
    """
    damping, growth, away = 0.0, 2.0, 0.0  # how far from where the derivatives were taken [std]
    pace, before = 1.0, np.inf  # share of a step that is taken near the optimum; what the last one promised
    for _ in range(rounds):
        here, aim, promised = _promise(problem, state, scales, damping)
        if scales.loud and promised < LEAST_OF_LOUD * here and (away == 0 or damping > 0):
            break
        if damping > 0 and promised < least:
            damping = 0.0
            continue
        if promised < least and away < AS_GOOD:
            new = learn(problem, state, scales)
            settled, scales = change(scales, new) < SETTLED, new
            if settled:
                return state, scales, True
            continue
        near = promised < NEAR and damping == 0
        if near and promised > before / 2:  # steps to and fro over the optimum
            pace = max(pace / 2, LEAST_PACE)
            aim = problem.moved(state.point, pace * (aim.vector - state.point.vector))
        before = promised if near else np.inf
        drop, tried = -np.inf, None
        if promised >= least:
            drop, tried = _tried(problem, state, scales, here, aim)
        ratio = drop / promised if promised > 0 else -np.inf
        fresh = away == 0
        if tried is not None and (drop > 0 or (near and drop > -NEAR)):
            damping *= max(1 / 3, 1 - (2 * ratio - 1) ** 3)
            damping, growth = damping if damping > LEAST_DAMPED else 0.0, 2.0
            state, away = tried, away + float(np.sqrt(promised))
            keep = away < AS_GOOD if near else abs(ratio - 1) < TRUSTED
        elif fresh:
            damping, growth, keep = max(growth * damping, 10 * LEAST_DAMPED), 2 * growth, True
            if damping > MOST_DAMPED:
                break
        else:
            keep = False
        if not keep:
            renewed = _renewed(problem, state)
            if renewed is None:
                break
            state, away = renewed, 0.0
        if not keep or near:
            scales = learn(problem, state, scales, 1)
    return state, scales, False


def _unlimited(problem: Problem, state: _State, scales: Scales, rounds: int) -> tuple[_State, Scales]:
    """Return the optimum at which the strength of the sand limits nothing, if there is one that is likelier.

    Where the friction on the tyre rules in (10), cohesion and angle of friction say nothing. A fit that comes
    from where they rule ends at the edge of that region, in a second optimum.
    """
    shared = np.where([name in STRENGTH for name in SHARED], 0.0, state.point.shared)
    if np.array_equal(shared, state.point.shared):
        return state, scales
    raked = np.array([name in STRENGTH for name in SAND[:RAKED]])
    trials = [np.concatenate([np.where(raked, 0.0, x[:RAKED]), x[RAKED:]]) for x in state.point.trials]
    here, _, _ = _promise(problem, state, scales, 0.0)
    rise, there = _tried(
        problem, state, scales, here, replace(state.point, shared=shared, trials=tuple(trials))
    )
    there = _renewed(problem, there) if there is not None and rise > -NEAR else None
    if there is None:
        return state, scales
    other, theirs, converged = _descended(problem, there, scales, rounds, LEAST)
    better = converged and _evidence(problem, other, theirs) > _evidence(problem, state, scales)
    return (other, theirs) if better else (state, scales)


def _evidence(problem: Problem, state: _State, scales: Scales) -> float:
    """Return the logarithm of the marginal likelihood at a point."""
    post = _posterior(problem, state.point, state.normal, scales)
    return post.evidence - post.promised / 2 + log_prior(problem, scales, bool(state.point.effects))


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
    return here - there, _State(aim, state.slopes, responses, residuals, white, state.normal.at(white))


def _renewed(problem: Problem, state: _State) -> _State | None:
    """Return a state with the derivatives at its point, None where a run has no solution."""
    slopes = problem.slopes(state.point)
    if slopes is None:
        return None
    return replace(state, slopes=slopes, normal=problem.normal(state.point, slopes, state.residuals))


def change(before: Scales, after: Scales) -> float:
    """Return the largest change of the logarithm of a scale, infinite for one that was not learnt before."""
    names = ("shares", "formulas", "louder", "priors")
    pairs = ((getattr(before, n), getattr(after, n)) for n in names)
    ratios = [np.inf if k not in x else abs(np.log(y[k] / x[k])) for x, y in pairs for k in y]
    return float(max(ratios, default=0.0))


def under(problem: Problem, fitted: Fit, scales: Scales) -> Fit:
    """Return a fit, linear about its point, under the scales that another model has learnt for the priors.

    A model that lacks something widens the priors of what stands in for it; those of a model that lacks
    nothing say how much the trials really differ.
    """
    own = replace(fitted.scales, priors=scales.priors)
    own = _discrepancy(problem, fitted.normal, fitted.point, own)
    post = _posterior(problem, fitted.point, fitted.normal, own)
    evidence = post.evidence + log_prior(problem, own, bool(fitted.point.effects))
    return replace(fitted, scales=own, posterior=post, evidence=evidence)


def taken(problem: Problem, fitted: Fit, scales: Scales) -> Fit:
    """Return a fit, linear about its point, under scales that are taken for granted."""
    return replace(fitted, scales=scales, posterior=_posterior(problem, fitted.point, fitted.normal, scales))


def simulated(problem: Problem, point: Point) -> tuple[Array, ...] | None:
    """Return the response of every trial; None where one has no solution."""
    found = problem.respond([problem.task(point, i) for i in range(len(problem.trials))])
    return None if found is None else tuple(found)


def _aim(problem: Problem, point: Point, M: Array, std: Array, pull: Array, damping: float) -> Point:
    """Return where the damped step leads; numbers that it would take beyond their bounds stay at these.

    The others are solved for anew, given those: a step that is only cut off may lead uphill.
    """
    p = std.size
    N = M[:p, :p] + np.diag(std**-2.0)
    scale = 1 / np.sqrt(np.diag(N))
    N = N * np.outer(scale, scale) + damping * np.eye(p)
    g = scale * (M[:p, -1] + pull / std**2)
    free, step = np.ones(p, dtype=bool), np.zeros(p)
    while True:
        held = g[free] - N[np.ix_(free, ~free)] @ step[~free]
        step[free] = np.linalg.solve(N[np.ix_(free, free)], held)
        aim = problem.moved(point, scale * step)
        reached = (aim.vector - point.vector) / scale
        beyond = free & ~np.isclose(reached, step, rtol=1e-9, atol=1e-12)
        if not beyond.any():
            return aim
        free &= ~beyond
        step = np.where(free, step, reached)


def _linear(M: Array, std: Array, mean: Array, point: Point, aim: Point) -> float:
    """Return the objective that the derivatives promise at another point."""
    p = std.size
    x = aim.vector - point.vector
    squares = M[-1, -1] - 2 * x @ M[:p, -1] + x @ M[:p, :p] @ x
    return float(squares + np.sum(((aim.vector - mean) / std) ** 2))


def _posterior(problem: Problem, point: Point, normal: Normal, scales: Scales) -> Posterior:
    std, mean = problem.prior(point, scales)
    return posterior(*normal.marginal(scales), std**-2.0, mean - point.vector)


def log_prior(problem: Problem, scales: Scales, formula: bool) -> float:
    """Return the logarithm of the prior density of the scales, and of the noise being louder than learnt."""
    away = [np.log(share / (TOLERANCE / 2)) for share in scales.shares.values()]
    if formula:
        away += [np.log(share / FORMULA_ERROR[0]) for share in scales.formulas.values()]
    noise = sum(n * np.log(scales.louder.get(c, 1.0)) for c, n in problem.counts.items())
    return -0.5 * float(np.sum((np.array(away) / SPREAD) ** 2)) - float(noise)


def learn(problem: Problem, state: _State, scales: Scales, passes: int = UPDATES) -> Scales:
    """Learn the scales at a point: discrepancy and what of the noise it does not explain, then the priors.

    The first two ask for each other, and take `passes` at most to agree.

    The scale of a number that differs from trial to trial is the mode of its posterior under an inverse
    gamma prior whose weight is `PSEUDO_TRIALS` trials.
    """
    for _ in range(passes):
        scales = _discrepancy(problem, state.normal, state.point, scales)
        left = state.normal.misfits(state.white, scales)
        before = {c: scales.louder.get(c, 1.0) for c in problem.counts}
        louder = {
            c: max(1.0, before[c] * float(np.sqrt(max(left[c], 0.0) / max(n, 1))))
            for c, n in problem.counts.items()
        }
        scales = replace(scales, louder=louder)
        if all(abs(np.log(louder[c] / before[c])) < CLOSE for c in louder):
            break
    normal = state.normal
    M, logdet = normal.marginal(scales)
    for _ in range(UPDATES):
        std, mean = problem.prior(state.point, scales)
        post = posterior(M, logdet, std**-2.0, mean - state.point.vector)
        at, variance = state.point.vector + post.step, np.diag(post.covariance)
        priors, old = learnt_priors(problem, state.point, at, variance), scales.priors
        scales = replace(scales, priors=priors)
        if all(name in old and abs(np.log(std / old[name])) < CLOSE for name, std in priors.items()):
            break
    return scales


def _discrepancy(problem: Problem, normal: Normal, point: Point, scales: Scales) -> Scales:
    """Learn the scales of the discrepancy by Fisher scoring of their logarithms, under the priors of these.

    The gradient of the marginal likelihood is that of D. J. C. MacKay, Bayesian interpolation, Neural
    Computation 4 (1992) 415-447; his fixed point hardly moves where the trials say little of a scale. There
    the likelihood falls with the square of the scale, and Fisher's information is less than its curvature:
    the larger of both is taken, for the scoring alone jumps to and fro.
    """
    names = tuple(problem.counts)
    for _ in range(UPDATES):
        step = np.append(-_posterior(problem, point, normal, scales).step, 1.0)
        old = {(MOTION, c): scales.share_of(c) for c in names}
        old |= {(FORMULA, c): scales.formula_of(c) for c in names}
        rise = dict.fromkeys(old, 0.0)  # derivative of the marginal likelihood by the logarithm of a scale
        information = dict.fromkeys(old, 0.0)
        for part in normal.parts:
            for c in part.channels:
                mean, variance = c.amplitudes(step[part.place_in(step.size)], scales)
                for name in ((MOTION, c.name), (FORMULA, c.name)):
                    own = c.kind == name[0]
                    known = 1 - variance[own] / old[name] ** 2  # share that the trials determine
                    rise[name] += float(np.sum(mean[own] ** 2) / old[name] ** 2 - np.sum(known))
                    information[name] += 2 * float(np.sum(known**2))
        new = {}
        for name, scale in old.items():
            centre, bounds = (TOLERANCE / 2, SHARES) if name[0] == MOTION else (FORMULA_ERROR[0], FORMULAS)
            slope = rise[name] - float(np.log(scale / centre)) / SPREAD**2
            curvature = max(information[name], -2 * rise[name]) + SPREAD**-2.0
            further = np.clip(slope / curvature, -1, 1)
            new[name] = float(np.clip(scale * np.exp(further), *bounds))
        shares, formulas = ({c: new[kind, c] for c in names} for kind in (MOTION, FORMULA))
        scales = replace(scales, shares=shares, formulas=formulas)
        if all(abs(np.log(found / old[name])) < CLOSE for name, found in new.items()):
            break
    return scales


def learnt_priors(problem: Problem, point: Point, mean: Array, variance: Array) -> Mapping[str, float]:
    """Return the scales of the numbers that differ from trial to trial.

    Args:
        problem: the trials.
        point: which numbers there are.
        mean, variance: (p,) of the posterior of all numbers.
    """
    squares: dict[str, list[float]] = {}
    first: dict[str, float] = {}
    k = 0
    for t, x in zip(problem.trials, point.trials, strict=True):
        for n, slack in ((n, s) for n, s in enumerate(t.slacks) if s.learnt):
            squares.setdefault(slack.name, []).append(float(mean[k + n] ** 2 + variance[k + n]))
            first[slack.name] = slack.std
        k += x.size
    found = {
        name: float(np.sqrt((sum(q) + PSEUDO_TRIALS * first[name] ** 2) / (len(q) + PSEUDO_TRIALS)))
        for name, q in squares.items()
    }
    return found | _own_scales(problem, point, mean, variance)


def _own_scales(
    problem: Problem, point: Point, mean: Array, variance: Array | float = 0.0
) -> dict[str, float]:
    """Return the rms of the numbers that each effect has in each trial: their scale, whatever it is."""
    private = problem.parameters(point.effects, per_trial=True)
    squares = mean**2 + variance
    ends = np.cumsum([x.size for x in point.trials])
    table = np.array([squares[end - len(private) : end] for end in ends]).reshape(ends.size, len(private))
    found: dict[str, float] = {}
    for id_ in dict.fromkeys(id_ for id_, _ in private):
        at = [k for k, (e, _) in enumerate(private) if e == id_]
        width = max(width_of(private[k][1]) for k in at)
        rms = float(np.sqrt(np.mean(table[:, at])))
        found[own_name(id_)] = float(np.clip(rms, LEAST_OWN * width, width))
    return found
