"""What is learnt beside the numbers of a fit: discrepancy, loudness of the noise, widths of the priors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from granite_lab.inference.constants import (
    FORMULA_ERROR,
    NEAR_ZERO,
    NEGLIGIBLE,
    PSEUDO_TRIALS,
    TOLERANCE,
    UPDATES,
)
from granite_lab.inference.discrepancy import FORMULA, MOTION
from granite_lab.inference.normal import NormalEquations, Posterior, Scales, posterior
from granite_lab.inference.point import SHARED, Point
from granite_lab.inference.priors import trial_scale_name, width_of
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array

DISCREPANCIES = (TOLERANCE / 32, 32 * TOLERANCE)
FORMULAS = (FORMULA_ERROR[1] / 2**14, FORMULA_ERROR[1])
"""Smallest and largest scales of the discrepancy: none that matters, and all that a channel shows; of the
error of formulas, which is a share of traces that may be 10,000 times the noise (a wrong wheel radius)."""

FIRST = Scales(2 * TOLERANCE, FORMULA_ERROR[0])
"""Scales with which a search begins."""


def change(before: Scales, after: Scales) -> float:
    """Return the largest change of the logarithm of a scale, infinite for one that was not learnt before."""
    names = ("discrepancies", "formulas", "noise_factor", "priors")
    pairs = ((getattr(before, n), getattr(after, n)) for n in names)
    ratios = [np.inf if k not in x else abs(np.log(y[k] / x[k])) for x, y in pairs for k in y]
    return float(max(ratios, default=0.0))


def posterior_at(problem: Problem, point: Point, normal: NormalEquations, scales: Scales) -> Posterior:
    """Return the posterior of the numbers, linear about a point."""
    std, mean = problem.prior(point, scales)
    return posterior(*normal.marginal(scales), std**-2.0, mean - point.vector)


def log_prior(problem: Problem, scales: Scales, formula: bool) -> float:
    """Return the logarithm of the prior density of the scales, and of the noise being larger than learnt.

    The logarithm of a scale is normal about the value at which its search begins, with a std of one: a factor
    of 2.7 either way; convention. The std of a number that differs from trial to trial has an inverse gamma
    prior, relative to its mode. One that is wide to hold what all trials have in common is not likely.
    """
    away = [np.log(size / (TOLERANCE / 2)) for size in scales.discrepancies.values()]
    if formula:
        away += [np.log(size / FORMULA_ERROR[0]) for size in scales.formulas.values()]
    noise = sum(n * np.log(scales.noise_factor.get(c, 1.0)) for c, n in problem.counts.items())
    wider = np.array([scales.priors.get(name, std) / std for name, std in problem.learnt_std.items()])
    widths = PSEUDO_TRIALS * float(np.sum(np.log(wider) + (wider**-2.0 - 1) / 2))
    return -0.5 * float(np.sum(np.square(away))) - float(noise) - widths


def evidence_with_prior(problem: Problem, point: Point, post: Posterior, scales: Scales) -> float:
    """Return the logarithm of the evidence of a posterior with the priors of the scales."""
    return post.evidence + log_prior(problem, scales, bool(point.effects))


def learn_scales(
    problem: Problem,
    point: Point,
    normal: NormalEquations,
    white: Sequence[Array],
    scales: Scales,
    passes: int = UPDATES,
) -> Scales:
    """Learn the scales at a point: discrepancy and what of the noise it does not explain, then the priors.

    The first two ask for each other, and take `passes` at most to agree.

    The scale of a number that differs from trial to trial is the mode of its posterior under an inverse
    gamma prior whose weight is `PSEUDO_TRIALS` trials.
    """
    for _ in range(passes):
        scales = learn_discrepancy(problem, normal, point, scales)
        left = normal.misfits(white, scales)
        before = {c: scales.noise_factor.get(c, 1.0) for c in problem.counts}
        noise_factor = {
            c: max(1.0, before[c] * float(np.sqrt(max(left[c], 0.0) / max(n, 1))))
            for c, n in problem.counts.items()
        }
        scales = replace(scales, noise_factor=noise_factor)
        if all(abs(np.log(noise_factor[c] / before[c])) < NEGLIGIBLE for c in noise_factor):
            break
    M, logdet = normal.marginal(scales)
    for _ in range(UPDATES):
        std, mean = problem.prior(point, scales)
        post = posterior(M, logdet, std**-2.0, mean - point.vector)
        at, variance = point.vector + post.step, np.diag(post.covariance)
        priors, old = learnt_priors(problem, point, at, variance), scales.priors
        scales = replace(scales, priors=priors)
        if all(name in old and abs(np.log(std / old[name])) < NEGLIGIBLE for name, std in priors.items()):
            break
    return scales


def learn_discrepancy(problem: Problem, normal: NormalEquations, point: Point, scales: Scales) -> Scales:
    """Learn the scales of the discrepancy by Fisher scoring of their logarithms, under the priors of these.

    The gradient of the marginal likelihood is that of D. J. C. MacKay, Bayesian interpolation, Neural
    Computation 4 (1992) 415-447; his fixed point hardly moves where the trials say little of a scale. There
    the likelihood falls with the square of the scale, and Fisher's information is less than its curvature:
    the larger of both is taken, for the scoring alone jumps to and fro. Each scale steps as if the others
    stayed. Where two explain the same residuals, both go too far: a step that lowers the evidence is halved.
    """
    best, highest = scales, -np.inf
    for _ in range(UPDATES):
        post = posterior_at(problem, point, normal, scales)
        evidence = evidence_with_prior(problem, point, post, scales)
        if evidence >= highest:
            best, highest = scales, evidence
            scales = _scored(problem, normal, post, scales)
        else:
            scales = between(best, scales)
        if change(best, scales) < NEGLIGIBLE:
            return scales
    return best


def _scored(problem: Problem, normal: NormalEquations, post: Posterior, scales: Scales) -> Scales:
    """Return the scales of the discrepancy after one step of Fisher's scoring, see `learn_discrepancy`."""
    names, step = tuple(problem.counts), np.append(-post.step, 1.0)
    covariance = np.pad(post.covariance, (0, 1))
    old = {(MOTION, c): scales.discrepancy_of(c) for c in names}
    old |= {(FORMULA, c): scales.formula_of(c) for c in names}
    rise = dict.fromkeys(old, 0.0)  # derivative of the marginal likelihood by the logarithm of a scale
    information = dict.fromkeys(old, 0.0)
    for part in normal.parts:
        place = part.place_in(step.size)
        moves = covariance[np.ix_(place, place)]
        for c in part.channels:
            mean, variance = c.amplitudes(step[place], scales, moves)
            for name in ((MOTION, c.name), (FORMULA, c.name)):
                of_kind = c.kind == name[0]
                determined = 1 - variance[of_kind] / old[name] ** 2  # share that the trials determine
                rise[name] += float(np.sum(mean[of_kind] ** 2) / old[name] ** 2 - np.sum(determined))
                information[name] += 2 * float(np.sum(determined**2))
    new = {}
    for name, scale in old.items():
        centre, bounds = (TOLERANCE / 2, DISCREPANCIES) if name[0] == MOTION else (FORMULA_ERROR[0], FORMULAS)
        slope = rise[name] - float(np.log(scale / centre))
        curvature = max(information[name], -2 * rise[name]) + 1
        further = np.clip(slope / curvature, -1, 1)
        new[name] = float(np.clip(scale * np.exp(further), *bounds))
    discrepancies, formulas = ({c: new[kind, c] for c in names} for kind in (MOTION, FORMULA))
    return replace(scales, discrepancies=discrepancies, formulas=formulas)


def between(first: Scales, second: Scales) -> Scales:
    """Return the geometric means of two sets of scales; what the first has not learnt is as at the start."""

    def mean(before: Callable[[str], float], after: Mapping[str, float]) -> dict[str, float]:
        return {key: float(np.sqrt(before(key) * size)) for key, size in after.items()}

    return replace(
        second,
        priors=mean(lambda name: first.priors.get(name, second.priors[name]), second.priors),
        discrepancies=mean(first.discrepancy_of, second.discrepancies),
        formulas=mean(first.formula_of, second.formulas),
        noise_factor=mean(lambda name: first.noise_factor.get(name, 1.0), second.noise_factor),
    )


def learnt_priors(problem: Problem, point: Point, mean: Array, variance: Array) -> Mapping[str, float]:
    """Return the scales of the numbers that differ from trial to trial.

    Those of sand and gains are about the trials' mean: what these have alike is a number of its own, whose
    prior is that of the files.

    Args:
        problem: the trials.
        point: which numbers there are.
        mean, variance: (p,) of the posterior of all numbers.
    """
    moments: dict[str, list[tuple[float, float]]] = {}
    first, k = problem.learnt_std, 0
    for t, x in zip(problem.trials, point.trials, strict=True):
        for n, slack in ((n, s) for n, s in enumerate(t.slacks) if s.learnt):
            moments.setdefault(slack.name, []).append((float(mean[k + n]), float(variance[k + n])))
        k += x.size
    priors = {}
    for name, of_trials in moments.items():
        values, variances = np.array(of_trials).T
        centre = values.mean() if name in SHARED else 0.0
        squares = float(np.sum((values - centre) ** 2 + variances))
        count = values.size + PSEUDO_TRIALS
        priors[name] = float(np.sqrt((squares + PSEUDO_TRIALS * first[name] ** 2) / count))
    return priors | per_trial_scales(problem, point, mean, variance)


def per_trial_scales(
    problem: Problem, point: Point, mean: Array, variance: Array | float = 0.0
) -> dict[str, float]:
    """Return the rms of the numbers that each effect has in each trial: their scale, whatever it is."""
    private = problem.parameters(point.effects, per_trial=True)
    squares = mean**2 + variance
    ends = np.cumsum([x.size for x in point.trials])
    table = np.array([squares[end - len(private) : end] for end in ends]).reshape(ends.size, len(private))
    scales: dict[str, float] = {}
    for id_ in dict.fromkeys(id_ for id_, _ in private):
        at = [k for k, (e, _) in enumerate(private) if e == id_]
        width = max(width_of(private[k][1]) for k in at)
        rms = float(np.sqrt(np.mean(table[:, at])))
        scales[trial_scale_name(id_)] = float(np.clip(rms, NEAR_ZERO * width, width))
    return scales
