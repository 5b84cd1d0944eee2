"""How sure a set of effects is: fitted sets compete again as if other speeds, or trials, had been driven.

The posterior over the sets that happened to be fitted is almost always 0 or 1: it takes thousands of bins for
independent, while the errors of a model are alike in all trials of a command. Here whole commands count, each
predicted by the others; single trials, where there are few speeds. It is pseudo-BMA+ of Yao, Vehtari, Simpson
and Gelman, Using stacking to average Bayesian predictive distributions, Bayesian Analysis 13 (2018) 917-1007,
with two changes. The log density of what is left out is that of an error whose size is not known,

    S = -1/2 log det C - n/2 log(r^T C^-1 r),

n the degrees of freedom, C the covariance of the errors r: a model that lacks something is believed to the
size of its own errors only. And the sum over so few units is drawn from its posterior, Student's t about what
the best set expects in each unit, see `winners`. The Bayesian bootstrap never leaves the range of the speeds
that were driven, and counts it as doubt that an effect shows more at a high speed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from granite_lab.discovery.heldout import Equations, Predicted, left_out, predict, units
from granite_lab.discovery.models import Model, Search
from granite_lab.inference.constants import DRAWS, EFFECT_ODDS, FEWEST_SPEEDS, FORMULA_ERROR, TRIED
from granite_lab.inference.fit import Fit
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array

SUREST = 1 - 0.5 / DRAWS
"""The largest probability that is stated: so many draws show no larger one."""


@dataclass(frozen=True, eq=False)
class Competition:
    """How often each set wins.

    Attributes:
        models: the sets that compete.
        weights: (k,) their probabilities; they sum to one.
    """

    models: tuple[Model, ...]
    weights: Array

    def probability(self, wanted: Callable[[Model], bool]) -> float:
        """Return the probability of the sets that fulfil a condition."""
        return float(self.weights[[wanted(m) for m in self.models]].sum())


def by_evidence(search: Search) -> Competition:
    """Return what the posterior alone says, for trials that cannot be left out."""
    logs = np.array([m.log_posterior for m in search.models])
    weights = np.exp(logs - logs.max())
    return Competition(search.models, _never_certain(weights / weights.sum()))


class Predictions:
    """Predictions of trials and speeds that are left out, each set's once.

    Args:
        problem: the trials.
        right: fit of the best set; the trials differ from each other as its scales say, for all sets alike.
        tolerance: as in `predict`.
    """

    def __init__(self, problem: Problem, right: Fit, tolerance: float) -> None:
        self.problem, self.right, self.tolerance = problem, right, tolerance
        self.predicted: dict[tuple[str, ...], tuple[Predicted, Array]] = {}

    def of(self, models: Sequence[Model]) -> list[Predicted]:
        """Return the predictions of some sets."""
        return [predicted for predicted, _ in self._of(models)]

    def squares_if_right(self, models: Sequence[Model]) -> Array:
        """Return (k, units) `Predicted.squares` for data that the best set explains without any error."""
        return np.array([squares for _, squares in self._of(models)])

    def _of(self, models: Sequence[Model]) -> list[tuple[Predicted, Array]]:
        new = [m for m in models if m.effects not in self.predicted]
        predicted = self.problem.pool.parallel(self._predict, new)
        self.predicted |= {m.effects: p for m, p in zip(new, predicted, strict=True)}
        return [self.predicted[m.effects] for m in models]

    def _predict(self, model: Model) -> tuple[Predicted, Array]:
        fit = replace(model.fit, scales=replace(model.fit.scales, priors=self.right.scales.priors))
        equations = Equations(self.problem, fit, keep=True)
        predicted = predict(self.problem, fit, self.tolerance, equations)
        return predicted, left_out(self.problem, equations.if_right(self.right), self.tolerance)[1]


def compete(problem: Problem, search: Search, predictions: Predictions) -> Competition:
    """Let the best set compete with those that lack one of its effects.

    Args:
        problem: the trials.
        search: of them.
        predictions: of trials and speeds that are left out.
    """
    models = competitors(search)
    predicted = predictions.of(models)
    losses, squares = (np.array([getattr(p, kind) for p in predicted]) for kind in ("loss", "squares"))
    if_right = predictions.squares_if_right(models)
    free = np.array([predicted[0].expected[list(out)].sum() for out in units(problem)])
    comparable = np.isfinite(losses + if_right).all(axis=0) & (squares > 0).all(axis=0) & (free > 0)
    if comparable.sum() < FEWEST_SPEEDS:
        return by_evidence(search)
    odds = np.array([m.log_posterior - m.fit.evidence for m in models])
    odds -= 0.5 * (losses - squares)[:, comparable].sum(axis=1)  # determinants: known, whatever is measured
    free, squares, if_right = (x[..., comparable] for x in (free, squares, if_right))
    more = np.fmax(if_right - if_right[0], 0.0) / squares[0]
    leads = 0.5 * free * np.log1p(more)
    alone = next(k for k, m in enumerate(models) if not m.effects)
    common = np.array([bool(set(m.effects) & set(search.best.effects)) for m in models])
    shared = common * np.fmax(leads[alone].sum() - leads.sum(axis=1), 0.0)
    return Competition(models, winners(-0.5 * free * np.log(squares), odds, leads, shared))


def winner(competition: Competition, search: Search) -> Model:
    """Return the most probable set.

    A set that was set aside, since its last effect does not matter, counts for the likeliest part of it.
    """
    votes: dict[Model, float] = {}
    for model, weight in zip(competition.models, competition.weights.tolist(), strict=True):
        kept = (m for m in (model, *search.models) if m.effects not in search.set_aside)
        part = next((m for m in kept if set(m.effects) <= set(model.effects)), search.baseline)
        votes[part] = votes.get(part, 0.0) + weight
    return max(votes, key=lambda m: votes[m])


def competitors(search: Search) -> tuple[Model, ...]:
    """Return the best set, and for each of its effects the likeliest sets that lack it.

    That which lacks nothing else is always among them, and so is the model alone.
    """
    best = search.best
    models = [best]
    for id_ in best.effects:
        lacking = [m for m in search.models if id_ not in m.effects]
        rest = [m for m in lacking if set(m.effects) == set(best.effects) - {id_}]
        models += [*rest, *lacking[:TRIED]]
    models += [m for m in search.models if not m.effects]
    return tuple({m.effects: m for m in models}.values())


def winners(densities: Array, odds: Array, leads: Array, shared: Array) -> Array:
    """Return the probabilities of sets.

    The lead of the first set over another one differs between the units, since a signature grows with the
    speed. The uncertainty of the sum is that of a ratio estimator (Cochran, Sampling Techniques, 3rd ed.
    1977, section 6.4): the leads depart from proportion to the expected ones. It is at least that of noise,
    which gives a log likelihood ratio of mean m the variance 2 m. Errors of formulas that both sets share
    follow no such proportion: the whole spread of the leads over the units then counts, but no more than such
    errors can make. Effects that lead by E and are off by a share f make 2 m (1 + 2 f^2 E) at most, where all
    of their error lies along the difference of the two sets.

    Args:
        densities: (k, n) log predictive densities of the units, by sets.
        odds: (k,) logarithms of the sets' prior odds.
        leads: (k, n) expected log density ratios of the first set to each, if the first is right.
        shared: (k,) expected lead of what the set has in common with the first, over the model alone.
    """
    k, n = densities.shape
    rng = np.random.default_rng(0)
    found, noise = densities[0] - densities, 2 * leads.sum(axis=1)
    leads = np.where(noise[:, None] > 0, leads, 1.0)
    total = found.sum(axis=1, keepdims=True)
    away, alike = found - leads * total / leads.sum(axis=1, keepdims=True), found - total / n
    spread, whole = (n / (n - 1) * np.sum(x**2, axis=1) for x in (away, alike))
    least = np.fmax(noise, np.fmin(whole, noise * (1 + 2 * FORMULA_ERROR[0] ** 2 * shared)))
    sums = np.sqrt(n / (n - 1)) * rng.normal(size=(DRAWS, n)) @ away.T
    sums += np.sqrt(np.fmax(least - spread, 0.0)) * rng.normal(size=(DRAWS, k))
    sums /= np.sqrt(rng.chisquare(n - 1, (DRAWS, 1)) / (n - 1))
    sums += odds - total[:, 0]
    weights = np.exp(sums - sums.max(axis=1, keepdims=True))
    return _never_certain((weights / weights.sum(axis=1, keepdims=True)).mean(axis=0))


def _never_certain(weights: Array) -> Array:
    """Return probabilities with half a draw added that is shared by all: none is then exactly 0 or 1."""
    return np.asarray((DRAWS * weights + 0.5 / weights.size) / (DRAWS + 0.5))


def nothing_missing(search: Search) -> float:
    """Return the probability that no effect of the library that matters is missing, where none was found.

    A candidate that was not fitted counts by what its screen promises, and each by the probability that it
    matters if it acts. One that makes the model likelier, and was not chosen, does not matter.
    """
    baseline, screened = search.baseline, search.screened_alone()
    logs = {id_: np.log(EFFECT_ODDS) + score.gain for id_, score in screened.items()}
    for model in (m for m in search.models if len(m.effects) == 1):
        logs[model.effects[0]] = model.log_posterior - baseline.log_posterior
    matters = {id_: score.relevant for id_, score in screened.items()}
    odds = sum(float(np.exp(log)) * matters.get(id_, 1.0) for id_, log in logs.items() if log < 0)
    return min(1 / (1 + odds), SUREST)
