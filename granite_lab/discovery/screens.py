"""Screens: what a model predicts with each candidate at some sizes, as columns of its normal equations."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from granite_lab.inference.constants import LINEAR, MEMORY
from granite_lab.inference.fit import Fit
from granite_lab.inference.normal import NormalEquations, Posterior, posterior
from granite_lab.inference.point import Further, Point, stacked
from granite_lab.inference.problem import Problem
from granite_lab.inference.spill import Spillable
from granite_lab.logs.trial import Array
from granite_lab.model.effect import EffectParameter

TOGETHER = 10
"""Effects that are screened in one graph, all but one at their neutral values. Each makes its instructions
about 5 % more, and to compile a graph takes longer than its simulations."""


@dataclass(frozen=True)
class Probe:
    """A size at which the response to a candidate was simulated.

    Attributes:
        candidate: id.
        parameter: the strength that is not neutral.
        place: of the parameter among those of the candidate.
        size: how far it is from the neutral value.
        about: values of all parameters, before this strength is added.
    """

    candidate: str
    parameter: EffectParameter
    place: int
    size: float
    about: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Screen:
    """All candidates about one fit.

    Attributes:
        probes: with one column each, those of `per_trial` excepted.
        per_trial: candidates whose numbers differ by trial, to their probes; these have a column a trial.
        posterior: of the model without them; its `rest` holds the columns, first `probes`, then per trial
            those of `per_trial`, then the residual.
        marginal: the normal equations it is of, and the log determinant of the discrepancy.
        trials: number of trials.
        point: about which the screen is linear.
        spillable: `normal` and `raw`.
    """

    probes: tuple[Probe, ...]
    per_trial: Mapping[str, tuple[Probe, ...]]
    posterior: Posterior
    marginal: tuple[Array, float]
    trials: int
    point: Point
    spillable: Spillable[tuple[NormalEquations, Mapping[int, Array]]]

    @property
    def normal(self) -> NormalEquations:
        """Equations from which `posterior` and `marginal` follow under other scales."""
        return self.spillable.value[0]

    @property
    def raw(self) -> Mapping[int, Array]:
        """Of the first trial of each command, its (C n, k) columns before whitening.

        They are by the trial's own parameters, the shared ones, `probes`, then `per_trial` of the trial.
        """
        return self.spillable.value[1]

    def columns_of(self, trial: int) -> Array:
        """Return the places of the candidates' columns that a trial has, in the order of `raw`."""
        count = sum(len(group) for group in self.per_trial.values())
        behind = len(self.probes) + trial * count + np.arange(count)
        return np.asarray(np.concatenate([np.arange(len(self.probes)), behind]))

    def places_per_trial(self, id_: str) -> Array:
        """Return the (trials, o) places of the columns of such a candidate."""
        probes = [p for group in self.per_trial.values() for p in group]
        first = [k for k, p in enumerate(probes) if p.candidate == id_]
        return np.asarray(len(self.probes) + np.arange(self.trials)[:, None] * len(probes) + np.array(first))


def sizes(p: EffectParameter) -> tuple[float, ...]:
    """Return the distances from the neutral value at which a strength is probed.

    They go from where the model is linear to beyond the largest that is expected. One is probed in the middle
    of the logarithms where the trace is proportional to the strength, or has either sign.
    """
    high, low = p.prior_high - p.neutral, p.prior_low - p.neutral
    if p.per_trial:
        return (high / 2,)
    if low < 0 < high:
        both = (np.sqrt(LINEAR) * high, np.sqrt(LINEAR) * low)
        return both[:1] if p.linear else both
    if p.moving:
        return tuple(np.geomspace(low / 2, high, 8).tolist())
    least = max(low, LINEAR * high)
    if p.linear:
        return (float(np.sqrt(least * high)),)
    expected = (least / 2, float(np.sqrt(least * high)), high, 4 * high)
    return tuple(size for size in expected if p.neutral + size <= p.high)


def probes_of(problem: Problem, id_: str, most: int | None = None) -> list[Probe]:
    """List the sizes of a candidate, one strength at a time, `most` of each, all by default.

    Of a strength that moves its trace none is left out: no small size shows what a larger one does.
    """
    parameters = problem.parameters_of(id_)
    starts = [p.kinds or (p.neutral,) for p in parameters]
    return [
        Probe(id_, p, k, size, about)
        for about in itertools.product(*starts)
        for k, p in enumerate(parameters)
        if not p.shape
        for size in sizes(p)[: None if p.moving else most]
    ]


def screen(problem: Problem, fit: Fit, ids: Sequence[str], *, most: int | None = None) -> Screen:
    """Simulate the candidates at their sizes about a fit, and integrate everything else out.

    Args:
        problem: the trials.
        fit: about which the screen is linear.
        ids: the candidates.
        most: sizes of a strength at most, the smallest first; all by default.
    """
    probes = [probe for id_ in ids for probe in probes_of(problem, id_, most)]
    sound = np.ones(len(probes), dtype=bool)
    changes: dict[int, Array] = {}
    groups = _groups(problem, fit, ids)
    for number, everyone in enumerate(problem.inputs):  # the responses of all would take gigabytes
        pairs = _simulated(problem, fit, probes, groups, number)
        sound &= np.array([run is not None and base is not None for run, base in pairs], dtype=bool)
        changes |= _shown(problem, fit, everyone, pairs)
    per_trial: dict[str, list[int]] = {}
    for k in (k for k in np.flatnonzero(sound).tolist() if probes[k].parameter.per_trial):
        per_trial.setdefault(probes[k].candidate, []).append(k)
    shared = [k for k in np.flatnonzero(sound).tolist() if not probes[k].parameter.per_trial]
    order = [*shared, *(k for group in per_trial.values() for k in group)]
    columns = {i: problem.columns(i, fit.point, fit.derivatives) for i, _ in enumerate(problem.trials)}
    if order:
        columns = {i: np.column_stack([table, changes.pop(i)[:, order]]) for i, table in columns.items()}
    further = Further.computed(columns, len(order), len(order) - len(shared))
    normal = problem.normal(fit.point, fit.derivatives, fit.residuals, further=further, keep=False)
    first = [everyone[0] for everyone in problem.commands]
    raw = {i: columns[i] for i in first}
    return Screen(
        tuple(probes[k] for k in shared),
        {id_: tuple(probes[k] for k in group) for id_, group in per_trial.items()},
        *_reduced(problem, normal, fit),
        len(problem.trials),
        fit.point,
        Spillable((normal, raw)),
    )


def _simulated(
    problem: Problem, fit: Fit, probes: Sequence[Probe], groups: Mapping[str, tuple[str, ...]], number: int
) -> list[tuple[Array | None, Array | None]]:
    """Return the responses of an input to each of the probes, and those of the same graph without it."""
    neutral = {
        group: problem.centre(_switched_on(problem, fit, group), number) for group in set(groups.values())
    }
    probed, bases = [], []
    for probe in probes:
        values, group = list(probe.about), groups[probe.candidate]
        values[probe.place] += probe.size
        point = _switched_on(problem, fit, group, {probe.candidate: values})
        probed.append(problem.centre(point, number))
        bases.append(neutral[group])
    runs = problem.pool.run([*probed, *bases], keep=False)
    return list(zip(runs[: len(probes)], runs[len(probes) :], strict=True))


def _shown(
    problem: Problem, fit: Fit, trials: Sequence[int], pairs: list[tuple[Array | None, Array | None]]
) -> dict[int, Array]:
    """Return per trial of an input the (C n, k) bins of what k pairs of simulations differ by.

    As many at a time become bins as fit into `MEMORY`, and the simulations are given up.
    """
    bins_of: dict[int, list[Array]] = {i: [] for i in trials}
    like = next((base for _, base in pairs if base is not None), None)
    if like is None:
        return {}
    count = max(1, int(MEMORY / like.nbytes))
    for first in range(0, len(pairs), count):
        several = pairs[first : first + count]
        pairs[first : first + count] = [(None, None)] * len(several)
        changes = stacked(
            [0 * like if run is None or base is None else run - base for run, base in several], like
        )
        for i in trials:
            shown = problem.trials[i].effect_columns
            bins_of[i].append(shown(changes, fit.point.trials[i], fit.point.sensors))
    return {i: np.hstack(tables) for i, tables in bins_of.items()}


def _groups(problem: Problem, fit: Fit, ids: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return candidate to the effects of its graph: itself and others, which are neutral.

    Alone are those that make a simulation stiff, and those beside which the neutral ones are not inert.
    """
    effects = problem.pool.scenario.effects
    plain = [id_ for id_ in ids if not any(p.moving for p in effects[id_].parameters)]
    plain.sort(key=lambda id_: -len(effects[id_].states))
    packs = [tuple(plain[k : k + TOGETHER]) for k in range(0, len(plain), TOGETHER)]
    points = [fit.point, *(_switched_on(problem, fit, pack) for pack in packs)]
    base, *runs = problem.pool.run([problem.centre(point, 0) for point in points], keep=False)
    alone: dict[str, tuple[str, ...]] = {id_: (id_,) for id_ in ids}
    if base is None:
        return alone
    much = LINEAR * np.abs(base).max(axis=1, keepdims=True)
    inert = [run is not None and bool((np.abs(run - base) <= much).all()) for run in runs]
    return alone | {id_: pack for pack in itertools.compress(packs, inert) for id_ in pack}


def _switched_on(
    problem: Problem, fit: Fit, ids: Sequence[str], values: Mapping[str, Sequence[float]] | None = None
) -> Point:
    """Return the point of a fit with more effects, at their neutral values where none are given."""
    point = fit.point
    for id_ in ids:
        neutral = [p.neutral for p in problem.parameters_of(id_)]
        point = problem.with_effect(point, id_, (values or {}).get(id_, neutral))
    return point


def rescreened(problem: Problem, screened: Screen, fit: Fit) -> Screen:
    """Return a screen about the same point under the scales of another fit there."""
    after, marginal = _reduced(problem, screened.normal, fit)
    return replace(screened, posterior=after, marginal=marginal)


def _reduced(problem: Problem, normal: NormalEquations, fit: Fit) -> tuple[Posterior, tuple[Array, float]]:
    std, mean = problem.prior(fit.point, fit.scales)
    marginal = normal.marginal(fit.scales)
    return posterior(*marginal, std**-2.0, mean - fit.point.vector), marginal


def around(problem: Problem, point: Point, id_: str) -> list[Point]:
    """Return a point with a strength of an effect that moves its trace at the next smaller and larger size.

    The other numbers stay, and the sizes are those at which it is probed.

    Args:
        problem: the trials.
        point: with the effect.
        id_: of the effect.
    """
    points = []
    for k, (effect, p) in enumerate(problem.parameters(point.effects, per_trial=False)):
        if effect == id_ and p.moving:
            size = point.common[k] - p.neutral
            smaller = [s for s in sizes(p) if s < size * (1 - LINEAR)][-1:]
            larger = [s for s in sizes(p) if s > size * (1 + LINEAR)][:1]
            for other in (*smaller, *larger):
                common = point.common.copy()
                common[k] = p.neutral + other
                points.append(replace(point, common=common))
    return points
