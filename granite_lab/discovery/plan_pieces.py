"""What one trial, driven or not, would tell about rival explanations: simulations and their derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from granite_lab.discovery.arrow import Block, Projection, project
from granite_lab.discovery.bench import Bench, Setting, Task
from granite_lab.discovery.nuisance import TrialModel
from granite_lab.discovery.plan_design import Design, Driven
from granite_lab.discovery.plan_stage import staged
from granite_lab.discovery.point import Point
from granite_lab.discovery.problem import Problem
from granite_lab.discovery.refit import with_effect
from granite_lab.discovery.signature import probes_of
from granite_lab.discovery.slopes import blocks_at, slopes_at
from granite_lab.errors import EstimateError
from granite_lab.logs.trial import Array
from granite_lab.model.effect import Effect

STEP = 0.02
"""Step of a difference by an effect's parameter, as a share of its expected range."""

ROUNDS = 4


@dataclass(frozen=True)
class Rival:
    """One explanation: an effect with the values at which it explains the trials; None is no effect."""

    effect: Effect | None
    values: tuple[float, ...] = ()

    @property
    def id(self) -> str:
        """The effect's name."""
        return self.effect.id if self.effect is not None else "nothing"

    def variations(self) -> list[tuple[tuple[float, ...], float]]:
        """Return the values themselves, then those with one parameter moved, and by how much."""
        if self.effect is None:
            return []
        found = [(self.values, 0.0)]
        for k, p in enumerate(self.effect.parameters):
            h = STEP * (p.prior_high - p.prior_low)
            h = h if self.values[k] + h <= p.high else -h
            found.append((tuple(v + h * (j == k) for j, v in enumerate(self.values)), h))
        return found


@dataclass(frozen=True, eq=False)
class Piece:
    """One trial.

    Attributes:
        model: its layout.
        block: whitened derivatives by the nuisances.
        columns: (m, k) whitened, per rival the change of the readings, then its derivatives.
        prior: (q,) inverse variances of the numbers that all trials share.
    """

    model: TrialModel
    block: Block
    columns: Array
    prior: Array


@dataclass(frozen=True, eq=False)
class _Plain:
    """A trial without any rival: its problem, derivatives, response, and effects that are on anyway."""

    problem: Problem
    block: Block
    response: Array
    prior: Array
    setting: Setting


class Table:
    """Makes pieces: everything that trials have in common.

    Args:
        design: what was driven.
        bench: its commands are those of the design, then those that are proposed.
        others: effects that are in the model whatever the answer, with their values.
    """

    def __init__(self, design: Design, bench: Bench, others: Sequence[Rival] = ()) -> None:
        self.design, self.bench, self.others = design, bench, tuple(others)
        self._plain: dict[int, _Plain] = {}

    def piece(self, number: int, like: Driven, rivals: Sequence[Rival]) -> Piece:
        """Simulate one trial.

        Args:
            number: of its command.
            like: the trials whose channels and noise it has.
            rivals: explanations.

        Raises:
            EstimateError: a simulation does not converge.
        """
        if number not in self._plain:
            self._plain[number] = self._nuisances(number, like)
        plain = self._plain[number]
        asked = [
            (r.effect.id, values, h) for r in rivals if r.effect for values, h in r.variations()
        ]  # fmt: skip
        tasks = [Task(number, self.design.sand, (*plain.setting, (id_, values))) for id_, values, _ in asked]
        found = self.bench.run(tasks, keep=False)
        columns: list[Array] = []
        base: Array | None = None
        for (id_, _, h), signals in zip(asked, found, strict=True):
            if signals is None:
                raise EstimateError(f"{id_} cannot be simulated here")
            if h == 0:
                base = signals
                columns.append(signals - plain.response)
            else:
                assert base is not None
                columns.append((signals - base) / h)
        model = plain.problem.trials[0]
        x = np.zeros(model.size)
        bins = plain.problem.whiten(0, model.effect_columns(np.stack(columns), x))
        return Piece(model, plain.block, bins, plain.prior)

    def _nuisances(self, number: int, like: Driven) -> _Plain:
        problem = staged(self.design, self.bench, [(number, like)])
        point: Point = replace(problem.neutral(), sand=np.asarray(self.design.sand))
        for other in self.others:
            point = with_effect(problem, point, other.id, other.values)
        slopes = slopes_at(problem, point)
        block = blocks_at(problem, point, slopes)[0]
        setting = problem.centre(point, number).setting
        return _Plain(problem, block, slopes.response[0], problem.bounds(point)[0], setting)


def together(pieces: Sequence[Piece]) -> Projection:
    """Return what survives of all columns when the nuisances of all trials are refitted."""
    return project([p.block for p in pieces], [p.columns for p in pieces], pieces[0].prior)


def places(rivals: Sequence[Rival]) -> list[tuple[int, list[int]]]:
    """Return per rival the place of its column and those of its derivatives; -1 for no effect."""
    found, n = [], 0
    for r in rivals:
        if r.effect is None:
            found.append((-1, list[int]()))
            continue
        count = len(r.effect.parameters)
        found.append((n, list(range(n + 1, n + 1 + count))))
        n += 1 + count
    return found


def difference(n: int, rivals: Sequence[Rival], gram: Array, true: int, false: int) -> tuple[float, Array]:
    """Return the misfit that is left when a false rival stands in for the true one, and how it is made up.

    Args:
        n: number of columns.
        rivals: explanations.
        gram: (n, n) inner products of the surviving columns.
        true, false: places of the two.

    Returns:
        chi2, and the (n,) amounts of the columns whose sum is what is left.
    """
    where = places(rivals)
    amounts = np.zeros(n)
    for place, sign in ((where[true][0], 1.0), (where[false][0], -1.0)):
        if place >= 0:
            amounts[place] = sign
    own = where[false][1]
    if own:
        scale = 1 / np.sqrt(np.fmax(np.diag(gram)[own], 1e-300))
        G = gram[np.ix_(own, own)] * np.outer(scale, scale) + 1e-9 * np.eye(len(own))
        amounts[own] = -scale * np.linalg.solve(G, scale * (gram[own] @ amounts))
    return max(0.0, float(amounts @ gram @ amounts)), amounts


def stand_in(
    table: Table, driven: Sequence[tuple[int, Driven]], truth: Rival, effect: Effect
) -> Rival | None:
    """Fit an effect in the place of another on the trials at hand, without their data.

    Args:
        table: makes the pieces.
        driven: number and trials of each command.
        truth: the explanation that is imitated.
        effect: of the one that imitates.

    Returns:
        None where nothing converges.
    """
    best: tuple[float, Rival] | None = None
    for probe in probes_of(effect):
        try:
            misfit, _ = _misfit(table, driven, truth, Rival(effect, probe.values))
        except EstimateError:
            continue
        if best is None or misfit < best[0]:
            best = misfit, Rival(effect, probe.values)
    for _ in range(ROUNDS if best else 0):
        assert best is not None
        _, step = _misfit(table, driven, truth, best[1])
        moved = [
            float(np.clip(v + s, p.low, p.high))
            for v, s, p in zip(best[1].values, step, effect.parameters, strict=True)
        ]
        trial = Rival(effect, tuple(moved))
        try:
            misfit, _ = _misfit(table, driven, truth, trial)
        except EstimateError:
            break
        if misfit >= best[0] * (1 - 1e-3):
            break
        best = misfit, trial
    return best[1] if best else None


def _misfit(
    table: Table, driven: Sequence[tuple[int, Driven]], truth: Rival, guess: Rival
) -> tuple[float, Array]:
    """Return the misfit of a guess as it stands, and the step of its parameters that lowers it most."""
    pieces = [p for number, like in driven for p in [table.piece(number, like, (truth, guess))] * like.count]
    gram = together(pieces).gram
    _, amounts = difference(gram.shape[0], (truth, guess), gram, 0, 1)
    (here, _), (there, own) = places((truth, guess))
    apart = np.zeros(gram.shape[0])
    apart[here], apart[there] = 1.0, -1.0
    return float(apart @ gram @ apart), -amounts[own]
