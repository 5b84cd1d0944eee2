"""The numbers of a fit as a finding states them, errors of the effects' formulas included."""

from __future__ import annotations

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


def _rough(fit: Fit) -> float:
    """Return the error of the formulas as a share of their traces: as learnt, or the usual one."""
    learnt = float(np.median(list(fit.scales.formulas.values()) or [0.0]))
    return max(FORMULA_ERROR[0], learnt)


def by_formulas(problem: Problem, fit: Fit) -> Array:
    """Return the (p,) std of the numbers of a fit that errors of the formulas of its effects make.

    A formula is wrong by a factor that differs from command to command and from channel to channel: each such
    share of a trace moves the numbers by what the linear fit makes of it, and the moves are independent.
    """
    point, effects = fit.point, len(fit.point.effects)
    if not effects:
        return np.zeros(point.vector.size)
    every = sorted({c for t in problem.trials for c in t.channels})
    columns = {}
    for i, t in enumerate(problem.trials):
        traces = t.effect_columns(fit.derivatives.traces[problem.input_of[i]], point.trials[i], point.sensors)
        apart = np.zeros((len(t.channels), traces.shape[0] // len(t.channels), len(every), effects))
        for k, (c, part) in enumerate(zip(t.channels, np.split(traces, len(t.channels)), strict=True)):
            apart[k, :, every.index(c)] = part
        table = problem.columns(i, point, fit.derivatives)
        columns[i] = np.column_stack([table, apart.reshape(traces.shape[0], -1)])
    count = len(every) * effects
    changes = (np.zeros((0, 0, count)),)
    further = Further(changes, counts=(count,) * len(problem.commands), columns=columns)
    normal = problem.normal(point, fit.derivatives, fit.residuals, further=further, keep=False)
    std, mean = problem.prior(point, fit.scales)
    moves = posterior(*normal.marginal(fit.scales), std**-2.0, mean - point.vector).follow
    return np.asarray(_rough(fit) * np.sqrt(np.sum(moves**2, axis=1)))


def numbers_of(problem: Problem, fit: Fit, id_: str) -> tuple[FittedParameter, ...]:
    """Return the fitted numbers of an effect, relative to the logs.

    The std of a strength includes an error of the formula that is the same everywhere, for it cannot be told
    from the strength; that of a shape includes errors that differ, see `by_formulas`.
    """
    effect = problem.pool.scenario.effects[id_]
    scaled = float(np.mean([t.observation.scaled for t in problem.trials]))
    common = problem.parameters(fit.point.effects, per_trial=False)
    private = problem.parameters(fit.point.effects, per_trial=True)
    variance, common_std = np.diag(fit.posterior.covariance), fit.common_std
    of_formulas = by_formulas(problem, fit)[-len(common) :]
    first = np.cumsum([0, *(x.size for x in fit.point.trials)])
    numbers = []
    for k, (e, p) in enumerate(common):
        if e == id_:
            std, value = float(common_std[k]), float(fit.point.common[k])
            by_formula = of_formulas[k] if p.shape else _rough(fit) * (value - p.neutral)
            std = float(np.hypot(std, by_formula))
            numbers.append(FittedParameter(p.name, p.unit, Estimate(effect.as_logged(value, scaled), std)))
    for k, (e, p) in enumerate(private):
        if e == id_:
            places = [int(first[i]) + t.size + k for i, t in enumerate(problem.trials)]
            values = [float(fit.point.vector[place]) for place in places]
            rms = float(np.sqrt(np.mean(np.square(values))))
            std = float(np.sqrt(np.mean(variance[places]) / len(values)))
            numbers.append(FittedParameter(p.name, p.unit, Estimate(rms, std), tuple(values)))
    return tuple(numbers)


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


def sand_of(problem: Problem, fit: Fit) -> dict[str, Estimate]:
    """Return the sand that all trials share, as logarithms of ratios to the files.

    The std includes errors of the formulas of the effects, see `by_formulas`.
    """
    first = sum(x.size for x in fit.point.trials)
    std = np.sqrt(np.fmax(np.diag(fit.posterior.covariance), 0.0) + by_formulas(problem, fit) ** 2)[first:]
    return {name: Estimate(float(fit.point.shared[k]), float(std[k])) for k, name in enumerate(SAND)}


def sand_of_trial(problem: Problem, fit: Fit, i: int) -> tuple[str, dict[str, float]]:
    """Return the name of a trial, and the numbers of its sand."""
    soil = problem.pool.scenario.soil
    base = {"a_theta": load_paper().a_theta} | {n: float(getattr(soil, n)) for n in SAND[1:SAND_PER_TRIAL]}
    ratio = np.exp(fit.point.shared[:SAND_PER_TRIAL] + fit.point.trials[i][:SAND_PER_TRIAL])
    return problem.trials[i].observation.name, {
        n: base[n] * float(r) for n, r in zip(SAND[:SAND_PER_TRIAL], ratio, strict=True)
    }
