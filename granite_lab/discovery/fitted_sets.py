"""The sets of effects that a search has fitted so far, and the fits that add to them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace

from granite_lab.discovery.candidates import Score
from granite_lab.discovery.heldout import Equations, losses
from granite_lab.discovery.leaders import (
    NOTHING_FITTED,
    Fitted,
    Prospect,
    Screening,
    leaders,
    origins,
    screened,
)
from granite_lab.discovery.models import Model, Search, finely, ranked
from granite_lab.discovery.relevance import has_strained_trials, is_adequate
from granite_lab.discovery.screens import around
from granite_lab.discovery.sets import EffectSet, Starts, best_fits, fit_sets, from_best_part, set_of
from granite_lab.inference.constants import FEW, LEAST_GAIN, NEGLIGIBLE
from granite_lab.inference.descent import ROUGH, Goal, misfit_at
from granite_lab.inference.fit import Fit
from granite_lab.inference.normal import Scales
from granite_lab.inference.point import Point
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array
from granite_lab.model.dictionary import is_term

MOST = 6
"""Effects in a set at most."""


@dataclass
class FittedSets:
    """The sets that a search has fitted so far.

    Attributes:
        problem: the trials, with the noise.
        candidates: ids.
        tolerance: discrepancy that does not matter, as a share of a channel's rms.
        tell: called with the stage and its number.
        models: the fitted sets.
        screenings: sets to the screens beside them.
        set_aside: sets that are not the best, see `Search.set_aside`.
        stage: number of effects beside which is searched; `MOST` where they are exchanged.
    """

    problem: Problem
    candidates: Sequence[str]
    tolerance: float
    tell: Callable[[str, int], None]
    models: dict[EffectSet, Model]
    screenings: dict[EffectSet, tuple[Screening, ...]] = field(default_factory=dict)
    set_aside: set[EffectSet] = field(default_factory=set)
    stage: int = 0
    _losses: dict[Fit, Array] = field(default_factory=dict)

    @classmethod
    def of_search(
        cls,
        found: Search,
        problem: Problem,
        candidates: Sequence[str],
        tolerance: float,
        tell: Callable[[str, int], None],
    ) -> FittedSets:
        """Return the sets of a search that has ended, to search on; the search stays as it is."""
        models = {m.effects: m for m in found.models}
        return cls(problem, candidates, tolerance, tell, models, dict(found.screenings), set(found.set_aside))

    @property
    def baseline(self) -> Model:
        """The model without effects."""
        return self.models[()]

    @property
    def fits(self) -> dict[EffectSet, Fit]:
        """The fits of the sets."""
        return {k: m.fit for k, m in self.models.items()}

    def as_search(self) -> Search:
        """Return what was fitted and screened."""
        return Search(tuple(ranked(self.models.values())), self.screenings, frozenset(self.set_aside))

    def likeliest(self) -> Model:
        """Return the likeliest set all of whose effects matter."""
        return ranked(m for k, m in self.models.items() if k not in self.set_aside)[0]

    def losses(self, model: Model) -> Array:
        """Return the losses of a set on what is left out, computed once for each fit."""
        if model.fit not in self._losses:
            self._losses[model.fit] = losses(self.problem, Equations(self.problem, model.fit), self.tolerance)
        return self._losses[model.fit]

    def is_adequate(self, model: Model) -> bool:
        """Tell whether a model leaves no discrepancy that matters, and no trial stands in for one."""
        adequate = is_adequate(self.problem, model.fit, self.tolerance)
        return adequate and not has_strained_trials(self.problem, model.fit)

    def at_optimum_if_adequate(self, model: Model) -> Model:
        """Return a set that leaves nothing that matters at its optimum, any other one as it is.

        What is fitted beside it then gains by its own effect, and not by what the set has missed so far.
        """
        if not model.effects or model.fit.fine or not self.is_adequate(model):
            return model
        self.tell_fits([model.effects])
        (fine,) = finely(self.problem, [model])
        if fine is not model:
            self.replace_fit(fine)
        return fine

    def prospects(self, model: Model, fitted: Fitted = NOTHING_FITTED) -> list[Prospect]:
        """Return the candidates to be fitted beside a model, see `leaders`."""
        if model.effects not in self.screenings:
            self.tell(f"screening candidates beside {_words(model.effects)}", self.stage)
            for key, screenings in self.screenings.items():  # their columns are large
                self.screenings[key] = tuple(replace(s, screened=None) for s in screenings)
            self.screenings[model.effects] = self._screened(model)
        return leaders(self.screenings[model.effects], fitted)

    def _screened(self, model: Model) -> tuple[Screening, ...]:
        """Screen the candidates beside a model."""
        problem, scales = self.problem, model.fit.scales
        others = [c for c in self.candidates if c not in model.effects]
        sizes = FEW if model.effects else None  # of a strength, the smallest first
        starts = [model.fit] if model.effects else origins(problem, model.fit)
        hidden = scales.largest > self.tolerance or scales.poor_fit or has_strained_trials(problem, model.fit)
        screens = problem.pool.parallel(
            lambda start: screened(problem, start, others, sizes, self.tolerance, hidden), starts
        )
        return tuple(screening for screenings in screens for screening in screenings)

    def fit_prospects(self, model: Model, prospects: Sequence[Prospect]) -> None:
        """Fit some candidates beside a model, from each start once."""
        starts = {
            (origin.point, score.candidate, score.values, id(score.trial_values)): (origin.point, score)
            for prospect in prospects for origin, score in prospect.starts
        }  # fmt: skip
        ids = dict.fromkeys(prospect.score.candidate for prospect in prospects)
        new = {id_: key for id_ in ids if (key := model.with_effect(id_)) not in self.models}
        points = [with_score(self.problem, *start) for start in starts.values()]
        self.fit_new([(point, model.fit) for point in points], model.log_posterior)
        for id_, key in new.items():
            if key in self.models and self.models[key].log_posterior > model.log_posterior:
                self.refit_at_other_sizes(key, id_)

    def fit_new(
        self, starts: Sequence[tuple[Point, Fit]], bar: float | None = None, goal: Goal = ROUGH
    ) -> None:
        """Fit the sets of some points that are not fitted yet, each with the scales of a fit nearby.

        Where they compete with a set that is fitted already, `bar` is the logarithm of its posterior.
        """
        new = [(start, near.scales) for start, near in starts if set_of(start) not in self.models]
        self.tell_fits(set_of(start) for start, _ in new)
        fits = fit_sets(self.problem, new, self.fits, bar, goal)
        self.models.update({k: Model.of(k, f) for k, f in fits.items()})

    def fit_parts(self, model: Model, lacking: Collection[str] = ()) -> list[Model]:
        """Return the sets that lack one library effect of a model, of `lacking` if given; fit the new ones.

        Their sand is that of the model, or of the likeliest set that has a part of their effects, where it
        already compensates for the effect that they lack: the one with the smaller misfit. Their fits end
        where what they may still gain changes little of what that effect closes.
        """
        ids = [id_ for id_ in model.effects if not is_term(id_) and (not lacking or id_ in lacking)]
        points = [self.problem.without_effect(model.fit.point, id_) for id_ in ids]
        new = [p for p in points if set_of(p) not in self.models]
        goal = replace(ROUGH, evidence=model.fit.evidence, share=NEGLIGIBLE)

        def start_of(point: Point) -> Point:
            starts = point, from_best_part(self.problem, point, self.fits)
            return min(starts, key=lambda start: misfit_at(self.problem, start, model.fit.scales))

        self.fit_new([(start_of(p), model.fit) for p in new], goal=goal)
        return [m for p in points if (m := self.models.get(set_of(p)))]

    def refit(self, model: Model, starts: Sequence[Point], scales: Scales) -> Model:
        """Fit a set again from other starts; return the likelier fit."""
        (again,) = self.refit_each([model], [[(start, scales) for start in starts]])
        return again

    def refit_each(self, models: Sequence[Model], starts: Sequence[Starts]) -> list[Model]:
        """Fit some sets again, each from its other starts; return the likelier fits."""
        self.tell_fits(model.effects for model in models)

        def again(number: int) -> Model:
            model = models[number]
            fit = best_fits(self.problem, starts[number], ROUGH, model.log_posterior).get(model.effects)
            return model if fit is None else Model.of(model.effects, fit)

        others = self.problem.pool.parallel(again, range(len(models)))
        pairs = list(zip(models, others, strict=True))
        better = [o if o.log_posterior > m.log_posterior + LEAST_GAIN else m for m, o in pairs]
        for model, other in zip(models, better, strict=True):
            if other is not model:
                self.replace_fit(other)
        return better

    def replace_fit(self, model: Model) -> None:
        """Put a better fit of a set in place of the old one, whose screen it does not fit."""
        self.models[model.effects] = model
        self.screenings.pop(model.effects, None)

    def refit_at_other_sizes(self, key: EffectSet, id_: str) -> None:
        """Fit a set again from the sizes next to that at which an effect ended, until neither is likelier.

        The likelihood has an optimum wherever an edge of a trace that moves with its strength falls on one of
        the residual.
        """
        for _ in range(MOST):
            model = self.models[key]
            points = around(self.problem, model.fit.point, id_)
            if not points or self.refit(model, points, model.fit.scales) is model:
                break

    def tell_fits(self, sets: Iterable[EffectSet]) -> None:
        """Tell which sets are fitted next."""
        if words := dict.fromkeys(map(_words, sets)):
            self.tell(f"fitting {', '.join(words)}", self.stage)


def with_score(problem: Problem, point: Point, score: Score) -> Point:
    """Return a point with a candidate of a screen, at the size that the screen promises most of."""
    return problem.with_effect(point, score.candidate, score.values, score.trial_values)


def _words(effects: Sequence[str]) -> str:
    return " + ".join(effects) if effects else "the model alone"
