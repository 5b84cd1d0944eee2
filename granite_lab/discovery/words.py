"""The verdict and its limits in plain words."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from granite_lab.discovery.finding import SIMULATES_WORSE, UNCONVERGED, EffectFinding, GroundWave, Verdict
from granite_lab.discovery.heldout import speeds
from granite_lab.discovery.verdict import Judgement
from granite_lab.inference.constants import FEWEST_SPEEDS, LEAST_SHARE
from granite_lab.inference.problem import SECONDS, Problem
from granite_lab.parameters import is_driven
from granite_lab.rounding import chance, percent, percent_of, plus_minus


def provisional(problem: Problem) -> tuple[str, ...]:
    """Return why a verdict on these trials is provisional."""
    reasons = []
    driven = len(speeds(problem))
    if max(len(repetitions) for repetitions in problem.commands) < 2:
        reasons.append("no command was repeated, so noise and discrepancy cannot be separated")
    if driven < FEWEST_SPEEDS:
        reasons.append(f"{driven} of at least {FEWEST_SPEEDS} speeds driven")
    return tuple(reasons)


def sentence(
    verdict: Verdict,
    effects: Sequence[EffectFinding],
    description: Sequence[EffectFinding],
    judgement: Judgement,
    reasons: Sequence[str],
    tolerance: float,
) -> str:
    """Say the verdict in one to four sentences."""
    head = f"Provisional ({'; '.join(reasons)}): " if reasons else ""
    if verdict == "none":
        text = f"the model explains the trials within the tolerance of {percent(tolerance)} and the noise."
    elif effects:
        join = ", and " if any(e.twins for e in effects) else " and "
        text = f"missing from the model: {join.join(_name(e) for e in effects)}."
        if verdict == "partly named" and judgement.ground_wave is None:
            text += " More is missing that no candidate explains."
    elif judgement.ground_wave and not description:
        text = "something is missing from the model that changes from trial to trial."
    elif judgement.scatter and not description:
        text = f"something is missing from the model that changes from trial to trial. {differing(judgement)}"
    elif description:
        text = "something is missing from the model. No candidate explains it for certain."
    else:
        text = "something is missing from the model. No candidate explains it, no term describes it."
    likely = [e for e in description if e.is_likely]
    if likely and verdict != "none":
        text += (
            f" Likely, but not sure: {', '.join(f'{_name(e)} ({chance(e.probability)})' for e in likely)}."
        )
    if (rest := [e for e in description if e not in likely]) and verdict != "none":
        terms = ", ".join(e.title if e.empirical else e.id for e in rest)
        text += f" A description without a cause: {terms}."
    if judgement.ground_wave:
        text += f" {waving(judgement.ground_wave)}"
    if verdict != "none" and (effects or description) and (shrinks := _shrinks(judgement)):
        text += f" {shrinks}"
    return head + (text if head else text[0].upper() + text[1:])


def differing(judgement: Judgement) -> str:
    """Say by how much repetitions differ, and in which channel most."""
    channel, share = max(judgement.scatter.items(), key=lambda item: item[1])
    return (
        f"Repetitions of a command differ in {channel} by {percent(share)} of its rms in motion, "
        "which noise, sand and gains do not explain."
    )


def waving(wave: GroundWave) -> str:
    """Say how long the waves of the ground are, and how they show."""
    length, by = plus_minus(wave.wavelength, "mm", 1e3), "the position of the robot"
    if math.isfinite(wave.order):
        by += f", or {wave.order:.2g} times a turn of the wheels,"
    return (
        f"The ground has waves of {length}: {wave.channel} repeats with {by} at all speeds, by "
        f"{percent(wave.share)} of its rms in motion and in another phase in each trial."
    )


def _shrinks(judgement: Judgement) -> str:
    left = judgement.remainder
    if not np.isfinite(left):
        return ""
    predicted = np.isfinite(judgement.before.left_out).any()
    where = "On trials that were left out" if predicted else "No trial could be left out; in the fit itself"
    text = f"{where} {percent(1 - left)} of the gap is closed"
    return text + ("." if left < LEAST_SHARE else f"; {percent(left)} is not explained.")


def _name(effect: EffectFinding) -> str:
    if effect.twins:
        names = " or ".join([effect.id, *effect.twins])
        return f"{names} (these trials cannot tell them apart)"
    return effect.id


def notes(problem: Problem, judgement: Judgement, effects: Sequence[EffectFinding]) -> tuple[str, ...]:
    """List what could not be told and why."""
    return (
        *_notes_on_trials(problem),
        *_notes_on_model(problem, judgement, effects),
        *_notes_on_sizes(judgement, effects),
    )


def _notes_on_trials(problem: Problem) -> Iterator[str]:
    """Yield what the trials cannot show: too few speeds, sensors that were not logged."""
    if len(problem.commands) == 1:
        yield (
            "At one speed, effects that differ in how they grow with speed cannot be told apart, nor from "
            "sand that differs from its file."
        )
    channels = {c for t in problem.trials for c in t.channels}
    by_wheels = any(is_driven(t.observation.variant) for t in problem.trials)
    for kind, name, lost in (
        ("current", "currents", "friction, efficiency and torque constant of the drives"),
        ("accel", "accelerations", "the motion of the body"),
        ("wheel", "wheel angles", "the motion of the wheels"),
    ):
        if not any(c.startswith(kind) for c in channels) and not (kind == "wheel" and by_wheels):
            yield f"No {name} were logged, so {lost} cannot be seen."


def _notes_on_model(
    problem: Problem, judgement: Judgement, effects: Sequence[EffectFinding]
) -> Iterator[str]:
    """Yield what the likeliest model leaves open: weak candidates, another law, scatter, no optimum."""
    if problem.is_exhausted:
        minutes = SECONDS * len(problem.trials) / 60
        yield (
            f"The simulations took {minutes:.0f} minutes of processor time, after which nothing further is "
            "tried: other sets of effects may be as likely, and what is left is not described."
        )
    if judgement.verdict == "unknown" and judgement.small:
        best = ", ".join(n.id for n in judgement.small)
        yield f"The likeliest candidates ({best}) do not explain enough to be named."
    if lacks := [n.id for n in judgement.described if n.id not in judgement.model.effects]:
        yield f"The saved model is without {' and '.join(lacks)}, and predicts other trials better so."
    if judgement.masked:
        yield (
            f"Gains of the sensors, alike in all trials, mask {' and '.join(judgement.masked)}. The saved "
            "model holds it, for a simulation has no gains; its share of the gap is what simulations close."
        )
    library = problem.pool.scenario.effects
    if laws := [e.id for e in effects if e.id in library and library[e.id].law]:
        yield f"The soil follows another law than the model's: {' and '.join(laws)}."
    if judgement.scatter:
        yield differing(judgement)
    if judgement.simulates_worse:
        yield (
            f"{SIMULATES_WORSE} by the files. Numbers that each trial has of its own close the gap of the "
            "fit; they may stand in for something that is missing."
        )
    if not (fit := judgement.model.fit).converged:
        yield (
            f"{UNCONVERGED}: its derivatives predict an optimum {np.sqrt(fit.predicted_drop):.1f} std away, "
            "which no step reached. The standard errors include this distance."
        )


def _notes_on_sizes(judgement: Judgement, effects: Sequence[EffectFinding]) -> Iterator[str]:
    """Yield which effects close little of the gap, and which numbers differ from trial to trial."""
    for n in judgement.named:
        if n.closes.value < LEAST_SHARE:
            yield (
                f"{n.id} closes {percent_of(n.closes)} of the whole gap; of the change of "
                f"{n.channel[0]} by all effects, it makes {percent(n.channel[1])}."
            )
    for e in effects:
        per_trial = (p for p in e.parameters if p.per_trial and np.isfinite(p.estimate.value))
        if (p := next(per_trial, None)) is not None:
            yield f"{e.id}: {p.name} differs from trial to trial; its root mean square is given."
