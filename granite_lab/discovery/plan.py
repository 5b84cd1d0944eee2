"""`plan_next`: which trial would best answer what a discovery has left open.

Each proposed trial is simulated with every explanation. What one explanation cannot imitate of the
other, all nuisances and its own numbers refitted over the trials at hand and the new one, is the
chi2 by which the false one would lose; twice the log evidence, and with it the chance of a decision.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from granite_lab.discovery.bench import Bench
from granite_lab.discovery.plan_conditions import OnABlock, StagedWorld
from granite_lab.discovery.plan_design import Design, Driven
from granite_lab.discovery.plan_options import LEFT_OUT, Option, options
from granite_lab.discovery.plan_pieces import Piece, Rival, Table, difference, places, stand_in, together
from granite_lab.discovery.plan_question import Question, Suspect, ids_of
from granite_lab.discovery.plan_words import strongest
from granite_lab.discovery.rivals import MISMATCH, TWIN
from granite_lab.discovery.signature import strengths
from granite_lab.effects.library import library
from granite_lab.errors import EstimateError
from granite_lab.logs.trial import Array

JUST_MISSED = 0.5
"""Share of the threshold that a candidate has which was not shown, where its evidence was less."""


@dataclass(frozen=True)
class Outlook:
    """What a set of trials could decide.

    Attributes:
        chance: that the false explanation is ruled out, or that the effect is shown; mean over what
            may be true. NaN where a number is to be sharpened.
        evidence: expected chi2 by which the false explanation loses, whichever is the true one: the
            smallest of all pairs.
        std: of the named effect's strengths, by parameter, where they are to be sharpened.
    """

    chance: float
    evidence: float
    std: tuple[float, ...] = ()


@dataclass(frozen=True)
class Proposal:
    """A trial that could be driven, with what would be known after it.

    Attributes:
        option: the trial.
        after: what the trials at hand and this one could decide.
        channel, phase: where in the new trial the explanations part most; empty where they do not.
    """

    option: Option
    after: Outlook
    channel: str
    phase: str


@dataclass(frozen=True)
class Plan:
    """The proposals, the best first.

    Attributes:
        question: what is open.
        rivals: the explanations with their numbers.
        now: what the trials at hand can decide.
        proposals: ranked.
        left_out: what was not simulated, and why.
        runs: simulations that were needed.
    """

    question: Question
    rivals: tuple[Rival, ...]
    now: Outlook
    proposals: tuple[Proposal, ...]
    left_out: tuple[str, ...]
    runs: int


def plan_next(
    design: Design,
    question: Question,
    *,
    room: float | None = None,
    max_speed: float | None = None,
    jobs: int = 1,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> Plan:
    """Rank trials by how well they would answer the question.

    Args:
        design: the trials at hand.
        question: what is open.
        room: longest way the sand allows [m]; the longest so far by default.
        max_speed: fastest command [m/s].
        jobs: number of processes.
        progress: told how many trials are looked at, and of how many.

    Raises:
        EstimateError: the trials at hand cannot be simulated, or a rival cannot be fitted.
    """
    ids = ids_of((*question.suspects, *question.others))
    chosen = options(design, ids, room=room, max_speed=max_speed)
    n = len(design.driven)
    variants = (*(d.variant for d in design.driven), *(o.variant for o in chosen))
    under = (*(d.conditions for d in design.driven), *(o.conditions for o in chosen))
    effects = library() | {s.effect.id: s.effect for s in (*question.suspects, *question.others)}
    world = StagedWorld(
        design.robot, design.soil, variants, effects | {OnABlock.id: OnABlock()}, conditions=under
    )
    driven = list(enumerate(design.driven))
    with Bench(world, jobs) as bench:
        others = [Rival(s.effect, s.values) for s in question.others]
        table = Table(design, bench, others)
        rivals = explanations(table, driven, question)
        pieces = [p for k, d in driven for p in [table.piece(k, d, rivals)] * d.count]
        now, _ = outlook(question, rivals, pieces)
        proposals, failed = [], 0
        for k, option in enumerate(chosen):
            progress(k, len(chosen))
            same = next((j for j, d in driven if option.repeats and d is option.like), n + k)
            try:
                new = table.piece(same, option.like, rivals)
            except EstimateError:
                failed += 1
                continue
            after, apart = outlook(question, rivals, [*pieces, new])
            rows = dict(zip(new.model.channels, np.split(apart, len(new.model.channels)), strict=True))
            channel, phase, energy = strongest(new.model.observation, rows)
            known = energy > 1e-3
            proposals.append(Proposal(option, after, channel if known else "", phase if known else ""))
        progress(len(chosen), len(chosen))
        runs = bench.runs
    left_out: tuple[str, ...] = LEFT_OUT
    if failed:
        left_out = (*left_out, f"{failed} commands at which the simulated robot digs itself in")
    ranked = tuple(sorted(proposals, key=_rank))
    return Plan(question, rivals, now, ranked, left_out, runs)


def _rank(proposal: Proposal) -> tuple[float, float, bool]:
    after = proposal.after
    chance = 0.0 if np.isnan(after.chance) else round(after.chance, 2)
    return -chance, sum(after.std) if after.std else -after.evidence, not proposal.option.repeats


def explanations(table: Table, driven: list[tuple[int, Driven]], question: Question) -> tuple[Rival, ...]:
    """Return the rivals with the numbers at which each explains the trials at hand.

    Raises:
        EstimateError: none can be fitted.
    """
    first = question.suspects[0]
    if question.kind == "sharpen":
        return (Rival(first.effect, first.values),)
    if first.values:
        named = Rival(first.effect, first.values)
        fitted = [stand_in(table, driven, named, s.effect) for s in question.suspects[1:]]
        found = [named, *(r for r in fitted if r is not None)]
    else:
        least = JUST_MISSED * question.threshold if question.kind == "show" else question.threshold
        sized = [_sized(table, driven, s, max(s.evidence, least)) for s in question.suspects]
        found = [r for r in sized if r is not None]
        if question.kind == "show":
            found.insert(0, Rival(None))
    if len(found) < 2:
        raise EstimateError("no rival explanation can be simulated on these trials", "check the effects")
    return tuple(found)


def _sized(table: Table, driven: list[tuple[int, Driven]], suspect: Suspect, aim: float) -> Rival | None:
    """Return the candidate at the size at which the trials at hand would show so much evidence."""
    effect = suspect.effect
    k = strengths(effect)[0]
    p = effect.parameters[k]
    size = 0.3 * (p.prior_high - p.neutral)
    for _ in range(3):
        values = tuple(p.neutral + size if j == k else q.neutral for j, q in enumerate(effect.parameters))
        rival = Rival(effect, values)
        try:
            pieces = [x for i, d in driven for x in [table.piece(i, d, (rival,))] * d.count]
        except EstimateError:
            return None
        shown = together(pieces).gram[0, 0]
        if shown <= 0:
            return None
        low, high = p.low - p.neutral, p.high - p.neutral
        size = float(np.clip(size * np.clip(np.sqrt(aim / shown), 0.05, 20), low, high))
    return rival


def outlook(question: Question, rivals: tuple[Rival, ...], pieces: list[Piece]) -> tuple[Outlook, Array]:
    """Return what trials could decide, and the (m,) whitened signal by which the last of them does."""
    through = together(pieces)
    gram, last = through.gram, through.left[-1]
    n = gram.shape[0]
    if question.kind == "sharpen":
        own = places(rivals)[0][1]
        scale = 1 / np.sqrt(np.fmax(np.diag(gram)[own], 1e-300))
        inverse = np.linalg.pinv(gram[np.ix_(own, own)] * np.outer(scale, scale), rcond=1e-9, hermitian=True)
        std = scale * np.sqrt(np.fmax(np.diag(inverse), 0))
        effect = rivals[0].effect
        assert effect is not None
        kept = strengths(effect)
        signal = last[:, own[kept[0]]] * std[kept[0]]
        return Outlook(float("nan"), 0.0, tuple(float(std[k]) for k in kept)), signal
    if question.kind == "show":
        pairs = [(k, 0) for k in range(1, len(rivals))]
    else:
        pairs = [(a, b) for a in range(len(rivals)) for b in range(len(rivals)) if a != b]
    chances, least, signal = [], np.inf, np.zeros(last.shape[0])
    for true, false in pairs:
        loss, amounts = difference(n, rivals, gram, true, false)
        if question.kind == "show":
            chances.append(float(ndtr(np.sqrt(loss) - np.sqrt(question.threshold))))
        else:
            here = places(rivals)[true][0]
            need = TWIN + MISMATCH * float(gram[here, here])
            chances.append(decided(loss, need))
        if loss < least:
            least, signal = loss, last @ amounts
    return Outlook(float(np.mean(chances)), float(least)), signal


def decided(loss: float, need: float) -> float:
    """Return the chance that a false explanation loses by more than `need`.

    Args:
        loss: the chi2 by which it loses without noise; with noise that is normal with four times
            this variance.
        need: what must be exceeded.
    """
    return float(ndtr(-(need - loss) / (2 * np.sqrt(loss)))) if loss > 0 else 0.0
