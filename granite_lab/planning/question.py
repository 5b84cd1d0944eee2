"""What a search knows worst, and the explanations with the values that they need on the trials at hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from granite_lab.discovery.candidates import probes_of
from granite_lab.effects.library import get
from granite_lab.errors import EstimateError, InputError
from granite_lab.inference.bench import Setting, Values
from granite_lab.model.effect import Effect, EffectParameter
from granite_lab.planning.design import Design
from granite_lab.planning.stage import Stage, fitted

DECISIVE = 3.0
"""Logarithm of a Bayes factor that decides between two explanations, 20 to 1 (Kass and Raftery 1995)."""

MOST = 3
"""Number of explanations that are compared."""

ROUNDS = 3
"""Steps of Gauss and Newton by which one explanation imitates another."""


@dataclass(frozen=True)
class Question:
    """What the next trial should answer.

    Attributes:
        kind: tell the rivals "apart", "show" each of them against nothing, or "sharpen" a number.
        rivals: ids of the explanations, the named one first; empty where a number is sharpened.
        named: the effects in the model.
        first: place of the one of them that the rivals stand in for; None where they stand for none.
        gains: per rival that stands for none, the log Bayes factor that it has on the trials at hand.
    """

    kind: Literal["apart", "show", "sharpen"]
    rivals: tuple[str, ...]
    named: Setting
    first: int | None = None
    gains: tuple[float, ...] = ()


def question(design: Design, known: Mapping[str, Effect]) -> Question:
    """Choose what is known worst: twins first, then a verdict that is not final, then the size of a number.

    Effects whose strengths all differ from trial to trial cannot be foreseen for a new one and are no rivals.

    Raises:
        InputError: the design is of another version of an effect.
        UsageError: a named effect is not known.
    """
    if any(len(e.values) != len(get(e.id, known).parameters) for e in design.named):
        raise InputError("the design is of another version of an effect", "run 'granite-lab discover' again")
    named = tuple((e.id, _within(get(e.id, known).parameters, e.values)) for e in design.named)
    ids = [id_ for id_, _ in named]
    lasting = [i for i, e in known.items() if any(not p.shape and not p.per_trial for p in e.parameters)]
    twins = [[t for t in e.twins if t in lasting] for e in design.named]
    if any(twins):
        first = max(range(len(named)), key=lambda k: len(twins[k]))
        return Question("apart", (ids[first], *twins[first][: MOST - 1]), named, first)
    most = DECISIVE if design.verdict == "none" else np.inf  # what is shown and is small needs no trial
    possible = [c for c in design.possible if c.name not in ids and c.name in lasting and c.value < most]
    leading = possible[:MOST]
    rivals = tuple(c.name for c in leading)
    if design.verdict == "unknown" and len(rivals) > 1:
        return Question("apart", rivals, (), None, tuple(max(c.value, DECISIVE) for c in leading))
    if (design.provisional or design.verdict == "unknown") and rivals:
        if named:
            return Question("apart", (ids[-1], *rivals[: MOST - 1]), named, len(named) - 1)
        return Question("show", rivals, (), None, tuple(max(c.value, DECISIVE / 2) for c in leading))
    return Question("sharpen", (), named)


def _within(parameters: Sequence[EffectParameter], values: Sequence[float]) -> Values:
    return tuple(float(np.clip(v, p.low, p.high)) for p, v in zip(parameters, values, strict=True))


def explanations(stage: Stage, asked: Question) -> tuple[Setting, ...]:
    """Return the models that are compared; where something is to be shown, the first is that without it.

    Raises:
        EstimateError: fewer than two of them can be simulated.
    """
    found: list[Setting] = []
    others: Setting = ()
    if asked.first is None:
        found += [()] if asked.kind == "show" else []
        guesses = [_start(stage, (), i, gain=g) for i, g in zip(asked.rivals, asked.gains, strict=True)]
    else:
        truth = asked.named[asked.first]
        others = tuple(e for e in asked.named if e is not truth)
        found.append((*others, truth))
        guesses = [_imitating(stage, others, truth, id_) for id_ in asked.rivals[1:]]
    found += [(*others, guess) for guess in guesses if guess is not None]
    if len(found) < 2:
        raise EstimateError("no other explanation can be simulated on these trials", "check the effects")
    return tuple(found)


def _start(
    stage: Stage, others: Setting, id_: str, truth: Setting = (), gain: float = 0.0
) -> tuple[str, Values] | None:
    """Return an effect at the size at which it comes nearest to `truth`, or has a log Bayes factor `gain`."""
    problem = stage.problem(0)
    parameters = problem.parameters_of(id_)
    neutral = np.array([p.neutral for p in parameters])
    tried = []
    for probe in probes_of(problem, id_):
        values = tuple((neutral + probe.size * (np.arange(neutral.size) == probe.place)).tolist())
        if not probe.is_own and stage.possible((*others, (id_, values))):
            tried.append(values)
    if not tried:
        return None
    models = [*([truth] if truth else []), *((*others, (id_, values)) for values in tried)]
    rest = fitted(stage.at_hand(others, models), len(models)).rest
    size = np.fmax(np.diag(rest)[-len(tried) :], 1e-12)
    if truth:
        amounts = rest[0, 1:] / size
        best = int(np.argmax(amounts**2 * size))
    else:
        amounts = np.sqrt(2 * gain / size)
        best = int(np.argmin(np.abs(np.log(amounts))))
    scaled = _within(parameters, (neutral + amounts[best] * (np.array(tried[best]) - neutral)).tolist())
    return id_, scaled if stage.possible((*others, (id_, scaled))) else tried[best]


def _imitating(
    stage: Stage, others: Setting, truth: tuple[str, Values], id_: str
) -> tuple[str, Values] | None:
    """Return an effect with the values at which it comes nearest to another on the trials at hand."""
    true = (*others, truth)
    guess = nearest = _start(stage, others, id_, true)
    least = np.inf
    parameters = stage.problem(0).parameters_of(id_)
    shared = [k for k, p in enumerate(parameters) if not p.per_trial]
    for _ in range(ROUNDS):
        if guess is None:
            break
        try:
            found = fitted(stage.at_hand((*others, guess), [true]), 1)
        except EstimateError:
            break
        if found.misfit >= least:
            break
        least, nearest = found.misfit, guess
        values = np.array(guess[1])
        values[shared] += found.step[-len(shared) :]
        guess = id_, _within(parameters, values.tolist())
    return nearest
