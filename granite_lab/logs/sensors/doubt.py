"""What is wrong with a sensor, or may be: one record, from the reader to the grade of the estimate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

Grade = Literal["good", "fair", "poor"]


@dataclass(frozen=True)
class Doubt:
    """One thing that is wrong with a sensor or with what is estimated from it.

    Attributes:
        what: is seen, in plain words.
        where: file, column or sensor; "" where `what` says it.
        remedy: what was done about it, or what the user can do; "" for neither.
        grade: the best that an estimate can still be.
        std: of slip ratios, which covers what is seen [-]; 0 where the std need not grow.
        distance_std: is added to that of the distance after the instant `after` [s] [m].
        rolled_std: is added to that of the distance that the wheels rolled, as a share of it [-].
        dead: a channel that should measure holds no measurement.
    """

    what: str
    where: str = ""
    remedy: str = ""
    grade: Grade = "good"
    std: float = 0.0
    distance_std: float = 0.0
    after: float = math.inf
    rolled_std: float = 0.0
    dead: bool = False

    def __str__(self) -> str:
        seen = f"{self.where}: {self.what}" if self.where else self.what
        return f"{seen}; {self.remedy}" if self.remedy else seen

    def of(self, where: str) -> Doubt:
        """Return the same, of a place in which its own lies: a file, or a column of it."""
        return replace(self, where=f"{where}: {self.where}" if self.where else where)


def some_of(texts: Sequence[str], most: int) -> str:
    """List the first of some texts for a message, with an ellipsis where there are more."""
    return ", ".join(texts[:most]) + (", …" if len(texts) > most else "")
