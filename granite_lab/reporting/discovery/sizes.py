"""Sizes of effects: what was found, what is expected, and the smallest that the trials show."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from granite_lab.discovery.finding import Finding, FoundEffect, FoundParameter
from granite_lab.model.effect import Effect, EffectParameter

LIKELY = 1.96
"""Standard deviations on either side of a value that make its 95 % interval."""


@dataclass(frozen=True)
class Share:
    """Smallest sizes of a candidate, as shares of the largest that is expected [%].

    Attributes:
        low, high: over its strengths; infinite where these trials cannot show it.
        limit: what sets the least of them, "noise" or "tolerance".
    """

    low: float
    high: float
    limit: str


def reach(p: EffectParameter) -> float:
    """Return how far from its neutral value a strength may be expected to be, or a shape from zero."""
    start = 0.0 if p.shape else p.neutral
    return max((p.prior_high - start, p.prior_low - start), key=abs) or 1.0


def shares(finding: Finding, known: Mapping[str, Effect]) -> dict[str, Share]:
    """Return per candidate its smallest sizes; one that is not in `known` is left out."""
    declared = {id_: {p.name: p for p in e.parameters} for id_, e in known.items()}
    found: dict[str, Share] = {}
    for d in finding.detectable:
        p = declared.get(d.effect, {}).get(d.parameter)
        if p is None or p.shape:
            continue
        share = 100 * d.size / abs(reach(p)) if math.isfinite(d.size) else math.inf
        old = found.get(d.effect, Share(math.inf, 0.0, d.limit))
        limit = d.limit if share < old.low else old.limit
        found[d.effect] = Share(min(old.low, share), max(old.high, share), limit)
    return found


def multiple(finding: Finding, effect: FoundEffect, parameter: FoundParameter) -> float:
    """Return a found size over the smallest that these trials show; NaN where that is not known."""
    sizes = {(d.effect, d.parameter): d.size for d in finding.detectable}
    smallest = sizes.get((effect.id, parameter.name), math.nan)
    declared = {p.name: p for a in finding.active if a.effect.id == effect.id for p in a.effect.parameters}
    neutral = declared[parameter.name].neutral if parameter.name in declared else 0.0
    away = abs(parameter.estimate.value - neutral)
    return away / smallest if math.isfinite(smallest) and smallest > 0 else math.nan
