"""The posterior over sets of effects: screened by linear algebra, the leaders fitted in full."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from granite_lab.discovery.candidates import Score, around
from granite_lab.discovery.carrying import carried, filed, worse
from granite_lab.discovery.heldout import Predicted, predict, predicts_better
from granite_lab.discovery.leaders import Look, Promise, leaders, origins, screened
from granite_lab.discovery.relevance import good, made, needed, shows, strained, unexplained
from granite_lab.discovery.sets import attempts, fit_sets, set_of, where_alone
from granite_lab.inference.constants import DRAWS, EFFECT_ODDS, FEW, LEFT, RIVAL, TOLERANCE, TRIED, WORTH
from granite_lab.inference.descent import LEAST
from granite_lab.inference.fit import ROUNDS, Fit, under
from granite_lab.inference.gap import prediction_change
from granite_lab.inference.normal import Scales
from granite_lab.inference.point import Point
from granite_lab.inference.problem import Problem
from granite_lab.inference.scales import FIRST, FORMULAS

MOST = 6
"""Effects in a set at most."""

FINE = 12
"""Most steps of a fit that begins where another one ended: a fine one at a rough one's end, or one of the
best set with an effect exchanged; convention."""

UNLIKELY = 1 / DRAWS
"""Odds below which a set changes no probability: no draw shows it."""


@dataclass(frozen=True, eq=False)
class Model:
    """A set of effects with its fit.

    Attributes:
        effects: ids, sorted.
        fit: the best that was found.
        log_posterior: evidence and the prior of the set.
    """

    effects: tuple[str, ...]
    fit: Fit
    log_posterior: float


@dataclass(frozen=True, eq=False)
class Search:
    """What a search has looked at.

    Attributes:
        models: fitted sets, the likeliest first.
        looks: sets beside which candidates were screened, to the screens.
        small: sets whose last effect does not stay: it changes little, or does not predict what is left out;
            and likelier sets than the best whose simulations predict that worse than the files do.
    """

    models: tuple[Model, ...]
    looks: Mapping[tuple[str, ...], tuple[Look, ...]]
    small: frozenset[tuple[str, ...]] = frozenset()

    @property
    def best(self) -> Model:
        """The likeliest set all of whose effects matter."""
        return next(m for m in self.models if m.effects not in self.small)

    @property
    def alone(self) -> Model:
        """The model without effects, which is always fitted."""
        return next(m for m in self.models if not m.effects)

    @property
    def beside(self) -> tuple[str, ...]:
        """The effects that are likely beside the best set, and too small to matter."""
        likelier = self.models[: self.models.index(self.best)]
        return tuple(dict.fromkeys(e for m in likelier for e in m.effects if e not in self.best.effects))

    def model(self, effects: Sequence[str]) -> Model | None:
        """Return the model of a set, None where it was not fitted."""
        key = tuple(sorted(effects))
        return next((m for m in self.models if m.effects == key), None)

    def probability(self, wanted: Callable[[Model], bool]) -> float:
        """Return the posterior probability of the models that fulfil a condition."""
        weights = np.exp(np.array([m.log_posterior for m in self.models]) - self.models[0].log_posterior)
        return float(weights[[wanted(m) for m in self.models]].sum() / weights.sum())


def search(
    problem: Problem,
    base: Fit,
    candidates: Sequence[str],
    tolerance: float = TOLERANCE,
    tell: Callable[[str, int], None] = lambda *_: None,
) -> Search:
    """Extend the model effect by effect, revise the set, then exchange each of its effects for its rivals.

    Candidates are screened under the discrepancy as learnt and under one of the tolerated size.

    Args:
        problem: the trials, with the noise.
        base: the fit without effects.
        candidates: ids.
        tolerance: discrepancy that does not matter, as a share of a channel's rms.
        tell: called with the stage, and the number of effects beside which is searched; `MOST` while effects
            are exchanged.
    """
    steps = _Steps(problem, candidates, tolerance, tell, {(): _model((), base)})
    best, taken = steps.revised(*steps.path(steps.models[()]))
    steps.exchange(best, taken)
    for _ in range(MOST):
        steps.guard()
        steps.finish()
        if not steps.reduced():
            break
    models = sorted(steps.models.values(), key=lambda m: -m.log_posterior)
    return Search(tuple(models), steps.looks, frozenset(steps.small))


@dataclass(frozen=True, eq=False)
class _Extension:
    """One step of a search: the set before it, that with one more effect, and what was tried."""

    before: Model
    after: Model
    tried: Sequence[Score]


@dataclass
class _Steps:
    """The steps of a search, with what it has fitted so far.

    Attributes:
        problem, candidates, tolerance, tell: as `search` has them.
        models: fitted sets.
        looks: sets to the screens beside them.
        small: sets that are not the best, see `stays` and `guard`.
        predictions: fits to what they predict of trials that are left out.
        from_files, from_larger: sets also fitted from the files' sand; from where a larger one ended.
        named: effects beside which is searched; `MOST` where they are exchanged.
    """

    problem: Problem
    candidates: Sequence[str]
    tolerance: float
    tell: Callable[[str, int], None]
    models: dict[tuple[str, ...], Model]
    looks: dict[tuple[str, ...], tuple[Look, ...]] = field(default_factory=dict)
    small: set[tuple[str, ...]] = field(default_factory=set)
    predictions: dict[Fit, Predicted] = field(default_factory=dict)
    from_files: set[tuple[str, ...]] = field(default_factory=set)
    from_larger: set[tuple[str, ...]] = field(default_factory=set)
    named: int = 0

    @property
    def fits(self) -> dict[tuple[str, ...], Fit]:
        """The fits of the sets."""
        return {k: m.fit for k, m in self.models.items()}

    def path(self, model: Model) -> tuple[Model, list[_Extension]]:
        """Extend a set effect by effect; return the last set and the steps to it."""
        taken: list[_Extension] = []
        while len(model.effects) < MOST:
            best, tried = self.extended(model)
            if best is model:
                best = self.afresh(model)
                if best is model:
                    break
            elif (other := self.after_larger(model, best)) is not model:
                best = other
            else:
                taken.append(_Extension(model, best, tried))
            model = best
        return model, taken

    def after_larger(self, model: Model, larger: Model) -> Model:
        """Fit a set again from the end of a fit with one more effect; return the likelier fit.

        Full fits change what candidates promise by factors of up to two. One that brings more than that
        shows that the set beside which it stands had missed its optimum; what else stood beside that is
        fitted anew.
        """
        if not model.effects or model.effects in self.from_larger:
            return model
        (id_,) = set(larger.effects) - set(model.effects)
        looks = self.looks[model.effects]
        promised = max(s.gain for look in looks for s in look.scores if s.candidate == id_)
        if larger.fit.evidence - model.fit.evidence <= 2 * promised:
            return model
        self.from_larger.add(model.effects)
        start = self.problem.without_effect(larger.fit.point, id_)
        other = self.refitted(model, [start], larger.fit.scales)
        if other is not model:
            old = {k for k in self.models if set(k) > set(model.effects)}
            self.models = {k: m for k, m in self.models.items() if k not in old}
            self.small -= old
        return other

    def afresh(self, model: Model) -> Model:
        """Fit a set that leaves a discrepancy again from the numbers of the files; return the likelier fit.

        Sand that stood in for effects which have been found since may lie beside another optimum.
        """
        if not model.effects or model.effects in self.from_files or self.settled(model):
            return model
        self.from_files.add(model.effects)
        return self.refitted(model, [model.fit.point.at_files()], FIRST)

    def refitted(self, model: Model, starts: Sequence[Point], scales: Scales) -> Model:
        """Fit a set again from other starts; return the likelier fit."""
        self.fitting([model.effects])
        refit = attempts(self.problem, [(start, scales) for start in starts]).get(model.effects)
        other = model if refit is None else _model(model.effects, refit)
        if other.log_posterior <= model.log_posterior + WORTH:
            return model
        self.models[model.effects] = other
        self.looks.pop(model.effects, None)
        return other

    def revised(self, best: Model, taken: list[_Extension]) -> tuple[Model, list[_Extension]]:
        """Extend again what is left of a set without one of its effects, and go on with a likelier one.

        An effect that resembles the sum of two missing ones may be found before either. The `FEW` effects
        that are needed least are taken out, each in turn; see `is_strange`.
        """
        for _ in range(MOST):
            if len(best.effects) < 2 or not self.is_strange(best):
                break
            self.named = MOST
            points = [self.problem.without_effect(best.fit.point, e) for e in best.effects]
            self.fitted([(point, best.fit) for point in points])
            parts = [
                m for key in map(set_of, points) if (m := self.models.get(key)) and key not in self.looks
            ]
            for rest in sorted(parts, key=lambda m: -m.log_posterior)[:FEW]:
                other, tried = self.extended(rest)
                if other.log_posterior > best.log_posterior + WORTH:
                    best, way = self.path(other)
                    taken = [_Extension(rest, other, tried), *way]
                    break
            else:
                break
        return best, taken

    def is_strange(self, model: Model) -> bool:
        """Tell whether a set may hold an effect that stands in for others.

        Errors of its formulas are then as large as they may be in more than one channel, and it predicts
        trials left out worse than noise and tolerance allow.
        """
        if sum(error >= FORMULAS[1] for error in model.fit.scales.formulas.values()) < 2:
            return False
        predicted = self.predicted(model)
        return bool(predicted.unseen.sum() > (1 + LEFT**2) * predicted.expected.sum())

    def extended(self, model: Model) -> tuple[Model, list[Score]]:
        """Return the best set with one more effect, the set itself if none is better, and what was tried."""
        self.named = max(self.named, len(model.effects))
        promises = self.promised(model)
        tried: list[Promise] = []
        for group in self.in_turn(model, promises):
            tried += group
            self.fit(model, group)
            best = self.best_of(model, tried)
            if best is not model and len(tried) < len(promises):
                tried = promises  # its rivals
                self.fit(model, promises)
                best = self.best_of(model, promises)
            if best is not model:
                return best, [p.score for p in tried]
        return model, [p.score for p in tried]

    def in_turn(self, model: Model, promises: list[Promise]) -> list[list[Promise]]:
        """Return the groups in which candidates are fitted beside a model until one of them stays.

        Beside effects that leave no discrepancy that is one after the other, for most often none stays. Where
        errors of the formulas may explain all that is left, it is the first alone; elsewhere all together.
        """
        if self.settled(model):
            return [[p] for p in promises]
        if model.effects:
            left = unexplained(self.problem, model.fit, model.fit.scales, self.tolerance)
            if max(left.values(), default=0.0) <= self.tolerance:
                return [promises[:1]]
        return [promises]

    def promised(self, model: Model) -> list[Promise]:
        """Return the candidates to be fitted beside a model, those of the scales as learnt first."""
        if model.effects not in self.looks:
            self.tell(f"screening candidates beside {_words(model.effects)}", self.named)
            others = [c for c in self.candidates if c not in model.effects]
            sizes = FEW if model.effects else None  # of a strength, the smallest first
            begins = [model.fit] if model.effects else origins(self.problem, model.fit)
            scales = model.fit.scales
            wide = scales.largest > self.tolerance or scales.loud or strained(self.problem, model.fit)
            screens = self.problem.bench.side_by_side(
                lambda k: screened(self.problem, begins[k], others, sizes, self.tolerance if wide else None),
                len(begins),
            )
            for key, looks in self.looks.items():  # their columns are large
                self.looks[key] = tuple(replace(look, screened=None) for look in looks)
            self.looks[model.effects] = tuple(look for looks in screens for look in looks)
        return leaders(self.looks[model.effects])

    def fit(self, model: Model, group: Sequence[Promise]) -> None:
        """Fit some leaders beside a model, from each start once."""
        starts = {
            (origin.point, score.candidate, score.values, id(score.trial_values)): (origin.point, score)
            for promise in group for origin, score in promise.starts
        }  # fmt: skip
        ids = dict.fromkeys(promise.score.candidate for promise in group)
        new = {id_: key for id_ in ids if (key := tuple(sorted((*model.effects, id_)))) not in self.models}
        self.fitted([(_with(self.problem, *start), model.fit) for start in starts.values()])
        for id_, key in new.items():
            self.shifted(key, id_)

    def shifted(self, key: tuple[str, ...], id_: str) -> None:
        """Fit a set again from the sizes next to that at which an effect ended, until neither is likelier.

        The likelihood has an optimum wherever an edge of a trace that moves with its strength falls on one of
        the residual.
        """
        for _ in range(MOST):
            model = self.models.get(key)
            points = around(self.problem, model.fit.point, id_) if model else []
            if model is None or not points or self.refitted(model, points, model.fit.scales) is model:
                break

    def fitted(self, starts: Sequence[tuple[Point, Fit]], rounds: int = ROUNDS) -> None:
        """Fit the sets of some points that are not fitted yet, each with the scales of a fit nearby."""
        new = [(start, near.scales) for start, near in starts if set_of(start) not in self.models]
        self.fitting(set_of(start) for start, _ in new)
        fits = fit_sets(self.problem, new, self.fits, rounds)
        self.models.update({k: _model(k, f) for k, f in fits.items()})

    def fitting(self, sets: Iterable[tuple[str, ...]]) -> None:
        """Tell which sets are fitted next."""
        if words := dict.fromkeys(map(_words, sets)):
            self.tell(f"fitting {', '.join(words)}", self.named)

    def best_of(self, model: Model, tried: Sequence[Promise]) -> Model:
        """Return the likeliest set with one of the tried whose new effect stays; the set itself if none."""
        keys = [tuple(sorted((*model.effects, p.score.candidate))) for p in tried]
        better = [self.models[k] for k in keys if k in self.models and k not in self.small]
        least = model.log_posterior + WORTH
        for other in sorted(better, key=lambda m: -m.log_posterior):
            if other.log_posterior <= least:
                break
            if gains(model, other) and self.stays(model, other):
                return other
            self.small.add(other.effects)  # it cannot be named; it is listed
        return model

    def stays(self, model: Model, other: Model) -> bool:
        """Tell whether the last effect of a set stays: it matters, and predicts what is left out.

        Beside others it must be needed, too, or show beyond the errors of their formulas as learnt. A contact
        law beside another one must be needed: it may be the error of that formula.
        """
        problem, scales = self.problem, other.fit.scales
        changes = prediction_change(problem, model.fit, other.fit)
        if max(changes.values(), default=0.0) <= self.tolerance:
            return False
        if model.effects:
            (id_,) = set(other.effects) - set(model.effects)
            left = needed(problem, model.fit, scales, id_, changes, self.tolerance)
            share = made(changes, prediction_change(problem, self.models[()].fit, other.fit), self.tolerance)
            laws = [e for e in other.effects if self.problem.bench.world.effects[e].law]
            corrects = id_ in laws and len(laws) > 1
            if max(left.values(), default=0.0) <= self.tolerance and (corrects or not shows(share, scales)):
                return False
        before = predict(problem, under(problem, model.fit, scales), self.tolerance)
        return predicts_better(before, self.predicted(other))

    def predicted(self, model: Model) -> Predicted:
        """Return how a set predicts trials that are left out, computed once for each fit."""
        if model.fit not in self.predictions:
            self.predictions[model.fit] = predict(self.problem, model.fit, self.tolerance)
        return self.predictions[model.fit]

    def settled(self, model: Model) -> bool:
        """Tell whether a model leaves no discrepancy that matters."""
        return good(self.problem, model.fit, self.tolerance) and not strained(self.problem, model.fit)

    def exchange(self, best: Model, taken: Sequence[_Extension]) -> None:
        """Fit the best set with each of its effects exchanged for rivals that were tried in its place.

        A rival must have gained `RIVAL` of what the effect did: the sets beside which they stood differ.

        Args:
            best: the set.
            taken: the way to it.
        """
        self.named = MOST
        points: list[Point] = []  # not for the last effect: what was tried stood beside the same set
        for step in taken[:-1]:
            before, after = step.before, step.after
            (id_,) = set(after.effects) - set(before.effects)
            without = self.problem.without_effect(best.fit.point, id_)
            points.append(where_alone(self.problem, without, self.fits))
            least = before.log_posterior + RIVAL * (after.log_posterior - before.log_posterior)
            for score in (s for s in step.tried if s.candidate not in best.effects):
                alternative = self.models.get(tuple(sorted((*before.effects, score.candidate))))
                if alternative and alternative.log_posterior > least:
                    points.append(_with(self.problem, without, score))
        self.fitted([(point, best.fit) for point in points], FINE)
        for key in map(set_of, points):
            rest, rival = (self.models.get(k) for k in (tuple(e for e in key if e in best.effects), key))
            better = rest and rival and rest is not rival and rival.log_posterior > best.log_posterior
            if rest and rival and better and not self.stays(rest, rival):
                self.small.add(key)

    def reduced(self) -> bool:
        """Fit the likeliest set without each of its effects from its own end; tell whether one is likelier.

        A set that was fitted before another effect was known may have missed its optimum: what that effect
        closes is then too large. It is fitted again where the end of the likeliest set promises more. One
        that is likelier is extended again.
        """
        self.named, best = MOST, self.likeliest()
        points = [self.problem.without_effect(best.fit.point, id_) for id_ in best.effects]
        looks = attempts(self.problem, [(point, best.fit.scales) for point in points], rounds=0)
        starts = [
            (look.point, best.fit.scales)
            for key, look in looks.items()
            if key not in self.models
            or under(self.problem, look, look.scales).evidence > self.models[key].fit.evidence + WORTH
        ]
        self.fitting(set_of(point) for point, _ in starts)
        for key, refit in attempts(self.problem, starts).items():
            if key not in self.models or refit.evidence > self.models[key].fit.evidence:
                self.models[key] = _model(key, refit)
                self.looks.pop(key, None)
        if self.likeliest() is best:
            return False
        self.path(self.likeliest())
        return True

    def likeliest(self) -> Model:
        """Return the likeliest set all of whose effects matter."""
        return max((m for k, m in self.models.items() if k not in self.small), key=lambda m: m.log_posterior)

    def guard(self) -> None:
        """Set aside sets that predict what is left out worse than the numbers of the files do.

        Sand that has moved to make up for a wrong effect shows there. None is set aside where every set does.
        """
        ranked = sorted(self.models.values(), key=lambda m: -m.log_posterior)
        by_files = filed(self.problem, self.models[()].fit)
        bad: list[tuple[str, ...]] = []
        for m in (m for m in ranked if m.effects and m.effects not in self.small):
            if not worse(carried(self.problem, m.fit, self.tolerance), by_files, self.tolerance):
                self.small.update(bad)
                return
            bad.append(m.effects)

    def finish(self) -> None:
        """Fit the sets that can change a probability to their optimum; the others keep their rough fit.

        They are the first `TRIED` sets whose odds against the likeliest are not below `UNLIKELY`. A set that
        only adds effects which do not matter is left out: it is no evidence against the likeliest.
        """
        ranked = sorted(self.models.values(), key=lambda m: -m.log_posterior)
        best = self.likeliest()
        least = best.log_posterior + np.log(UNLIKELY)
        others = [m for m in ranked if m.log_posterior >= least and not set(m.effects) >= set(best.effects)]
        wanted = [m for m in (best, *others[: TRIED - 1]) if not m.fit.converged]
        self.fitting(m.effects for m in wanted)
        starts = [(m.fit.point, m.fit.scales) for m in wanted]
        fits = attempts(self.problem, starts, LEAST, FINE)
        for m in wanted:
            fine = fits.get(m.effects)
            if fine is not None and (fine.converged or fine.evidence > m.fit.evidence):
                self.models[m.effects] = _model(m.effects, fine)


def _with(problem: Problem, point: Point, score: Score) -> Point:
    return problem.with_effect(point, score.candidate, score.values, score.trial_values)


def _model(effects: tuple[str, ...], result: Fit) -> Model:
    """Give a fit the prior of its set: equal odds for each effect."""
    return Model(effects, result, result.evidence + len(effects) * float(np.log(EFFECT_ODDS)))


def gains(model: Model, other: Model) -> bool:
    """Tell whether a set is likelier than a smaller one would be at the optimum that its fit may have missed.

    By its derivatives that is half of `Fit.promised` above what the fit has reached.
    """
    return bool(other.log_posterior > model.log_posterior + WORTH + model.fit.promised / 2)


def _words(effects: Sequence[str]) -> str:
    return " + ".join(effects) if effects else "the model alone"
