"""Sand that gives before the tyre slides is found by a fit that began on the other branch of (10)."""

from __future__ import annotations

import numpy as np
import pytest

from granite_lab.discovery import discover
from granite_lab.effects import get
from granite_lab.hidden.making import make_set
from granite_lab.hidden.wish import Wish
from granite_lab.parameters import load_robot, load_soil


@pytest.mark.slow
def test_weak_sand_is_not_taken_for_a_centre_of_mass_off_its_file() -> None:
    """φ 19 % and μ_s 14 % lower than filed: the fit began where only friction on the tyre counts."""
    robot, soil = load_robot(), load_soil()
    trials, answer = make_set(Wish("none", 10503, sand_off=True), robot, soil)
    finding = discover(trials, robot, soil, effects={"com_offset": get("com_offset")})
    assert (finding.verdict, finding.effects) == ("none", ())
    found = finding.sand["friction_angle"].value
    assert np.exp(found) == pytest.approx(answer["sand_off"]["friction_angle"], rel=0.04)
