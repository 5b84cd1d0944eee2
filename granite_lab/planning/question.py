"""What a search knows worst, and the explanations with the values that they need on the trials at hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from granite_lab.discovery.candidates import Probe, probes_of
from granite_lab.effects.library import get
from granite_lab.errors import EstimateError
from granite_lab.logs.trial import Array
from granite_lab.model.effect import Effect
from granite_lab.planning.design import Design
from granite_lab.planning.stage import Explanation, Model, Stage, against, integrated

DECISIVE = 3.0
"""Logarithm of a Bayes factor that decides between two explanations, 20 to 1 (Kass and Raftery 1995)."""

MOST = 3
"""Number of explanations that are compared."""

ROUNDS = 3
"""Steps of Gauss and Newton by which one explanation imitates another; the residual is nearly linear then."""

Kind = Literal["apart", "show", "sharpen"]


@dataclass(frozen=True)
class Question:
    """What the next trial should answer.

    Attributes:
        kind: tell the rivals "apart", "show" each of them against nothing at all, or "sharpen" a number.
        rivals: ids of the explanations, the named one first; empty where a number is sharpened.
        named: the effects in the model.
        first: place of the one of them that the rivals stand in for; None where they stand for none.
        gains: per rival the logarithm of the Bayes factor that the search gave it.
    """

    kind: Kind
    rivals: tuple[str, ...]
    named: Model
    first: int | None = None
    gains: tuple[float, ...] = ()

    @property
    def words(self) -> str:
        """The question for people."""
        if self.kind == "apart":
            return f"What would tell {', '.join(self.rivals[:-1])} from {self.rivals[-1]}?"
        if self.kind == "show":
            return f"What would show {' or '.join(self.rivals)}, if it is there?"
        return "What would sharpen the number that is known worst?"

    @property
    def others(self) -> Model:
        """Effects that are in the model whatever the answer."""
        return tuple(e for k, e in enumerate(self.named) if k != self.first)


def question(design: Design, known: Mapping[str, Effect]) -> Question:
    """Choose what is known worst: twins first, then a verdict that is not final, then the size of a number.

    Args:
        design: the trials at hand and what came out.
        known: effects by id.

    Raises:
        UsageError: a named effect is not known.
    """
    named = tuple(Explanation(e.id, _within(get(e.id, known), e.values)) for e in design.named)
    ids = [e.id for e in named]
    twins = [[t for t in e.twins if _strength(known, t)] for e in design.named]
    if any(twins):
        first = max(range(len(named)), key=lambda k: len(twins[k]))
        return Question("apart", (ids[first], *twins[first][: MOST - 1]), named, first)
    open_ = [c for c in design.possible if c.id not in ids and _strength(known, c.id)]
    if design.verdict == "unknown" and len(open_) > 1:
        leading = open_[:MOST]
        gains = tuple(max(c.gain, DECISIVE) for c in leading)
        return Question("apart", tuple(c.id for c in leading), (), None, gains)
    if (design.provisional or design.verdict == "unknown") and open_:
        leading = open_[: MOST - 1]
        if named:
            first = min(range(len(named)), key=lambda k: design.named[k].probability)
            return Question("apart", (ids[first], *(c.id for c in leading)), named, first)
        gains = tuple(max(c.gain, DECISIVE / 2) for c in leading)
        return Question("show", tuple(c.id for c in leading), (), None, gains)
    return Question("sharpen", (), named)


def _strength(known: Mapping[str, Effect], id_: str) -> bool:
    """Whether an effect has a strength that all trials share; others cannot be foreseen for a new trial."""
    return id_ in known and any(not p.shape and not p.per_trial for p in known[id_].parameters)


def _within(effect: Effect, values: Sequence[float]) -> tuple[float, ...]:
    given = [*values, *(p.neutral for p in effect.parameters[len(values) :])]
    return tuple(float(np.clip(v, p.low, p.high)) for p, v in zip(effect.parameters, given, strict=False))


def explanations(stage: Stage, asked: Question) -> tuple[Model, ...]:
    """Return the models that are compared; where something is to be shown, the first is that without it.

    Raises:
        EstimateError: fewer than two of them can be simulated.
    """
    others = asked.others
    found: list[Model] = [others] if asked.kind == "show" else []
    if asked.first is not None:
        truth = asked.named[asked.first]
        found.append((*others, truth))
        guesses = [_imitating(stage, others, truth, id_) for id_ in asked.rivals[1:]]
    else:
        guesses = [_sized(stage, others, i, g) for i, g in zip(asked.rivals, asked.gains, strict=True)]
    found += [(*others, g) for g in guesses if g is not None]
    if len(found) < 2:
        raise EstimateError("no other explanation can be simulated on these trials", "check the effects")
    return tuple(found)


def _probed(
    stage: Stage, others: Model, id_: str, truth: Model | None = None
) -> tuple[list[tuple[Probe, Explanation]], Array]:
    """Return an effect at several sizes, with the (k, k) products of what remains of their differences.

    The difference by `truth`, where it is given, comes first among the k.
    """
    problem = stage.problem(0, stage.design.driven[0])
    parameters = problem.parameters_of(id_)
    found = []
    for probe in probes_of(problem, id_):
        values = tuple(p.neutral + probe.size * (k == probe.place) for k, p in enumerate(parameters))
        guess = Explanation(id_, values)
        if not probe.is_own and stage.possible((*others, guess)):
            found.append((probe, guess))
    models = [*([truth] if truth else []), *((*others, guess) for _, guess in found)]
    if not found:
        return [], np.zeros((0, 0))
    rest = integrated(stage.at_hand(others, models), stage.prior(others)).rest[:-1, :-1]
    return found, rest


def _scaled(stage: Stage, probe: Probe, guess: Explanation, amount: float) -> Explanation:
    """Return an effect with the size of a probe times an amount, within its bounds."""
    parameters = stage.problem(0, stage.design.driven[0]).parameters_of(guess.id)
    p = parameters[probe.place]
    size = float(np.clip(p.neutral + amount * probe.size, p.low, p.high))
    return Explanation(guess.id, tuple(size if k == probe.place else v for k, v in enumerate(guess.values)))


def _sized(stage: Stage, others: Model, id_: str, gain: float) -> Explanation | None:
    """Return an effect at the size at which the trials at hand would show it with some Bayes factor."""
    found, rest = _probed(stage, others, id_)
    amounts = np.sqrt(2 * gain / np.fmax(np.diag(rest), 1e-12))
    if not found:
        return None
    best = int(np.argmin(np.abs(np.log(amounts))))
    guess = _scaled(stage, *found[best], float(amounts[best]))
    return guess if stage.possible((*others, guess)) else found[best][1]


def _imitating(stage: Stage, others: Model, truth: Explanation, id_: str) -> Explanation | None:
    """Return an effect with the values at which it comes nearest to another on the trials at hand."""
    true = (*others, truth)
    found, rest = _probed(stage, others, id_, true)
    if not found:
        return None
    size = np.fmax(np.diag(rest)[1:], 1e-12)
    best = int(np.argmax(rest[0, 1:] ** 2 / size))
    guess = _scaled(stage, *found[best], float(rest[0, 1 + best] / size[best]))
    if not stage.possible((*others, guess)):
        guess = found[best][1]
    parameters = stage.problem(0, stage.design.driven[0]).parameters_of(id_)
    shared = [k for k, p in enumerate(parameters) if not p.per_trial]
    least, nearest = np.inf, guess
    for _ in range(ROUNDS):
        model = (*others, guess)
        try:
            fitted = against(stage.at_hand(model, [true]), stage.prior(model), 0)
        except EstimateError:
            break
        if fitted.misfit >= least:
            break
        least, nearest = fitted.misfit, guess
        values = list(guess.values)
        for k, step in zip(shared, fitted.step[-len(shared) :], strict=True):
            values[k] = float(np.clip(values[k] + step, parameters[k].low, parameters[k].high))
        guess = Explanation(id_, tuple(values))
    return nearest
