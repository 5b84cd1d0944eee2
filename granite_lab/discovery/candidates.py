"""How much each candidate would add to a model, by linear algebra about its fit."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from granite_lab.discovery.screens import Screen
from granite_lab.inference.constants import DRAWS, NEAR_ZERO, RIVAL
from granite_lab.inference.priors import width_of
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array

SCALES_TRIED = np.exp(-np.arange(-np.log(NEAR_ZERO)))
"""Scales that are tried for the numbers that an effect has in each trial, as shares of the prior's range,
down to none, one std of the prior of their logarithm apart."""


@dataclass(frozen=True, eq=False)
class Score:
    """What a candidate would bring.

    Attributes:
        candidate: id.
        gain: logarithm of the Bayes factor, linear about the fit.
        values: of all its parameters, where a fit may start.
        trial_values: (trials, o) of those that each trial has of its own.
        relevant: posterior probability, if the candidate acts, that it moves the prediction of some channel
            by more than the tolerance.
    """

    candidate: str
    gain: float
    values: tuple[float, ...]
    trial_values: Array | None = None
    relevant: float = 1.0


def gain(rest: Array, places: Sequence[int], variances: Array) -> tuple[float, Array]:
    """Return the log Bayes factor of further columns, and the posterior mean of their amplitudes.

    Args:
        rest: of `Posterior`.
        places: of the columns.
        variances: of the prior of each amplitude.
    """
    G, b = rest[np.ix_(places, places)], rest[places, -1]
    root = np.sqrt(variances)
    M = np.eye(root.size) + root[:, None] * G * root
    L = np.linalg.cholesky(M)
    x = np.linalg.solve(L, root * b)
    mean = root * np.linalg.solve(L.T, x)
    return float(0.5 * x @ x - np.log(np.diag(L)).sum()), np.asarray(mean)


def relevant(problem: Problem, screened: Screen, places: Array, variances: Array, tolerance: float) -> float:
    """Return the probability that further columns move the prediction of a channel beyond the tolerance.

    The other numbers follow, as far as the trials allow. As in `gap.prediction_change`, the change of a
    command is an rms over its repetitions.

    Args:
        problem: the trials.
        screened: the columns.
        places: (o,) of the columns, or (trials, o) of those that each trial has of its own.
        variances: (places,) of the prior of each amplitude.
        tolerance: a share of a channel's rms in motion.
    """
    rest, listed = screened.posterior.rest, _listed(places)
    _, mean = gain(rest, listed, variances)
    root = np.linalg.cholesky(np.linalg.inv(rest[np.ix_(listed, listed)] + np.diag(1 / variances)))
    drawn = mean + np.random.default_rng(0).normal(size=(DRAWS, mean.size)) @ root.T
    of_trial = drawn.reshape(DRAWS, -1, places.shape[-1])  # one for all, or a row for each trial
    largest = np.zeros(DRAWS)
    for command, repetitions in enumerate(problem.commands):
        first = repetitions[0]
        own = places[first] if places.ndim > 1 else places
        amounts = of_trial[:, list(repetitions)] if places.ndim > 1 else of_trial
        moved = _moved(screened, first, own)
        for c, rows in problem.rows[first].items():
            size, moving = problem.rms_of(command, c)
            if size > 0 and moving.any():
                change = moved[rows][moving]
                squares = np.einsum("dro,op,drp->d", amounts, change.T @ change, amounts)
                scale = size**2 * moving.sum() * amounts.shape[1]
                largest = np.fmax(largest, squares / scale)
    return float((np.sum(largest > tolerance**2) + 0.5) / (DRAWS + 1))  # never certain, see `SUREST`


def _moved(screened: Screen, trial: int, places: Array) -> Array:
    """Return (C n, o) how the prediction of the first trial of a command follows some of its columns."""
    sizes = [x.size for x in screened.point.trials]
    begin, shared = sum(sizes[:trial]), sum(sizes)
    parameters = [*range(begin, begin + sizes[trial]), *range(shared, len(screened.posterior.follow))]
    table = screened.raw[trial]
    of_trial = screened.columns_of(trial)
    chosen = len(parameters) + np.array([int(np.flatnonzero(of_trial == k)[0]) for k in places])
    follow = screened.posterior.follow[np.ix_(parameters, places)]
    return np.asarray(table[:, chosen] - table[:, : len(parameters)] @ follow)


def scores(problem: Problem, screened: Screen, tolerance: float) -> list[Score]:
    """Return what each candidate would bring, the best first."""
    ids = dict.fromkeys([*(p.candidate for p in screened.probes), *screened.per_trial])
    ranked = [
        (_per_trial if i in screened.per_trial else _shared)(problem, screened, i, tolerance) for i in ids
    ]
    return sorted(ranked, key=lambda s: -s.gain)


def _shared(problem: Problem, screened: Screen, id_: str, tolerance: float) -> Score:
    """Try every combination of the sizes of a candidate's strengths, of each kind that it may be of."""
    best = Score(id_, -np.inf, tuple(p.neutral for p in problem.parameters_of(id_)))
    columns: tuple[Array, Array] | None = None
    kinds: dict[tuple[float, ...], dict[int, list[int]]] = {}
    for k, probe in enumerate(screened.probes):
        if probe.candidate == id_:
            kinds.setdefault(probe.about, {}).setdefault(probe.place, []).append(k)
    for about, strengths in kinds.items():
        counts = range(1, len(strengths) + 1)
        for chosen in (c for n in counts for c in itertools.combinations(strengths.values(), n)):
            for places in itertools.product(*chosen):
                probes = [screened.probes[k] for k in places]
                variances = np.array([(width_of(p.parameter) / p.size) ** 2 for p in probes])
                value, mean = gain(screened.posterior.rest, places, variances)
                values = list(about)
                allowed = True
                for probe, amount in zip(probes, mean, strict=True):
                    p, size = probe.parameter, probe.size * float(amount)
                    allowed &= p.low <= p.neutral + size <= p.high or abs(size) > abs(p.high - p.neutral)
                    allowed &= p.low < p.neutral or size > 0
                    start = probe.size if p.moving else size  # at another size the trace is another
                    values[probe.place] = float(np.clip(p.neutral + start, p.low, p.high))
                if allowed and value > best.gain:
                    best, columns = Score(id_, value, tuple(values)), (np.array(places), variances)
    if columns is None:
        return best
    return replace(best, relevant=relevant(problem, screened, *columns, tolerance))


def rivals(screened: Screen, id_: str) -> list[str]:
    """Return the candidates that may stand for another one, linear about the fit.

    Beside the same effects they promise at least `RIVAL` of what it does, and of what they promise it leaves
    less than half.
    """
    rest = screened.posterior.rest
    best: dict[str, tuple[float, int, float]] = {}
    for k, p in enumerate(screened.probes):
        variance = (width_of(p.parameter) / p.size) ** 2
        single, _ = gain(rest, [k], np.array([variance]))
        best[p.candidate] = max(best.get(p.candidate, (-np.inf, k, variance)), (single, k, variance))
    if id_ not in best:
        return []
    reference, first, variance = best[id_]
    names = []
    for other, (single, k, wide) in best.items():
        if other != id_ and single >= RIVAL * reference:
            both, _ = gain(rest, [first, k], np.array([variance, wide]))
            names += [other] if both - reference < single / 2 else []
    return names


def others_of(problem: Problem) -> list[list[int]]:
    """Return, command by command, the trials of all others; all trials where there is one command."""
    trials = [i for repetitions in problem.commands for i in repetitions]
    return [[i for i in trials if i not in repetitions] or trials for repetitions in problem.commands]


def _per_trial(problem: Problem, screened: Screen, id_: str, tolerance: float) -> Score:
    """Try the numbers that each trial has of its own, at several scales of them.

    A number whose probe has no solution in the model stays neutral.

    The gain is that of all commands but the one that speaks for them most: an order of the wheels shows at
    every speed, a resonance of the frame coincides with it at one (order tracking: R. B. Randall,
    Vibration-based Condition Monitoring, Wiley 2011).
    """
    places = screened.places_per_trial(id_)
    probes = screened.per_trial[id_]
    size = np.array([p.size for p in probes])
    width = np.array([width_of(p.parameter) for p in probes])
    parameters = problem.parameters_of(id_)
    private = [k for k, p in enumerate(parameters) if p.per_trial]
    probed = [private.index(p.place) for p in probes]
    best = Score(id_, -np.inf, ())
    likeliest = np.zeros(0)
    for scale in SCALES_TRIED:
        variances = np.tile((scale * width / size) ** 2, screened.trials)
        _, mean = gain(screened.posterior.rest, _listed(places), variances)
        value = min(
            gain(screened.posterior.rest, _listed(places[trials]), variances[: places[trials].size])[0]
            for trials in others_of(problem)
        )
        if value > best.gain:
            trial_values = np.tile([parameters[k].neutral for k in private], (screened.trials, 1))
            trial_values[:, probed] += mean.reshape(places.shape) * size
            best = Score(id_, value, tuple(p.neutral for p in parameters), trial_values)
            likeliest = variances
    return replace(best, relevant=relevant(problem, screened, places, likeliest, tolerance))


def _listed(places: Array) -> list[int]:
    return [int(k) for k in places.ravel()]
