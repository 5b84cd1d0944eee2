"""Uncertainty budgets in the manner of GUM, of means over trials and of a_θ.

Every trial brings the components of its own std (`Motion.slip_parts`, `K92Fit.parts`). They are independent
between trials, so that the variance of a weighted sum is the sum of the weighted variances (JCGM 100:2008,
5.1.2); what scatters between trials beyond them is a component of type A. What the stated std does not hold
is not added here: `LEFT_OUT` names it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from granite_lab.estimate import Estimate, Part
from granite_lab.fitting.fit import AThetaFit, K92Fit

SCATTER = "scatter between trials beyond these"

SMALL = 0.002
"""Components with a smaller share of the variance are listed as one."""

_SHARED = (
    "Not part of the stated std: errors that all trials share, of the wheel radius, of the robot's file and "
    "of the soil's file; and effects that the model lacks."
)

LEFT_OUT: Mapping[str, str] = {
    "slip": "Not part of the stated std: an error of the wheel radius in the robot's file, which all trials "
    "share. 1 % of the radius moves λ_R by nearly 1 point.",
    "k92": _SHARED,
    "a_theta": _SHARED,
}


@dataclass(frozen=True)
class Budget:
    """What the standard uncertainty of a result is made of.

    Attributes:
        speed: of the trials [m/s]; NaN for a_θ.
        result: with the std that is stated everywhere else.
        parts: components, largest first.
    """

    speed: float
    result: Estimate
    parts: tuple[Part, ...]

    @property
    def combined(self) -> float:
        """Combined standard uncertainty by the components."""
        return math.hypot(*(part.contribution for part in self.parts))

    def share(self, part: Part) -> float:
        """Return the share of a component in the combined variance."""
        return (part.contribution / self.combined) ** 2 if self.combined > 0 else math.nan


def of_mean(speed: float, mean: Estimate, trials: Sequence[Sequence[Part]]) -> Budget | None:
    """Return the budget of a mean over trials; None where a trial has no components.

    Args:
        speed: of the trials [m/s].
        mean: over the trials, with the std that is stated: by the trials' own or by their scatter.
        trials: components of each trial.
    """
    if not trials or not all(trials) or not math.isfinite(mean.std):
        return None
    n = len(trials)
    parts = _pooled([(1 / n, own) for own in trials])
    beyond = mean.std**2 - sum(part.contribution**2 for part in parts)
    if beyond > 1e-6 * mean.std**2:
        one = math.sqrt(beyond * n)
        parts.append(Part(SCATTER, "A", f"Student, {n - 1} d.o.f.", "1", one, math.sqrt(beyond)))
    return Budget(speed, mean, _ranked(parts))


def of_a_theta(fit: AThetaFit, fits: Sequence[K92Fit]) -> Budget | None:
    """Return the budget of a_θ; None where it was not fitted to the k_92 of these trials.

    Args:
        fit: of a_θ, to the k_92 by slip.
        fits: of the trials, in the order in which they went into it.
    """
    weighed = [(c, own) for c, own in zip(fit.sensitivity, fits, strict=False) if c]
    if len(fit.sensitivity) != len(fits) or not all(own.parts for _, own in weighed):
        return None
    parts = [*_pooled([(c, own.parts) for c, own in weighed]), *fit.parts]
    return Budget(math.nan, fit.a_theta, _ranked(parts))


def _pooled(trials: Sequence[tuple[float, Sequence[Part]]]) -> list[Part]:
    """Return the components of a weighted sum over trials: each source once, its std as rms over trials."""
    by_name: dict[str, list[tuple[float, Part]]] = {}
    for weight, parts in trials:
        for part in parts:
            by_name.setdefault(part.name, []).append((weight, part))
    pooled = []
    for name, found in by_name.items():
        first = found[0][1]
        std = math.sqrt(sum(part.std**2 for _, part in found) / len(found))
        whole = math.hypot(*(weight * part.contribution for weight, part in found))
        pooled.append(Part(name, first.kind, first.distribution, first.unit, std, whole))
    return pooled


def _ranked(parts: Sequence[Part]) -> tuple[Part, ...]:
    """Return the components largest first, the smallest ones merged into one."""
    whole = sum(part.contribution**2 for part in parts)
    small = [part for part in parts if part.contribution**2 < SMALL * whole]
    ranked = sorted((part for part in parts if part not in small), key=lambda part: -part.contribution)
    if small:
        rest = math.hypot(*(part.contribution for part in small))
        ranked.append(Part(f"{len(small)} smaller components", "B", "normal", "", math.nan, rest))
    return tuple(ranked)
