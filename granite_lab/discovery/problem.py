"""The least-squares problem: trials, simulations and noise; the numbers come as arguments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from granite_lab.discovery.bench import PER_TRIAL, SAND, Bench, Setting, Task, Values
from granite_lab.discovery.noise import Whitener
from granite_lab.discovery.nuisance import UNKNOWN_SAND, TrialModel
from granite_lab.discovery.point import Point
from granite_lab.errors import EstimateError
from granite_lab.logs.trial import Array
from granite_lab.model.effect import Effect, EffectParameter


class Problem:
    """The trials, the simulations and the noise; the numbers come as arguments."""

    def __init__(self, trials: Sequence[TrialModel], bench: Bench) -> None:
        self.trials, self.bench = tuple(trials), bench
        self.variants = sorted({t.variant for t in trials})
        self.whiteners: list[list[Whitener]] = []
        self.free: dict[str, tuple[int, ...]] = {}

    def places(self, id_: str) -> tuple[int, ...]:
        """Return which parameters of an effect are fitted; the others stay neutral."""
        return self.free.get(id_, tuple(range(len(self.effect(id_).parameters))))

    def neutral(self) -> Point:
        """Return the point of the files' values."""
        return Point(np.zeros(len(SAND)), (), np.zeros(0), tuple(np.zeros(t.size) for t in self.trials))

    def effect_parameters(self, ids: Sequence[str]) -> tuple[list[EffectParameter], list[EffectParameter]]:
        """Return the shared and the per-trial parameters of effects, in order."""
        every = self._owned(ids)
        return [p for _, p in every if not p.per_trial], [p for _, p in every if p.per_trial]

    def shared_parameters(self, ids: Sequence[str]) -> list[tuple[str, EffectParameter]]:
        """Return the shared parameters of effects, each with the id of its effect, in order."""
        return [(id_, p) for id_, p in self._owned(ids) if not p.per_trial]

    def own_parameters(self, ids: Sequence[str]) -> list[tuple[str, EffectParameter]]:
        """Return the per-trial parameters of effects, each with the id of its effect, in order."""
        return [(id_, p) for id_, p in self._owned(ids) if p.per_trial]

    def _owned(self, ids: Sequence[str]) -> list[tuple[str, EffectParameter]]:
        return [(id_, self.effect(id_).parameters[k]) for id_ in ids for k in self.places(id_)]

    def effect(self, id_: str) -> Effect:
        """Return a candidate."""
        return self.bench.world.effects[id_]

    def setting(self, ids: Sequence[str], common: Array, own: Array) -> Setting:
        """Return the effects with their values, for the simulator."""
        shared, private = iter(common.tolist()), iter(own.tolist())
        setting = []
        for id_ in ids:
            values = [p.neutral for p in self.effect(id_).parameters]
            for k in self.places(id_):
                values[k] = next(private if self.effect(id_).parameters[k].per_trial else shared)
            setting.append((id_, tuple(values)))
        return tuple(setting)

    def task(self, point: Point, trial: int) -> Task:
        """Return the simulation of one trial at its own sand."""
        x = point.trials[trial]
        sand = point.sand.copy()
        sand[:PER_TRIAL] += x[:PER_TRIAL]
        own = x[self.trials[trial].size :]
        return Task(
            self.trials[trial].variant, as_values(sand), self.setting(point.effects, point.common, own)
        )

    def own_precision(self, ids: Sequence[str]) -> Array:
        """Return inverse prior variances of the effects' numbers per trial."""
        return np.array([(3 * (p.prior_high - p.prior_low)) ** -2.0 for p in self.effect_parameters(ids)[1]])

    def centre(self, point: Point, variant: int) -> Task:
        """Return the simulation of a command at the mean sand of its trials."""
        own = [x for t, x in zip(self.trials, point.trials, strict=True) if t.variant == variant]
        sand = point.sand.copy()
        sand[:PER_TRIAL] += np.mean([x[:PER_TRIAL] for x in own], axis=0)
        return Task(
            variant, as_values(sand), self.setting(point.effects, point.common, self.extra(point, variant))
        )

    def responses(self, tasks: Sequence[Task]) -> list[Array] | None:
        """Return the (7, M) response of each simulation; None where one has no solution."""
        found = [r for r in self.bench.run(tasks) if r is not None]
        return found if len(found) == len(tasks) else None

    def centres_at(self, point: Point) -> list[Array]:
        """Return per command its (7, M) response at the mean sand of its trials.

        Raises:
            EstimateError: a simulation fails.
        """
        found = self.responses([self.centre(point, v) for v in self.variants])
        if found is None:
            raise EstimateError("a simulation near the fit does not converge", "check robot and soil files")
        return found

    def extra(self, point: Point, variant: int) -> Array:
        """Return the mean over the trials of a command of the effects' numbers per trial."""
        own = [x[t.size :] for t, x in zip(self.trials, point.trials, strict=True) if t.variant == variant]
        return np.asarray(np.mean(own, axis=0))

    def whiten(self, trial: int, columns: Array) -> Array:
        """Return whitened (C n,) or (C n, k) columns of one trial."""
        parts = np.split(columns, len(self.whiteners[trial]))
        return np.concatenate([w(part) for w, part in zip(self.whiteners[trial], parts, strict=True)])

    def residuals(self, point: Point, responses: Sequence[Array]) -> tuple[Array, ...]:
        """Return per trial (C, n) measured minus predicted."""
        return tuple(
            t.measured - t.predict(r, x[: t.size])
            for t, r, x in zip(self.trials, responses, point.trials, strict=True)
        )

    @property
    def count(self) -> int:
        """How many numbers were measured, over all trials."""
        return sum(int(w.known.sum()) for own in self.whiteners for w in own)

    def chi2(self, white: Sequence[Array], point: Point) -> float:
        """Return the sum of squares of whitened residuals and priors."""
        priors = float(np.sum((point.sand / UNKNOWN_SAND) ** 2)) + sum(
            float(np.sum((x[: t.size] / t.prior) ** 2))
            for t, x in zip(self.trials, point.trials, strict=True)
        )
        prior = self.bounds(point)[0][len(SAND) :]
        shapes = float(prior @ (point.common - self.centres(point)[len(SAND) :]) ** 2)
        own = self.own_precision(point.effects)
        private = sum(float(own @ x[t.size :] ** 2) for t, x in zip(self.trials, point.trials, strict=True))
        return float(sum(w @ w for w in white)) + priors + shapes + private

    def white(self, residuals: Sequence[Array]) -> tuple[Array, ...]:
        """Return the whitened residuals of each trial in a row."""
        return tuple(self.whiten(i, r.ravel()) for i, r in enumerate(residuals))

    def bounds(self, point: Point) -> tuple[Array, Array, Array]:
        """Return inverse prior variances, lowest and highest shared numbers.

        A strength has no prior; a shape has a wide one, for it means nothing where the strength is small.
        """
        shared, _ = self.effect_parameters(point.effects)
        sand = np.asarray(UNKNOWN_SAND)
        shapes = [(p.prior_high - p.prior_low) ** -2 if p.shape else 0.0 for p in shared]
        return (
            np.concatenate([sand**-2, shapes]),
            np.concatenate([-4 * sand, [p.low for p in shared]]),
            np.concatenate([4 * sand, [p.high for p in shared]]),
        )

    def centres(self, point: Point) -> Array:
        """Return what the priors pull the shared numbers to."""
        shared, _ = self.effect_parameters(point.effects)
        return np.concatenate([np.zeros(len(SAND)), [p.neutral for p in shared]])


def as_values(values: Array) -> Values:
    """Return an array as the plain numbers of a task."""
    return tuple(values.tolist())
