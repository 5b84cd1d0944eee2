"""Judging a discovery by the sealed answer."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from granite_lab.errors import InputError
from granite_lab.files import read_json
from granite_lab.hidden.catalogue import TWINS
from granite_lab.hidden.gaps import LEAST

MEANING = {
    "right": "exactly what is hidden",
    "twin_set": "the hidden effect is in the named set of twins",
    "with_remainder": "the hidden library effect is named, and that more is missing",
    "vague": "the hidden effect is in a set of more than three twins",
    "partial": "some of the hidden effects are named, and none is wrong",
    "spurious": "all hidden effects are named, and one too many",
    "near_twin": "a near twin of the hidden effect is named as if alone",
    "wrong_name": "another effect is named than the hidden one",
    "missed": "an effect is hidden, none was found",
    "false_alarm": "nothing is hidden, an effect was found",
    "abstained": "a gap was found, no effect was named",
    "idle": "no effect was named and nothing was closed, although much could be",
}

LARGEST_SET = 3
"""Most names in a set of twins that still counts as an answer."""

REMAINDER = 0.1
"""A discovery that is not *partly named* must state a remainder of at least this share of the gap; what
closes less is small."""

CEILING = 0.3
"""Share of the gap that any forces could close, from which on an answer that closes nothing is a miss."""

SCHEMA = "granite-lab/discovery/3"

VERDICTS = ("none", "named", "partly named", "unknown")


FILES = ("finding.json", "report.json")
"""Names under which `discover` and `study` write a discovery."""


@dataclass(frozen=True)
class ParameterScore:
    """One parameter of an effect that was named rightly.

    Attributes:
        effect, name, unit: which.
        kind: how the hidden number compares with the library's (see `Size`).
        true, value, std: what was hidden and what was found.
        z: (value - true) / std; None without a std.
        relative: value / true - 1; None where true is zero.
    """

    effect: str
    name: str
    unit: str
    kind: str
    true: float
    value: float
    std: float | None
    z: float | None
    relative: float | None


@dataclass(frozen=True)
class Names:
    """Effects counted one by one. A set of twins names one effect, which may be any of its members.

    Attributes:
        right: hidden effects that were named.
        missed: hidden effects of the library that were not, and count.
        absorbed: those of the library that do not count, named or not: a refit of sand and sensors leaves
            less than `LEAST` of the gap.
        wrong: named effects, by the first of each set, that are not hidden.
    """

    right: tuple[str, ...]
    missed: tuple[str, ...]
    absorbed: tuple[str, ...]
    wrong: tuple[str, ...]


@dataclass(frozen=True)
class Stated:
    """An effect of the library with the probability that was stated for it, as a name or as likely only.

    Attributes:
        id: in front of its set of twins.
        probability: that it, or a twin, acts.
        right: the set holds a hidden effect.
        named: it was named; else it stands in the description.
    """

    id: str
    probability: float
    right: bool
    named: bool


@dataclass(frozen=True)
class Score:
    """How a discovery fared.

    Attributes:
        outcome: see `MEANING`; right: counts as a right answer.
        verdict: of the discovery; named: the ids that it named first.
        hidden: ids that were hidden.
        set_size: names in the largest set that holds a hidden effect.
        parameters: of the effects named rightly.
        gap_closed: share of the gap that closed, for "train" and "held_out".
        names: of the hidden effects of the library and of those named: rightly named, missed, wrongly named.
        stated: effects that were named or described, those without a stated probability left out.
        closed_withheld: share of the gap that the saved model closes at a speed that no trial shows; None
            where no such motion is in the answer, or no model was saved.
    """

    outcome: str
    right: bool
    verdict: str
    named: tuple[str, ...]
    hidden: tuple[str, ...]
    set_size: int
    parameters: tuple[ParameterScore, ...]
    gap_closed: Mapping[str, float | None]
    names: Names
    stated: tuple[Stated, ...] = ()
    closed_withheld: float | None = None


def read_finding(place: Path) -> dict[str, Any]:
    """Return a discovery's JSON document: of a file, also of a study, or of the newest in a folder.

    Raises:
        InputError: the file cannot be read, or is none, or the study did not search.
    """
    path = place
    if place.is_dir():
        there = [place / name for name in FILES if (place / name).is_file()]
        if not there:
            raise InputError(
                f"{place}: holds no finding ('finding.json' is missing)",
                f"run 'granite-lab discover TRIALS… --out {place}' first",
            )
        path = max(there, key=lambda file: file.stat().st_mtime)
    document = read_json(path, "give the output of `discover --json`")
    if "discovery" in document:
        document = document["discovery"]
        if document is None:
            raise InputError(
                f"{path}: this study did not search for a missing effect",
                "run 'granite-lab study' without --no-discover, or 'granite-lab discover'",
            )
    if document.get("schema") != SCHEMA:
        raise InputError(f"{path}: not a discovery, expected schema '{SCHEMA}'", "see `discover --json`")
    if document.get("verdict") not in VERDICTS:
        raise InputError(f"{path}: verdict is {document.get('verdict')!r}, expected {', '.join(VERDICTS)}")
    try:
        for effect in document.get("effects", []):
            _set_of(effect)
    except (TypeError, KeyError, AttributeError):
        raise InputError(f"{path}: 'effects' is malformed, expected a list of objects with an id") from None
    return document


def score(
    answer: Mapping[str, Any], finding: Mapping[str, Any], closed_withheld: float | None = None
) -> Score:
    """Judge a discovery by a sealed answer.

    Args:
        answer: as `granite_lab.hidden.sealed` opens it.
        finding: as `discover --json` prints it, of which `verdict`, `effects`, `gap`, `closed`, `ceiling` and
            `remainder` count.
        closed_withheld: share of the gap that the saved model closes at the speed that was withheld.
    """
    effects = finding.get("effects", []) if finding["verdict"] in ("named", "partly named") else []
    hidden = tuple(effect["id"] for effect in answer["effects"])
    outside = {effect["id"] for effect in answer["effects"] if not effect["library"]}
    inside = tuple(name for name in hidden if name not in outside)
    places = matched(effects, inside)
    reopens = answer.get("reopens_after_refit", {})
    absorbed = tuple(name for name in inside if reopens.get(name, 1.0) < LEAST)
    names = Names(
        right=tuple(sorted(places)),
        missed=tuple(name for name in inside if name not in (*places, *absorbed)),
        absorbed=absorbed,
        wrong=tuple(str(e["id"]) for k, e in enumerate(effects) if k not in places.values()),
    )
    set_size = max((len(_set_of(effects[k])) for k in places.values()), default=0)
    by_head = all(effects[k]["id"] == name for name, k in places.items())
    outcome = _judge(finding["verdict"], names, set_size, by_head=by_head, something=bool(hidden))
    left = _number(finding.get("remainder"))
    if outside and outcome in ("right", "twin_set"):
        more = finding["verdict"] == "partly named" or (left is not None and left >= REMAINDER)
        outcome = "with_remainder" if more else "partial"
    if outcome == "abstained" and _idle(finding):
        outcome = "idle"
    right = outcome in ("right", "twin_set", "with_remainder") or (outcome == "abstained" and bool(outside))
    parameters = {effect["id"]: effect.get("parameters") or {} for effect in effects}
    closed = {part: _closed(finding.get("gap") or {}, part) for part in ("train", "held_out")}
    return Score(
        outcome=outcome,
        right=right,
        verdict=finding["verdict"],
        named=tuple(parameters),
        hidden=hidden,
        set_size=set_size,
        parameters=tuple(
            _parameter(effect["id"], name, true, parameters[effect["id"]][name])
            for effect in answer["effects"]
            for name, true in effect["parameters"].items()
            if effect["id"] in parameters and name in parameters[effect["id"]]
        ),
        gap_closed=closed if left is None else closed | {"held_out": 1 - left},
        names=names,
        stated=_stated(effects, (finding.get("description") or {}).get("terms") or [], inside),
        closed_withheld=closed_withheld,
    )


def matched(effects: Sequence[Mapping[str, Any]], hidden: Sequence[str]) -> dict[str, int]:
    """Return the place of the set that names each hidden effect; each set stands for one of them.

    The name in front of a set counts before the twins behind it.
    """
    heads = [str(effect["id"]) for effect in effects]
    free, places = list(range(len(effects))), {}
    for name in sorted(hidden, key=lambda n: n not in heads):
        holds = [k for k in free if heads[k] == name] or [k for k in free if name in _set_of(effects[k])]
        if holds:
            free.remove(holds[0])
            places[name] = holds[0]
    return places


def _stated(
    named: Sequence[Mapping[str, Any]], terms: Sequence[Mapping[str, Any]], hidden: Sequence[str]
) -> tuple[Stated, ...]:
    """Hold stated probabilities against what is hidden; a formula that is no effect states no cause."""
    effects = [*named, *(t for t in terms if not t.get("empirical"))]
    right = matched(effects, hidden).values()
    return tuple(
        Stated(str(e["id"]), p, k in right, k < len(named))
        for k, e in enumerate(effects)
        if (p := _number(e.get("probability"))) is not None
    )


def _idle(finding: Mapping[str, Any]) -> bool:
    """Tell whether a discovery closes nothing although it states that much could be closed."""
    ceiling = finding.get("ceiling")
    most = _number(ceiling.get("value") if isinstance(ceiling, Mapping) else ceiling)
    closed = (finding.get("closed") or {}).get("trials") or {}
    return most is not None and most >= CEILING and (_number(closed.get("value")) or 0.0) < REMAINDER


def _set_of(effect: Mapping[str, Any]) -> set[str]:
    return {str(effect["id"]), *map(str, effect.get("indistinguishable_from") or [])}


def _judge(verdict: str, names: Names, set_size: int, *, by_head: bool, something: bool) -> str:
    """Return the outcome by the hidden effects of the library.

    Args:
        verdict: of the discovery.
        names: rightly named, missed and wrongly named.
        set_size: names in the largest set that holds a hidden effect.
        by_head: each hidden effect stands in front of its set.
        something: is hidden, be it outside of the library.
    """
    if verdict == "none":
        return "missed" if something else "right"
    if not something:
        return "false_alarm"
    if verdict == "unknown" or not (names.right or names.wrong):
        return "abstained"
    if names.missed:
        pairs = [any(frozenset((head, name)) in TWINS for name in names.missed) for head in names.wrong]
        if len(pairs) == len(names.missed) and all(pairs):
            return "near_twin"
        return "partial" if names.right and not names.wrong else "wrong_name"
    if names.wrong:
        return "spurious" if names.right else "wrong_name"
    if set_size > LARGEST_SET:
        return "vague"
    return "right" if by_head else "twin_set"


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, (int, float)) and math.isfinite(value) else None


def _parameter(effect: str, name: str, true: Mapping[str, Any], stated: Mapping[str, Any]) -> ParameterScore:
    value, std, right = _number(stated.get("value")), _number(stated.get("std")), float(true["value"])
    off = math.nan if value is None else value - right
    return ParameterScore(
        effect, name, str(true["unit"]), str(true["kind"]), right,
        math.nan if value is None else value, std,
        off / std if value is not None and std else None,
        off / right if value is not None and right else None,
    )  # fmt: skip


def _closed(gap: Mapping[str, Any], part: str) -> float | None:
    """Return (before - after) / (before - 1) where there was a gap; 1 is what noise and tolerance explain."""
    before, after = (_number((gap.get(part) or {}).get(name)) for name in ("before", "after"))
    if before is None or after is None or before <= 1:
        return None
    return (before - after) / (before - 1)
