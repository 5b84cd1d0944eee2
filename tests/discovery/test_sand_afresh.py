"""A fit whose sand ran after an effect that was missing finds back once the effect is known."""

from __future__ import annotations

import pytest

from granite_lab.discovery import discover
from granite_lab.effects import get
from granite_lab.hidden.making import make_set
from granite_lab.hidden.wish import Wish
from granite_lab.parameters import load_robot, load_soil
from tests.soak import soak_only


@pytest.mark.slow
@soak_only
def test_a_weak_effect_beside_another_gets_its_true_size() -> None:
    """Where the sand had gone for want of both, φ was 6 % and k_φ 12 % off and the offset halved."""
    robot, soil = load_robot(), load_soil()
    hidden = {"com_offset.forward": 0.0006968, "tyre_windup.compliance": 0.000114025}
    trials, _ = make_set(Wish("com_offset+tyre_windup", 10689, sizes=hidden), robot, soil)
    candidates = {id_: get(id_) for id_ in ("com_offset", "tyre_windup")}
    finding = discover(trials, robot, soil, effects=candidates)
    found = {e.id: e.parameters[0].estimate for e in finding.effects}
    assert found.keys() == candidates.keys()
    forward = found["com_offset"]
    assert forward.value == pytest.approx(0.0006968, abs=3 * forward.std)
    assert forward.std < 5e-5
