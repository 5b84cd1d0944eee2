"""A name is not given to a candidate that only mends the formula of one that was found."""

from __future__ import annotations

import pytest

from granite_lab.discovery import discover
from granite_lab.effects import get
from granite_lab.hidden.making import make_set
from granite_lab.hidden.wish import Wish
from granite_lab.parameters import load_robot, load_soil
from tests.soak import soak_only

CANDIDATES = ("sand_throw", "torque_constant_error", "payload_mass")


@pytest.mark.slow
@soak_only
def test_what_a_strong_effect_leaves_by_another_formula_gets_no_name_of_its_own() -> None:
    """The hidden trials throw sand by another formula; what is left looks like an error of the torque."""
    robot, soil = load_robot(), load_soil()
    trials, _ = make_set(Wish("sand_throw", 10161, sizes={"sand_throw.loss": 0.2}), robot, soil)
    finding = discover(trials, robot, soil, effects={id_: get(id_) for id_ in CANDIDATES})
    assert finding.verdict == "named"
    assert [e.id for e in finding.effects] == ["sand_throw"]
    (left,) = [c for c in finding.rounds[1] if c.id == "torque_constant_error"]
    assert left.status == "related"
    assert left.evidence > finding.threshold
    assert any("would explain a little of what is left" in note for note in finding.notes)
