"""The number of a weak effect does not hang on where the fit without it ended."""

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
def test_a_small_offset_of_the_centre_of_mass_is_measured_though_other_sand_imitates_most_of_it() -> None:
    """Without the effect φ, K and μ_s off their file leave hardly more than noise."""
    robot, soil = load_robot(), load_soil()
    true = 6.971e-4
    trials, _ = make_set(Wish("com_offset", 10232, sizes={"com_offset.forward": true}), robot, soil)
    finding = discover(trials, robot, soil, effects={"com_offset": get("com_offset")})
    assert [e.id for e in finding.effects] == ["com_offset"]
    forward = finding.effects[0].parameters[0].estimate
    assert forward.std < 0.1 * true
    assert abs(forward.value - true) < 3 * forward.std
