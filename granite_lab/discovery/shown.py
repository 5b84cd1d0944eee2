"""What a set of trials could show: the smallest sizes, and what would be taken for what."""

from __future__ import annotations

from dataclasses import dataclass

from granite_lab.logs.trial import Array


@dataclass(frozen=True)
class Detectable:
    """The smallest size of an effect that these trials can show.

    Attributes:
        effect, parameter, unit: which.
        size: strength that is found with a probability of 80 % [unit]; NaN where these trials cannot.
        confused_with: candidates whose signature is more than 95 % the same once the nuisances are refitted.
    """

    effect: str
    parameter: str
    unit: str
    size: float
    confused_with: tuple[str, ...]


@dataclass(frozen=True)
class Played:
    """A size that was put into the trials.

    Attributes:
        effect, parameter, unit: which.
        detectable: smallest size that these trials show [unit]; NaN where they cannot.
        size: that was put in, as a distance from the neutral value [unit]; NaN where none could.
    """

    effect: str
    parameter: str
    unit: str
    detectable: float
    size: float


@dataclass(frozen=True, eq=False)
class Confusion:
    """What would come out of these trials if one candidate were in them.

    Attributes:
        ids: the candidates, in the rows and columns of `matrix`.
        matrix: (k, k) share of the sets with the row's candidate in which the column's comes first;
            NaN in the row of one that these trials cannot show.
        missed: (k,) share in which nothing is named; with the row of `matrix` it sums to one.
        kept: (k,) share in which the right one is named, alone or in a set that cannot be told apart.
        alone: (k,) share in which it is named alone.
        played: the sizes that were put in.
        factor: times the smallest detectable size, where no other size was asked for.
        draws: sets a row.
    """

    ids: tuple[str, ...]
    matrix: Array
    missed: Array
    kept: Array
    alone: Array
    played: tuple[Played, ...]
    factor: float
    draws: int

    def taken_for(self, id_: str, share: float = 0.05) -> tuple[tuple[str, float], ...]:
        """Return the wrong candidates that come first in more than `share` of the sets, likeliest first."""
        row = self.matrix[self.ids.index(id_)]
        wrong = [(o, float(x)) for o, x in zip(self.ids, row, strict=True) if o != id_ and x > share]
        return tuple(sorted(wrong, key=lambda item: -item[1]))
