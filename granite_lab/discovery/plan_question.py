"""What a discovery has left open: which explanations it could not tell apart, which it could not show."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from granite_lab.discovery.finding import Verdict
from granite_lab.effects.library import get
from granite_lab.errors import InputError
from granite_lab.model.effect import Effect

MOST = 3
"""Candidates that are looked at where none was named."""

Kind = Literal["apart", "show", "sharpen"]


@dataclass(frozen=True)
class Suspect:
    """A candidate as the discovery left it.

    Attributes:
        effect: the candidate.
        values: as fitted; empty where only its evidence is known.
        evidence: drop of chi2 that it brought.
    """

    effect: Effect
    values: tuple[float, ...]
    evidence: float


@dataclass(frozen=True)
class Question:
    """What the next trial should answer.

    Attributes:
        kind: tell the suspects "apart", "show" each against nothing at all, or "sharpen" the numbers
            of the only one.
        suspects: the explanations; the first is the one that was named, where one was.
        others: named effects that are not in question.
        threshold: evidence that names an effect.
    """

    kind: Kind
    suspects: tuple[Suspect, ...]
    others: tuple[Suspect, ...]
    threshold: float

    @property
    def words(self) -> str:
        """The question for people."""
        names = [s.effect.id for s in self.suspects]
        if self.kind == "apart":
            return f"What would tell {', '.join(names[:-1])} from {names[-1]}?"
        if self.kind == "show":
            return f"What would show {' or '.join(names)}, if it is there?"
        return f"What would sharpen the numbers of {names[0]}?"


def question(document: Mapping[str, Any], known: Mapping[str, Effect], where: str) -> Question:
    """Read from a finding's document what is open.

    Args:
        document: as `finding_as_json` makes it.
        known: candidates by id.
        where: the file, for messages.

    Raises:
        InputError: the document is not complete.
        UsageError: an effect in it is not known.
    """
    try:
        verdict: Verdict = document["verdict"]
        threshold = float(document["threshold"] or math.nan)
        tried = [(str(c["id"]), float(c["evidence"] or 0.0)) for c in document["candidates"]]
        named = [
            (
                str(e["id"]),
                {n: float(p["value"]) for n, p in e["parameters"].items() if p["value"] is not None},
                [str(t) for t in e["indistinguishable_from"]],
            )
            for e in document["effects"]
            if not e.get("empirical")
        ]
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{where}: is not a complete finding ({error})", "run 'discover' again") from None
    by_id = dict(tried)
    if verdict == "named" and named:
        found = {
            id_: Suspect(get(id_, known), _values(get(id_, known), values), by_id.get(id_, threshold))
            for id_, values, _ in named
        }
        first = max(named, key=lambda e: len(e[2]))
        twins = tuple(Suspect(get(t, known), (), found[first[0]].evidence) for t in first[2])
        others = tuple(s for id_, s in found.items() if id_ != first[0] and id_ not in first[2])
        kind: Kind = "apart" if twins else "sharpen"
        return Question(kind, (found[first[0]], *twins), others, threshold)
    leading = [(i, x) for i, x in tried if i in known and not _own(known[i])][:MOST]
    if not leading:
        raise InputError(f"{where}: names no candidate", "run 'granite-lab discover' with candidates")
    kind = "apart" if verdict == "unknown" and len(leading) > 1 else "show"
    return Question(kind, tuple(Suspect(get(i, known), (), x) for i, x in leading), (), threshold)


def _own(effect: Effect) -> bool:
    return any(p.per_trial for p in effect.parameters)


def _values(effect: Effect, found: Mapping[str, float]) -> tuple[float, ...]:
    return tuple(
        min(max(found.get(p.name, p.neutral), p.low), p.high) for p in effect.parameters
    )  # fmt: skip


def ids_of(suspects: Sequence[Suspect]) -> list[str]:
    """Return the names."""
    return [s.effect.id for s in suspects]
