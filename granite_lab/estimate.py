"""A number with its standard deviation, the unit in which every stage passes results on."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Literal, NamedTuple


@dataclass(frozen=True)
class Estimate:
    """A value with its standard deviation, both in the unit its holder names.

    A value that could not be estimated is NaN; a std of NaN means that it is not known.
    """

    value: float
    std: float = math.nan

    def interval(self, factor: float = 1.959964) -> tuple[float, float]:
        """Return value -/+ factor * std, by default the 95 % interval of a normal law."""
        return self.value - factor * self.std, self.value + factor * self.std

    def as_json(self) -> dict[str, float]:
        """Return the record as it stands in every JSON output."""
        return {"value": self.value, "std": self.std}


Kind = Literal["A", "B"]
"""How an uncertainty was evaluated (JCGM 100, 4.2 and 4.3): from repeated observations, or by other means."""


@dataclass(frozen=True)
class Part:
    """One component of a standard uncertainty.

    Attributes:
        name: of the source, as a reader calls it.
        kind: type of its evaluation.
        distribution: that was assumed.
        unit: of `std`.
        std: standard uncertainty of the source.
        contribution: standard uncertainty of the result that it causes [the result's unit].
        common: whether it is the same error in all trials of a robot, such as that of the wheel radius.
    """

    name: str
    kind: Kind
    distribution: str
    unit: str
    std: float
    contribution: float
    common: bool = False

    @property
    def sensitivity(self) -> float:
        """Size of the sensitivity coefficient |c| [the result's unit over `unit`]."""
        return self.contribution / self.std if self.std > 0 else math.nan

    def times(self, factor: float) -> Part:
        """Return the part of a result that is `factor` times this one."""
        return replace(self, contribution=abs(factor) * self.contribution)


class Mean(NamedTuple):
    """A mean over repetitions with its standard error, its 95 % interval, and how many went in."""

    value: float
    std: float
    low: float
    high: float
    n: int


def weights_of(estimates: Sequence[Estimate], vague: float = math.inf) -> list[float]:
    """Return the weights of repetitions in their mean; they add up to 1.

    They are equal, unless the std of one is beyond `vague`: then they follow from the stated std and the
    scatter between the repetitions (DerSimonian & Laird, Control. Clin. Trials 7 (1986) 177-188).
    """
    n = len(estimates)
    if n < 2 or not any(e.std > vague for e in estimates):
        return [1.0 / n] * n if n else []
    least = min((e.std for e in estimates if e.std > 0), default=1.0)
    w = [1.0 / max(e.std, 1e-3 * least) ** 2 if e.std >= 0 else 0.0 for e in estimates]
    total = sum(w)
    mean = sum(a * e.value for a, e in zip(w, estimates, strict=True)) / total
    surplus = sum(a * (e.value - mean) ** 2 for a, e in zip(w, estimates, strict=True)) - (n - 1)
    scatter = max(surplus, 0.0) / max(total - sum(a**2 for a in w) / total, 1e-300)
    w = [1.0 / (1.0 / a + scatter) if a > 0 else 0.0 for a in w]
    return [a / sum(w) for a in w]


def in_common(weights: Sequence[float], parts: Sequence[Sequence[Part]]) -> float:
    """Return the variance of a weighted mean beyond that of independent errors, by the components of each.

    Errors that are common to all add up in the mean (JCGM 100, 5.2.2, correlation 1).
    """
    sums: dict[str, list[float]] = defaultdict(list)
    for weight, of_trial in zip(weights, parts, strict=True):
        for part in of_trial:
            if part.common:
                sums[part.name].append(weight * part.contribution)
    return math.fsum(sum(c) ** 2 - sum(x**2 for x in c) for c in sums.values())


def mean_over(
    estimates: Iterable[Estimate], vague: float = math.inf, parts: Sequence[Sequence[Part]] = ()
) -> Mean:
    """Average repetitions, with the wider of two 95 % intervals; weights are those of `weights_of`.

    One comes from the scatter between the repetitions (Student's t), the other from their stated
    standard deviations. The first includes the scatter of the sand, the second that of the
    sensors; with few repetitions either can be too small by chance. A mean does not reduce errors that all
    repetitions have in common, by the `parts` of each.
    """
    import numpy as np  # noqa: PLC0415, heavy
    from scipy.special import stdtrit  # noqa: PLC0415, heavy

    known = [(e, of_trial) for e, of_trial in zip_longest(estimates, parts) if math.isfinite(e.value)]
    finite = [e for e, _ in known]
    n = len(finite)
    if n == 0:
        return Mean(math.nan, math.nan, math.nan, math.nan, 0)
    values, w = np.array([e.value for e in finite]), np.array(weights_of(finite, vague))
    mean = float(w @ values)
    stds = np.where(w > 0, [e.std for e in finite], 0.0)
    stated = math.sqrt(float(np.sum((w * stds) ** 2)) + in_common(w.tolist(), [p or () for _, p in known]))
    scatter = float(np.sqrt(w @ (values - mean) ** 2 / (n - 1))) if n > 1 else math.nan
    half = float(np.fmax(1.959964 * stated, float(stdtrit(max(n - 1, 1), 0.975)) * scatter))
    return Mean(mean, float(np.fmax(stated, scatter)), mean - half, mean + half, n)
