"""Which candidates a search looks at beside what it has found."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from granite_lab.discovery.candidates import Score
from granite_lab.discovery.search import Look, Model, left_open
from granite_lab.inference.fit import FORMULAS
from granite_lab.inference.normal import Scales


def look(**gains: float) -> tuple[Look, ...]:
    origin: Any = SimpleNamespace(posterior=SimpleNamespace(evidence=0.0))
    nothing: Any = None
    return (Look(origin, nothing, tuple(Score(name, gain, ()) for name, gain in gains.items())),)


def beside_play(formula: float) -> Model:
    fit: Any = SimpleNamespace(scales=Scales(0.0, formula))
    return Model(("play",), fit, 0.0)


LOOKS = {
    (): look(play=430.0, reaction=269.0, friction=157.0, drag=20.0),
    ("play",): look(reaction=380.0, friction=101.0, drag=5.0),
}


@pytest.mark.parametrize(
    ("candidate", "gain", "open_"),
    [
        ("reaction", 380.0, True),  # nothing of it is explained: the other effect of a pair
        ("friction", 101.0, False),  # a rival, in part explained away, that closes what the formula leaves
        ("drag", 5.0, True),  # never a rival
        ("empirical.force_slip", 400.0, False),
    ],
)
def test_beside_a_formula_at_its_limit_rivals_are_no_candidates(
    candidate: str, gain: float, open_: bool
) -> None:
    assert left_open(beside_play(FORMULAS[1]), LOOKS, ())(candidate, gain) is open_


def test_beside_a_model_that_leaves_nothing_only_what_differs_from_trial_to_trial_is_open() -> None:
    wanted = left_open(beside_play(0.5 * FORMULAS[1]), LOOKS, {"drag"})
    assert [c for c in LOOKS["play",][0].scores if wanted(c.candidate, c.gain)] == [
        LOOKS["play",][0].scores[2]
    ]
