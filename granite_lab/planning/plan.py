"""`plan_next`: which trial would best answer what a search has left open."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from granite_lab.errors import EstimateError
from granite_lab.inference.bench import SAND, Bench
from granite_lab.inference.conditions import STAGING, StagedWorld
from granite_lab.inference.problem import SHARED
from granite_lab.logs.trial import Array
from granite_lab.model.effect import Effect
from granite_lab.planning.design import Design
from granite_lab.planning.options import LEFT_OUT, Option, options
from granite_lab.planning.question import DECISIVE, Question, explanations, question
from granite_lab.planning.stage import Model, Stage, against, integrated
from granite_lab.processes import one_thread

if TYPE_CHECKING:
    import pandas as pd

FIFTH = 0.8
"""A standard deviation that falls to this share, or less, is worth a trial."""


@dataclass(frozen=True)
class Target:
    """What is to be improved.

    Attributes:
        words: a number, as "drive_reaction.share", or two explanations, as "a from b".
        now: relative standard deviation of the number, or expected logarithm of the Bayes factor of the
            true explanation against the other, whichever is true.
    """

    words: str
    now: float


@dataclass(frozen=True)
class Proposal:
    """A trial that could be driven, with what would be known after it.

    Attributes:
        option: the trial.
        after: as `Target.now`, of each target.
        best: place of the target that it improves most.
        worth: a standard deviation falls by a fifth or more, or a Bayes factor becomes 20 times larger.
        rank: the smaller, the better.
    """

    option: Option
    after: tuple[float, ...]
    best: int
    worth: bool
    rank: tuple[float, float, bool]


@dataclass(frozen=True)
class Plan:
    """The proposals, the best first.

    Attributes:
        question: what is open.
        models: the explanations with their values.
        targets: what is to be improved.
        proposals: ranked.
        left_out: what was not simulated, and why.
        design: the trials at hand.
        runs: simulations that were needed.
    """

    question: Question
    models: tuple[Model, ...]
    targets: tuple[Target, ...]
    proposals: tuple[Proposal, ...]
    left_out: tuple[str, ...]
    design: Design
    runs: int

    @property
    def worth(self) -> bool:
        """Whether any trial is worth driving."""
        return any(p.worth for p in self.proposals)

    def to_frame(self) -> pd.DataFrame:
        """Return the proposals, one row each, best first, with the target that each improves most."""
        import pandas as pd  # noqa: PLC0415

        rows = []
        for p in self.proposals:
            v, target = p.option.variant, self.targets[p.best]
            motion = (v.velocity, v.acceleration, v.distance, p.option.conditions.words, p.option.repeats)
            rows.append((*motion, target.words, target.now, p.after[p.best], p.worth, p.option.why))
        names = ["v_mps", "a_mps2", "distance_m", "conditions", "repeats"]
        return pd.DataFrame(rows, columns=[*names, "target", "before", "after", "worth", "why"])


@one_thread()
def plan_next(
    design: Design,
    known: Mapping[str, Effect],
    *,
    room: float | None = None,
    max_speed: float | None = None,
    jobs: int = 1,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> Plan:
    """Rank trials by how well they would answer what is open.

    Args:
        design: the trials at hand, and what came out.
        known: effects by id.
        room: longest way the sand allows [m]; the longest so far by default.
        max_speed: fastest command [m/s].
        jobs: number of processes.
        progress: told how many trials are looked at, and of how many.

    Raises:
        EstimateError: the trials at hand, or the explanations, cannot be simulated.
        UsageError: a named effect is not known.
    """
    asked = question(design, known)
    chosen = options(design, [*asked.rivals, *(e.id for e in asked.named)], room=room, max_speed=max_speed)
    n = len(design.driven)
    world = StagedWorld(
        design.robot,
        design.soil,
        (*(d.variant for d in design.driven), *(o.variant for o in chosen)),
        {**known, **STAGING},
        conditions=(*(d.conditions for d in design.driven), *(o.conditions for o in chosen)),
    )
    with Bench(world, jobs) as bench:
        stage = Stage(design, bench)
        sharpens = asked.kind == "sharpen"
        models = (asked.named,) if sharpens else explanations(stage, asked)
        false = models[:1] if sharpens or asked.kind == "show" else models
        others = [[m for m in models if m is not f] for f in false]
        at_hand = [stage.at_hand(f, o) for f, o in zip(false, others, strict=True)]

        def look(informations: Sequence[Array]) -> list[Target]:
            if sharpens:
                return _stds(stage, asked.named, informations[0])
            return _factors(stage, models, false, informations)

        targets = look(at_hand)
        looked: list[tuple[Option, list[float]]] = []
        failed = 0
        for k, option in enumerate(chosen):
            progress(k, len(chosen))
            number, count = n + k, 1
            if option.repeats:
                number, count = design.driven.index(option.like), int(option.like.count)
            try:
                after = []
                for f, o, before in zip(false, others, at_hand, strict=True):
                    new = stage.information(number, option.like, count + option.repeats, f, o)
                    old = stage.information(number, option.like, count, f, o) if option.repeats else 0.0
                    after.append(before + new - old)
            except EstimateError:
                failed += 1
                continue
            looked.append((option, [t.now for t in look(after)]))
        progress(len(chosen), len(chosen))
        runs = bench.runs
    if sharpens:
        k = _worst(targets, [after for _, after in looked])
        targets, looked = [targets[k]], [(option, [after[k]]) for option, after in looked]
    proposals = [_proposal(o, targets, after, sharpens=sharpens) for o, after in looked]
    left_out = (*LEFT_OUT, *([f"{failed} commands that cannot be simulated"] if failed else []))
    proposals.sort(key=lambda p: (not p.worth, p.rank))
    return Plan(asked, models, tuple(targets), tuple(proposals), left_out, design, runs)


def _worst(targets: Sequence[Target], after: Sequence[Sequence[float]]) -> int:
    """Return the place of the number with the largest relative std, of those that a trial can improve if any.

    What no trial can show, as the cohesion of sand that gives way along the tyre, no prediction needs.
    """
    helped = [k for k, t in enumerate(targets) if any(reached[k] <= FIFTH * t.now for reached in after)]
    return max(helped or range(len(targets)), key=lambda k: targets[k].now)


def _proposal(option: Option, targets: Sequence[Target], after: list[float], *, sharpens: bool) -> Proposal:
    """Judge a trial; of several pairs those count that it decides."""
    if sharpens:
        rank = (after[0], 0.0, not option.repeats)
        return Proposal(option, tuple(after), 0, after[0] <= FIFTH * targets[0].now, rank)
    gained = [a - t.now for a, t in zip(after, targets, strict=True)]
    best = int(np.argmax(gained))
    rank = (-sum(min(g, DECISIVE) for g in gained), -gained[best], not option.repeats)
    return Proposal(option, tuple(after), best, gained[best] >= DECISIVE, rank)


def _stds(stage: Stage, named: Model, information: Array) -> list[Target]:
    """Return the relative std of each named strength; of a_θ and the sand where there is none."""
    std = np.sqrt(np.diag(integrated(information, stage.prior(named)).covariance))
    problem = stage.problem(0, stage.design.driven[0])
    point = stage.point(problem, named)
    found = []
    for k, (id_, p) in enumerate(problem.parameters(point.effects, per_trial=False)):
        size = abs(float(point.common[k]) - p.neutral)
        if not p.shape and size > 0:
            found.append(Target(f"{id_}.{p.name}", float(std[len(SHARED) + k]) / size))
    return found or [Target(name, float(std[k])) for k, name in enumerate(SAND)]


def _factors(
    stage: Stage, models: Sequence[Model], false: Sequence[Model], informations: Sequence[Array]
) -> list[Target]:
    """Return the expected logarithm of the Bayes factor of each pair, the smaller one of both directions.

    It is half of what remains of their difference when all numbers of the false one are fitted to it.
    """
    factors: dict[tuple[int, int], float] = {}
    for b, (model, information) in enumerate(zip(false, informations, strict=True)):
        precision = stage.prior(model)
        for column, a in enumerate(k for k in range(len(models)) if k != b):
            pair = min(a, b), max(a, b)
            factor = against(information, precision, column).misfit / 2
            factors[pair] = min(factors.get(pair, np.inf), factor)
    names = [m[-1].id if m else "nothing" for m in models]
    if len(false) == 1:
        names[0] = "nothing"
    pairs = [p for p in combinations(range(len(models)), 2) if p in factors]
    return [Target(f"{names[b]} from {names[a]}", max(0.0, float(factors[a, b]))) for a, b in pairs]
