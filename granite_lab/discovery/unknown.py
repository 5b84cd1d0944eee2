"""Is what is left noise? If not, abstain and say what the missing quantity looks like."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from granite_lab.discovery.baseline import noise_energy, pure_error
from granite_lab.discovery.empirical import EmpiricalLaw, amounts, sparse
from granite_lab.discovery.finding import Unrepeated, Verdict
from granite_lab.discovery.lackfit import largest_score, null_threshold
from granite_lab.discovery.point import Fit
from granite_lab.discovery.problem import Problem
from granite_lab.discovery.refit import misfit, refit, with_effect
from granite_lab.discovery.select import Choice, settle
from granite_lab.discovery.signature import is_own, signatures
from granite_lab.discovery.unrepeated import unrepeated

MARGIN = 0.5
LEAST = 6.0
"""The threshold of the map is at least `LEAST`, and `MARGIN` above the bootstrap's, whose tail is a guess."""

CLOSED = 0.9
"""A named effect whose fit leaves more than noise stays named if it closes this share of the misfit: its
formula may differ from nature's."""

HALF, PLAIN = 0.5, 0.05
"""What is named must close this share of the misfit where more than `PLAIN` of the noise's energy is left:
repetitions that differ from one another raise the threshold of the map, and it no longer tells."""

TERM = 0.03
"""Share of the misfit that a term of the empirical law must explain."""


@dataclass(frozen=True, eq=False)
class Judgement:
    """The verdict and what it rests on.

    Attributes:
        verdict: as in a Finding.
        fit: the final fit: with the named effects, with the empirical law, or without any.
        threshold: of the map.
        score_before, score_after: largest score without effects and with the named ones.
        closed: share of the misfit that the named effects close; NaN without any.
        unrepeated: what repetitions do not share and several sensors see, with the named effects.
        law: drop of chi2 by the empirical law.
    """

    verdict: Verdict
    fit: Fit
    threshold: float
    score_before: float
    score_after: float
    closed: float
    unrepeated: Unrepeated
    law: float = 0.0


def judge(
    problem: Problem, base: Fit, choice: Choice, evidence: float, rng: np.random.Generator, level: float
) -> Judgement:
    """Decide between none, named and unknown.

    Args:
        problem: the trials, with the noise as it was learnt last.
        base: the fit without effects.
        choice: the named effects.
        evidence: that a term of the empirical law must bring at least.
        rng: of the bootstrap.
        level: probability of a false alarm on the map.
    """
    error = pure_error(problem, choice.fit.white)
    threshold = max(LEAST, null_threshold(problem, error, rng, level=level) + MARGIN)
    before = largest_score(problem, problem.white(base.residuals))
    after = largest_score(problem, choice.fit.white)
    noise = noise_energy(problem, choice.fit.white)
    first, last = (misfit(problem.white(f.residuals), noise) for f in (base, choice.fit))
    closed = 1 - last / first if choice.effects and first > 0 else float("nan")
    poor = bool(choice.effects) and closed < HALF and last > PLAIN * noise
    apart = unrepeated(problem, error)
    calm = after <= threshold and not poor
    # the rest of an effect that differs from trial to trial does so, too, where its formula is not nature's
    own = closed >= CLOSED and any(is_own(problem.effect(id_)) for id_ in choice.effects)
    if (own or not apart.plain) and (calm or (choice.effects and closed >= CLOSED)):
        verdict: Verdict = "named" if choice.effects else "none"
        return Judgement(verdict, choice.fit, threshold, before, after, closed, apart)
    # where all that repeats is explained there is nothing to learn a law from
    law = None if calm and not choice.effects else empirical_law(problem, base, max(evidence, TERM * first))
    fit = law if law is not None else base
    return Judgement("unknown", fit, threshold, before, after, closed, apart, base.chi2 - fit.chi2)


def empirical_law(problem: Problem, base: Fit, least: float) -> Fit | None:
    """Fit a sparse law of the missing force, moment and torque; None where no term helps.

    Args:
        problem: the trials.
        base: the fit without effects.
        least: drop of chi2 that each term must bring.
    """
    law = problem.effect(EmpiricalLaw.id)
    problem.free.pop(law.id, None)
    signs = signatures(problem, base, {law.id: law}, small=True)
    b = signs.products(base, problem.centres(base.point), problem.bounds(base.point)[0])
    chosen, _ = sparse(signs.gram, b, least)
    if not chosen:
        return None
    values = [p.neutral for p in law.parameters]
    for amount, k in zip(amounts(signs.gram, b, chosen), chosen, strict=True):
        probe, p = signs.probes[k], law.parameters[signs.probes[k].parameter]
        values[probe.parameter] = float(np.clip(amount * probe.size, p.low, p.high))
    problem.free[law.id] = tuple(sorted(signs.probes[k].parameter for k in chosen))
    found = refit(problem, [with_effect(problem, base.point, law.id, values)], near=base.slopes)
    return settle(problem, found) if found is not None and found.chi2 < base.chi2 - least else None
