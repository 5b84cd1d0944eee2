"""Fitted sets of effects, and what a search found among them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from granite_lab.discovery.candidates import Score
from granite_lab.discovery.leaders import Screening, best_scores
from granite_lab.discovery.sets import UNLIKELY, EffectSet, best_fits, log_posterior
from granite_lab.inference.constants import LEAST_GAIN
from granite_lab.inference.descent import TO_OPTIMUM
from granite_lab.inference.fit import Fit
from granite_lab.inference.problem import Problem


@dataclass(frozen=True, eq=False)
class Model:
    """A set of effects with its fit.

    Attributes:
        effects: ids, sorted.
        fit: the best that was found.
        log_posterior: evidence and the prior of the set.
    """

    effects: EffectSet
    fit: Fit
    log_posterior: float

    @classmethod
    def of(cls, effects: EffectSet, fit: Fit) -> Model:
        """Give a fit the prior of its set."""
        return cls(effects, fit, log_posterior(effects, fit))

    def with_effect(self, id_: str) -> EffectSet:
        """Return the set with one more effect."""
        return tuple(sorted((*self.effects, id_)))

    def is_improved_by(self, larger: Model) -> bool:
        """Tell whether a larger set is likelier than this one would be at an optimum that it missed.

        By its derivatives that is half of `Fit.predicted_drop` above what its fit has reached.
        """
        least = self.log_posterior + LEAST_GAIN + self.fit.predicted_drop / 2
        return bool(larger.log_posterior > least)


def finely(problem: Problem, models: Sequence[Model]) -> list[Model]:
    """Return models at the optimum of their fits; one that comes no further as it is."""
    rough = [m for m in models if not m.fit.fine]
    fits = best_fits(problem, [(m.fit.point, m.fit.scales) for m in rough], TO_OPTIMUM)
    return [Model.of(m.effects, fits[m.effects]) if m.effects in fits else m for m in models]


def likely(models: Iterable[Model], best: Model) -> list[Model]:
    """Return the models that can change a probability, the likeliest first: the others are `UNLIKELY`."""
    least = best.log_posterior + np.log(UNLIKELY)
    return [m for m in ranked(models) if m.log_posterior >= least]


def ranked(models: Iterable[Model]) -> list[Model]:
    """Return models, the likeliest first."""
    return sorted(models, key=lambda m: -m.log_posterior)


@dataclass(frozen=True, eq=False)
class Search:
    """What a search has fitted and screened.

    Attributes:
        models: fitted sets, the likeliest first; before them the one that predicts best, see `led_by`.
        screenings: sets beside which candidates were screened, to the screens.
        set_aside: sets whose last effect does not stay: it changes little, or does not predict what is left
            out; and likelier sets than the best whose simulations predict that worse than the files do.
    """

    models: tuple[Model, ...]
    screenings: Mapping[EffectSet, tuple[Screening, ...]]
    set_aside: frozenset[EffectSet] = frozenset()

    @property
    def best(self) -> Model:
        """The likeliest set all of whose effects matter."""
        return next(m for m in self.models if m.effects not in self.set_aside)

    @property
    def baseline(self) -> Model:
        """The model without effects, which is always fitted."""
        return next(m for m in self.models if not m.effects)

    @property
    def negligible(self) -> EffectSet:
        """The effects that likelier sets than the best hold besides: likely, and too small to matter."""
        likelier = self.models[: self.models.index(self.best)]
        return tuple(dict.fromkeys(e for m in likelier for e in m.effects if e not in self.best.effects))

    def led_by(self, model: Model) -> Search:
        """Return the search with a model of one of its sets as the best."""
        return replace(self, models=(model, *(m for m in self.models if m.effects != model.effects)))

    def screened_alone(self) -> dict[str, Score]:
        """Return candidate to the screen of it as the only effect that promises most, by scales as learnt."""
        return best_scores(self.screenings.get((), ()))

    def model(self, effects: Sequence[str]) -> Model | None:
        """Return the model of a set, None where it was not fitted."""
        key = tuple(sorted(effects))
        return next((m for m in self.models if m.effects == key), None)
