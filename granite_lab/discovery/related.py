"""Does a further effect only mend the formula of one that was found before?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from granite_lab.discovery.detect import confusion
from granite_lab.discovery.signature import Signatures
from granite_lab.logs.trial import Array
from granite_lab.model.effect import Effect

RELATED = 0.2
"""A further effect must explain at least this share of what it has in common with one that was found: the
formula of that one may be wrong by some tenths in just that. Relatives that only mended a formula brought
0.02 to 0.09; true further effects, even the weak one of the samples, more than 1."""


@dataclass
class Relatives:
    """What candidates have in common with the effects that were found.

    It is the evidence for the effect times the squared cosine between the signatures, as they were around
    the fit without the effect: around a fit with it the sand may stand at a corner, where its derivatives
    promise more than it can do.
    """

    _found: dict[str, tuple[float, tuple[str, ...], Array]] = field(default_factory=dict)

    def add(self, id_: str, evidence: float, signs: Signatures, candidates: Mapping[str, Effect]) -> None:
        """Note an effect with its evidence and the signatures of the round in which it was found."""
        self._found[id_] = evidence, *confusion(signs, candidates)

    def replace(self, old: tuple[str, ...], new: tuple[str, ...]) -> None:
        """Note that a rival has taken the place of an effect."""
        gone, come = (set(a) - set(b) for a, b in ((old, new), (new, old)))
        for before, after in zip(gone, come, strict=True):
            self._found[after] = self._found[before]

    def least(self, id_: str, chosen: tuple[str, ...]) -> float:
        """Return the evidence that a candidate must bring beside the chosen effects."""
        common = [0.0]
        for other in chosen:
            evidence, ids, cosines = self._found[other]
            if other in ids and id_ in ids:
                common.append(evidence * float(cosines[ids.index(other), ids.index(id_)]) ** 2)
        return RELATED * max(common)
