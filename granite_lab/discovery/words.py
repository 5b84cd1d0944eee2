"""The verdict and its limits in plain words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from granite_lab.discovery.finding import CHANCE, FoundEffect, Gap
from granite_lab.discovery.problem import Problem
from granite_lab.discovery.select import Choice
from granite_lab.discovery.unknown import Judgement


def sentence(judgement: Judgement, effects: Sequence[FoundEffect], gap: Gap) -> str:
    """Say the verdict in one or two sentences."""
    before, after, floor = gap.held_out
    shrinks = (
        f"On trials that were left out the gap falls from {before:.2f} to {after:.2f}; noise is {floor:.2f}."
    )
    if judgement.verdict == "none":
        return "The model explains the trials within their noise and the scatter of the sand."
    if judgement.verdict == "named":
        return f"Missing from the model: {' and '.join(_name(e) for e in effects)}. {shrinks}"
    if effects:
        terms = ", ".join(p.name.replace("_", " ") for e in effects for p in e.parameters)
        return (
            "Something is missing that no candidate explains; an empirical law stands in for it "
            f"({terms}). {shrinks}"
        )
    if judgement.unrepeated.plain:
        return (
            "Something acts on the robot that is not the same in each trial; the model does not know of it."
        )
    return "Something is missing that neither a candidate nor an empirical law explains."


def _name(effect: FoundEffect) -> str:
    if effect.twins:
        return f"{effect.id}, or what these trials cannot tell from it ({', '.join(effect.twins)})"
    return effect.id


def notes(
    problem: Problem, judgement: Judgement, choice: Choice, effects: Sequence[FoundEffect]
) -> tuple[str, ...]:
    """List what could not be told and why."""
    found = []
    counts = [sum(t.variant == v for t in problem.trials) for v in problem.variants]
    if len(problem.trials) == 1:
        found.append(
            "One trial only: nothing was held out, and below 4 Hz noise cannot be told from what is missing."
        )
    elif max(counts) == 1:
        found.append("No command was driven twice: its slow noise was taken to be as loud as the fast.")
    if len(problem.variants) == 1:
        found.append(
            "One speed only: effects that differ in how they grow with speed cannot be told apart, nor "
            "from sand off the file."
        )
    channels = {c for t in problem.trials for c in t.channels}
    for kind, lost in (
        ("current", "friction, efficiency and torque constant of the drives cannot be seen"),
        ("accel", "the motion of the body cannot be seen"),
        ("wheel", "the motion of the wheels cannot be seen"),
    ):
        if not any(c.startswith(kind) for c in channels):
            found.append(f"No {kind} was logged: {lost}.")
    if judgement.verdict == "named" and judgement.score_after > judgement.threshold:
        found.append(
            f"The named effects close {100 * judgement.closed:.0f} % of the misfit, but what is left is "
            "more than noise: the formula may differ from nature's, or something small is missing besides."
        )
    if judgement.verdict == "unknown" and choice.effects:
        found.append(
            f"The best candidates ({', '.join(choice.effects)}) close {100 * judgement.closed:.0f} % of "
            "the misfit and are not named."
        )
    apart = judgement.unrepeated
    if apart.plain:
        found.append(
            "Something acts on the robot that is not the same each time, such as a gust, a strap, or a part "
            "whose phase differs from trial to trial: in what the repetitions of a command do not share, "
            f"{apart.first} and {apart.second} go together between {apart.low:g} and {apart.high:g} Hz "
            f"({apart.score:.0f} standard deviations, by chance at most {CHANCE:g})."
        )
    for t in choice.rounds[0] if choice.rounds else ():
        if t.status == "at a bound":
            found.append(f"{t.effect} was not evaluated: its fit ended at a bound ({', '.join(t.bounds)}).")
        elif t.status == "uneven":
            found.append(
                f"{t.effect} was not named: it would need another size in each trial, not only another phase."
            )
        elif t.status == "not converged":
            found.append(f"{t.effect} was not evaluated: with it the simulation or the fit fails here.")
    related = [t for t in choice.rounds[-1] if t.status == "related"] if choice.rounds else []
    if judgement.verdict == "named" and related:
        found.append(
            f"{' or '.join(t.effect for t in related)} would explain a little of what is left (evidence "
            f"{max(t.evidence for t in related):.0f}), but so would a fault in the formula of "
            f"{' or '.join(choice.effects)}, whose traces are alike: not named."
        )
    for e in effects:
        for p in e.parameters:
            if p.per_trial and np.isfinite(p.estimate.value):
                found.append(f"{e.id}: {p.name} differs from trial to trial; its root mean square is given.")
                break
    return tuple(found)
