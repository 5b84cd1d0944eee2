"""The numbers of a fit as a finding states them, errors of the effects' formulas included."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from granite_lab.discovery.finding import FittedParameter
from granite_lab.estimate import Estimate
from granite_lab.inference.constants import FORMULA_ERROR
from granite_lab.inference.fit import Fit
from granite_lab.inference.normal import posterior
from granite_lab.inference.point import Further
from granite_lab.inference.pool import SAND, SAND_PER_TRIAL
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array
from granite_lab.model.effect import Active
from granite_lab.parameters import load_paper


class _Made(Mapping[int, Array]):
    """Columns of trials, made when they are asked for: those of many trials at once take gigabytes."""

    def __init__(self, make: Callable[[int], Array], count: int) -> None:
        self.make, self.count = make, count

    def __getitem__(self, i: int) -> Array:
        return self.make(i)

    def __iter__(self) -> Iterator[int]:
        return iter(range(self.count))

    def __len__(self) -> int:
        return self.count


@dataclass(frozen=True, eq=False)
class Numbers:
    """The numbers of a fit, with standard errors that hold errors of the formulas of its effects."""

    problem: Problem
    fit: Fit

    @property
    def rough(self) -> float:
        """Error of the formulas as a share of their traces: as learnt, or the usual one."""
        learnt = float(np.median(list(self.fit.scales.formulas.values()) or [0.0]))
        return max(FORMULA_ERROR[0], learnt)

    @cached_property
    def by_formulas(self) -> Array:
        """(p,) std of all numbers that errors of the formulas make.

        A formula is wrong by a factor that differs from command to command and from channel to channel: each
        such share of a trace moves the numbers by what the linear fit makes of it, and the moves are
        independent.
        """
        problem, fit, point = self.problem, self.fit, self.fit.point
        effects = len(point.effects)
        if not effects:
            return np.zeros(point.vector.size)
        every = sorted({c for t in problem.trials for c in t.channels})

        def columns(i: int) -> Array:
            t = problem.trials[i]
            changes = fit.derivatives.traces[problem.input_of[i]]
            traces = t.effect_columns(changes, point.trials[i], point.sensors)
            apart = np.zeros((len(t.channels), traces.shape[0] // len(t.channels), len(every), effects))
            for k, (c, part) in enumerate(zip(t.channels, np.split(traces, len(t.channels)), strict=True)):
                apart[k, :, every.index(c)] = part
            table = problem.columns(i, point, fit.derivatives)
            return np.column_stack([table, apart.reshape(traces.shape[0], -1)])

        count = len(every) * effects
        none, made = (np.zeros((0, 0, count)),), _Made(columns, len(problem.trials))
        further = Further(none, counts=(count,) * len(problem.commands), columns=made)
        normal = problem.normal(point, fit.derivatives, fit.residuals, further=further, keep=False)
        std, mean = problem.prior(point, fit.scales)
        moves = posterior(*normal.marginal(fit.scales), std**-2.0, mean - point.vector).follow
        return np.asarray(self.rough * np.sqrt(np.sum(moves**2, axis=1)))

    def of_effect(self, id_: str) -> tuple[FittedParameter, ...]:
        """Return the numbers of an effect, relative to the logs.

        The std of a strength includes an error of the formula that is the same everywhere, for it cannot be
        told from the strength; that of a shape includes `by_formulas`.
        """
        problem, fit, point = self.problem, self.fit, self.fit.point
        effect = problem.pool.scenario.effects[id_]
        scaled = float(np.mean([t.observation.scaled for t in problem.trials]))
        variance, common_std = fit.std**2, fit.common_std
        first = np.cumsum([0, *(x.size for x in point.trials)])
        numbers = []
        for k, (e, p) in enumerate(problem.parameters(point.effects, per_trial=False)):
            if e == id_:
                value = float(point.common[k])
                of_formula = self._of_common[k] if p.shape else self.rough * (value - p.neutral)
                std = float(np.hypot(common_std[k], of_formula))
                numbers.append(
                    FittedParameter(p.name, p.unit, Estimate(effect.as_logged(value, scaled), std))
                )
        for k, (e, p) in enumerate(problem.parameters(point.effects, per_trial=True)):
            if e == id_:
                places = [int(first[i]) + t.size + k for i, t in enumerate(problem.trials)]
                values = [float(point.vector[place]) for place in places]
                rms = float(np.sqrt(np.mean(np.square(values))))
                std = float(np.sqrt(np.mean(variance[places]) / len(values)))
                numbers.append(FittedParameter(p.name, p.unit, Estimate(rms, std), tuple(values)))
        return tuple(numbers)

    @property
    def _of_common(self) -> Array:
        """`by_formulas` of `Point.common`."""
        return self.by_formulas[self.by_formulas.size - self.fit.point.common.size :]

    @cached_property
    def sand(self) -> dict[str, Estimate]:
        """The sand, mean of the trials, as logarithms of ratios to the files."""
        first, point = sum(x.size for x in self.fit.point.trials), self.fit.point
        value = point.shared[: len(SAND)].copy()
        value[:SAND_PER_TRIAL] += np.mean([x[:SAND_PER_TRIAL] for x in point.trials], axis=0)
        std = np.hypot(self.fit.std, self.by_formulas)[first:]
        return {name: Estimate(float(value[k]), float(std[k])) for k, name in enumerate(SAND)}

    @cached_property
    def own_means(self) -> dict[str, float]:
        """Gain or tilt to its mean over the trials, with what they share of it."""
        values: dict[str, list[float]] = {}
        shared = self.fit.point.calibration
        for t, x in zip(self.problem.trials, self.fit.point.trials, strict=True):
            for slack, value in zip(t.slacks, x, strict=False):
                if slack.learnt and slack.name not in SAND:
                    values.setdefault(slack.name, []).append(float(value) + shared.get(slack.name, 0.0))
        return {name: float(np.mean(of)) for name, of in values.items()}

    @property
    def alike(self) -> tuple[str, ...]:
        """Names of `own_means` that lie two standard deviations beyond their usual range."""
        first = self.problem.learnt_std
        return tuple(name for name, mean in self.own_means.items() if abs(mean) > 2 * first[name])

    def sand_of_trial(self, i: int) -> tuple[str, dict[str, float]]:
        """Return the name of a trial, and the numbers of its sand."""
        soil, point = self.problem.pool.scenario.soil, self.fit.point
        base = {"a_theta": load_paper().a_theta}
        base |= {n: float(getattr(soil, n)) for n in SAND[1:SAND_PER_TRIAL]}
        ratio = np.exp(point.shared[:SAND_PER_TRIAL] + point.trials[i][:SAND_PER_TRIAL])
        return self.problem.trials[i].observation.name, {
            n: base[n] * float(r) for n, r in zip(SAND[:SAND_PER_TRIAL], ratio, strict=True)
        }


def active_of(problem: Problem, fit: Fit) -> tuple[Active, ...]:
    """Return the effects as a simulation takes them, see `_typical` for what each trial has of its own."""
    point, effects = fit.point, problem.pool.scenario.effects
    typical = _typical(problem, fit)
    return tuple(
        Active(effects[id_], values)
        for id_, values in problem.setting(point.effects, point.common, np.asarray(typical))
    )


def _typical(problem: Problem, fit: Fit) -> Array:
    """Return the numbers of effects that differ from trial to trial as one trial may have them: their mean.

    A cosine and a sine have another phase in each trial, so that their means vanish: the amplitude that all
    share, its rms over the trials, stands in the cosine.
    """
    private = problem.parameters(fit.point.effects, per_trial=True)
    rows = [x[t.size :] for t, x in zip(problem.trials, fit.point.trials, strict=True)]
    typical = np.asarray(np.mean(rows, axis=0))
    square = np.asarray(np.mean(np.square(rows), axis=0))
    place = {(id_, p.name): k for k, (id_, p) in enumerate(private)}
    for id_ in fit.point.effects:
        for pair in problem.pool.scenario.effects[id_].circles:
            c, s = (place[id_, name] for name in pair)
            typical[c], typical[s] = min(float(np.sqrt(square[c] + square[s])), private[c][1].high), 0.0
    return typical
