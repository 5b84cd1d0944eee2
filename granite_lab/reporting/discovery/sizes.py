"""Sizes of effects: what was found, what is expected, and the smallest that the trials show."""

from __future__ import annotations

import math
from collections.abc import Mapping

from granite_lab.discovery.finding import Finding, FoundEffect, FoundParameter
from granite_lab.model.effect import Effect, EffectParameter

LIKELY = 1.96
"""Standard deviations on either side of a value that make its 95 % interval."""


def reach(p: EffectParameter) -> float:
    """Return how far from its neutral value a strength may be expected to be, or a shape from zero."""
    start = 0.0 if p.shape else p.neutral
    return max((p.prior_high - start, p.prior_low - start), key=abs) or 1.0


def shares(finding: Finding, known: Mapping[str, Effect]) -> dict[str, tuple[float, float]]:
    """Return per candidate the least and the largest of its smallest sizes, of what is expected [%].

    Infinite where these trials cannot show the effect.

    Args:
        finding: the record.
        known: candidates by id; one that is not there is left out.
    """
    declared = {id_: {p.name: p for p in e.parameters} for id_, e in known.items()}
    found: dict[str, tuple[float, float]] = {}
    for d in finding.detectable:
        p = declared.get(d.effect, {}).get(d.parameter)
        if p is None or p.shape:
            continue
        share = 100 * d.size / abs(reach(p)) if math.isfinite(d.size) else math.inf
        low, high = found.get(d.effect, (math.inf, 0.0))
        found[d.effect] = min(low, share), max(high, share)
    return found


def multiple(finding: Finding, effect: FoundEffect, parameter: FoundParameter) -> float:
    """Return a found size over the smallest that these trials show; NaN where that is not known."""
    sizes = {(d.effect, d.parameter): d.size for d in finding.detectable}
    smallest = sizes.get((effect.id, parameter.name), math.nan)
    declared = {p.name: p for a in finding.active if a.effect.id == effect.id for p in a.effect.parameters}
    neutral = declared[parameter.name].neutral if parameter.name in declared else 0.0
    away = abs(parameter.estimate.value - neutral)
    return away / smallest if math.isfinite(smallest) and smallest > 0 else math.nan


def untried(finding: Finding) -> list[str]:
    """Return the candidates that the search could not simulate, so that it says nothing of them."""
    tried = {c.id for found in finding.rounds for c in found}
    named = {e.id for e in finding.effects}
    return [i for i in dict.fromkeys(d.effect for d in finding.detectable) if i not in tried | named]


def unseen(finding: Finding, effect_id: str) -> str:
    """Say why a candidate has no smallest size."""
    return "could not be tried" if effect_id in untried(finding) else "cannot be seen"


def picked(finding: Finding, number: int) -> str | None:
    """Return the candidate that a round of the search put into the model: the next no longer tries it."""
    if number + 1 >= len(finding.rounds):
        return None
    later = {c.id for c in finding.rounds[number + 1]}
    gone = [c for c in finding.rounds[number] if c.id not in later]
    return max(gone, key=lambda c: c.evidence).id if gone else None
