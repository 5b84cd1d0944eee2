"""A number with its standard deviation, the unit in which every stage passes results on."""

from __future__ import annotations

import math
from dataclasses import dataclass


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
