"""How sure a set of effects is: fitted sets compete again as if other speeds, or trials, had been driven.

The posterior over the sets that happened to be fitted is almost always 0 or 1: it takes thousands of bins for
independent, while the errors of a model are alike in all trials of a command. Here whole commands count, each
predicted by the others; single trials, where there are few speeds. It is pseudo-BMA+ of Yao, Vehtari, Simpson
and Gelman, Using stacking to average Bayesian predictive distributions, Bayesian Analysis 13 (2018) 917-1007,
with two changes. The log density of what is left out is that of an error whose size is not known,

    S = -1/2 log det C - n/2 log(r^T C^-1 r),

n the degrees of freedom, C the covariance of the errors r: a model that lacks something is believed to the
size of its own errors only. And the sum over so few units is drawn from its posterior, Student's t, in place
of the Bayesian bootstrap, which never leaves the range of the four speeds that were driven.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from granite_lab.discovery.heldout import Predicted, units
from granite_lab.discovery.models import Model, Search
from granite_lab.inference.constants import DRAWS, EFFECT_ODDS, FEWEST_SPEEDS, TINY, TRIED
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


def compete(
    problem: Problem, search: Search, predicted: Callable[[Sequence[Model]], Sequence[Predicted]]
) -> Competition:
    """Let the best set compete with those that lack one of its effects.

    Args:
        problem: the trials.
        search: of them.
        predicted: returns the predictions of trials and speeds that are left out.
    """
    models = competitors(search)
    places = units(problem)
    predictions = predicted(models)
    losses, squares = (np.array([getattr(p, kind) for p in predictions]) for kind in ("loss", "squares"))
    free = np.array([predictions[0].expected[list(out)].sum() for out in places])
    comparable = np.isfinite(losses).all(axis=0) & (squares > 0).all(axis=0) & (free > 0)
    if comparable.sum() < FEWEST_SPEEDS:
        return by_evidence(search)
    odds = np.array([m.log_posterior - m.fit.evidence for m in models])
    densities = -0.5 * (losses - squares + free * np.log(np.fmax(squares, TINY)))
    return Competition(models, winners(densities[:, comparable], odds))


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


def winners(densities: Array, odds: Array) -> Array:
    """Return the probabilities of sets.

    Args:
        densities: (k, n) log predictive densities of the units, by sets.
        odds: (k,) logarithms of the sets' prior odds.
    """
    n = densities.shape[1]
    rng = np.random.default_rng(0)
    mean = densities.mean(axis=1, keepdims=True)
    z = rng.normal(size=(DRAWS, n))
    t = (z - z.mean(axis=1, keepdims=True)) / np.sqrt(rng.chisquare(n - 1, (DRAWS, 1)) / n)
    sums = n * mean[:, 0] + odds + t @ (densities - mean).T
    weights = np.exp(sums - sums.max(axis=1, keepdims=True))
    return _never_certain((weights / weights.sum(axis=1, keepdims=True)).mean(axis=0))


def _never_certain(weights: Array) -> Array:
    """Return probabilities with half a draw added that is shared by all: none is then exactly 0 or 1."""
    return np.asarray((DRAWS * weights + 0.5 / weights.size) / (DRAWS + 0.5))


def nothing_missing(search: Search) -> float:
    """Return the probability that no effect of the library is missing, where none that matters was found.

    A candidate that was not fitted counts by what its screen promises. One that makes the model likelier, and
    was not chosen, does not matter.
    """
    baseline = search.baseline
    logs = {id_: np.log(EFFECT_ODDS) + gain for id_, gain in search.screened_gains().items()}
    for model in (m for m in search.models if len(m.effects) == 1):
        logs[model.effects[0]] = model.log_posterior - baseline.log_posterior
    return 1 / (1 + float(np.sum([np.exp(log) for log in logs.values() if log < 0])))
